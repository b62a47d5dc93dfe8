//! Resolved-rate control with a robust inverse, and joint-space PD, as published; with the same model, limits, path and governor as our law.

use super::Arm;
use crate::law::Torques;
use crate::limits::Parts;
use crate::linear::{Jacobian, Joints, Vector6, displaced, rotation_log, stack, symmetric_eigen};
use crate::reference::error::bounded;
use crate::types::Refusal;
use model::unit_scaled;
use nalgebra::{Matrix6, SMatrix};
use shared_types::scenario::{Control, Damping};

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
    pub q: Joints<N>,
}

impl<const N: usize> JointMemory<N> {
    /// A reference at `q`.
    pub fn at(q: Joints<N>) -> Self {
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
    /// Singular values (unit-scaled) below this floor dropped.
    Truncated(f64),
}

impl Inverse {
    /// J^# of unit-scaled rows: Σ v_k uᵀ_k·f(σ_k).
    ///
    /// Damped: f = σ/(σ² + λ²), λ² = λ_max²(1 − w/w₀)² where w = √det JJᵀ < w₀ [Nakamura & Hanafusa 1986]. Truncated: f = 1/σ above the floor,
    /// else 0. From the eigenvectors of JJᵀ, 6×6, by Jacobi's method with a fixed number of sweeps.
    pub(super) fn of<const N: usize>(self, J: &Jacobian<N>) -> SMatrix<f64, N, 6> {
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
            Self::Truncated(floor) => values.map(|value| {
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

/// Resolved-rate control with a robust inverse: q̇_r = J^#(V_d + (k_p/k_v)e), q̈ = k_v(q̇_r − q̇) + J^#(a_d + (k_p/k_v)(V_d − V) − J̇q̇).
///
/// The velocity level keeps joint motions outside the range of J^# from drifting.
///
/// # Errors
/// None: kept in the signature of every law.
pub(crate) fn resolved<const N: usize>(
    arm: &Arm<'_, N>,
    inverse: Inverse,
) -> Result<Torques<N>, Refusal> {
    let Arm {
        setup,
        now,
        motion,
        problem,
    } = *arm;
    let Control { k_p, k_v, .. } = setup.scenario.control;
    let scaled = |x: &Vector6| unit_scaled(x, setup.length_m, &setup.task);
    let sharp = inverse.of(&unit_scaled(&now.at.J, setup.length_m, &setup.task));
    let (k, desired) = (k_p / k_v, &motion.desired);
    let rate = sharp * scaled(&(desired.V + bounded(&motion.error) * k));
    let V = now.at.J * now.qdot;
    let feed = sharp * scaled(&(desired.a + (desired.V - V) * k - now.at.Jdot_qdot));
    let qddot = (rate - now.qdot) * k_v + feed;
    let path = problem.A * (sharp * scaled(&problem.a_path));
    Ok(Torques {
        parts: Parts {
            path,
            rest: problem.A * qddot - path,
            null: Joints::zeros(),
        },
        qdot_nominal: sharp * scaled(&motion.V_nominal),
        qddot_path: sharp * scaled(&(motion.a_feed - now.at.Jdot_qdot)),
    })
}

/// Joint-space PD on inverse kinematics: q_d follows the path by a robust inverse, the joints follow q_d.
///
/// # Errors
/// None: kept in the signature of every law.
pub(crate) fn joint_pd<const N: usize>(
    arm: &Arm<'_, N>,
    memory: &mut JointMemory<N>,
) -> Result<Torques<N>, Refusal> {
    let Arm {
        setup, now, motion, ..
    } = *arm;
    let Control { k_p, k_v, .. } = setup.scenario.control;
    let X = setup.model.forward_kinematics(&memory.q);
    let r = X.R * now.p_EC;
    let J = displaced(setup.model.jacobian(&memory.q), &r);
    let desired = &motion.desired;
    let error = stack(
        &(desired.p - X.p - r),
        &rotation_log(&(desired.R * X.R.transpose())),
    );
    let scaled = |x: &Vector6| unit_scaled(x, setup.length_m, &setup.task);
    let inverse = Inverse::Damped(setup.scenario.control.baseline.joint_pd);
    let sharp = inverse.of(&unit_scaled(&J, setup.length_m, &setup.task));
    let rate = sharp * scaled(&(desired.V + error * k_v));
    let feed = sharp * scaled(&(motion.a_feed - now.at.Jdot_qdot));
    let qddot = (memory.q - now.q) * k_p + (rate - now.qdot) * k_v + feed;
    memory.q += rate * setup.scenario.dt_s();
    Ok(Torques {
        parts: Parts {
            rest: now.terms.A * qddot,
            ..Parts::zero()
        },
        qdot_nominal: sharp * scaled(&motion.V_nominal),
        qddot_path: feed,
    })
}
