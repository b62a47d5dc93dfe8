//! The operational-space formulation: equations 3 to 5 of Chang & Khatib 1995.
//!
//! J is any set of rows of full rank: all of the task's where the arm is regular, without the singular ones where it is not. It is kept as Jᵀ in an N×N
//! matrix, zero beyond the rows there are, so that one size serves every rank and nothing is allocated.

use crate::types::Refusal;
use nalgebra::{SMatrix, SVector};

/// Share of a row, squared and in the metric of A⁻¹, that must be new against the rows before it; between the 1e-16 of rounding and the 1e-4 of a
/// regular set of rows.
const NEW: f64 = 1e-12;

/// The factor L of a symmetric positive definite matrix LLᵀ, lower triangular.
#[derive(Clone, Copy, Debug)]
pub struct Cholesky<const N: usize> {
    L: SMatrix<f64, N, N>,
    /// 1/L_ii: each solution then takes no quotient.
    reciprocals: SVector<f64, N>,
}

impl<const N: usize> Cholesky<N> {
    /// Factors G, of which the lower half is read. Shape N×N · Cost O(N³), no allocation
    ///
    /// # Errors
    /// [`Refusal::Singular`] where a row depends on those before it, or is not finite.
    #[inline]
    pub fn new(mut G: SMatrix<f64, N, N>) -> Result<Self, Refusal> {
        let whole = G.diagonal();
        let mut reciprocals = SVector::zeros();
        for k in 0..N {
            let pivot = G[(k, k)];
            if pivot.is_nan() || pivot <= NEW * whole[k] {
                return Err(Refusal::Singular);
            }
            reciprocals[k] = 1.0 / pivot.sqrt();
            for i in 0..N {
                G[(i, k)] = if i < k {
                    0.0
                } else {
                    G[(i, k)] * reciprocals[k]
                };
            }
            for j in k + 1..N {
                let factor = G[(j, k)];
                for i in j..N {
                    G[(i, j)] -= G[(i, k)] * factor;
                }
            }
        }
        Ok(Self { L: G, reciprocals })
    }

    /// L⁻¹B. Row by row, so that the processor computes all columns at once.
    #[inline]
    fn forward<const K: usize>(&self, B: &SMatrix<f64, N, K>) -> SMatrix<f64, N, K> {
        let mut x = B.transpose();
        for i in 0..N {
            let row = x.column(i) * self.reciprocals[i];
            x.set_column(i, &row);
            for j in i + 1..N {
                x.column_mut(j).axpy(-self.L[(j, i)], &row, 1.0);
            }
        }
        x.transpose()
    }

    /// The solution of LLᵀX = B.
    #[inline]
    pub fn solve<const K: usize>(&self, B: &SMatrix<f64, N, K>) -> SMatrix<f64, N, K> {
        let mut x = self.forward(B).transpose();
        for i in (0..N).rev() {
            let row = x.column(i) * self.reciprocals[i];
            x.set_column(i, &row);
            for j in 0..i {
                x.column_mut(j).axpy(-self.L[(i, j)], &row, 1.0);
            }
        }
        x.transpose()
    }
}

/// A Jacobian with its operational-space inertia and its dynamically consistent inverse.
#[derive(Clone, Copy, Debug)]
pub struct Operational<const N: usize> {
    /// Jᵀ, N×N; its columns from `count` on are zero.
    pub J_T: SMatrix<f64, N, N>,
    count: usize,
    A: Cholesky<N>,
    /// Of J A⁻¹ Jᵀ; one on the diagonal in place of absent rows.
    Lambda_inverse: Cholesky<N>,
}

