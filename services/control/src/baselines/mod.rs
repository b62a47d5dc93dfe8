//! The laws of others, each as published, with the same model, limits, path and clock.

pub mod hold_and_blend;
pub mod resolved_rate;

use crate::controller::Setup;
use crate::law::{self, Problem, Torques};
use crate::paper::operational_space::{Cholesky, null_torque};
use crate::tick::{Motion, Now};
use crate::types::Refusal;
use nalgebra::SMatrix;

/// All that a law of others may look at.
pub(crate) struct Arm<'a, const N: usize> {
    pub(crate) setup: &'a Setup<N>,
    pub(crate) now: &'a Now<'a, N>,
    pub(crate) motion: &'a Motion<N>,
    pub(crate) problem: &'a Problem<'a, N>,
}

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
