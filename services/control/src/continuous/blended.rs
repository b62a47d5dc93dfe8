//! The paper's law as one solve for all singularities, continuous across the boundary of every neighbourhood (+).
//!
//! For every engaged singularity its ζ is projected out of the translational (or rotational) rows and a row is appended
//!
//! ```text
//! row_i = β_i·(ζ_iᵀJ)/g_i + (1 − β_i)·aux_i
//! ```
//!
//! with the right-hand sides a* − J̇q̇ for the orthogonal rows and the auxiliary acceleration for the rest; then Γ = A·q̈ + bias.
//!
//! # The paper's law inside, plain operational-space control outside
//! With β = 1 the rows span those of J and q̈ = J⁻¹(a* − J̇q̇): operational-space control. With β = 0 let [B | w] be the inverse of the augmented
//! matrix, so J_r·B = 1, J_r·w = 0, aux·w = 1. Then q̈ = B·r + w·a_aux. The paper's Γ = J_rᵀΛ_r·r + N_T·Γ₀ with Γ₀ = A·w·(a_aux − aux·J̄_r·r)
//! accelerates J_r·q̈ = r and aux·q̈ = a_aux: the same q̈, because the augmented matrix is regular: the torque is the paper's exactly (proofs:
//! `one_solve_gives_the_papers_torque`, `outside_every_neighbourhood_one_solve_is_operational_space_control`).

use crate::law::{Active, LawError, Torques, Wanted};
use crate::linear::{Lu, PIVOT_FLOOR, SolveError};
use crate::paper::singular_frame::{Basis, orthogonal_rows};
use nalgebra::{SMatrix, SVector, Vector6};

/// The augmented system: orthogonal rows, one row per engaged singularity, dynamically consistent null space of both where joints are left over.
#[derive(Clone, Debug)]
pub struct Augmented<const N: usize> {
    /// N×N; the first `orthogonal` rows are those of the task orthogonal to ζ, the next `singular` the singularities'.
    pub M: SMatrix<f64, N, N>,
    /// Right-hand side.
    pub acceleration: SVector<f64, N>,
    /// The share of it that lies along the path.
    pub along: SVector<f64, N>,
    /// Right-hand side for nominal velocities.
    pub velocity: SVector<f64, N>,
    /// Right-hand side for the path's own acceleration.
    pub feed: SVector<f64, N>,
    /// How many rows of the task are orthogonal to the singular directions.
    pub orthogonal: usize,
    /// How many belong to singularities.
    pub singular: usize,
}

impl<const N: usize> Augmented<N> {
    /// Sets the system up.
    ///
    /// # Errors
    /// [`LawError::TooManyRows`] where the task has more axes than the arm has joints.
    #[inline(always)]
    pub fn new(wanted: &Wanted<'_, N>, actives: &[Active<N>]) -> Result<Self, LawError> {
        let (J, Jdot_qdot) = (&wanted.at.J, &wanted.at.Jdot_qdot);
        let orthogonal = orthogonal_rows(&wanted.task, actives)?;
        let mut system = Self {
            M: SMatrix::zeros(),
            acceleration: SVector::zeros(),
            along: SVector::zeros(),
            velocity: SVector::zeros(),
            feed: SVector::zeros(),
            orthogonal: orthogonal.len(),
            singular: actives.len(),
        };
        let mut used = 0;
        let mut push =
            |row: SVector<f64, N>, acceleration: f64, along: f64, velocity: f64, feed: f64| {
                system.M.set_row(used, &row.transpose());
                (system.acceleration[used], system.along[used]) = (acceleration, along);
                (system.velocity[used], system.feed[used]) = (velocity, feed);
                used += 1;
            };
        let (relative, feed) = (wanted.a - Jdot_qdot, wanted.a_feed - Jdot_qdot);
        for e in orthogonal.iter() {
            push(
                transposed_times(J, e),
                e.dot(&relative),
                e.dot(&wanted.a_path),
                e.dot(&wanted.V),
                e.dot(&feed),
            );
        }
        for active in actives {
            let (mut row, mut acceleration) = (
                active.aux_row * (1.0 - active.beta),
                active.aux_acceleration * (1.0 - active.beta),
            );
            let (mut along, mut velocity, mut own) =
                (0.0, active.aux_rate * (1.0 - active.beta), 0.0);
            // β > 0 only at |s| > η_in, where the gain is far from zero.
            if active.beta > 0.0 {
                let scale = active.beta / active.gain;
                row += transposed_times(J, &active.zeta_B) * scale;
                acceleration += active.zeta_B.dot(&relative) * scale;
                along = active.zeta_B.dot(&wanted.a_path) * scale;
                velocity += active.zeta_B.dot(&wanted.V) * scale;
                own = active.zeta_B.dot(&feed) * scale;
            }
            push(row, acceleration, along, velocity, own);
        }
        if used < N {
            // WᵀA q̈ = WᵀA q̈₀ with W a basis of the null space: q̈ = J̄·r + N·q̈₀, dynamically consistent.
            let mut basis = Basis::<N>::empty();
            for i in 0..used {
                basis.add(system.M.row(i).transpose());
            }
            for i in used..N {
                basis.add_best(
                    (0..N).map(|k| SVector::from_fn(|j, _| if j == k { 1.0 } else { 0.0 })),
                );
                let row = wanted.A * basis.last();
                let scale = 1.0 / row.norm();
                system.M.set_row(i, &(row * scale).transpose());
                system.acceleration[i] = row.dot(&wanted.posture) * scale;
            }
        }
        Ok(system)
    }
}

