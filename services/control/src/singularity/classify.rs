//! The type of a singularity, from the second-order motion along ζ: Type 1, Type 2, or mixed, with the numbers.
//!
//! Everything here works on a copy of the arm, its joints as screws.

use super::geometry::Geometry;
use super::tracked_svd::TrackedSvd;
use super::tracker::{Arm, unscaled};
use crate::linear::{Joints, Matrix3, Vector3, symmetric_eigen};
use crate::paper::operational_space::Cholesky;
use crate::types::{Class, Kind};
use nalgebra::SMatrix;
use shared_types::bounds::within;

/// κ₁ above which null-space motion moves the end-effector along ζ; unit-scaled, per rad².
pub const FOLD: f64 = 0.05;

/// κ₁ against κ₂ above which that is what it mainly does. Of codimension one only: around a vector measure ζ turns by half a turn anyway.
const FOLD_SHARE: f64 = 0.5;

/// Most Newton steps onto m = 0, the largest step in any joint, rad, and |m| that counts as zero.
const NEWTON: (usize, f64, f64) = (24, 0.3, 1e-8);

/// Steps of the verified self-motion, and the length of each, rad.
const SELF_MOTION: (usize, f64) = (6, 0.05);

/// The type of one singularity by the second order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Its type; unknown where no singular posture was found near by.
    pub class: Class,
    /// Largest curvature of the end-effector's motion along ζ under unit null motion, unit-scaled.
    pub kappa_1: f64,
    /// Turning rate of ζ along the null motion.
    pub kappa_2: f64,
}

/// The singular posture that a direction leads to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lock {
    /// Its name, and the one that a second direction has there.
    pub(super) names: [Kind; 2],
    pub(super) verdict: Verdict,
    /// The strongest curvature moves the end-effector along u, not against it.
    pub(super) folds_along: bool,
}

/// A few directions of Π, zeros beyond its dimension.
type Free<const N: usize> = [Joints<N>; 3];

/// Kind and type of direction `i` of `svd`, on a copy of the arm moved onto m = 0 by Newton's method.
///
/// With V a basis of Π there and u the left null vector, κ₁ = max|eig(Vᵀ(u·H)V)| with H = ∂J/∂q, κ₂ = |ζ'| along the null motion. Type 1: κ₁ > 0.05, of
/// one sign, and with a signed measure κ₁ > 0.5 κ₂. Type 2: κ₁ ≤ 0.05 and the arm, moved along Π, stays singular with C in place. Mixed: neither.
///
/// Units κ₁, κ₂ per rad², per rad, on unit-scaled rows · Ensures [`Class::Unknown`] where Newton's method reaches no singular posture · Cost bounded,
/// about 50 µs: not for every tick; no allocation
pub(super) fn classify<const N: usize>(
    geometry: &Geometry,
    arm: &Arm<N>,
    mut svd: TrackedSvd<N>,
    i: usize,
    length_m: f64,
) -> Lock {
    let Some((arm, free, Q)) = lock(geometry, arm, &mut svd, i, length_m) else {
        return Lock {
            names: [Kind::Numeric; 2],
            verdict: Verdict::default(),
            folds_along: false,
        };
    };
    let (curvatures, _) = symmetric_eigen(&Matrix3::from_fn(|a, b| {
        0.5 * (free[a].dot(&(Q * free[b])) + free[b].dot(&(Q * free[a])))
    }));
    let (highest, lowest) = (curvatures.max().max(0.0), curvatures.min().min(0.0));
    let kappa_1 = highest.max(-lowest);
    let kappa_2 = svd.turning(&arm.0.rate(&free[0]), i, length_m).norm();
    let folds = highest.min(-lowest) <= 0.1 * kappa_1
        && !(svd.is_square() && kappa_1 <= FOLD_SHARE * kappa_2);
    let class = if kappa_1 > FOLD {
        if folds { Class::Type1 } else { Class::Mixed }
    } else if moves_itself(geometry, &arm, svd, i, free[0], length_m) {
        Class::Type2
    } else {
        Class::Mixed
    };
    Lock {
        names: geometry.names(&arm.0, &arm.1),
        verdict: Verdict {
            class,
            kappa_1,
            kappa_2,
        },
        folds_along: highest > -lowest,
    }
}

/// The arm on m = 0, Π there, and u·H; `None` where Newton's method leads to no singular posture.
fn lock<const N: usize>(
    geometry: &Geometry,
    (screws, p): &Arm<N>,
    svd: &mut TrackedSvd<N>,
    i: usize,
    length_m: f64,
) -> Option<(Arm<N>, Free<N>, SMatrix<f64, N, N>)> {
    let (mut screws, mut p) = (*screws, *p);
    let (steps, longest, zero) = NEWTON;
    for _ in 0..steps {
        let m = svd.v[i] * svd.sigma[i];
        let mut span = svd.others(i);
        let mut free = [Joints::zeros(); 3];
        for e in free.iter_mut().take(N - span.len()) {
            *e = span.any();
            span.push(*e);
        }
        let u = geometry.without_elbow(svd.covector(i), &p);
        let Q = screws.hessian(&unscaled(&u, length_m));
        if within(m.norm(), zero) {
            return Some(((screws, p), free, Q));
        }
        let gradients = free.map(|e| Q.tr_mul(&e));
        let mut gram = Matrix3::from_fn(|a, b| gradients[a].dot(&gradients[b]));
        for (k, e) in free.iter().enumerate() {
            gram[(k, k)] += if e.norm_squared() > 0.0 { 1e-9 } else { 1.0 };
        }
        let share = Cholesky::new(gram)
            .ok()?
            .solve(&Vector3::from_fn(|k, _| -m.dot(&free[k])));
        let step: Joints<N> = (0..3).map(|k| gradients[k] * share[k]).sum();
        let step = step * (longest / step.amax().max(longest));
        let (next, by) = screws.moved(&step);
        (screws, p) = (next, p + by);
        svd.track(&geometry.rows(&screws, &p, length_m));
    }
    None
}

/// Whether the arm can move on along Π with C in place and σ_i staying zero.
fn moves_itself<const N: usize>(
    geometry: &Geometry,
    start: &Arm<N>,
    mut svd: TrackedSvd<N>,
    i: usize,
    mut direction: Joints<N>,
    length_m: f64,
) -> bool {
    let (steps, length) = SELF_MOTION;
    let mut arm = *start;
    let moved = |(screws, p): &Arm<N>, by: Joints<N>, svd: &mut TrackedSvd<N>| {
        let (next, gone) = screws.moved(&by);
        let there = (next, p + gone);
        svd.track(&geometry.rows(&there.0, &there.1, length_m));
        let onwards = svd.others(i).residual(by);
        (there, onwards / onwards.norm().max(1e-12))
    };
    for _ in 0..steps {
        // Midpoint rule.
        direction = moved(&arm, direction * (0.5 * length), &mut svd.clone()).1;
        (arm, direction) = moved(&arm, direction * length, &mut svd);
    }
    let turned = steps as f64 * length;
    svd.sigma[i].abs() < 1e-2 * turned && (arm.1 - start.1).norm() < 1e-2 * turned * length_m
}
