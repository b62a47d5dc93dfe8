//! A commanded turn of ζ, planned and announced before anything moves (+).
//!
//! Reduces to the paper's law: the plan chooses which way round ζ is turned and predicts the motion; the turn itself is the paper's Type 2 strategy.

use crate::limits::clock::MARGIN;
use crate::linear::{Joints, largest_share};
use crate::paper::type_2::Turn;
use crate::reference::path::quintic;
use crate::singularity::family::Family;
use crate::singularity::turning::turning;
use crate::types::{Refusal, Singularity};
use model::Model;
use shared_types::scenario::Control;

/// Distance that a planned null-space motion keeps from joint limits, rad.
const LIMIT_MARGIN: f64 = 0.03;

/// Angle between directions that are one line, rad.
const SAME_LINE: f64 = 1e-3;

/// Slices of the duration's integral.
const SLICES: u32 = 64;

/// The bounds of a turn.
#[derive(Clone, Copy, Debug)]
pub struct Room<'a, const N: usize> {
    /// Joint positions, rad.
    pub q: &'a Joints<N>,
    /// The arm's limits.
    pub model: &'a Model<N>,
    /// Rate limits of the auxiliary coordinates, and whether the governor acts.
    pub control: &'a Control,
}

/// The turn of ζ by `angle` (rad); the other way round where joint limits force it and the goal is the same line.
///
/// `duration_s` is the leg's.
///
/// # Errors
/// [`Refusal::Room`] where the joint limits allow neither.
pub fn plan<const N: usize>(
    family: &Family<N>,
    s: &Singularity<N>,
    angle: f64,
    duration_s: f64,
    room: &Room<'_, N>,
) -> Result<Turn<N>, Refusal> {
    let plan = |angle: f64| {
        let by = turning(family, room.model, room.q, s, angle).filter(|by| room.holds(by))?;
        Some(Turn {
            from: s.axis(),
            angle,
            by,
            duration_s: room.duration_of(angle, &by, duration_s),
        })
    };
    let other = angle - std::f64::consts::PI.copysign(angle);
    // After half a turn the line is where it was: the other way would turn nothing.
    let is_turn = other.abs() > SAME_LINE;
    let around = || is_turn.then(|| plan(other)).flatten();
    plan(angle).or_else(around).ok_or(Refusal::Room)
}

impl<const N: usize> Room<'_, N> {
    /// Whether every joint stays within its limits.
    fn holds(&self, by: &Joints<N>) -> bool {
        let inside = |i: usize| {
            let end = self.q[i] + by[i];
            by[i] == 0.0
                || end > self.model.lower()[i] + LIMIT_MARGIN
                    && end < self.model.upper()[i] - LIMIT_MARGIN
        };
        (0..N).all(inside)
    }

    /// Duration of a turn whose time law the governor slows down where a rate would exceed its limit: ∫ max(1, demand/0.95) dt, s.
    fn duration_of(&self, angle: f64, by: &Joints<N>, planned_s: f64) -> f64 {
        let share = angle.abs() / self.control.aux_rate_max.largest();
        let share = share.max(largest_share(by, self.model.velocity()));
        if !self.control.governor {
            return planned_s;
        }
        let slice = planned_s / f64::from(SLICES);
        (0..SLICES)
            .map(|k| {
                slice
                    * (share * quintic(slice * (f64::from(k) + 0.5), planned_s)[1] / MARGIN)
                        .max(1.0)
            })
            .sum()
    }
}
