//! Type 2: null-space motion only turns ζ_i. It is held constant, or driven to ζ_id by a potential [CK95 §4].

use super::reference::Target;
use crate::linear::{Joints, Vector3};
use crate::types::{Mode, Singularity};

/// Turning rate of ζ per null motion, rad per rad, below which it cannot be turned.
pub const TURNS: f64 = 0.05;

/// ζ_i held constant: the coordinate stays where it is.
///
/// Source CK95 §4, Type 2
#[must_use]
pub fn held() -> Target {
    Target {
        mode: Mode::Hold,
        ..Target::default()
    }
}

/// A commanded turn of ζ_i by null-space motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn<const N: usize> {
    /// ζ when it began.
    pub from: Vector3,
    /// The whole angle, rad.
    pub angle: f64,
    /// Predicted motion of each joint, rad.
    pub by: Joints<N>,
    /// Predicted duration, s; 0 before it begins.
    pub duration_s: f64,
}

impl<const N: usize> Turn<N> {
    /// No turn.
    pub fn none() -> Self {
        Self {
            from: Vector3::zeros(),
            angle: 0.0,
            by: Joints::zeros(),
            duration_s: 0.0,
        }
    }

    /// The target that turns ζ_i to ζ_id.
    ///
    /// `share` of the way, 0 to 1, and its rate `share_rate`, 1/s of the path's clock, whose speed is `clock`. Requires the singularity's κ₂ to be the
    /// turning rate of ζ per auxiliary coordinate; |κ₂| ≤ 0.05 counts as one. Ensures an error in (−π, π]/κ₂ · Errors none · Cost O(1)
    pub fn target(&self, s: &Singularity<N>, share: f64, share_rate: f64, clock: f64) -> Target {
        let turned = turned(s, &self.from);
        let wanted = self.angle * share;
        // `turned` is known up to whole turns: the nearest one is meant.
        let error = crate::linear::wrap_angle(wanted - turned);
        // From angles of ζ to the auxiliary coordinate.
        let per_aux = if s.kappa_2.abs() > TURNS {
            s.kappa_2
        } else {
            1.0
        };
        let rate = self.angle * share_rate * clock;
        Target {
            error: error / per_aux,
            rate: rate / per_aux,
            weight: 1.0,
            mode: Mode::Reorient,
            ..Target::default()
        }
    }
}

/// Angle through which ζ_i has turned since `from`, in (−π, π], about the second axis of its singular frame.
fn turned<const N: usize>(s: &Singularity<N>, from: &Vector3) -> f64 {
    let (zeta, axis) = (s.axis(), s.R_BS.column(1).into_owned());
    libm::atan2(axis.dot(&from.cross(&zeta)), from.dot(&zeta))
}
