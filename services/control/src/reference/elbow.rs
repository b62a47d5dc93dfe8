//! Type 1 reference of a PUMA's elbow: θ from the desired distance of the wrist centre.

use super::{Memory, Situation, Target};
use crate::linear::linear;
use crate::singular::PumaFactors;
use crate::types::{Mode, Singularity};

/// Damping of the feed-forward at the fold, on sin θ.
const MU: f64 = 0.01;

/// Angle from the lock within which the arm may change to the other side.
const SIDE_CHANGE: f64 = 0.02;

/// θ_d = ±acos((|p_d|² − d² − a2² − L3²)/(2 a2 L3)), θ̇_ff = −(p_d·v_d)/(a2 L3)·s_d/(s_d² + μ²), s_d = sin θ_d.
///
/// The sign is the side of the fold: kept, or taken as commanded when the arm is at the lock. Goals beyond reach project onto the boundary.
pub(super) fn target<const N: usize>(puma: &PumaFactors, elbow: &Singularity<N>, at: &Situation<'_, N>, memory: &mut Memory) -> Target {
    let theta = elbow.aux;
    if memory.side == 0.0 {
        memory.side = if theta < 0.0 { -1.0 } else { 1.0 };
    }
    if at.branch != 0 && theta.abs() < SIDE_CHANGE {
        memory.side = f64::from(at.branch);
    }
    let S = PumaFactors::shoulder(at.terms);
    let (p, p_d) = (at.at.p - S, at.desired.p - S);
    let offset = p.dot(&at.terms.z[1]);
    let twice = 2.0 * puma.a2 * puma.L3;
    let cos_d = (p_d.norm_squared() - offset * offset - puma.a2 * puma.a2 - puma.L3 * puma.L3) / twice;
    // Rounding at the boundary itself is not a goal beyond it: 1e-7 is 0.02 µm.
    let clipped = cos_d.abs() > 1.0 + 1e-7;
    let theta_d = memory.side * libm::acos(cos_d.clamp(-1.0, 1.0));
    let sin_d = libm::sin(theta_d);
    let rate = if clipped { 0.0 } else { -2.0 * p_d.dot(&linear(&at.desired.V)) / twice * sin_d / (sin_d * sin_d + MU * MU) };
    Target { error: theta_d - theta, rate, weight: 1.0, mode: if clipped { Mode::Slide } else { Mode::Track }, clipped }
}
