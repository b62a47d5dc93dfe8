//! What others do at a singularity, each as published: honest opponents, with the same model, limits, path and governor.

use super::{LawError, Torques, Wanted, kept_rows};
use crate::centre::PoseMotion;
use crate::linear::{angular, linear, rotation_log, stack, symmetric_eigen};
use model::Pose;
use nalgebra::{Matrix6, SMatrix, SVector, Vector3, Vector6};

/// State and reference that the baselines share.
#[derive(Clone, Copy, Debug)]
pub struct Arm<'a, const N: usize> {
    /// Joint positions, rad.
    pub q: &'a SVector<f64, N>,
    /// Joint velocities, rad/s.
    pub qdot: &'a SVector<f64, N>,
    /// Desired motion of C.
    pub desired: &'a PoseMotion,
    /// Pose error at C.
    pub error: &'a Vector6<f64>,
    /// Stiffness, 1/s².
    pub k_p: f64,
    /// Damping, 1/s.
    pub k_v: f64,
    /// The length that makes metres and radians comparable, m.
    pub length_m: f64,
}

/// Joint positions that a law remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointMemory<const N: usize> {
    /// Whether `q` is being held.
    pub holding: bool,
    /// Positions held, or reference positions; rad.
    pub q: SVector<f64, N>,
}

impl<const N: usize> JointMemory<N> {
    /// A reference at `q`.
    #[must_use]
    pub fn at(q: SVector<f64, N>) -> Self {
        Self { holding: false, q }
    }
}

/// A generalised inverse that stays finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inverse {
    /// Damped least squares with the damping that grows as manipulability falls.
    Damped,
    /// Singular values below a threshold dropped.
    Truncated,
}

/// Manipulability (unit-scaled) below which the damping begins.
const W_0: f64 = 0.08;
/// Largest damping.
const LAMBDA_MAX: f64 = 0.06;
/// Singular value (unit-scaled) below which a direction is dropped.
const SIGMA_MIN: f64 = 0.06;

impl Inverse {
    /// J^# of unit-scaled rows: Σ v_k uᵀ_k·f(σ_k).
    ///
    /// Damped: f = σ/(σ² + λ²), λ² = λ_max²(1 − w/w₀)² where w = √det JJᵀ < w₀ [Nakamura & Hanafusa 1986]. Truncated: f = 1/σ above a threshold,
    /// else 0. From the eigenvectors of JJᵀ, 6×6, by Jacobi's method with a fixed number of sweeps.
    fn of<const N: usize>(self, J: &SMatrix<f64, 6, N>) -> SMatrix<f64, N, 6> {
        let (values, U) = symmetric_eigen(&(J * J.transpose()));
        let largest = values.max();
        let real = |value: f64| value > 1e-20 * largest.max(1e-30);
        let w = values.iter().filter(|v| real(**v) && **v > 0.0).map(|v| v.sqrt()).product::<f64>();
        let short = (1.0 - w / W_0).max(0.0);
        let lambda2 = LAMBDA_MAX * LAMBDA_MAX * short * short;
        let gain = values.map(|value| match self {
            Self::Damped if real(value) => 1.0 / (value + lambda2),
            Self::Truncated if value > SIGMA_MIN * SIGMA_MIN => 1.0 / value,
            _ => 0.0,
        });
        J.transpose() * (U * Matrix6::from_diagonal(&gain) * U.transpose())
    }
}

/// The task's rows of a 6×N Jacobian or twist, linear ones divided by the arm's length; the other rows zero.
fn scale<const C: usize>(rows: &SMatrix<f64, 6, C>, task: &[bool; 6], length_m: f64) -> SMatrix<f64, 6, C> {
    let mut out = *rows;
    for (k, mut row) in out.row_iter_mut().enumerate() {
        row *= if !task[k] { 0.0 } else { [1.0 / length_m, 1.0][k / 3] };
    }
    out
}

