//! The commanded path, followed by the judge itself. Of the controller it takes the path's time alone, and holds it to
//! the rules of a clock: it never goes back, runs no faster than the run, and comes to the path's end.

use control::{GroundTruth, Progress};
use model::Pose;
use nalgebra::{Matrix3, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use shared_types::PlantState;
use shared_types::bounds::within;

/// Path time that a controller may be short of the end by rounding, s.
const ROUNDING_S: f64 = 1e-6;
/// Share of the path that may pass in ticks without a whole account, such as messages that a fault has dropped.
const MOST_UNSEEN: f64 = 0.25;

/// Where the judge is on the path. What a replacement of the recorder goes on from.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct PathMeter {
    place: Option<Place>,
    clock: PathClock,
    /// The first segment that was to turn ζ where no direction was lost.
    idle: Option<usize>,
}

/// [`Progress`] as a checkpoint holds it.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Place {
    leg: usize,
    time_s: f64,
    begun: bool,
    R: [[f64; 3]; 3],
    p: [f64; 3],
    by: [f64; 3],
    turn: [f64; 3],
}

impl From<&Progress> for Place {
    fn from(progress: &Progress) -> Self {
        Self {
            leg: progress.leg,
            time_s: progress.time_s,
            begun: progress.begun,
            R: progress.start.R.into(),
            p: progress.start.p.into(),
            by: progress.by.into(),
            turn: progress.turn.into(),
        }
    }
}

impl From<&Place> for Progress {
    fn from(place: &Place) -> Self {
        Self {
            leg: place.leg,
            time_s: place.time_s,
            begun: place.begun,
            start: Pose {
                R: Matrix3::from(place.R),
                p: Vector3::from(place.p),
            },
            by: place.by.into(),
            turn: place.turn.into(),
        }
    }
}

impl PathMeter {
    /// At the path's start; in a steered run there is none.
    pub(super) fn new(truth: &dyn GroundTruth) -> Self {
        Self {
            place: truth.start().as_ref().map(Place::from),
            ..Self::default()
        }
    }

    /// The true pose's error against the path at the time that the controller states, `[p_d − p; log(R_d Rᵀ)]`; m, rad.
    /// `None`: there is no path. `dt_s`: length of a tick.
    pub(super) fn error(
        &mut self,
        truth: &dyn GroundTruth,
        path_time_s: f64,
        dt_s: f64,
        state: &PlantState,
    ) -> Option<Vector6<f64>> {
        let place = self.place.as_mut()?;
        let by_s = self.clock.take(state.header.tick, path_time_s, dt_s);
        let mut progress = Progress::from(&*place);
        let idle = truth.advance(&mut progress, by_s);
        self.idle = self.idle.or(idle);
        *place = Place::from(&progress);
        Some(truth.error(&progress, state))
    }

    /// What the controller did with its clock that no controller may; `is_done`: it has said that its task is done.
    pub(super) fn breach(&self, truth: &dyn GroundTruth, is_done: bool) -> Option<String> {
        self.place?;
        let (came_s, all_s) = (self.clock.time_s, truth.duration_s());
        if let Some((tick, from_s, to_s)) = self.clock.breach {
            return Some(format!(
                "the controller moved the path's time from {from_s:.3} s to {to_s:.3} s by tick {tick}: it may only run on, at most as fast as the run"
            ));
        }
        let unseen_s = self.clock.unseen_s;
        if !within(unseen_s, MOST_UNSEEN * all_s) {
            return Some(format!(
                "the path's time ran on by {unseen_s:.3} s of {all_s:.3} s in ticks in which the controller said nothing"
            ));
        }
        if let Some(segment) = self.idle {
            return Some(format!(
                "segment {segment} was to turn a singular direction, but began outside of the singularity's neighbourhood: nothing was turned"
            ));
        }
        (is_done && came_s < all_s - ROUNDING_S).then(|| {
            format!("the controller ended at {came_s:.3} s of a path that takes {all_s:.3} s")
        })
    }
}

/// The path's time as a controller states it.
#[derive(Debug, Default, Serialize, Deserialize)]
struct PathClock {
    time_s: f64,
    /// Tick of the last statement.
    last: Option<u64>,
    /// The first breach: its tick, and the times before and after.
    breach: Option<(u64, f64, f64)>,
    /// Time that passed on the path in ticks of which no whole account came, s.
    unseen_s: f64,
}

impl PathClock {
    /// The time that passes on the path up to a tick, s: as the controller states it, within the rules.
    fn take(&mut self, tick: u64, time_s: f64, dt_s: f64) -> f64 {
        let ticks = self.last.map_or(tick + 1, |last| tick.saturating_sub(last));
        let most_s = ticks as f64 * dt_s * (1.0 + 1e-6) + 1e-9;
        let by_s = time_s - self.time_s;
        // A NaN is in no range.
        if !(-1e-9..=most_s).contains(&by_s) && self.breach.is_none() {
            self.breach = Some((tick, self.time_s, time_s));
        }
        if ticks > 1 && self.last.is_some() {
            self.unseen_s += (by_s - dt_s).clamp(0.0, most_s);
        }
        self.last = Some(tick);
        let by_s = if by_s > 0.0 { by_s.min(most_s) } else { 0.0 };
        self.time_s += by_s;
        by_s
    }
}

#[cfg(test)]
mod tests {
    use super::PathClock;

    fn clock(times: &[f64]) -> PathClock {
        let mut clock = PathClock::default();
        for (tick, time_s) in times.iter().enumerate() {
            clock.take(tick as u64, *time_s, 1e-3);
        }
        clock
    }

    #[test]
    fn a_clock_that_waits_and_runs_on_is_one() {
        let clock = clock(&[0.0, 1e-3, 1e-3, 1.5e-3, 2.5e-3]);
        assert_eq!(clock.breach, None);
        assert!((clock.time_s - 2.5e-3).abs() < 1e-12);
    }

    #[test]
    fn time_that_passes_while_nothing_is_said_is_counted() {
        let mut clock = PathClock::default();
        for (tick, time_s) in [(0, 0.0), (1, 1e-3), (11, 11e-3), (12, 12e-3)] {
            clock.take(tick, time_s, 1e-3);
        }
        assert!(clock.breach.is_none() && (clock.unseen_s - 9e-3).abs() < 1e-12);
    }

    #[test]
    fn a_clock_that_jumps_goes_back_or_is_no_number_is_none() {
        for times in [[0.0, 1e-3, 0.9], [0.0, 1e-3, 0.0], [0.0, 1e-3, f64::NAN]] {
            let clock = clock(&times);
            assert_eq!(clock.breach.map(|(tick, ..)| tick), Some(2), "{times:?}");
            assert!(clock.time_s <= 2.1e-3, "no time is credited for it");
        }
    }
}
