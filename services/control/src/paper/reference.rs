//! The reference of an auxiliary coordinate, and the state that a strategy keeps between ticks.

use crate::types::Mode;

/// The state that a strategy keeps of one singularity between ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Memory {
    /// Side of the singularity, sign of s_i: −1 or +1; 0 before the first tick.
    pub side: f64,
    /// Passing through with ζ off the direction of travel.
    pub passing: bool,
    /// The desired motion does not depend on ζ; at a fold, the goal slides along the boundary.
    pub holding: bool,
    /// Angle of the auxiliary coordinate while passing through, rad.
    pub passage: f64,
}

/// Where the auxiliary coordinate should be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Target {
    /// Reference minus present value, rad.
    pub error: f64,
    /// Rate of the reference, rad/s.
    pub rate: f64,
    /// Change of that rate, rad/s², where a plan has it.
    pub change: Option<f64>,
    /// Weight of the error, 0 to 1.
    pub weight: f64,
    /// The mode this amounts to inside the neighbourhood.
    pub mode: Mode,
    /// The desired pose is beyond reach.
    pub clipped: bool,
}