/// Resolved-rate control with a robust inverse: q̇_r = J^#(V_d + (k_p/k_v)e), q̈ = k_v(q̇_r − q̇) + J^#(a_d + (k_p/k_v)(V_d − V) − J̇q̇).
///
/// The velocity level keeps joint motions that J^# does not see from drifting.
///
/// # Errors
/// None: kept in the signature of every law.
pub fn resolved<const N: usize>(arm: &Arm<'_, N>, wanted: &Wanted<'_, N>, inverse: Inverse) -> Result<Torques<N>, LawError> {
    let scaled = |x: &Vector6<f64>| scale(x, &wanted.task, arm.length_m);
    let sharp = inverse.of(&scale(&wanted.at.J, &wanted.task, arm.length_m));
    let k = arm.k_p / arm.k_v;
    let error = stack(&crate::linear::clamp_norm(linear(arm.error), 0.05), &crate::linear::clamp_norm(angular(arm.error), 0.25));
    let rate = sharp * scaled(&(arm.desired.V + error * k));
    let V = wanted.at.J * arm.qdot;
    let feed = sharp * scaled(&(arm.desired.a + (arm.desired.V - V) * k - wanted.at.Jdot_qdot));
    let qddot = (rate - arm.qdot) * arm.k_v + feed;
    let along = wanted.A * (sharp * scaled(&wanted.a_path));
    Ok(Torques {
        path: along,
        across: wanted.A * qddot - along,
        null: SVector::zeros(),
        qdot_nominal: sharp * scaled(&wanted.V),
        qddot_path: sharp * scaled(&(wanted.a_feed - wanted.at.Jdot_qdot)),
    })
}

/// Joint-space PD on inverse kinematics: q_d follows the path by damped least squares, the joints follow q_d.
///
/// `at(q)` gives pose and Jacobian of E at another posture, and C in E's axes.
///
/// # Errors
/// None: kept in the signature of every law.
pub fn joint_pd<const N: usize>(
    arm: &Arm<'_, N>,
    wanted: &Wanted<'_, N>,
    memory: &mut JointMemory<N>,
    dt: f64,
    at: impl Fn(&SVector<f64, N>) -> (Pose, SMatrix<f64, 6, N>),
) -> Result<Torques<N>, LawError> {
    let (X, mut J) = at(&memory.q);
    let r = X.R * wanted.p_EC;
    for mut column in J.column_iter_mut() {
        let v = Vector3::new(column[3], column[4], column[5]).cross(&r);
        (0..3).for_each(|k| column[k] += v[k]);
    }
    let error = stack(&(arm.desired.p - X.p - r), &rotation_log(&(arm.desired.R * X.R.transpose())));
    let sharp = Inverse::Damped.of(&scale(&J, &wanted.task, arm.length_m));
    let rate = sharp * scale(&(arm.desired.V + error * arm.k_v), &wanted.task, arm.length_m);
    let feed = sharp * scale(&(wanted.a_feed - wanted.at.Jdot_qdot), &wanted.task, arm.length_m);
    let qddot = (memory.q - arm.q) * arm.k_p + (rate - arm.qdot) * arm.k_v + feed;
    memory.q += rate * dt;
    let qdot_nominal = sharp * scale(&wanted.V, &wanted.task, arm.length_m);
    Ok(Torques { path: SVector::zeros(), across: wanted.A * qddot, null: SVector::zeros(), qdot_nominal, qddot_path: feed })
}

/// Singular values over the largest between which the blend runs: below the first fully singular, above the second regular.
const BLEND: [f64; 2] = [0.003, 0.03];
/// Open-loop torque of the Type 2 strategy, as a share of the limit.
const OPEN_LOOP: f64 = 0.01;

