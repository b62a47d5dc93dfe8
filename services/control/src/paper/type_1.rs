//! Type 1: null-space motion moves the end-effector along ζ_i, so s_i is a task coordinate.
//!
//! At a fold the distance along ζ_i is even in the coordinate x (the elbow angle θ, or s_i itself): two values ±|x_d| meet a desired distance, and
//! their sign is the posture. Into the singularity: x → 0. Out of it: by the rate, whose sign chooses the posture [CK95 §4].

use super::reference::{Memory, Target};
use crate::types::Mode;

/// Coordinate (rad, or of s_i) within which the arm may change to the other side.
pub const SIDE_CHANGE: f64 = 0.02;

/// The fold's coordinate as the desired pose needs it, on either side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fold {
    /// Present value x of the coordinate.
    pub x: f64,
    /// |x_d|; 0 where the desired pose is beyond reach.
    pub size: f64,
    /// Rate of |x_d|, 1/s.
    pub rate: f64,
    /// The desired pose is beyond reach and has been projected onto the boundary.
    pub clipped: bool,
}

impl Fold {
    /// A fold at `x` to be opened by `size` = |x_d|, where what opens it grows by `growth` = slope·d|x_d|/dt, 1/s: rate = growth·slope/(slope² +
    /// damping²), and 0 beyond reach.
    pub(crate) fn new(
        x: f64,
        size: f64,
        growth: f64,
        slope: f64,
        damping: f64,
        clipped: bool,
    ) -> Self {
        let rate = growth * slope / (slope * slope + damping * damping);
        Self {
            x,
            size,
            rate: if clipped { 0.0 } else { rate },
            clipped,
        }
    }
}

/// The coordinate's target on its side: x_d = side·|x_d|.
///
/// The side is kept, or taken from `branch` (−1, +1; 0: keep) in the neighbourhood of the singularity. Goals beyond reach slide along the boundary, and a goal
/// on the boundary itself does so until it has left it by 0.02: noise does not change the mode.
///
/// Units those of `fold.x` (rad for an elbow angle, 1 for s_i) · Requires `memory.side` = ±1 · Ensures sign x_d = side and a finite target for a finite
/// `fold` · Errors none · Source CK95 §4, Type 1 · Cost O(1), no allocation
pub fn on_side(fold: &Fold, is_inside: bool, branch: i32, memory: &mut Memory) -> Target {
    if branch != 0 && is_inside {
        memory.side = f64::from(branch);
    }
    memory.holding = fold.clipped || memory.holding && fold.size < SIDE_CHANGE;
    Target {
        error: memory.side * fold.size - fold.x,
        rate: memory.side * fold.rate,
        weight: 1.0,
        mode: if memory.holding {
            Mode::Slide
        } else {
            Mode::Track
        },
        clipped: fold.clipped,
        ..Target::default()
    }
}
