//! Foresight: the rates that the path ahead demands, so that the governor brakes in time (+).
//!
//! Reduces to the paper's law: a path whose demands stay below 0.95 leaves the clock at full speed (proof:
//! `a_feasible_path_runs_at_full_clock_speed`).

use model::{Pose, Terms};
use nalgebra::{SVector, Vector3};
use shared_types::scenario::BySingularity;

/// Stretches of the path that are looked at.
pub const FORESEEN: usize = 10;

/// Step of the path's clock between them, s.
pub const FORESEEN_STEP_S: f64 = 0.025;

/// Demand of the path ahead at full clock speed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Foreseen {
    /// Largest share of any rate limit on each stretch, [`FORESEEN_STEP_S`] long.
    pub demand: [f64; FORESEEN],
}

/// The arm and its path ahead.
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
    pub rate_max: &'a BySingularity,
    /// Exit thresholds on |s_i|.
    pub eta_out: &'a BySingularity,
    /// Whether the wrist is being passed with ζ off the direction of travel.
    pub passing: bool,
}
