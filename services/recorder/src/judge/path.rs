//! The judge's own copy of the commanded path. From the controller it takes only the path's time.
//! That clock must never go back, must not run faster than the run, and must reach the path's end.

use control::{Asked, GroundTruth, Progress, SIDE_CHANGE};
use nalgebra::{Vector3, Vector6};
use shared_types::PlantState;
use shared_types::bounds::within;
use shared_types::scenario::Scenario;

/// Path time that a controller may be short of the end by rounding, s.
const ROUNDING_S: f64 = 1e-6;
/// Largest error of a turn of ζ, rad, where half of the turn is not less.
const TURN_MOST: f64 = 0.035;
/// Share of the path that may pass in ticks without a whole account, such as messages that a fault has dropped.
const MOST_UNSEEN: f64 = 0.25;

/// The judge's position on the path.
#[derive(Debug, Default)]
pub(super) struct PathMeter {
    place: Option<Progress>,
    clock: PathClock,
    /// The tick in which the path's end was reached.
    ended: Option<u64>,
    posture: PostureMeter,
}

impl PathMeter {
    /// At the path's start; in a steered run there is none.
    pub(super) fn new(truth: &dyn GroundTruth) -> Self {
        Self {
            place: truth.start(),
            ..Self::default()
        }
    }

    /// The true pose's error against the path at the time that the controller states, `[p_d − p; log(R_d Rᵀ)]`; m, rad.
    /// `None`: there is no path. `dt_s`: length of a tick.
    pub(super) fn error(
        &mut self,
        truth: &dyn GroundTruth,
        path_time_s: f64,
        state: &PlantState,
        dt_s: f64,
    ) -> Option<Vector6<f64>> {
        let place = self.place.as_mut()?;
        let tick = state.header.tick;
        let by_s = self.clock.take(tick, path_time_s, dt_s);
        let before = place.leg;
        let had_begun = place.begun;
        truth.advance(place, by_s);
        for leg in before..place.leg {
            self.posture.end(leg, truth.asked(leg));
        }
        let asked = truth.asked(place.leg);
        if (place.leg, place.begun) != (before, had_begun) {
            self.posture.begin(place.leg, asked);
        }
        self.posture.pass(asked);
        if self.clock.time_s >= truth.duration_s() - ROUNDING_S {
            self.ended.get_or_insert(tick);
        }
        Some(truth.error(place, state))
    }

    /// The place on the path of the latest tick; `None`: there is no path.
    pub(super) fn place(&self) -> Option<Progress> {
        self.place
    }

    /// The true pose's error against the path's end, `[p_d − p; log(R_d Rᵀ)]`; m, rad. `None`: there is no path.
    pub(super) fn left(&self, truth: &dyn GroundTruth, state: &PlantState) -> Option<Vector6<f64>> {
        let mut end = self.place()?;
        truth.advance(&mut end, (truth.duration_s() - self.clock.time_s).max(0.0));
        Some(truth.error(&end, state))
    }

    /// Violations of the clock's rules by the controller; `is_done`: it has reported the end of its
    /// task.
    pub(super) fn breach(
        &self,
        truth: &dyn GroundTruth,
        scenario: &Scenario,
        is_done: bool,
    ) -> Option<String> {
        self.place.as_ref()?;
        let came_s = self.clock.time_s;
        let all_s = truth.duration_s();
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
        if let Some(untaken) = &self.posture.untaken {
            return Some(untaken.clone());
        }
        if is_done && came_s < all_s - ROUNDING_S {
            return Some(format!(
                "the controller's last `path_time_s` is {came_s:.3} s; the path takes {all_s:.3} s"
            ));
        }
        // The tick of the end and the one in which it is said may round.
        let last = self.clock.last.zip(self.ended);
        let settled = last.map_or(0, |(last, ended)| last - ended) + 2;
        let settled_s = settled as f64 / f64::from(scenario.rate_hz);
        let settle_s = scenario.settle_s;
        (is_done && settled_s < settle_s).then(|| {
            format!(
                "the controller ended {settled_s:.3} s after the path did: the arm was to settle for {settle_s} s (settle_s)"
            )
        })
    }
}

