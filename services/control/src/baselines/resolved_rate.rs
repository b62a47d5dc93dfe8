//! Resolved-rate control with a robust inverse, and joint-space PD, as published; with the same model, limits, path and governor as our law.

use crate::centre::PoseMotion;
use crate::law::{LawError, Torques, Wanted};
use crate::linear::{angular, clamp_norm, linear, rotation_log, stack, symmetric_eigen};
use model::{Pose, Terms};
use nalgebra::{Matrix6, SMatrix, SVector, Vector3, Vector6};
use shared_types::scenario::Damping;

/// State and reference that the baselines share.
#[derive(Clone, Copy, Debug)]
pub struct Arm<'a, const N: usize> {
    /// Joint positions, rad.
    pub q: &'a SVector<f64, N>,
    /// Joint velocities, rad/s.
    pub qdot: &'a SVector<f64, N>,
    /// Kinematics and dynamics at this state.
    pub terms: &'a Terms<N>,
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
    /// Ticks classified as Type 1, less those as Type 2.
    pub votes: f64,
    /// Bit i: joint i is pushed downwards.
    pub reversed: u32,
    /// Positions held, or reference positions; rad.
    pub q: SVector<f64, N>,
}

impl<const N: usize> JointMemory<N> {
    /// A reference at `q`.
    #[must_use]
    pub fn at(q: SVector<f64, N>) -> Self {
        Self {
            holding: false,
            votes: 0.0,
            reversed: 0,
            q,
        }
    }
}

/// A generalised inverse that stays finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inverse {
    /// Damped least squares with the damping that grows as manipulability falls.
    Damped(Damping),
    /// Singular values (unit-scaled) below the floor dropped.
    Truncated {
        /// The least that is kept.
        floor: f64,
    },
}

impl Inverse {
    /// J^# of unit-scaled rows: Σ v_k uᵀ_k·f(σ_k).
    ///
    /// Damped: f = σ/(σ² + λ²), λ² = λ_max²(1 − w/w₀)² where w = √det JJᵀ < w₀ [Nakamura & Hanafusa 1986]. Truncated: f = 1/σ above the floor,
    /// else 0. From the eigenvectors of JJᵀ, 6×6, by Jacobi's method with a fixed number of sweeps.
    pub(super) fn of<const N: usize>(self, J: &SMatrix<f64, 6, N>) -> SMatrix<f64, N, 6> {
        let (values, U) = symmetric_eigen(&(J * J.transpose()));
        let largest = values.max();
        let real = |value: f64| value > 1e-20 * largest.max(1e-30);
        let gain = match self {
            Self::Damped(Damping { onset, largest }) => {
                let w = values
                    .iter()
                    .filter(|v| real(**v) && **v > 0.0)
                    .map(|v| v.sqrt())
                    .product::<f64>();
                let lambda = largest * (1.0 - w / onset).max(0.0);
                values.map(|value| {
                    if real(value) {
                        1.0 / (value + lambda * lambda)
                    } else {
                        0.0
                    }
                })
            }
            Self::Truncated { floor } => values.map(|value| {
                if value > floor * floor {
                    1.0 / value
                } else {
                    0.0
                }
            }),
        };
        J.transpose() * (U * Matrix6::from_diagonal(&gain) * U.transpose())
    }
}

/// The task's rows of a 6×N Jacobian or twist, linear ones divided by the arm's length; the other rows zero.
pub(super) fn scale<const C: usize>(
    rows: &SMatrix<f64, 6, C>,
    task: &[bool; 6],
    length_m: f64,
) -> SMatrix<f64, 6, C> {
    let mut out = *rows;
    for (k, mut row) in out.row_iter_mut().enumerate() {
        row *= if !task[k] {
            0.0
        } else {
            [1.0 / length_m, 1.0][k / 3]
        };
    }
    out
}

/// A pose error bounded for feedback: 50 mm, 0.25 rad, as for our own law.
pub(super) fn bounded(error: &Vector6<f64>) -> Vector6<f64> {
    stack(
        &clamp_norm(linear(error), 0.05),
        &clamp_norm(angular(error), 0.25),
    )
}

/// Resolved-rate control with a robust inverse: q̇_r = J^#(V_d + (k_p/k_v)e), q̈ = k_v(q̇_r − q̇) + J^#(a_d + (k_p/k_v)(V_d − V) − J̇q̇).
///
/// The velocity level keeps joint motions outside the range of J^# from drifting.
///
/// # Errors
/// None: kept in the signature of every law.
pub fn resolved<const N: usize>(
    arm: &Arm<'_, N>,
    wanted: &Wanted<'_, N>,
    inverse: Inverse,
) -> Result<Torques<N>, LawError> {
    let scaled = |x: &Vector6<f64>| scale(x, &wanted.task, arm.length_m);
    let sharp = inverse.of(&scale(&wanted.at.J, &wanted.task, arm.length_m));
    let k = arm.k_p / arm.k_v;
    let error = bounded(arm.error);
    let rate = sharp * scaled(&(arm.desired.V + error * k));
    let V = wanted.at.J * arm.qdot;
    let feed = sharp * scaled(&(arm.desired.a + (arm.desired.V - V) * k - wanted.at.Jdot_qdot));
    let qddot = (rate - arm.qdot) * arm.k_v + feed;
    let along = wanted.A * (sharp * scaled(&wanted.a_path));
    Ok(Torques {
        path: along,
        rest: wanted.A * qddot - along,
        null: SVector::zeros(),
        qdot_nominal: sharp * scaled(&wanted.V),
        qddot_path: sharp * scaled(&(wanted.a_feed - wanted.at.Jdot_qdot)),
    })
}

/// Joint-space PD on inverse kinematics: q_d follows the path by a robust inverse, the joints follow q_d.
///
/// `at(q)` gives pose and Jacobian of E at another posture, and C in E's axes.
///
/// # Errors
/// None: kept in the signature of every law.
pub fn joint_pd<const N: usize>(
    arm: &Arm<'_, N>,
    wanted: &Wanted<'_, N>,
    memory: &mut JointMemory<N>,
    inverse: Inverse,
    dt: f64,
    at: impl Fn(&SVector<f64, N>) -> (Pose, SMatrix<f64, 6, N>),
) -> Result<Torques<N>, LawError> {
    let (X, mut J) = at(&memory.q);
    let r = X.R * wanted.p_EC;
    for mut column in J.column_iter_mut() {
        let v = Vector3::new(column[3], column[4], column[5]).cross(&r);
        (0..3).for_each(|k| column[k] += v[k]);
    }
    let error = stack(
        &(arm.desired.p - X.p - r),
        &rotation_log(&(arm.desired.R * X.R.transpose())),
    );
    let sharp = inverse.of(&scale(&J, &wanted.task, arm.length_m));
    let rate = sharp
        * scale(
            &(arm.desired.V + error * arm.k_v),
            &wanted.task,
            arm.length_m,
        );
    let feed = sharp
        * scale(
            &(wanted.a_feed - wanted.at.Jdot_qdot),
            &wanted.task,
            arm.length_m,
        );
    let qddot = (memory.q - arm.q) * arm.k_p + (rate - arm.qdot) * arm.k_v + feed;
    memory.q += rate * dt;
    let qdot_nominal = sharp * scale(&wanted.V, &wanted.task, arm.length_m);
    Ok(Torques {
        path: SVector::zeros(),
        rest: wanted.A * qddot,
        null: SVector::zeros(),
        qdot_nominal,
        qddot_path: feed,
    })
}
