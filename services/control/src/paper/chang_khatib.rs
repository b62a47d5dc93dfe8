//! The paper's law in its own form: singular rows dropped, operational forces for the rest, null-space torque for the auxiliary coordinates.

use super::operational_space::{Operational, null_torque};
use super::singular_frame::{Basis, orthogonal_rows};
use crate::law::{Active, Actives, LawError, Torques, Wanted};
use crate::linear::Lu;
use nalgebra::{SMatrix, SVector};

/// Torques by the reduced Jacobian and its dynamically consistent null space.
///
/// Γ = J_rᵀF_r + [1 − J_rᵀJ̄_rᵀ]Γ₀, J_r the Jacobian in the singular frame without its singular rows     [CK95 Eq. 3]
///
/// Shapes J_r m×N, m the orthogonal rows, matched by the type · Units N·m · Frame base axes at C · Requires `actives` to be the singularities inside
/// their neighbourhoods: each one's direction is dropped whole, whatever its β · Ensures that Γ₀ does not accelerate the kept rows · Cost O(N³), no
/// allocation
///
/// # Errors
/// [`LawError`] if the reduced Jacobian is rank deficient.
pub fn torques<const N: usize>(
    wanted: &Wanted<'_, N>,
    actives: &Actives<N>,
) -> Result<Torques<N>, LawError> {
    match orthogonal_rows(&wanted.task, actives)?.len() {
        6 => reduced::<6, N>(wanted, actives),
        5 => reduced::<5, N>(wanted, actives),
        4 => reduced::<4, N>(wanted, actives),
        3 => reduced::<3, N>(wanted, actives),
        2 => reduced::<2, N>(wanted, actives),
        1 => reduced::<1, N>(wanted, actives),
        rows => Err(LawError::TooManyRows { rows, joints: N }),
    }
}

fn reduced<const M: usize, const N: usize>(
    wanted: &Wanted<'_, N>,
    actives: &[Active<N>],
) -> Result<Torques<N>, LawError> {
    let orthogonal = orthogonal_rows(&wanted.task, actives)?;
    let T = SMatrix::<f64, M, 6>::from_fn(|i, j| orthogonal[i][j]);
    let op = Operational::<M, N>::new(T * wanted.at.J, wanted.A)?;
    let (a, Jdot_qdot) = (T * wanted.a, T * wanted.at.Jdot_qdot);
    let F = op.force(&a, &Jdot_qdot);
    let F_path = op.Lambda * (T * wanted.a_path);

    // Γ₀ = −A∇V₀ with ∇V₀ = −Σ w_i·a_i: w_i moves auxiliary coordinate i alone and no orthogonal row. The auxiliary acceleration that
    // the task itself causes is taken off, so that each coordinate accelerates by a_i. Damping is in a_i, not in joint space.
    let lu = Lu::new(augmented(&op.J, actives, wanted.A))?;
    let caused = op.Jbar * (a - Jdot_qdot);
    let mut rhs = SVector::<f64, N>::zeros();
    let mut rates = SVector::<f64, N>::zeros();
    for (k, active) in actives.iter().enumerate() {
        rhs[M + k] = active.aux_acceleration - active.aux_row.dot(&caused);
        rates[M + k] = active.aux_rate;
    }
    rates.rows_mut(0, M).copy_from(&(T * wanted.V));
    let mut feed = SVector::<f64, N>::zeros();
    feed.rows_mut(0, M)
        .copy_from(&(T * wanted.a_feed - Jdot_qdot));
    let posture = op.N() * wanted.posture;
    let redundant = if M + actives.len() < N {
        posture
    } else {
        SVector::zeros()
    };
    let grad_V_0 = -(lu.solve(&rhs) + redundant);
    let Gamma_0 = null_torque(wanted.A, &grad_V_0, 0.0, &SVector::zeros());
    let null = op.torque(&SVector::zeros(), &Gamma_0);
    let path = op.J.transpose() * F_path;
    Ok(Torques {
        path,
        rest: op.J.transpose() * F - path,
        null,
        qdot_nominal: lu.solve(&rates),
        qddot_path: lu.solve(&feed),
    })
}

/// Orthogonal rows, auxiliary rows, and for a redundant arm WᵀA of what is left.
fn augmented<const M: usize, const N: usize>(
    J: &SMatrix<f64, M, N>,
    actives: &[Active<N>],
    A: &SMatrix<f64, N, N>,
) -> SMatrix<f64, N, N> {
    let mut rows = SMatrix::<f64, N, N>::zeros();
    let mut basis = Basis::<N>::empty();
    let mut used = 0;
    let mut push = |row: SVector<f64, N>| {
        rows.set_row(used, &row.transpose());
        basis.add(row);
        used += 1;
    };
    for i in 0..M {
        push(J.row(i).transpose());
    }
    for active in actives {
        push(active.aux_row);
    }
    for i in used..N {
        basis.add_best((0..N).map(|k| SVector::from_fn(|j, _| if j == k { 1.0 } else { 0.0 })));
        rows.set_row(i, &(A * basis.last()).normalize().transpose());
    }
    rows
}
