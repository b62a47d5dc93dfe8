//! Thresholds of directions that are found by number, and the fold's reference that they share.

use super::family::Situation;
use crate::paper::type_1::Fold;
use crate::types::Singularity;

/// |s| over η_out below which a direction is classified, and beyond which its type is given up: a hysteresis outside of the neighbourhood.
pub(super) const LATCH: (f64, f64) = (1.3, 1.6);

/// Damping of squared singular values, unit-scaled, where two of them cross: σ = 0.01 is far below any in the arm's regular postures.
pub(super) const SQUARED_GAP: f64 = 1e-4;

/// Damping of a fold's feed-forward, in the units of its coordinate: rad, or of s.
const FOLD_DAMPING: f64 = 0.02;

/// Square of a fold's coordinate below zero at which the desired pose is beyond reach, not only rounded.
const BEYOND_REACH: f64 = -1e-7;

/// The coordinate x of a fold as the desired pose needs it: x_d² = x² + 2ζᵀe/h, because the motion along ζ is h·x²/2.
///
/// `inverse_curvature` is 1/h, 1/m or 1/rad by ζ's half · Ensures a size of 0 and no rate where the desired pose is beyond reach · Errors none · Cost
/// O(1), no allocation
pub(super) fn fold<const N: usize>(
    x: f64,
    inverse_curvature: f64,
    s: &Singularity<N>,
    at: &Situation<'_, N>,
) -> Fold {
    let square = x * x + 2.0 * inverse_curvature * s.zeta_B.dot(at.error);
    let (clipped, size) = (square < BEYOND_REACH, square.max(0.0).sqrt());
    let damped = size * size + FOLD_DAMPING * FOLD_DAMPING;
    let rate = if clipped {
        0.0
    } else {
        inverse_curvature * s.zeta_B.dot(&at.desired.V) * size / damped
    };
    Fold {
        x,
        size,
        rate,
        clipped,
    }
}
