//! The elbow of any arm with formulas: measure and Type 1 reference from two lengths and the angle between them.

use super::axes::frame;
use super::family::Posture;
use crate::centre::PoseMotion;
use crate::linear::{Joints, Vector3, linear, stack, unit};
use crate::paper::type_1::Fold;
use crate::types::{Class, Kind, Singularity};
use model::Terms;

/// Damping of the feed-forward at the fold, on sin θ.
const MU: f64 = 0.01;

/// The elbow's singularity: ζᵀJ = −fold·sin θ·θ̇ modulo the other rows. Type 1: θ moves C along ζ at second order, by fold/2 per rad².
///
/// `zeta` unit, `towards` the second axis of its frame, both in B; `theta` rad from full stretch; `fold` = L2 L3/ρ, m; `row` the gradient of θ.
#[inline]
pub(super) fn measure<const N: usize>(
    (zeta, towards): (&Vector3, &Vector3),
    (theta, theta_rate): (f64, f64),
    fold: f64,
    row: Joints<N>,
) -> Singularity<N> {
    let (sin, cos) = libm::sincos(theta);
    Singularity {
        kind: Kind::Elbow,
        class: Class::Type1,
        s: sin,
        s_rate: cos * theta_rate,
        zeta_B: stack(zeta, &Vector3::zeros()),
        R_BS: frame(zeta, towards),
        gain: -fold * sin,
        aux: theta,
        aux_rate: theta_rate,
        aux_row: row,
        kappa_1: fold,
        ..Singularity::none()
    }
}

/// cos θ that puts C at the desired place, and its rate (1/s): (|p_d|² − d² − L2² − L3²)/(2 L2 L3), d the share of p along the elbow's axis.
pub(super) fn cosine(
    S: &Vector3,
    desired: &PoseMotion,
    lengths: [f64; 2],
    offset: f64,
) -> [f64; 2] {
    let (p_d, twice) = (desired.p - S, 2.0 * lengths[0] * lengths[1]);
    let cos_d =
        (p_d.norm_squared() - offset * offset - lengths[0] * lengths[0] - lengths[1] * lengths[1])
            / twice;
    [cos_d, 2.0 * p_d.dot(&linear(&desired.V)) / twice]
}

/// The elbow's fold.
///
/// |θ_d| = acos(c_d), its rate −ċ_d·s_d/(s_d² + μ²), s_d = sin |θ_d|, with c_d the cosine that the desired pose needs.
///
/// Units rad, rad/s · Ensures |θ_d| in [0, π], and `clipped` where |c_d| > 1 · Errors none
pub(super) fn fold(theta: f64, [cos_d, cos_rate]: [f64; 2]) -> Fold {
    // Rounding at the boundary itself is not a goal beyond it: 1e-7 is 0.02 µm.
    let clipped = cos_d.abs() > 1.0 + 1e-7;
    let size = libm::acos(cos_d.clamp(-1.0, 1.0));
    Fold::new(theta, size, -cos_rate, libm::sin(size), MU, clipped)
}

/// Upper arm and forearm in the plane normal to an elbow's axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bend {
    /// From the shoulder to the elbow, and on to the wrist, m.
    pub(super) upper: Vector3,
    pub(super) forearm: Vector3,
    /// Their lengths, m.
    pub(super) lengths: [f64; 2],
    /// Angle from full stretch, (−π, π].
    pub(super) theta: f64,
}

impl Bend {
    /// From the two links in space and the unit axis n.
    pub(super) fn new(upper: Vector3, forearm: Vector3, n: &Vector3) -> Self {
        let across = |v: Vector3| v - n * n.dot(&v);
        let (upper, forearm) = (across(upper), across(forearm));
        Self {
            upper,
            forearm,
            lengths: [upper.norm(), forearm.norm()],
            theta: libm::atan2(n.dot(&upper.cross(&forearm)), upper.dot(&forearm)),
        }
    }
}

/// The elbow of joint 4 between a shoulder's centre S, where axes 1 to 3 meet, and a wrist's centre C, where axes 5 to 7 do: joints 1 to 3 move C on a
/// sphere about S, so that pᵀJ = −L2 L3 sin θ·e4 exactly, with p = C − S and all lengths in the plane normal to the elbow's axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BetweenCentres {
    /// C − S, m.
    p: Vector3,
    bend: Bend,
    /// p along the elbow's axis, m.
    offset: f64,
}

impl BetweenCentres {
    pub(super) fn new<const N: usize>(S: &Vector3, terms: &Terms<N>, C: &Vector3) -> Self {
        let (n, E) = (terms.z[3], terms.p[3]);
        Self {
            p: C - S,
            bend: Bend::new(E - S, C - E, &n),
            offset: (C - S).dot(&n),
        }
    }

    /// C cannot move along the line from S to it. Type 1.
    pub(super) fn measure<const N: usize>(&self, at: &Posture<'_, N>) -> Singularity<N> {
        let length = self.p.norm();
        let zeta = if length > 1e-9 {
            self.p / length
        } else {
            at.terms.z[2]
        };
        let [L2, L3] = self.bend.lengths;
        let fold = L2 * L3 / length.max(1e-9);
        measure(
            (&zeta, &at.terms.z[3]),
            (self.bend.theta, at.qdot[3]),
            fold,
            unit(3),
        )
    }

    pub(super) fn cosine(&self, S: &Vector3, desired: &PoseMotion) -> [f64; 2] {
        cosine(S, desired, self.bend.lengths, self.offset)
    }
}
