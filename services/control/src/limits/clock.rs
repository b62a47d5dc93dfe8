//! The clock: the path's time slows down so that no joint exceeds its limits.
//!
//! Reduces to the paper's law: at a demand below 0.95 the clock runs at exactly 1 (proof: `a_feasible_path_runs_at_full_clock_speed`).

use super::torque::Limited;
use crate::controller::Setup;
use crate::linear::Joints;
use crate::state::State;

/// Slowest clock, but where the plan asks for a slower one.
pub(crate) const SLOWEST: f64 = 0.05;
/// The clock of a path that waits, a millimetre of whose way takes minutes: rates are divided by the clock, so it never stands.
const WAITING: f64 = 1e-3;
/// Share of a limit that the path may take.
pub const MARGIN: f64 = 0.95;
/// Time constants, s.
const DOWN: f64 = 0.020;
const UP: f64 = 0.080;
/// Time constant of the clock's own acceleration, s: a step in it would be a step in torque.
const SMOOTH: f64 = 0.008;
/// How far a rising demand is extrapolated, s: about as long as the clock takes to come down.
const LEAD: f64 = 0.060;
/// Demand below which a change is noise, and no rise.
const QUIET: f64 = 0.25;
/// Share of the torque limits that changing the clock's speed may take.
const BRAKE: f64 = 0.35;

/// Demand of the path at full clock speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load<const N: usize> {
    /// Largest share of a joint's speed, or of an auxiliary rate, at full clock speed.
    pub speed: f64,
    /// Torque that holds the arm, N·m.
    pub holding: Joints<N>,
    /// Torque that follows the path at full clock speed, without what holds the arm, N·m: it goes with the clock's speed squared.
    pub following: Joints<N>,
    /// Torque per change of the clock's speed, N·m·s.
    pub braking: Joints<N>,
    /// Fastest clock that the path plan allows, up to 1.
    pub planned: f64,
    /// Whether a plan knows what comes.
    pub is_planned: bool,
}

/// The clock of a run: its speed, and the time that has passed on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// Speed of the path's clock against real time, above 0 and at most 1: 0.05 on a path, or lower where its plan, a saturated joint or a steered joint's limit asks for it.
    pub rate: f64,
    /// Its change, 1/s.
    pub rate_dot: f64,
    /// Demand at the tick before.
    pub demand: f64,
    /// Time on the path since the start, s.
    pub path_s: f64,
    /// Time on the plan of the path, which waits where ζ is turned out of the way, s.
    pub plan_s: f64,
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            rate: 1.0,
            rate_dot: 0.0,
            demand: 0.0,
            path_s: 0.0,
            plan_s: 0.0,
        }
    }
}

impl Clock {
    /// At full speed, where time is what it is.
    pub fn begin_anew(&mut self) {
        *self = Self {
            path_s: self.path_s,
            plan_s: self.plan_s,
            ..Self::default()
        };
    }

    /// Slows down as fast as an arm does that is damped by `damping`, 1/s: the path waits for it.
    pub fn slow_down(&mut self, damping: f64, dt: f64) {
        let slowest = SLOWEST.min(self.rate);
        self.rate = (self.rate * libm::exp(-damping * dt)).max(slowest);
        self.rate_dot = 0.0;
    }

    /// Comes to a stop as fast as it slows down: the path waits for an arm whose torque is used up.
    fn wait(&mut self, dt: f64) {
        self.rate = (self.rate * libm::exp(-dt / DOWN)).max(WAITING.min(self.rate));
        self.rate_dot = 0.0;
    }

    /// Moves towards 0.95/demand within [0.05 or what the plan allows, 1], in 20 ms down, in 80 ms up, as fast as a share of the torque allows.
    ///
    /// The clock's change is known, so it is fed forward. Speed goes with the clock, torque beyond holding with its square. What comes is in the plan's
    /// speed, and the clock goes up as quickly as down; without a plan a rising demand is extrapolated over the time that slowing down takes.
    ///
    /// Units `limits` N·m, `dt` s · Requires `load.planned` > 0 · Ensures min(0.05, planned) ≤ rate ≤ 1 and |rate_dot| within the share of torque that braking may take; rate = 1 exactly while the
    /// demand stays below 0.95 · Errors none · Cost O(N), no allocation
    pub fn govern<const N: usize>(&mut self, load: &Load<N>, limits: &Joints<N>, dt: f64) {
        let mut demand = load.speed;
        let mut hardest = 1e3_f64;
        for i in 0..N {
            let room = room(limits[i], load.holding[i]);
            demand = demand.max(MARGIN * (load.following[i].abs() / room).sqrt());
            let braking = BRAKE * limits[i].min(2.0 * room);
            hardest = hardest.min(braking / load.braking[i].abs().max(1e-9));
        }
        let rising = ((demand.max(QUIET) - self.demand.max(QUIET)) / dt).max(0.0);
        self.demand = demand;
        let (lead, up) = if load.is_planned {
            (0.0, DOWN)
        } else {
            (LEAD, UP)
        };
        let target = MARGIN / (demand + lead * rising).max(1e-9);
        // The plan knows of places that need a slower clock than any demand measured so far.
        let slowest = SLOWEST.min(load.planned);
        let target = target.max(SLOWEST).min(load.planned);
        let lag = if target < self.rate { DOWN } else { up };
        let wanted = ((target - self.rate) / lag).clamp(-hardest, hardest);
        self.rate_dot += (wanted - self.rate_dot) * dt / (SMOOTH + dt);
        let next = (self.rate + self.rate_dot * dt).clamp(slowest.min(self.rate), 1.0);
        self.rate_dot = (next - self.rate) / dt;
        self.rate = next;
    }
}

