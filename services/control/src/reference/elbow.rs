//! Type 1 reference of an elbow: θ from the distance that is desired between its two ends.

use super::{Charts, Memory, Situation, Target, planar::PlanarArm};
use crate::linear::linear;
use crate::singular::PumaFactors;
use crate::singular::geometric::{Elbow, Geometry};
use crate::types::{Mode, Singularity};

/// Damping of the feed-forward at the fold, on sin θ.
const MU: f64 = 0.01;

/// Angle from the lock within which the arm may change to the other side.
const SIDE_CHANGE: f64 = 0.02;

/// θ_d = ±acos(c_d), θ̇_ff = −ċ_d·s_d/(s_d² + μ²), s_d = sin θ_d, with c_d the cosine that the desired pose needs.
///
/// The sign is the side of the fold: kept, or taken as commanded when the arm is at the lock. Goals beyond reach project onto the boundary.
pub(super) fn target<const N: usize>(charts: &Charts, elbow: &Singularity<N>, at: &Situation<'_, N>, memory: &mut Memory) -> Target {
    let theta = elbow.aux;
    if memory.side == 0.0 {
        memory.side = if theta < 0.0 { -1.0 } else { 1.0 };
    }
    if at.branch != 0 && theta.abs() < SIDE_CHANGE {
        memory.side = f64::from(at.branch);
    }
    let [cos_d, cos_rate] = desired(charts, at);
    // Rounding at the boundary itself is not a goal beyond it: 1e-7 is 0.02 µm.
    let clipped = cos_d.abs() > 1.0 + 1e-7;
    let theta_d = memory.side * libm::acos(cos_d.clamp(-1.0, 1.0));
    let sin_d = libm::sin(theta_d);
    let rate = if clipped { 0.0 } else { -cos_rate * sin_d / (sin_d * sin_d + MU * MU) };
    Target { error: theta_d - theta, rate, weight: 1.0, mode: if clipped { Mode::Slide } else { Mode::Track }, clipped }
}

/// cos θ that the desired pose needs, and its rate: by the cosine theorem.
fn desired<const N: usize>(charts: &Charts, at: &Situation<'_, N>) -> [f64; 2] {
    let between = |S: nalgebra::Vector3<f64>, lengths: [f64; 2], offset: f64| {
        // (|p_d|² − d² − L2² − L3²)/(2 L2 L3), d the share of p along the elbow's axis.
        let (p_d, twice) = (at.desired.p - S, 2.0 * lengths[0] * lengths[1]);
        let cos_d = (p_d.norm_squared() - offset * offset - lengths[0] * lengths[0] - lengths[1] * lengths[1]) / twice;
        [cos_d, 2.0 * p_d.dot(&linear(&at.desired.V)) / twice]
    };
    match charts {
        Charts::Geometric(Geometry::SphericalShoulder { S }) => {
            let elbow = Elbow::new(S, &at.terms.p[3], &at.at.p, &at.terms.z[3]);
            between(*S, elbow.lengths, elbow.offset)
        }
        Charts::Geometric(Geometry::ParallelAxes) => PlanarArm::new(at.terms, &at.at.p).elbow_cosine(at),
        Charts::Puma(puma) => {
            let S = PumaFactors::shoulder(at.terms);
            between(S, [puma.a2, puma.L3], (at.at.p - S).dot(&at.terms.z[1]))
        }
        // Never asked: an elbow without formulas has a reference of its own.
        Charts::Numeric => [1.0, 0.0],
    }
}