impl<const N: usize> Operational<N> {
    /// That of a Jacobian of `count` rows and full row rank.
    ///
    /// Shapes Jᵀ N×N, A N×N · Frame: that of J's rows · Cost O(N³), no allocation
    ///
    /// # Errors
    /// [`Refusal::Singular`] where A is not positive definite, or a row of J depends on those before it: leave the singular directions out first.
    #[inline]
    pub fn new(
        J_T: SMatrix<f64, N, N>,
        count: usize,
        A: &SMatrix<f64, N, N>,
    ) -> Result<Self, Refusal> {
        let A = Cholesky::new(*A)?;
        let half = A.forward(&J_T);
        let mut inverse = half.transpose() * half;
        (count..N).for_each(|i| inverse[(i, i)] = 1.0);
        Ok(Self {
            J_T,
            count,
            A,
            Lambda_inverse: Cholesky::new(inverse)?,
        })
    }

    /// The operational force that gives the rows the accelerations `a` less J̇q̇: F = Λa, Λ = (J A⁻¹ Jᵀ)⁻¹ symmetric positive definite.
    /// Shape N×K for K accelerations, zero beyond the rows; N, N·m.
    #[inline]
    pub fn force<const K: usize>(&self, a: &SMatrix<f64, N, K>) -> SMatrix<f64, N, K> {
        self.Lambda_inverse.solve(a)
    }

    /// Joint motion of a task motion `x` by the dynamically consistent inverse.
    ///
    /// J̄ = A⁻¹JᵀΛ, Λ = (J A⁻¹ Jᵀ)⁻¹     [CK95 Eq. 4]
    ///
    /// Shape N×K for K motions, zero beyond the rows → N×K · Ensures J·J̄ = 1, and the least kinetic energy
    #[inline]
    pub fn Jbar<const K: usize>(&self, x: &SMatrix<f64, N, K>) -> SMatrix<f64, N, K> {
        self.A.solve(&(self.J_T * self.force(x)))
    }

    /// Joint torque of a task force and a null-space torque.
    ///
    /// Γ = JᵀF + [1 − JᵀJ̄ᵀ]Γ₀     [CK95 Eq. 3]
    ///
    /// Shapes F N, zero beyond the rows, Γ₀ N → N; N·m · Ensures that Γ₀ does not accelerate the task; with as many rows as joints nothing of it is left
    #[inline]
    pub fn torque(&self, F: &SVector<f64, N>, Gamma_0: &SVector<f64, N>) -> SVector<f64, N> {
        if self.count == N {
            return self.J_T * F;
        }
        // J̄ᵀΓ₀ = ΛJA⁻¹Γ₀.
        let carried = self.force(&self.J_T.tr_mul(&self.A.solve(Gamma_0)));
        self.J_T * (F - carried) + Gamma_0
    }

    /// The share of the accelerations `a` of the rows from `kept` on that the rows before them do not cause, a_s − J_s·J̄_r·a_r; zero in those rows.
    #[inline]
    pub fn not_caused(&self, a: &SVector<f64, N>, kept: usize) -> SVector<f64, N> {
        let mut y = self.Lambda_inverse.forward(a);
        (0..kept).for_each(|i| y[i] = 0.0);
        self.Lambda_inverse.L * y
    }
}

