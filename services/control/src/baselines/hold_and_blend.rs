//! Hold and blend: the singularity handler of Stanford's SAI, from its published description, in code of our own.
//!
//! The singular values of J at the end-effector, metres and radians mixed, split the task: directions whose value is less than a share of the
//! largest are singular, the rest is controlled with its own Λ. The singular part's torque is blended by one α with a joint strategy that acts along
//! the right singular vectors, within the null space of the regular part. A jump of five radians along the null motion decides the type, a vote of
//! the last ticks which strategy acts: Type 1 holds the joints where they were at entry; Type 2 pushes open loop, the harder the more the force
//! asked for points along the singular direction. Λ is split without its cross terms: that is where its torque jumps come from.
//!
//! Beyond the description, in its favour: J̇q̇, gravity and Coriolis are compensated, the error is bounded, and the path has our governor.

use super::Arm;
use super::resolved_rate::{Inverse, JointMemory};
use crate::law::Torques;
use crate::limits::Parts;
use crate::linear::{Jacobian, Joints, Vector6, rotation_log, sign, stack, symmetric_eigen};
use crate::reference::error::bounded;
use crate::types::Refusal;
use model::{Model, Pose, TaskAxes, unit_scaled};
use nalgebra::{Cholesky, Const, SMatrix, SVector};
use shared_types::scenario::Damping;

/// Step along the null motion by which a singularity is classified, rad.
const JUMP: f64 = 5.0;
/// Motion along the singular direction, m and rad mixed, from which on it is Type 1.
const MOVED: f64 = 0.5;
/// How many ticks vote on the type.
const VOTERS: f64 = 200.0;
/// Distance from a joint limit at which the open-loop torque turns round, rad.
const TURN_ROUND: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// Columns in the order of the singular values, largest first.
fn sorted<const M: usize>(S: &SMatrix<f64, M, M>) -> (SVector<f64, M>, SMatrix<f64, M, M>) {
    let (values, vectors) = symmetric_eigen(S);
    let mut order: [usize; M] = std::array::from_fn(|i| i);
    order.sort_unstable_by(|a, b| values[*b].total_cmp(&values[*a]));
    (
        Joints::from_fn(|i, _| values[order[i]]),
        SMatrix::from_fn(|i, j| vectors[(i, order[j])]),
    )
}

/// Λ and J̄ of those rows of J that are used: the others are zero, and one on the diagonal keeps a single size for every rank.
fn operational<const N: usize>(
    A: &Cholesky<f64, Const<N>>,
    J: &Jacobian<N>,
    used: impl Fn(usize) -> bool,
) -> Option<(SMatrix<f64, 6, 6>, SMatrix<f64, N, 6>)> {
    let Ainv_Jt = A.solve(&J.transpose());
    let mut inverse = J * Ainv_Jt;
    (0..6)
        .filter(|i| !used(*i))
        .for_each(|i| inverse[(i, i)] = 1.0);
    let Lambda = Cholesky::new(inverse)?.inverse();
    Some((Lambda, Ainv_Jt * Lambda))
}

/// The directions of the task by their singular values, largest first.
struct Split<const N: usize> {
    J: Jacobian<N>,
    values: Vector6,
    U: SMatrix<f64, 6, 6>,
    V: SMatrix<f64, N, N>,
    /// How many are regular, and how many there are.
    regular: usize,
    axes: usize,
}

impl<const N: usize> Split<N> {
    /// Those whose value is less than the share `bound` of the largest are singular.
    fn new(J: Jacobian<N>, axes: usize, bound: f64) -> Self {
        let (values, U) = sorted(&(J * J.transpose()));
        let (_, V) = sorted(&(J.transpose() * J));
        let mut split = Self {
            J,
            values,
            U,
            V,
            regular: axes,
            axes,
        };
        let is_singular = |k: &usize| split.ratio(*k) < bound;
        split.regular = (1..axes).find(is_singular).unwrap_or(axes);
        split
    }

    fn ratio(&self, k: usize) -> f64 {
        (self.values[k].max(0.0) / self.values[0].max(1e-30)).sqrt()
    }