/// The segments' demands on the posture, followed on the truth.
#[derive(Debug, Default)]
struct PostureMeter {
    /// ζ when its turn began.
    zeta: [f64; 3],
    /// Whether the present segment has reached the fold that it has to leave.
    at_fold: bool,
    /// The first demand that was not met.
    untaken: Option<String>,
}

impl PostureMeter {
    fn begin(&mut self, segment: usize, asked: Asked) {
        self.at_fold = false;
        if let Asked::Turn {
            zeta, is_inside, ..
        } = asked
        {
            self.zeta = zeta;
            if !is_inside {
                self.say(format!("segment {segment} was to turn a singular direction, but began outside of the singularity's neighbourhood: nothing was turned"));
            }
        }
    }

    fn pass(&mut self, asked: Asked) {
        if let Asked::Side { is_inside, .. } = asked {
            self.at_fold |= is_inside;
        }
    }

    fn end(&mut self, segment: usize, asked: Asked) {
        match asked {
            Asked::Turn { zeta, by, .. } => {
                let (from, to) = (Vector3::from(self.zeta), Vector3::from(zeta));
                // Between lines: ζ and −ζ are the same direction.
                let line = |angle: f64| libm::acos(libm::cos(angle).abs().min(1.0));
                let turned = line(libm::atan2(from.cross(&to).norm(), from.dot(&to)));
                let most = TURN_MOST.min(0.5 * by.abs());
                if !within((turned - line(by)).abs(), most) {
                    let [by, turned] = [by.abs(), turned].map(f64::to_degrees);
                    self.say(format!("segment {segment} was to turn a singular direction by {by:.1}°: its line is {turned:.1}° from where it was"));
                }
            }
            Asked::Side { x, side, .. } if self.at_fold && x * side < -SIDE_CHANGE => {
                self.say(format!("segment {segment} was to leave the elbow's singularity on the side of branch {side:+}, and left it on the other"));
            }
            Asked::Side { .. } | Asked::Nothing => {}
        }
    }

    fn say(&mut self, untaken: String) {
        self.untaken.get_or_insert(untaken);
    }
}

/// The path's time as a controller states it.
#[derive(Debug, Default)]
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
    use super::{Asked, PathClock, PostureMeter};

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

    /// Whether a segment that showed these postures left its demand unmet.
    fn untaken(shown: &[Asked]) -> bool {
        let mut meter = PostureMeter::default();
        meter.begin(0, shown[0]);
        shown.iter().for_each(|asked| meter.pass(*asked));
        meter.end(0, shown[shown.len() - 1]);
        meter.untaken.is_some()
    }

    #[test]
    fn a_turn_of_zeta_is_taken_where_its_line_has_turned() {
        let turn = |angle: f64, is_inside| Asked::Turn {
            zeta: [libm::cos(angle), libm::sin(angle), 0.0],
            by: 1.0,
            is_inside,
        };
        for (angle, is_taken) in [
            (1.0, true),
            (0.99, true),
            (0.0, false),
            (0.5, false),
            (f64::NAN, false),
        ] {
            assert_eq!(
                untaken(&[turn(0.0, true), turn(angle, true)]),
                !is_taken,
                "{angle}"
            );
        }
        // The other way round ends on the same line.
        assert!(!untaken(&[
            turn(0.0, true),
            turn(1.0 - std::f64::consts::PI, true)
        ]));
        assert!(untaken(&[turn(0.0, false), turn(1.0, true)]));
    }

    #[test]
    fn a_fold_is_left_on_the_side_that_was_asked_for() {
        let side = |x: f64| Asked::Side {
            x,
            side: 1.0,
            is_inside: x.abs() < 0.1,
        };
        assert!(untaken(&[side(-0.3), side(0.01), side(-0.3)]));
        assert!(!untaken(&[side(-0.3), side(0.01), side(0.3)]));
        // It has not come to the fold, or is still at it.
        assert!(!untaken(&[side(-0.3), side(-0.2)]) && !untaken(&[side(0.0), side(-0.01)]));
    }
}
