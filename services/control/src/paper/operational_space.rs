//! The operational-space formulation: equations 3 to 5 of Chang & Khatib 1995.
//!
//! `J` is any m×n Jacobian of full row rank: the whole one where the arm is regular, the reduced one (singular rows dropped) where
//! it is not. The rank is matched by the type, never allocated.

use nalgebra::{Cholesky, SMatrix, SVector};

/// Why operational-space quantities do not exist.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum OperationalError {
    /// J A⁻¹ Jᵀ is not positive definite: J has dependent rows.
    #[error(
        "J A⁻¹ Jᵀ ({rows}×{rows}) is not positive definite: the Jacobian has dependent rows; drop the singular directions first"
    )]
    RankDeficient {
        /// Number of rows of J.
        rows: usize,
    },
    /// The mass matrix is not positive definite, or not finite.
    #[error("the mass matrix is not positive definite")]
    MassMatrix,
}

/// Operational-space inertia, dynamically consistent inverse and null-space projectors of one Jacobian.
#[derive(Clone, Debug)]
pub struct Operational<const M: usize, const N: usize> {
    /// The Jacobian, m×n.
    pub J: SMatrix<f64, M, N>,
    /// Λ = (J A⁻¹ Jᵀ)⁻¹, m×m, symmetric positive definite; kg (kg·m² for rotations).
    pub Lambda: SMatrix<f64, M, M>,
    /// J̄ = A⁻¹ Jᵀ Λ, n×m.
    pub Jbar: SMatrix<f64, N, M>,
}

impl<const M: usize, const N: usize> Operational<M, N> {
    /// Λ and J̄ of a full-row-rank Jacobian.
    ///
    /// J̄ = A⁻¹JᵀΛ, Λ = (J A⁻¹ Jᵀ)⁻¹     [CK95 Eq. 4]
    ///
    /// Shapes J m×n, A n×n · Frame: that of J's rows · Ensures J·J̄ = 1, Λ = Λᵀ > 0 · Cost O(n³), no allocation.
    ///
    /// # Errors
    /// [`OperationalError`] if A or J A⁻¹ Jᵀ has no Cholesky factor.
    pub fn new(J: SMatrix<f64, M, N>, A: &SMatrix<f64, N, N>) -> Result<Self, OperationalError> {
        let A = Cholesky::new(*A).ok_or(OperationalError::MassMatrix)?;
        let Ainv_Jt = A.solve(&J.transpose());
        let inverse =
            Cholesky::new(J * Ainv_Jt).ok_or(OperationalError::RankDeficient { rows: M })?;
        let Lambda = inverse.inverse();
        Ok(Self {
            J,
            Lambda,
            Jbar: Ainv_Jt * Lambda,
        })
    }

    /// Torque projector onto the dynamically consistent null space.
    ///
    /// N_T = 1 − JᵀJ̄ᵀ     [CK95 Eq. 3]
    ///
    /// Shape n×n · Ensures J A⁻¹ N_T = 0 and N_T² = N_T. It acts on torques; its transpose [`N`](Self::N) on velocities.
    #[must_use]
    pub fn N_T(&self) -> SMatrix<f64, N, N> {
        SMatrix::identity() - self.J.transpose() * self.Jbar.transpose()
    }

    /// Velocity projector, N = 1 − J̄J = N_Tᵀ: a joint velocity N·q̇ does not move the task.
    #[must_use]
    pub fn N(&self) -> SMatrix<f64, N, N> {
        SMatrix::identity() - self.Jbar * self.J
    }

    /// Operational force that gives the task acceleration `a` (compensation of gravity and Coriolis is in joint space, where it is
    /// regular): F = Λ(a − J̇q̇). Shapes m → m; N, N·m.
    #[must_use]
    pub fn force(&self, a: &SVector<f64, M>, Jdot_qdot: &SVector<f64, M>) -> SVector<f64, M> {
        self.Lambda * (a - Jdot_qdot)
    }

