//! The auxiliary row of a singular direction, turned towards the direction that its type asks for.
//!
//! It is turned towards ±m outside η_in, at a bounded rate, and *is* ±m beyond η_out. The motion along ζ is x = mᵀy + yᵀCy/2 for y in Π, C the
//! curvature (u·H restricted to Π). Its eigenvalues give the type, and that the direction inside:
//!
//! | C | type | a | reference |
//! |---|---|---|---|
//! | definite, or all but zero on one side | 1: a fold | strongest curvature | y_d² = y² + 2ζᵀe/h |
//! | indefinite | mixed | self-motion, aᵀCa = 0 | it is followed away from the lock: x stays, and \|m\| = \|Ca\|·y grows |
//! | zero | 2 | what turns ζ fastest | ζ is turned until what is left of the path is orthogonal to it |
//!
//! Of types 2 and mixed this is so at the lock only, |s| < [`FOUND`]; beyond it a is turned towards ±m, by which the path is followed.

use crate::linear::{Basis, Joints, Vector3, sign, wrap_line};
use crate::paper::neighborhood::Neighborhood;
use crate::types::Class;
use nalgebra::SMatrix;
use shared_types::bounds::within;

/// Most that a turns in Π at a tick, rad: inside η_in, and beyond it in addition at full openness.
const TURN: (f64, f64) = (0.01, 1.6);

/// Length below which a projected direction is undefined.
pub(super) const UNDEFINED: f64 = 0.05;

/// s beyond which m has a direction.
pub(super) const FOUND: f64 = 0.002;

/// A singular direction at one tick, as the turn of its auxiliary row depends on it.
pub(super) struct Turn<'a, const N: usize> {
    pub(super) class: Class,
    pub(super) s: f64,
    pub(super) near: Neighborhood,
    /// σ·v, the direction in which the posture is off the singular one.
    pub(super) m: Joints<N>,
    pub(super) v: Joints<N>,
    /// u·H, whose symmetric part on Π is the curvature C.
    pub(super) Q: &'a SMatrix<f64, N, N>,
    /// At the first tick, when nothing depends on a yet; never with one direction alone, whose sign is that of s.
    pub(super) begins: bool,
}

impl<const N: usize> Turn<'_, N> {
    /// The auxiliary row `a`, turned within Π, and the mixed curvature aᵀCb·b with b the rest of Π (one direction where there is one spare joint).
    ///
    /// `others` are the directions orthogonal to Π, `None` where the direction is not classified: a is not turned there. `zeta_rate` is how ζ turns
    /// along a joint motion, 1/rad. Shapes N · Units curvature 1/rad² on unit-scaled rows · Requires the a of the last tick, carried · Ensures |a| = 1,
    /// turned by at most [`TURN`] · Errors none · Cost O(N²), no allocation
    pub(super) fn of(
        &self,
        mut a: Joints<N>,
        others: Option<Basis<N>>,
        zeta_rate: impl Fn(&Joints<N>) -> Vector3,
    ) -> (Joints<N>, Joints<N>) {
        let mut curvature_b = Joints::<N>::zeros();
        if let Some(mut others) = others {
            let mut basis = others;
            basis.push(a);
            let b = basis.any();
            if self.s < self.near.eta_out {
                let in_plane = |[x, y]: [f64; 2]| a * x + b * y;
                // Inside, a fold has a coordinate of its own.
                let is_fold = self.class == Class::Type1;
                let found = if is_fold { self.near.eta_in } else { FOUND };
                let target = match self.class {
                    _ if self.s > found => Some(others.residual(self.m)),
                    Class::Type2 => strongest([&a, &b].map(&zeta_rate)).map(in_plane),
                    class => preferred(
                        class,
                        [
                            a.dot(&(self.Q * a)),
                            self.mixed(&a, &b),
                            b.dot(&(self.Q * b)),
                        ],
                    )
                    .map(in_plane),
                };
                if let Some(target) = target {
                    let openness = self.near.openness(self.s);
                    a = towards(
                        &a,
                        &target,
                        if self.begins {
                            TURN.1
                        } else {
                            TURN.0 + TURN.1 * openness
                        },
                    );
                }
            }
            if self.begins {
                // Of the two signs the one that another analyzer of this posture finds, too.
                a *= sign(a[a.icamax()] > 0.0);
            }
            others.push(a);
            let b = others.any();
            curvature_b = b * self.mixed(&a, &b);
        }
        // Where directions cross, what is left of a can have no length: it begins anew at the direction that is lost.
        if within(a.amax(), 2.0) {
            (a, curvature_b)
        } else {
            (self.v, Joints::zeros())
        }
    }

    /// aᵀCb.
    fn mixed(&self, a: &Joints<N>, b: &Joints<N>) -> f64 {
        0.5 * (a.dot(&(self.Q * b)) + b.dot(&(self.Q * a)))
    }
}

/// |mean| of the curvatures over their half difference from which on they are of one sign, or all but: a fold.
const ONE_SIDED: f64 = 0.8;

/// Where the auxiliary row should be inside, in the axes a and b: strongest curvature, or the self-motion. `None`: as it is.
fn preferred(class: Class, [aa, ab, bb]: [f64; 3]) -> Option<[f64; 2]> {
    // C = mean + radius·cos 2(ψ − ψ₀).
    let (mean, half) = (0.5 * (aa + bb), 0.5 * (aa - bb));
    let radius = libm::hypot(half, ab);
    if radius < 1e-6 {
        return None;
    }
    let strongest = 0.5 * libm::atan2(ab, half)
        + if mean < 0.0 {
            std::f64::consts::FRAC_PI_2
        } else {
            0.0
        };
    let angle = match class {
        Class::Mixed if mean.abs() < ONE_SIDED * radius => {
            let away = 0.5 * libm::acos((-mean / radius).clamp(-1.0, 1.0));
            let first = 0.5 * libm::atan2(ab, half);
            // The nearer of the two self-motions.
            let off = |angle: f64| wrap_line(angle).abs();
            if off(first + away) < off(first - away) {
                first + away
            } else {
                first - away
            }
        }
        _ => strongest,
    };
    let (sin, cos) = libm::sincos(angle);
    Some([cos, sin])
}

/// The combination of two motions that turns ζ fastest, from its rates along each. `None` where neither turns it.
fn strongest([one, two]: [Vector3; 2]) -> Option<[f64; 2]> {
    let (half, cross) = (
        0.5 * (one.norm_squared() - two.norm_squared()),
        one.dot(&two),
    );
    if libm::hypot(half, cross) < 1e-6 {
        return None;
    }
    let (sin, cos) = libm::sincos(0.5 * libm::atan2(cross, half));
    Some([cos, sin])
}

/// `a` turned by at most `angle` towards the line of `target`.
fn towards<const N: usize>(a: &Joints<N>, target: &Joints<N>, angle: f64) -> Joints<N> {
    let size = target.norm();
    if size <= 1e-9 || size.is_nan() {
        return *a;
    }
    let cos = a.dot(target) / size;
    let target = if cos < 0.0 {
        -target / size
    } else {
        target / size
    };
    let across = target - a * cos.abs();
    let sin = across.norm();
    if sin < 1e-12 {
        return *a;
    }
    let by = libm::atan2(sin, cos.abs()).min(angle);
    let (sin_by, cos_by) = libm::sincos(by);
    (a * cos_by + across * (sin_by / sin)).normalize()
}
