//! The type of a singularity, from the second-order motion along ζ: Type 1, Type 2, or mixed, with the numbers.
//!
//! Everything here works on a copy of the arm, its joints as screws.

use super::block::Block;
use super::screws::Screws;
use crate::linear::{angular, symmetric_eigen};
use crate::types::Class;
use nalgebra::{SMatrix, SVector, Vector3};

/// κ₁ above which null-space motion moves the end-effector along ζ; unit-scaled, per rad².
pub const FOLD: f64 = 0.05;

/// κ₁ against κ₂ above which that is what it mainly does.
pub const FOLD_SHARE: f64 = 0.5;

/// Most Newton steps onto σ = 0.
const NEWTON_STEPS: usize = 12;

/// Largest Newton step in any joint, rad.
const NEWTON_STEP_MAX: f64 = 0.3;

/// Singular value that counts as zero, unit-scaled: a hundred times what Newton leaves.
const ZERO: f64 = 1e-7;

/// Steps of the verified self-motion, and the length of each, rad.
const SELF_MOTION: (usize, f64) = (6, 0.05);

/// The type of one singularity by the second order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Its type; unknown where no singular posture was found near by.
    pub class: Class,
    /// Largest curvature of the end-effector's motion along ζ under unit null motion, unit-scaled.
    pub kappa_1: f64,
    /// Turning rate of ζ along the null motion, positive about the singular frame's second axis while v_iᵀq̇ > 0.
    pub kappa_2: f64,
    /// Distance in joint space to the singular posture classified, rad.
    pub distance: f64,
}

/// The type of the singularity at place `i` of `block`.
///
/// On a copy moved by Newton's method onto σ_i = 0: V₀ the null space of the whole unit-scaled J there (task axes `task`), u its left null vector,
/// κ₁ = max|eig(V₀ᵀ(u·H)V₀)| with H = ∂J/∂q, κ₂ = |ζ'| along the null motion. Type 1: κ₁ > 0.05 and κ₁ > 0.5 κ₂ and of one sign. Type 2:
/// κ₁ ≤ 0.05 and the arm, moved along the null space, stays singular with C in place. Mixed: whatever is neither.
///
/// Shapes `screws` 6×N at C · Units `length_m` m; κ₁, κ₂ per rad², per rad, on unit-scaled rows · Frame base axes · Requires a posture near σ_i = 0 ·
/// Ensures [`Class::Unknown`] where Newton's method reaches no singular posture · Errors none · Cost bounded, about 50 µs for six joints: not for
/// every tick; no allocation
#[must_use]
pub fn classify<const N: usize>(
    screws: &Screws<N>,
    block: &Block<N>,
    i: usize,
    length_m: f64,
    task: &[bool; 6],
) -> Verdict {
    let (mut screws, mut block) = (*screws, *block);
    let mut moved = SVector::<f64, N>::zeros();
    for _ in 0..NEWTON_STEPS {
        let sigma = block.sigma(i);
        if sigma.abs() < 0.01 * ZERO {
            break;
        }
        let gradient = block.gradient(&screws, i, length_m);
        let step = gradient * (-sigma / gradient.norm_squared().max(1e-6));
        let step = step * (NEWTON_STEP_MAX / step.amax().max(NEWTON_STEP_MAX));
        moved += step;
        screws = screws.moved(&step).0;
        block.track(&screws.scaled(length_m));
    }
    let distance = moved.norm();
    if block.sigma(i).abs() > ZERO {
        return Verdict {
            distance,
            ..Verdict::default()
        };
    }
    let null = NullSpace::new(&screws, length_m, task, &block.covector(i));
    let Q = screws.hessian(&null.covector(length_m));
    let (mut highest, mut lowest) = (0.0_f64, 0.0_f64);
    let curvature = null.V.transpose() * (Q + Q.transpose()) * null.V * 0.5;
    let (curvatures, along) = symmetric_eigen(&curvature);
    let mut strongest = 0;
    for k in 0..N {
        highest = highest.max(curvatures[k]);
        lowest = lowest.min(curvatures[k]);
        if curvatures[k].abs() > curvatures[strongest].abs() {
            strongest = k;
        }
    }
    let kappa_1 = highest.max(-lowest);
    // The null motion classified: that of the largest curvature, or where there is none the block's own.
    let motion = null.V
        * if kappa_1 > 1e-6 {
            along.column(strongest).into_owned()
        } else {
            null.V.transpose() * block.v(i)
        };
    let motion = motion / motion.norm().max(1e-12);
    let turning = block.turning(&screws.rate(&motion), i, length_m);
    let kappa_2 = turning.norm();
    let one_sign = highest.min(-lowest) <= 0.1 * kappa_1;
    let class = if kappa_1 > FOLD {
        if one_sign && kappa_1 > FOLD_SHARE * kappa_2 {
            Class::Type1
        } else {
            Class::Mixed
        }
    } else if self_motion(&screws, &block, i, &motion, length_m, task) {
        Class::Type2
    } else {
        Class::Mixed
    };
    // About the singular frame's second axis, per rate of the auxiliary coordinate, which is v_iᵀq̇.
    let about = angular(&block.covector(i))
        .cross(&angular(&turning))
        .dot(&screws.column(N - 1).1);
    let against = about * motion.dot(&block.v(i)) < 0.0;
    Verdict {
        class,
        kappa_1,
        kappa_2: if against { -kappa_2 } else { kappa_2 },
        distance,
    }
}