    /// Joint torque of a task force and a null-space torque.
    ///
    /// Γ = JᵀF + [1 − JᵀJ̄ᵀ]Γ₀     [CK95 Eq. 3]
    ///
    /// Shapes F m, Γ₀ n → n; N·m. Ensures that Γ₀ does not accelerate the task.
    #[must_use]
    pub fn torque(&self, F: &SVector<f64, M>, Gamma_0: &SVector<f64, N>) -> SVector<f64, N> {
        // N_T Γ₀ without forming N_T: Γ₀ − Jᵀ(J̄ᵀΓ₀).
        self.J.transpose() * (F - self.Jbar.transpose() * Gamma_0) + Gamma_0
    }
}

/// Null-space torque of a potential with joint damping.
///
/// Γ₀ = −A(q)[∇V₀ + k_vq q̇]     [CK95 Eq. 5]
///
/// A multiplies the gradient, so the null-space motion is decoupled: ∇V₀ is an acceleration, rad/s²; k_vq 1/s. Shape n; N·m.
#[must_use]
pub fn null_torque<const N: usize>(
    A: &SMatrix<f64, N, N>,
    grad_V_0: &SVector<f64, N>,
    k_vq: f64,
    qdot: &SVector<f64, N>,
) -> SVector<f64, N> {
    -(A * (grad_V_0 + qdot * k_vq))
}

