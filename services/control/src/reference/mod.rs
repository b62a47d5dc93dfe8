//! What the auxiliary coordinate of a singularity should do, so that the desired pose is met as soon as the arm can meet it.
//!
//! Type 1: the coordinate whose square is the distance to the boundary, from the distance that is desired. Type 2: the angle of ζ, from the
//! direction in which the desired motion leaves the singularity. Arms without formulas use [`numeric`], from the report alone.

mod elbow;
mod forearm;
mod numeric;
mod overhead;
mod planar;
mod predict;
mod wrist;

use crate::centre::{AtCentre, PoseMotion};
use crate::linear::wrap_line;
use crate::singular::{Geometry, PumaFactors};
use crate::trajectory::{Ahead, Foreseen};
use crate::types::{Kind, Mode, Singularity};
use model::{Pose, Terms};
use nalgebra::{SVector, Vector3, Vector6};

/// What a reference is computed from.
#[derive(Clone, Copy, Debug)]
pub struct Situation<'a, const N: usize> {
    /// Joint positions, rad.
    pub q: &'a SVector<f64, N>,
    /// The model's terms.
    pub terms: &'a Terms<N>,
    /// Kinematics at C.
    pub at: &'a AtCentre<N>,
    /// Desired motion of C.
    pub desired: &'a PoseMotion,
    /// Its twist if the clock ran at full speed.
    pub V_nominal: &'a Vector6<f64>,
    /// The rest of the path's leg.
    pub ahead: &'a Ahead,
    /// Pose error at C, `[p_d − p; log(R_d Rᵀ)]`.
    pub error: &'a Vector6<f64>,
    /// Joint limits, rad.
    pub lower: &'a SVector<f64, N>,
    /// Joint limits, rad.
    pub upper: &'a SVector<f64, N>,
    /// Posture to leave a Type 1 singularity in: −1, +1, or 0 to keep.
    pub branch: i32,
    /// Largest auxiliary rate, rad/s.
    pub rate_max: f64,
    /// Whether the governor may slow the path down.
    pub governed: bool,
}

/// What can be seen of the path ahead.
#[derive(Clone, Copy, Debug)]
pub struct Foresight<'a, const N: usize> {
    /// Joint positions, rad.
    pub q: &'a SVector<f64, N>,
    /// The model's terms.
    pub terms: &'a Terms<N>,
    /// Position of C, m.
    pub p_C: Vector3<f64>,
    /// Desired poses of C at equal steps of the path's clock, from now on.
    pub poses: &'a [Pose],
    /// The step, s.
    pub step_s: f64,
    /// Speed limits, rad/s.
    pub velocity: &'a SVector<f64, N>,
    /// Largest auxiliary rates, rad/s.
    pub rate_max: [f64; 3],
    /// Exit thresholds.
    pub eta_out: [f64; 3],
}

/// What a reference remembers from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Memory {
    /// Side of a fold: −1 or +1; 0 before the first tick.
    pub side: f64,
    /// Passing through with ζ off the direction of travel.
    pub passing: bool,
    /// The desired motion says nothing about ζ.
    pub holding: bool,
    /// Angle of ζ's companion in the forearm while passing through, rad.
    pub passage: f64,
}

/// Where the auxiliary coordinate should be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Target {
    /// Reference minus present value, rad.
    pub error: f64,
    /// Rate of the reference, rad/s.
    pub rate: f64,
    /// How much the error is to be believed, 0 to 1.
    pub weight: f64,
    /// What this amounts to, while inside.
    pub mode: Mode,
    /// The desired pose is beyond reach.
    pub clipped: bool,
}

/// Computes targets: by formula where the arm has one, else from the report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Charts {
    /// A PUMA's.
    Puma(PumaFactors),
    /// Those of an arm whose axes say what it is.
    Geometric(Geometry),
    /// Any arm's.
    Numeric,
}

impl Charts {
    /// Largest share of any rate limit on each stretch of the path ahead, where the arm has formulas; else nothing is foreseen.
    pub fn foresee<const N: usize>(&self, at: &Foresight<'_, N>, wrist: &Memory, out: &mut Foreseen) {
        match self {
            Self::Puma(puma) => forearm::foresee(puma, at, wrist, out),
            Self::Geometric(Geometry::ParallelAxes) => planar::foresee(at, wrist, out),
            Self::Geometric(Geometry::SphericalShoulder { .. }) | Self::Numeric => {}
        }
    }

    /// The target of one singularity's auxiliary coordinate.
    pub fn target<const N: usize>(&self, singularity: &Singularity<N>, at: &Situation<'_, N>, memory: &mut Memory) -> Target {
        match (self, singularity.kind) {
            (Self::Numeric, _) | (_, Kind::Numeric) => numeric::target(singularity, at, memory),
            (Self::Geometric(Geometry::SphericalShoulder { .. }), Kind::Wrist) => numeric::target(singularity, at, memory),
            (_, Kind::Elbow) => elbow::target(self, singularity, at, memory),
            (_, Kind::Wrist) => wrist::target(self, singularity, at, memory),
            (_, Kind::Overhead) => overhead::target(at, memory),
        }
    }
}

/// The smallest turn that brings the direction `from` onto the line of `to`, about `normal`, in (−π/2, π/2].
fn line_angle(from: &Vector3<f64>, to: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
    wrap_line(libm::atan2(normal.dot(&from.cross(to)), from.dot(to)))
}