/// Torque that is left for following the path beside what holds the arm: |holding + r²·following| ≤ 0.95·limit, at least a hundredth of it; N·m.
pub(crate) fn room(limit: f64, holding: f64) -> f64 {
    (MARGIN * limit - holding.abs()).max(0.01 * limit)
}

/// Step 5: time goes on at the clock's speed, whose next one the demands of this tick decide.
pub(crate) fn step<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    load: &Load<N>,
    limited: &Limited,
) {
    let clock = state.clock.rate;
    if setup.scenario.control.governor {
        let dt = setup.scenario.dt_s();
        if limited.saturation_mask != 0 && setup.scenario.servo.is_none() {
            // The arm falls behind: the path waits, whatever was reckoned with.
            state.clock.wait(dt);
        } else {
            state.clock.govern(load, setup.model.effort(), dt);
        }
    }
    let waits = state.force.waits();
    pass(setup, state, if waits { 0.0 } else { clock });
}

/// Time that goes on by a tick at the speed `clock`, on the plan, on the path and in its leg.
pub(crate) fn pass<const N: usize>(setup: &Setup<N>, state: &mut State<N>, clock: f64) {
    let step = clock * setup.scenario.dt_s();
    let on_path = setup.guide.path_time(state.clock.plan_s, step);
    state.clock.plan_s += step;
    state.clock.path_s += on_path;
    state.progress.time_s += on_path;
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    fn load(speed: f64, following: f64) -> Load<1> {
        Load {
            speed,
            holding: Vector1::new(2.0),
            following: Vector1::new(following),
            braking: Vector1::new(0.1),
            planned: 1.0,
            is_planned: false,
        }
    }

    #[test]
    fn the_clock_follows_the_demand_and_recovers() {
        let limits = Vector1::new(10.0);
        let mut clock = Clock::default();
        (0..300).for_each(|_| clock.govern(&load(1.9, 0.0), &limits, 1e-3));
        assert!((clock.rate - 0.5).abs() < 1e-3);
        (0..300).for_each(|_| clock.govern(&load(0.0, 30.0), &limits, 1e-3));
        assert!(
            2.0 + 30.0 * clock.rate * clock.rate < 9.6,
            "torque within the limit at rate {}",
            clock.rate
        );
        (0..1000).for_each(|_| clock.govern(&load(1e9, 0.0), &limits, 1e-3));
        assert!((clock.rate - SLOWEST).abs() < 1e-3);
        (0..1000).for_each(|_| clock.govern(&load(0.0, 0.0), &limits, 1e-3));
        assert!((clock.rate - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_feasible_path_runs_at_full_clock_speed() {
        // The demand has been there before: a rising one is extrapolated.
        let mut clock = Clock {
            demand: 0.94,
            ..Clock::default()
        };
        for _ in 0..1000 {
            clock.govern(&load(0.94, 7.0), &Vector1::new(10.0), 1e-3);
            assert_eq!((clock.rate, clock.rate_dot), (1.0, 0.0));
        }
    }

    /// If gravity takes most of a limit, the path gets the little that is left, and its clock gives way at once when that is used up.
    #[test]
    fn a_heavy_arm_is_moved_by_the_torque_that_is_left() {
        assert!((room(10.0, 9.3) - 0.2).abs() < 1e-12 && room(10.0, 9.9) > 0.0);
        let (limits, mut clock) = (Vector1::new(10.0), Clock::default());
        let heavy = Load {
            holding: Vector1::new(9.0),
            ..load(0.0, 2.0)
        };
        (0..500).for_each(|_| clock.govern(&heavy, &limits, 1e-3));
        let torque = 9.0 + 2.0 * clock.rate * clock.rate;
        assert!(torque < 9.6 && clock.rate > 0.4, "{torque}");
        (0..40).for_each(|_| clock.wait(1e-3));
        assert!(clock.rate < 0.2);
        (0..400).for_each(|_| clock.wait(1e-3));
        assert!(clock.rate == WAITING);
        (0..500).for_each(|_| clock.govern(&heavy, &limits, 1e-3));
        assert!(clock.rate > 0.4);
    }

    #[test]
    fn the_clock_never_brakes_harder_than_the_torque_allows() {
        let (limits, heavy) = (
            Vector1::new(10.0),
            Load {
                braking: Vector1::new(2.0),
                ..load(10.0, 0.0)
            },
        );
        let mut clock = Clock::default();
        for _ in 0..500 {
            clock.govern(&heavy, &limits, 1e-3);
            assert!(clock.rate_dot.abs() <= 0.35 * 10.0 / 2.0 + 1e-9);
        }
    }
}
