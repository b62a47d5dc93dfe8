//! References for any arm, from the report alone.

use super::{Memory, Situation, Target};
use crate::types::{Class, Mode, Singularity};

/// Damping on s.
const MU: f64 = 0.02;

/// Type 1: s_d² = s² + 2ζᵀe/h, the second-order motion x = h·s²/2 along ζ, with h = gain/s. Type 2 and mixed: ζ held.
pub(super) fn target<const N: usize>(singularity: &Singularity<N>, at: &Situation<'_, N>, memory: &mut Memory) -> Target {
    let s = singularity.s;
    if memory.side == 0.0 {
        memory.side = if s < 0.0 { -1.0 } else { 1.0 };
    }
    if singularity.class != Class::Type1 {
        return Target { mode: Mode::Hold, ..Target::default() };
    }
    if at.branch != 0 && s.abs() < 0.02 {
        memory.side = f64::from(at.branch);
    }
    // s is never exactly zero; gain vanishes with it.
    let curvature = s / singularity.gain;
    if !curvature.is_finite() {
        return Target { mode: Mode::Hold, ..Target::default() };
    }
    let square = s * s + 2.0 * curvature * singularity.zeta_B.dot(at.error);
    let clipped = square < -1e-7;
    let s_d = memory.side * square.max(0.0).sqrt();
    let rate = curvature * singularity.zeta_B.dot(&at.desired.V) * s_d / (s_d * s_d + MU * MU);
    let mode = if clipped { Mode::Slide } else { Mode::Track };
    Target { error: s_d - s, rate: if clipped { 0.0 } else { rate }, weight: 1.0, mode, clipped }
}