/// Whether the arm can move on along its null space with C in place and σ_i staying zero.
pub(super) fn self_motion<const N: usize>(
    screws: &Screws<N>,
    block: &Block<N>,
    i: usize,
    motion: &SVector<f64, N>,
    length_m: f64,
    task: &[bool; 6],
) -> bool {
    let (mut screws, mut block, mut direction) = (*screws, *block, *motion);
    let (steps, length) = SELF_MOTION;
    let mut gone = Vector3::zeros();
    for _ in 0..steps {
        let ahead = |screws: &Screws<N>, block: &Block<N>, direction: &SVector<f64, N>| {
            let null = NullSpace::new(screws, length_m, task, &block.covector(i));
            let v = null.V * (null.V.transpose() * direction);
            v / v.norm().max(1e-12)
        };
        // Midpoint rule.
        let half = screws.moved(&(direction * (0.5 * length))).0;
        let mut between = block;
        between.track(&half.scaled(length_m));
        direction = ahead(&half, &between, &direction);
        let (next, by) = screws.moved(&(direction * length));
        screws = next;
        gone += by;
        block.track(&screws.scaled(length_m));
        direction = ahead(&screws, &block, &direction);
    }
    let turned = steps as f64 * length;
    block.sigma(i).abs() < 1e-2 * turned && gone.norm() < 1e-2 * turned * length_m
}

/// The null space of a Jacobian and the left null vector nearest to a given one.
struct NullSpace<const N: usize> {
    /// Its basis, in the first columns; the rest zero.
    V: SMatrix<f64, N, N>,
    /// Unit, on scaled rows.
    u: SVector<f64, 6>,
}

impl<const N: usize> NullSpace<N> {
    /// Eigenvalues of JᵀJ below this are zero; between rounding and the square of the smallest regular singular value.
    const TOLERANCE: f64 = 1e-7;

    fn new(screws: &Screws<N>, length_m: f64, task: &[bool; 6], towards: &SVector<f64, 6>) -> Self {
        let mut J = screws.scaled(length_m);
        for (k, counts) in task.iter().enumerate() {
            if !counts {
                J.row_mut(k).fill(0.0);
            }
        }
        let (values, vectors) = symmetric_eigen(&(J.transpose() * J));
        let mut V = SMatrix::<f64, N, N>::zeros();
        for (count, k) in (0..N).filter(|k| values[*k] < Self::TOLERANCE).enumerate() {
            V.set_column(count, &vectors.column(k));
        }
        let (values, vectors) = symmetric_eigen(&(J * J.transpose()));
        let mut u = SVector::<f64, 6>::zeros();
        for k in (0..6).filter(|k| task[*k] && values[*k] < Self::TOLERANCE) {
            let one = vectors.column(k);
            u += one * one.dot(towards);
        }
        let size = u.norm();
        Self {
            V,
            u: if size > 1e-9 { u / size } else { *towards },
        }
    }

    /// u as a covector of unscaled rows.
    fn covector(&self, length_m: f64) -> SVector<f64, 6> {
        let mut a = self.u;
        a.fixed_rows_mut::<3>(0).scale_mut(1.0 / length_m);
        a
    }
}