/// Jᵀ·e, written out: nalgebra's product is a call with loops.
#[inline(always)]
fn transposed_times<const N: usize>(J: &SMatrix<f64, 6, N>, e: &Vector6<f64>) -> SVector<f64, N> {
    let row: [f64; N] = std::array::from_fn(|j| {
        J.data.0[j]
            .iter()
            .zip(&e.data.0[0])
            .fold(0.0, |sum, (x, y)| sum + x * y)
    });
    SVector::from(row)
}

/// Torques by the blended law; without actives this is plain operational-space control.
///
/// Γ = A·M⁻¹·r with M the augmented matrix and r its right-hand side; gravity and Coriolis are added by the caller.
///
/// Shapes M N×N · Units N·m · Frame base axes at C · Requires every singularity within η_out to be active · Ensures the paper's torque where β = 0 and
/// operational-space control where β = 1, both exactly · Cost O(N³), no allocation
///
/// # Errors
/// [`LawError`] if the augmented matrix is singular: σ_min > 0.03 wherever every singularity within η_out is engaged.
pub fn torques<const N: usize>(
    wanted: &Wanted<'_, N>,
    actives: &[Active<N>],
) -> Result<Torques<N>, LawError> {
    let system = Augmented::new(wanted, actives)?;
    let lu = Lu::new(system.M)?;
    let [qddot, along, qdot_nominal, qddot_path] = lu.solve_all([
        &system.acceleration,
        &system.along,
        &system.velocity,
        &system.feed,
    ]);
    let path = wanted.A * along;
    let null = null_torque(wanted.A, &qddot, &lu, &system, actives)?;
    let task = wanted.A * qddot - null;
    Ok(Torques {
        path,
        rest: task - path,
        null,
        qdot_nominal,
        qddot_path,
    })
}

/// The share of Γ = A·q̈ that lies in the null space of the orthogonal rows, singularity i's weighted by 1 − β_i so that it is continuous.
///
/// N_T·Γ = A·W(WᵀAW)⁻¹Wᵀ·Γ with W the motions that leave the orthogonal rows alone: columns of the augmented inverse.
#[inline(always)]
fn null_torque<const N: usize>(
    A: &SMatrix<f64, N, N>,
    qddot: &SVector<f64, N>,
    lu: &Lu<N>,
    system: &Augmented<N>,
    actives: &[Active<N>],
) -> Result<SVector<f64, N>, LawError> {
    let free = N - system.orthogonal;
    if free == 0 {
        return Ok(SVector::zeros());
    }
    let (mut W, mut AW) = (
        [SVector::<f64, N>::zeros(); N],
        [SVector::<f64, N>::zeros(); N],
    );
    for k in 0..free {
        W[k] = lu.solve(&SVector::from_fn(|i, _| {
            if i == system.orthogonal + k { 1.0 } else { 0.0 }
        }));
        AW[k] = A * W[k];
    }
    let mut share = gram_solved(&W[..free], &AW[..free], qddot)?;
    for (k, active) in actives.iter().enumerate() {
        share[k] *= 1.0 - active.beta;
    }
    Ok((0..free).fold(SVector::zeros(), |torque, k| torque + AW[k] * share[k]))
}

/// (WᵀAW)⁻¹WᵀA·q̈ for the columns of W and AW, up to N of them: Cholesky's elimination, for W has full rank and A is positive definite.
///
/// # Errors
/// [`LawError::Solve`] where a pivot is not positive, or not a number.
fn gram_solved<const N: usize>(
    W: &[SVector<f64, N>],
    AW: &[SVector<f64, N>],
    qddot: &SVector<f64, N>,
) -> Result<SVector<f64, N>, LawError> {
    let size = W.len();
    let mut gram = SMatrix::<f64, N, N>::zeros();
    let mut share = SVector::<f64, N>::zeros();
    for k in 0..size {
        share[k] = AW[k].dot(qddot);
        for l in 0..=k {
            gram[(k, l)] = W[k].dot(&AW[l]);
        }
    }
    let largest = (0..size).fold(0.0_f64, |largest, k| largest.max(gram[(k, k)]));
    for k in 0..size {
        let pivot = gram[(k, k)];
        if !pivot.is_finite() {
            return Err(SolveError::NotFinite.into());
        }
        if pivot <= PIVOT_FLOOR * largest {
            return Err(SolveError::RankDeficient {
                size,
                pivot,
                largest,
            }
            .into());
        }
        for i in k + 1..size {
            let l = gram[(i, k)] / pivot;
            for j in k + 1..=i {
                gram[(i, j)] -= l * gram[(j, k)];
            }
            share[i] -= l * share[k];
        }
    }
    for k in (0..size).rev() {
        for i in k + 1..size {
            share[k] -= gram[(i, k)] * share[i];
        }
        share[k] /= gram[(k, k)];
    }
    Ok(share)
}