/// Null-space torque of a potential with joint damping.
///
/// Γ₀ = −A(q)[∇V₀ + k_vq q̇]     [CK95 Eq. 5]
///
/// A multiplies the gradient, so the null-space motion is decoupled: ∇V₀ is an acceleration, rad/s²; k_vq 1/s. Shape n; N·m.
#[inline]
pub fn null_torque<const N: usize>(
    A: &SMatrix<f64, N, N>,
    grad_V_0: &SVector<f64, N>,
    k_vq: f64,
    qdot: &SVector<f64, N>,
) -> SVector<f64, N> {
    -(A * (grad_V_0 + qdot * k_vq))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::{Jacobian, Matrix3, Vector3, Vector6, unit};
    use crate::testing::{posture, puma, three_r};
    use nalgebra::Matrix6;
    use proptest::prelude::*;

    /// The rows of a Jacobian whose first `count` are kept, as columns.
    fn kept<const N: usize>(J: &Jacobian<N>, count: usize) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|i, k| if k < count { J[(k, i)] } else { 0.0 })
    }

    /// A matrix column by column of the identity.
    fn matrix<const N: usize>(
        f: impl Fn(&SVector<f64, N>) -> SVector<f64, N>,
    ) -> SMatrix<f64, N, N> {
        SMatrix::from_columns(&std::array::from_fn::<_, N, _>(|k| f(&unit(k))))
    }

    proptest! {
        /// Five rows of the PUMA at the wrist centre, wherever they are regular.
        // covers: CK95 Eq. 3 (operational_space::Operational::torque)
        // covers: CK95 Eq. 4 (operational_space::Operational::Jbar)
        // covers: CK95 Eq. 5 (operational_space::null_torque)
        #[test]
        fn the_null_space_is_dynamically_consistent(
            q in posture(puma()),
            qdot in prop::array::uniform6(-1.0..1.0),
            grad in prop::array::uniform6(-1.0..1.0),
        ) {
            let terms = puma().evaluate(&q, &SVector::zeros());
            let J = terms.J.fixed_rows::<5>(0).into_owned();
            prop_assume!(J.singular_values()[4] > 0.03);
            let op = Operational::new(kept(&terms.J, 5), 5, &terms.A).unwrap();
            let Jbar = matrix(|x| op.Jbar(x)).fixed_columns::<5>(0).into_owned();
            let N_T = matrix(|x| op.torque(&SVector::zeros(), x));
            let A_inverse = terms.A.try_inverse().unwrap();
            let Lambda = (J * A_inverse * J.transpose()).try_inverse().unwrap();
            prop_assert!((J * Jbar - SMatrix::<f64, 5, 5>::identity()).amax() < 1e-11);
            prop_assert!((Jbar - A_inverse * J.transpose() * Lambda).amax() < 1e-9);
            prop_assert!((N_T - Matrix6::identity() + J.transpose() * Jbar.transpose()).amax() < 1e-11);
            prop_assert!((J * A_inverse * N_T).amax() < 1e-10 && (N_T * N_T - N_T).amax() < 1e-10);

            let (qdot, grad) = (Vector6::from(qdot), Vector6::from(grad));
            let Gamma_0 = null_torque(&terms.A, &grad, 40.0, &qdot);
            prop_assert!((A_inverse * Gamma_0 + grad + qdot * 40.0).amax() < 1e-9);
            let Gamma = op.torque(&SVector::zeros(), &Gamma_0);
            prop_assert!((J * A_inverse * Gamma).amax() < 1e-9, "null torque accelerates the task");
        }
    }

    #[test]
    fn the_pseudo_inverse_disturbs_the_task_and_the_dynamically_consistent_one_does_not() {
        let terms = three_r().evaluate(&Vector3::new(0.5, 1.0, 0.8), &Vector3::zeros());
        let J = terms.J.fixed_rows::<2>(0).into_owned();
        let Gamma_0 = Vector3::new(20.0, -10.0, 15.0);
        let accelerates = |Gamma: Vector3| (J * terms.A.try_inverse().unwrap() * Gamma).norm();
        let op = Operational::new(kept(&terms.J, 2), 2, &terms.A).unwrap();
        let consistent = accelerates(op.torque(&SVector::zeros(), &Gamma_0));
        let Jplus = J.pseudo_inverse(1e-9).unwrap();
        let pseudo = accelerates(Gamma_0 - J.transpose() * Jplus.transpose() * Gamma_0);
        assert!(
            consistent < 1e-10 && pseudo > 1.0,
            "{consistent:e} against {pseudo} m/s²"
        );
    }

    #[test]
    fn dependent_rows_are_refused() {
        let J_T = Matrix3::new(1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0);
        assert_eq!(
            Operational::new(J_T, 2, &Matrix3::identity()).unwrap_err(),
            Refusal::Singular
        );
    }
}
