//! The laws of others, each as published, with the same model, limits, path and governor.

use crate::controller::Setup;
use crate::law::{self, Problem, Torques};
use crate::limits::Parts;
use crate::linear::{Jacobian, Joints, Vector6, symmetric_eigen};
use crate::paper::operational_space::{Cholesky, null_torque};
use crate::reference::error::bounded;
use crate::tick::{Motion, Now};
use crate::types::Refusal;
use model::unit_scaled;
use nalgebra::{Matrix6, SMatrix};
use shared_types::scenario::{Control, Damping};

/// Operational-space control with Γ₀ projected by 1 − Jᵀ(J⁺)ᵀ in place of 1 − JᵀJ̄ᵀ: right only for an arm at rest without mass, as the paper's Figure 1
/// shows. With as many rows as joints nothing of Γ₀ is left.
///
/// # Errors
/// [`Refusal::Singular`] for dependent rows.
pub fn pseudo_inverse<const N: usize>(problem: &Problem<'_, N>) -> Result<Torques<N>, Refusal> {
    let mut torques = law::solve(problem, &[])?;
    let rows = law::Rows::of(problem, &[])?;
    if rows.count == N {
        return Ok(torques);
    }
    let mut JJ_T: SMatrix<f64, N, N> = rows.J_T.tr_mul(&rows.J_T);
    (rows.count..N).for_each(|i| JJ_T[(i, i)] = 1.0);
    let JJ_T = Cholesky::new(JJ_T)?;
    let Gamma_0 = null_torque(problem.A, &problem.grad_V_0, problem.k_vq, problem.qdot);
    torques.parts.null = Gamma_0 - rows.J_T * JJ_T.solve(&rows.J_T.tr_mul(&Gamma_0));
    Ok(torques)
}

/// J^# of unit-scaled rows, which stays finite: Σ v_k uᵀ_k·σ_k/(σ_k² + λ²) with the damping that grows as manipulability falls, λ² = λ_max²(1 − w/w₀)²
/// where w = √det JJᵀ < w₀ [Nakamura & Hanafusa 1986].
///
/// From the eigenvectors of JJᵀ, 6×6, by Jacobi's method with a fixed number of sweeps.
fn damped<const N: usize>(J: &Jacobian<N>, damping: Damping) -> SMatrix<f64, N, 6> {
    let (values, U) = symmetric_eigen(&(J * J.transpose()));
    let largest = values.max();
    let real = |value: f64| value > 1e-20 * largest.max(1e-30);
    let w = values
        .iter()
        .filter(|v| real(**v) && **v > 0.0)
        .map(|v| v.sqrt())
        .product::<f64>();
    let lambda = damping.largest * (1.0 - w / damping.onset).max(0.0);
    let gain = values.map(|value| {
        if real(value) {
            1.0 / (value + lambda * lambda)
        } else {
            0.0
        }
    });
    J.transpose() * (U * Matrix6::from_diagonal(&gain) * U.transpose())
}

/// Resolved-rate control with damped least squares: q̇_r = J^#(V_d + (k_p/k_v)e), q̈ = k_v(q̇_r − q̇) + J^#(a_d + (k_p/k_v)(V_d − V) − J̇q̇).
///
/// The velocity level keeps joint motions outside the range of J^# from drifting.
pub(crate) fn resolved_rate<const N: usize>(
    setup: &Setup<N>,
    now: &Now<'_, N>,
    motion: &Motion<N>,
    problem: &Problem<'_, N>,
) -> Torques<N> {
    let Control { k_p, k_v, .. } = setup.scenario.control;
    let damping = setup.scenario.control.baseline.damped_least_squares;
    let scaled = |x: &Vector6| unit_scaled(x, setup.length_m, &setup.task);
    let J = unit_scaled(&now.at.J, setup.length_m, &setup.task);
    let sharp = damped(&J, damping);
    let (k, desired) = (k_p / k_v, &motion.desired);
    let rate = sharp * scaled(&(desired.V + bounded(&motion.error) * k));
    let V = now.at.J * now.qdot;
    let feed = sharp * scaled(&(desired.a + (desired.V - V) * k - now.at.Jdot_qdot));
    let qddot = (rate - now.qdot) * k_v + feed;
    let path = problem.A * (sharp * scaled(&problem.a_path));
    Torques {
        parts: Parts {
            path,
            rest: problem.A * qddot - path,
            null: Joints::zeros(),
        },
        qdot_nominal: sharp * scaled(&motion.V_nominal),
        qddot_path: sharp * scaled(&(motion.a_feed - now.at.Jdot_qdot)),
    }
}
