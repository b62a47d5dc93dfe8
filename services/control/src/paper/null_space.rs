//! Posture control in the null space of a redundant arm, by either projector: the paper's Figures 1 and 2.

use super::operational_space::{Operational, null_torque, pseudo_inverse_N_T};
use super::singular_frame::orthogonal_rows;
use crate::law::{LawError, Torques, Wanted};
use nalgebra::{SMatrix, SVector};

/// Which torques count as not moving the end-effector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Projector {
    /// 1 − Jᵀ(J⁺)ᵀ: right only for an arm at rest without mass.
    PseudoInverse,
    /// 1 − JᵀJ̄ᵀ.
    DynamicallyConsistent,
}

/// Γ = JᵀF + [1 − JᵀJ̄ᵀ]Γ₀, Γ₀ = −A[∇V₀ + k_vq q̇] towards the posture     [CK95 Eq. 3]
///
/// With [`Projector::PseudoInverse`] J⁺ stands in the place of J̄: no equation of the paper, but the law that its Figure 1 shows to fail.
///
/// Shapes J m×N, m the number of task axes, matched by the type · Units N·m · Frame base axes at C · Requires a J of full row rank · Ensures for
/// [`Projector::DynamicallyConsistent`] that Γ₀ does not accelerate the task · Cost O(N³), no allocation
///
/// # Errors
/// [`LawError`] if the Jacobian is rank deficient.
pub fn torques<const N: usize>(
    wanted: &Wanted<'_, N>,
    projector: Projector,
) -> Result<Torques<N>, LawError> {
    match orthogonal_rows::<N>(&wanted.task, &[])?.len() {
        1 => sized::<1, N>(wanted, projector),
        2 => sized::<2, N>(wanted, projector),
        3 => sized::<3, N>(wanted, projector),
        4 => sized::<4, N>(wanted, projector),
        5 => sized::<5, N>(wanted, projector),
        6 => sized::<6, N>(wanted, projector),
        rows => Err(LawError::TooManyRows { rows, joints: N }),
    }
}

fn sized<const M: usize, const N: usize>(
    wanted: &Wanted<'_, N>,
    projector: Projector,
) -> Result<Torques<N>, LawError> {
    let orthogonal = orthogonal_rows::<N>(&wanted.task, &[])?;
    let T = SMatrix::<f64, M, 6>::from_fn(|i, j| orthogonal[i][j]);
    let op = Operational::<M, N>::new(T * wanted.at.J, wanted.A)?;
    let Jdot_qdot = T * wanted.at.Jdot_qdot;
    let task = op.J.transpose() * op.force(&(T * wanted.a), &Jdot_qdot);
    let path = op.J.transpose() * (op.Lambda * (T * wanted.a_path));
    let Gamma_0 = null_torque(wanted.A, &(-wanted.posture), 0.0, &SVector::zeros());
    let null = match projector {
        Projector::DynamicallyConsistent => op.torque(&SVector::zeros(), &Gamma_0),
        Projector::PseudoInverse => pseudo_inverse_N_T(&op.J)? * Gamma_0,
    };
    Ok(Torques {
        path,
        rest: task - path,
        null,
        qdot_nominal: op.Jbar * (T * wanted.V),
        qddot_path: op.Jbar * (T * wanted.a_feed - Jdot_qdot),
    })
}
