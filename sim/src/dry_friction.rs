//! Dry friction of the joints of an arm that touches nothing.

use nalgebra::{SMatrix, SVector};

/// Sweeps over the joints at most; a PUMA takes five to ten.
const SWEEPS: usize = 100;

/// A sweep that changes no velocity by more is the last; rad/s.
const TOLERANCE: f64 = 1e-13;

/// The change of velocity by dry friction over a sub-step that would end with `v`.
///
/// v⁺ = v + A⁻¹λ with |λ_i| ≤ `most`_i, and v⁺_i = 0 or λ_i = −`most`_i·sign v⁺_i: Coulomb's law for impulses, which has one solution. Projected
/// Gauss–Seidel finds it [Moreau 1988, *Unilateral contact and dry friction in finite freedom dynamics*].
///
/// `most`: Coulomb friction times the length of the sub-step; N·m·s. NaN where A is not positive definite. No allocation.
pub(crate) fn velocity_change<const N: usize>(
    A: &SMatrix<f64, N, N>,
    v: &SVector<f64, N>,
    most: &SVector<f64, N>,
) -> SVector<f64, N> {
    let Some(A_inverse) = A.cholesky().map(|factor| factor.inverse()) else {
        return SVector::repeat(f64::NAN);
    };
    let (mut impulse, mut after) = (SVector::<f64, N>::zeros(), *v);
    for _ in 0..SWEEPS {
        let mut change = 0.0_f64;
        for i in 0..N {
            let before = impulse[i];
            impulse[i] = (before - after[i] / A_inverse[(i, i)]).clamp(-most[i], most[i]);
            let step = A_inverse.column(i) * (impulse[i] - before);
            after += step;
            change = change.max(step.amax());
        }
        if change <= TOLERANCE {
            break;
        }
    }
    after - v
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::{Model, Robot};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn each_joint_sticks_or_slides_as_coulomb_says(
            q in prop::array::uniform6(-3.0..3.0_f64),
            v in prop::array::uniform6(-2.0..2.0_f64),
            slow in 0.0..1.0_f64,
        ) {
            let arm = Model::<6>::new(&Robot::builtin("puma560").unwrap(), None).unwrap();
            let A = arm.mass_matrix(&SVector::from(q));
            let v = SVector::from(v) * libm::pow(10.0, -4.0 * slow);
            let most = arm.coulomb_friction() * 0.25e-3;
            let dv = velocity_change(&A, &v, &most);
            let (after, impulse) = (v + dv, A * dv);
            for i in 0..6 {
                prop_assert!(impulse[i].abs() <= most[i] * (1.0 + 1e-9));
                let slides = (impulse[i] + most[i] * after[i].signum()).abs() <= 1e-9 * most[i];
                prop_assert!(after[i].abs() < 1e-11 || slides, "joint {i}: {} rad/s under {} of {} N·m·s", after[i], impulse[i], most[i]);
            }
        }
    }
}
