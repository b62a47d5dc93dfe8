//! Combinations of two lost directions: which of a plane of them is followed.

use crate::linear::{angular, linear, wrap_line};
use crate::types::{Class, Kind};
use nalgebra::{SVector, Vector3};

/// Share of rotation in u² above which ζ is a rotation, below which a translation, far from the neighbourhood: at a wrist, at an elbow or a shoulder,
/// and at what has no name. In it, where that changes only before the half that is left vanishes.
const ANGULAR: [(f64, f64); 4] = [(0.1, 0.05), (0.95, 0.9), (0.6, 0.4), (0.98, 0.02)];

pub(super) fn is_set<const N: usize>(a: &SVector<f64, N>) -> bool {
    a.norm_squared() > 0.0
}

/// Left null vector `u` without what has been given the directions ζ before it, each a pair of ζ and its own u, on scaled rows.
///
/// Where two directions are lost any two vectors span them: both may be largest in the same half, along the same axis, and the rows that are kept then
/// lack one. u − u_1·(ζ_1ᵀu)/(ζ_1ᵀu_1) is lost just as u is, and has nothing along ζ_1.
pub(super) fn apart(
    u: SVector<f64, 6>,
    before: &[(SVector<f64, 6>, SVector<f64, 6>)],
) -> SVector<f64, 6> {
    before.iter().fold(u, |u, (zeta, other)| {
        let own = zeta.dot(other);
        if own.abs() < 0.1 {
            u
        } else {
            u - other * (zeta.dot(&u) / own)
        }
    })
}

/// The half of u that ζ takes, whether it is the rotation, and its vector; `is_settled` inside a neighbourhood, `was_angular` at the tick before.
pub(super) fn larger_half(
    u: &SVector<f64, 6>,
    kind: Kind,
    is_settled: bool,
    was_angular: bool,
) -> (bool, Vector3<f64>) {
    let (u_v, u_w) = (linear(u), angular(u));
    let (above, below) = match (is_settled, kind) {
        (true, _) => ANGULAR[3],
        (_, Kind::Wrist) => ANGULAR[0],
        (_, Kind::Elbow | Kind::Shoulder) => ANGULAR[1],
        _ => ANGULAR[2],
    };
    let share = u_w.norm_squared() / (u_v.norm_squared() + u_w.norm_squared()).max(1e-12);
    let is_angular = share > if was_angular { below } else { above };
    (is_angular, if is_angular { u_w } else { u_v })
}

/// Where the auxiliary row should be inside, in the axes a and b: strongest curvature, or the self-motion. `None`: as it is.
pub(super) fn preferred(class: Class, [aa, ab, bb]: [f64; 3]) -> Option<[f64; 2]> {
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
        Class::Type1 => strongest,
        Class::Mixed if mean.abs() < radius => {
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
        _ => return None,
    };
    let (sin, cos) = libm::sincos(angle);
    Some([cos, sin])
}

/// The combination of two motions that turns ζ fastest, from its rates along each. `None` where neither turns it.
pub(super) fn strongest([one, two]: [Vector3<f64>; 2]) -> Option<[f64; 2]> {
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
pub(super) fn towards<const N: usize>(
    a: &SVector<f64, N>,
    target: &SVector<f64, N>,
    angle: f64,
) -> SVector<f64, N> {
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

pub(super) fn unscaled(u: &SVector<f64, 6>, length_m: f64) -> SVector<f64, 6> {
    let mut a = *u;
    a.fixed_rows_mut::<3>(0).scale_mut(1.0 / length_m);
    a
}