/// The pseudo-inverse's torque projector 1 − Jᵀ(J⁺)ᵀ, which the paper's Figure 1 shows to disturb the task. Shape n×n.
///
/// # Errors
/// [`OperationalError::RankDeficient`] if J Jᵀ has no Cholesky factor.
pub fn pseudo_inverse_N_T<const M: usize, const N: usize>(
    J: &SMatrix<f64, M, N>,
) -> Result<SMatrix<f64, N, N>, OperationalError> {
    let JJt =
        Cholesky::new(J * J.transpose()).ok_or(OperationalError::RankDeficient { rows: M })?;
    Ok(SMatrix::identity() - J.transpose() * JJt.solve(J))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{posture, puma, three_r};
    use nalgebra::{Matrix3, Matrix6, Vector3};
    use proptest::prelude::*;

    /// Random states of the PUMA whose reduced Jacobian (first five rows at the wrist centre) is regular.
    fn reduced(q: &SVector<f64, 6>) -> Option<(SMatrix<f64, 5, 6>, Matrix6<f64>)> {
        let terms = puma().evaluate(q, &SVector::zeros());
        let J = terms.J.fixed_rows::<5>(0).into_owned();
        (crate::linear::singular_values(&J).0[4] > 0.03).then_some((J, terms.A))
    }

    proptest! {
        // covers: CK95 Eq. 4 (operational_space::Operational::new)
        #[test]
        fn the_inverse_is_one_and_lambda_is_positive_definite(q in posture(puma())) {
            let rows = reduced(&q);
            prop_assume!(rows.is_some());
            let (J, A) = rows.unwrap();
            let op = Operational::new(J, &A).unwrap();
            prop_assert!((op.J * op.Jbar - SMatrix::<f64, 5, 5>::identity()).amax() < 1e-12);
            prop_assert!((op.Lambda - op.Lambda.transpose()).amax() < 1e-12 * op.Lambda.amax());
            prop_assert!(op.Lambda.symmetric_eigenvalues().min() > 0.0);
        }

        // covers: CK95 Eq. 3 (operational_space::Operational::N_T)
        // covers: CK95 Eq. 3 (operational_space::Operational::torque)
        #[test]
        fn the_null_space_is_dynamically_consistent(q in posture(puma()), Gamma_0 in prop::array::uniform6(-10.0..10.0)) {
            let rows = reduced(&q);
            prop_assume!(rows.is_some());
            let (J, A) = rows.unwrap();
            let op = Operational::new(J, &A).unwrap();
            let (N_T, N) = (op.N_T(), op.N());
            let A_inv = A.cholesky().unwrap().inverse();
            prop_assert!((J * A_inv * N_T).amax() < 1e-12);
            prop_assert!((N_T * N_T - N_T).amax() < 1e-10);
            prop_assert!((N - N_T.transpose()).amax() < 1e-12);
            prop_assert!((J * N).amax() < 1e-11);
            let Gamma_0 = SVector::from(Gamma_0);
            let Gamma = op.torque(&SVector::zeros(), &Gamma_0);
            prop_assert!((Gamma - N_T * Gamma_0).amax() < 1e-11);
            prop_assert!((J * A_inv * Gamma).amax() < 1e-10, "null torque accelerates the task");
        }

        #[test]
        fn torque_does_not_depend_on_the_frame(q in posture(puma()), a in prop::array::uniform5(-1.0..1.0), turn in prop::array::uniform3(-3.0..3.0_f64)) {
            // Any change of basis of the orthogonal rows, here a rotation of the linear three.
            let rows = reduced(&q);
            prop_assume!(rows.is_some());
            let (J, A) = rows.unwrap();
            let mut T = SMatrix::<f64, 5, 5>::identity();
            T.fixed_view_mut::<3, 3>(0, 0).copy_from(&crate::linear::rotation_exp(&Vector3::from(turn)));
            let (a, zero) = (SVector::from(a), SVector::zeros());
            let one = Operational::new(J, &A).unwrap();
            let two = Operational::new(T * J, &A).unwrap();
            let difference = J.transpose() * one.force(&a, &zero) - (T * J).transpose() * two.force(&(T * a), &zero);
            prop_assert!(difference.amax() < 1e-11 * one.Lambda.amax());
        }

        // covers: CK95 Eq. 5 (operational_space::null_torque)
        #[test]
        fn a_damped_potential_is_an_acceleration(q in posture(puma()), qdot in prop::array::uniform6(-1.0..1.0), grad in prop::array::uniform6(-1.0..1.0)) {
            let A = puma().mass_matrix(&q);
            let (qdot, grad) = (SVector::from(qdot), SVector::from(grad));
            let qddot = A.cholesky().unwrap().solve(&null_torque(&A, &grad, 40.0, &qdot));
            prop_assert!((qddot + grad + qdot * 40.0).amax() < 1e-11);
        }
    }

    // covers: CK95 Eq. 3 (operational_space::Operational::torque)
    #[test]
    fn the_pseudo_inverse_disturbs_the_task_and_the_dynamically_consistent_one_does_not() {
        let q = Vector3::new(0.5, 1.0, 0.8);
        let terms = three_r().evaluate(&q, &Vector3::zeros());
        let J = terms.J.fixed_rows::<2>(0).into_owned();
        let A_inv: Matrix3<f64> = terms.A.cholesky().unwrap().inverse();
        let Gamma_0 = Vector3::new(20.0, -10.0, 15.0);
        let consistent = J
            * A_inv
            * Operational::new(J, &terms.A)
                .unwrap()
                .torque(&SVector::zeros(), &Gamma_0);
        let pseudo = J * A_inv * pseudo_inverse_N_T(&J).unwrap() * Gamma_0;
        assert!(
            consistent.norm() < 1e-10,
            "dynamically consistent: {:e} m/s²",
            consistent.norm()
        );
        assert!(
            pseudo.norm() > 1e3 * consistent.norm() && pseudo.norm() > 1.0,
            "pseudo-inverse: {} m/s²",
            pseudo.norm()
        );
    }

    #[test]
    fn dependent_rows_are_refused() {
        let A = Matrix3::identity();
        let J = SMatrix::<f64, 2, 3>::new(1.0, 0.0, 0.0, 1.0, 0.0, 0.0);
        assert_eq!(
            Operational::new(J, &A).unwrap_err(),
            OperationalError::RankDeficient { rows: 2 }
        );
    }
}