/// Hold and blend, after the published description of Stanford's singularity handler.
///
/// The singular values of J, metres and radians mixed, split the task into a regular part, controlled with its own Λ, and a singular part. One α, the
/// smallest ratio's place between two bounds, blends the singular part's torque with a joint strategy in the regular part's null space: Type 1
/// holds the joints where they were at entry (with damping); where the singular part is a rotation an open-loop torque of a fixed size pushes
/// joints the way the singular force asks. Λ is split without its cross terms, which is where its torque jumps come from.
///
/// # Errors
/// [`LawError`] if the regular part is rank deficient.
pub fn hold_and_blend<const N: usize>(
    arm: &Arm<'_, N>,
    wanted: &Wanted<'_, N>,
    memory: &mut JointMemory<N>,
    limits: &SVector<f64, N>,
) -> Result<Torques<N>, LawError> {
    let J = scale(&wanted.at.J, &wanted.task, 1.0);
    let (values, U) = symmetric_eigen(&(J * J.transpose()));
    let axes = kept_rows::<N>(&wanted.task, &[])?.len();
    let mut order: [usize; 6] = std::array::from_fn(|i| i);
    order.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
    let largest = values[order[0]].max(0.0).sqrt();
    let ratio = |k: usize| values[order[k]].max(0.0).sqrt() / largest.max(1e-12);
    let regular = (0..axes).filter(|k| ratio(*k) >= BLEND[1]).count();
    let alpha = ((ratio(axes - 1) - BLEND[0]) / (BLEND[1] - BLEND[0])).clamp(0.0, 1.0);

    let A_inv = nalgebra::Cholesky::new(*wanted.A).ok_or(crate::operational::OperationalError::MassMatrix)?;
    let relative = wanted.a - wanted.at.Jdot_qdot;
    // Dropped directions keep a one on the diagonal and zero rows, so one size serves every rank.
    let part = |used: &dyn Fn(usize) -> bool| {
        let T = Matrix6::from_fn(|i, j| if i < axes && used(i) { U[(j, order[i])] } else { 0.0 });
        let J = T * J;
        let Ainv_Jt = A_inv.solve(&J.transpose());
        let mut inverse = J * Ainv_Jt;
        for i in 0..6 {
            if i >= axes || !used(i) {
                inverse[(i, i)] = 1.0;
            }
        }
        let Lambda = nalgebra::Cholesky::new(inverse).ok_or(crate::operational::OperationalError::RankDeficient { rows: axes })?.inverse();
        Ok::<_, LawError>((J, Lambda * (T * relative), Ainv_Jt * Lambda))
    };
    let (J_ns, F_ns, Jbar_ns) = part(&|i| i < regular)?;
    let mut torque = J_ns.transpose() * F_ns;
    let mut null = SVector::zeros();
    if regular < axes {
        if !memory.holding {
            *memory = JointMemory { holding: true, q: *arm.q };
        }
        // Floored: the pure singular part has an unbounded Λ at the lock itself, where α is zero.
        let singular_force = if alpha > 0.0 { part(&|i| i >= regular)? } else { (SMatrix::zeros(), Vector6::zeros(), SMatrix::zeros()) };
        let (J_s, F_s, _) = singular_force;
        let u = U.column(order[axes - 1]).into_owned();
        let rotational = angular(&u).norm() > 0.5;
        let asked = J.transpose() * (u * u.dot(&relative));
        let joint = if rotational {
            SVector::from_fn(|i, _| {
                let limit = if limits[i].is_finite() { limits[i] } else { 1.0 };
                OPEN_LOOP * limit * if asked[i] == 0.0 { 0.0 } else { asked[i].signum() }
            }) - wanted.A * arm.qdot * arm.k_v
        } else {
            wanted.A * ((memory.q - arm.q) * arm.k_p - arm.qdot * arm.k_v)
        };
        let projected = joint - J_ns.transpose() * (Jbar_ns.transpose() * joint);
        torque += J_s.transpose() * F_s * alpha;
        null = projected * (1.0 - alpha);
    } else {
        memory.holding = false;
    }
    let sharp = Inverse::Damped.of(&scale(&wanted.at.J, &wanted.task, arm.length_m));
    let scaled = |x: &Vector6<f64>| scale(x, &wanted.task, arm.length_m);
    Ok(Torques {
        path: SVector::zeros(),
        across: torque,
        null,
        qdot_nominal: sharp * scaled(&wanted.V),
        qddot_path: sharp * scaled(&(wanted.a_feed - wanted.at.Jdot_qdot)),
    })
}