    fn is_regular(&self, i: usize) -> bool {
        i < self.regular
    }

    fn is_singular(&self, i: usize) -> bool {
        (self.regular..self.axes).contains(&i)
    }

    /// The directions that are used, as rows.
    fn rows(&self, used: impl Fn(usize) -> bool) -> SMatrix<f64, 6, 6> {
        SMatrix::from_fn(|i, j| if used(i) { self.U[(j, i)] } else { 0.0 })
    }
}

/// Torques by hold-and-blend.
///
/// Γ = J_nsᵀΛ_ns U_nsᵀ(a − J̇q̇) + α·J_sᵀΛ_s U_sᵀ(a − J̇q̇) + (1 − α)·Γ_joint, α = the place of σ_s/σ_1 between the two bounds of `blend`.
///
/// # Errors
/// [`Refusal::Singular`] if the regular part is rank deficient.
pub(crate) fn torques<const N: usize>(
    arm: &Arm<'_, N>,
    memory: &mut JointMemory<N>,
) -> Result<Torques<N>, Refusal> {
    let Arm {
        setup, now, motion, ..
    } = *arm;
    let (terms, task) = (now.terms, &setup.task);
    let [low, high] = setup.scenario.control.baseline.hold_and_blend.blend;
    let axes = TaskAxes(*task).count().min(N);
    let split = Split::new(unit_scaled(&terms.J, 1.0, task), axes, high);
    let relative = relative(arm);
    let A = Cholesky::new(terms.A).ok_or(Refusal::Singular)?;
    let T_ns = split.rows(|i| split.is_regular(i));
    let J_ns = T_ns * split.J;
    let (Lambda_ns, Jbar_ns) =
        operational(&A, &J_ns, |i| split.is_regular(i)).ok_or(Refusal::Singular)?;
    let mut rest = J_ns.transpose() * (Lambda_ns * (T_ns * relative));
    let mut null = Joints::zeros();
    if split.regular == axes {
        (memory.holding, memory.votes) = (false, 0.0);
    } else {
        let alpha = ((split.ratio(split.regular) - low) / (high - low)).clamp(0.0, 1.0);
        vote(arm, &split, memory);
        let free = SMatrix::<f64, N, N>::identity() - Jbar_ns * J_ns;
        null = joint_strategy(arm, &split, memory, &A, &free, &relative) * (1.0 - alpha);
        // At the lock itself Λ_s has no bound, and α is zero.
        let T_s = split.rows(|i| split.is_singular(i));
        let J_s = T_s * split.J;
        if alpha > 0.0
            && let Some((Lambda_s, _)) = operational(&A, &J_s, |i| split.is_singular(i))
        {
            let torque = J_s.transpose() * (Lambda_s * (T_s * relative));
            let effort = setup.model.effort();
            rest += Joints::from_fn(|i, _| torque[i].clamp(-effort[i], effort[i])) * alpha;
        }
    }
    let sharp = Inverse::Damped(Damping {
        onset: 0.08,
        largest: 0.06,
    })
    .of(&unit_scaled(&now.at.J, setup.length_m, task));
    let scaled = |x: &Vector6| unit_scaled(x, setup.length_m, task);
    Ok(Torques {
        parts: Parts {
            path: Joints::zeros(),
            rest,
            null,
        },
        qdot_nominal: sharp * scaled(&motion.V_nominal),
        qddot_path: sharp * scaled(&(motion.a_feed - now.at.Jdot_qdot)),
    })
}

/// The pose error from the end-effector to a pose, `[p − p_E; log(R R_Eᵀ)]`.
fn error_to(X_BE: &Pose, X: &Pose) -> Vector6 {
    stack(&(X.p - X_BE.p), &rotation_log(&(X.R * X_BE.R.transpose())))
}

/// a − J̇q̇ on the task's axes.
fn relative<const N: usize>(arm: &Arm<'_, N>) -> Vector6 {
    let (setup, now, control) = (arm.setup, arm.now, &arm.setup.scenario.control);
    let terms = now.terms;
    let desired = arm.motion.desired.at(&-now.p_EC);
    let error = error_to(&terms.X_BE, &desired.pose());
    let a =
        desired.a + (desired.V - terms.J * now.qdot) * control.k_v + bounded(&error) * control.k_p;
    unit_scaled(&(a - terms.Jdot_qdot), 1.0, &setup.task)
}

/// Votes on the type of the singularity; the joints are held where they were at entry, or when the votes for Type 2 were last more.
fn vote<const N: usize>(arm: &Arm<'_, N>, split: &Split<N>, memory: &mut JointMemory<N>) {
    let (model, now) = (&arm.setup.model, arm.now);
    if !memory.holding || memory.votes < 0.0 {
        (memory.holding, memory.q) = (true, *now.q);
    }
    let is_type_1 = (split.regular..split.axes).any(|k| {
        let there = model.forward_kinematics(&(now.q + split.V.column(k) * JUMP));
        let moved = error_to(&now.terms.X_BE, &there);
        moved.dot(&split.U.column(k)).abs() > MOVED
    });
    memory.votes = (memory.votes + sign(is_type_1)).clamp(-VOTERS, VOTERS);
}

/// The joint strategy, along the right singular vectors and in the regular part's null space, `free`; nothing where that has no room.
fn joint_strategy<const N: usize>(
    arm: &Arm<'_, N>,
    split: &Split<N>,
    memory: &mut JointMemory<N>,
    A: &Cholesky<f64, Const<N>>,
    free: &SMatrix<f64, N, N>,
    relative: &Vector6,
) -> Joints<N> {
    let (model, now) = (&arm.setup.model, arm.now);
    let tuned = &arm.setup.scenario.control.baseline.hold_and_blend;
    let V_t = Jacobian::<N>::from_fn(|i, j| match split.is_singular(i) {
        true => split.V[(j, i)],
        false => 0.0,
    });
    let J_joint = V_t * free;
    let Some((Lambda_joint, _)) = operational(A, &J_joint, |i| split.is_singular(i)) else {
        return Joints::zeros();
    };
    let wanted = if memory.votes > 0.0 {
        let hold = (memory.q - now.q) * tuned.hold_k_p - now.qdot * tuned.hold_k_v;
        Lambda_joint * (V_t * hold)
    } else {
        let asked = relative.dot(&split.U.column(split.regular)).abs() / relative.norm().max(1e-12);
        let push = Joints::from_fn(|i, _| push(memory, now.q, model, i) * tuned.push * asked);
        V_t * push - Lambda_joint * (V_t * now.qdot) * tuned.push_k_v
    };
    J_joint.transpose() * wanted
}

/// Torque limit of joint `i` with the sign of the open-loop torque, which turns round near a joint limit and stays so.
fn push<const N: usize>(
    memory: &mut JointMemory<N>,
    q: &Joints<N>,
    model: &Model<N>,
    i: usize,
) -> f64 {
    if model.upper()[i] - q[i] < TURN_ROUND {
        memory.reversed |= 1 << i;
    } else if q[i] - model.lower()[i] < TURN_ROUND {
        memory.reversed &= !(1 << i);
    }
    let limit = if model.effort()[i].is_finite() {
        model.effort()[i]
    } else {
        1.0
    };
    if memory.reversed >> i & 1 == 1 {
        -limit
    } else {
        limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::puma;
    use shared_types::random::Uniform;

    // Measured of the original: 65 % of the joint space (at its tool).
    #[test]
    fn most_postures_count_as_nearly_singular() {
        let mut random = Uniform(1);
        let near = (0..4000).filter(|_| {
            let q =
                Joints::<6>::from_fn(|i, _| random.within(puma().lower()[i], puma().upper()[i]));
            let J = puma().evaluate(&q, &Joints::zeros()).J;
            let (values, _) = sorted(&(J * J.transpose()));
            values[5].max(0.0).sqrt() < 0.06 * values[0].sqrt()
        });
        let share = near.count() as f64 / 4000.0;
        println!("{share}");
        assert!((0.55..0.75).contains(&share), "{share}");
    }
}
