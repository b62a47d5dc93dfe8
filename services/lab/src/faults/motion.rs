//! The arm's motion in a run, measured on the simulator's truth, and the guarantees that it breaks.

use model::Robot;
use recorder::Limits;
use shared_types::codes::{
    DRIVE_ABSENT, DRIVE_ACTIVE, DRIVE_BRAKED, DRIVE_ENCODER, DRIVE_HOLDING, DRIVE_REFUSED,
    DRIVE_STALE,
};
use shared_types::fault::{Fault, Kind};
use shared_types::scenario::Scenario;
use shared_types::{PlantState, SensorSample};

/// Torque may change by so much of its limit in a millisecond, whatever happens (`sim::Drive`); the rounding of a sum is allowed for.
const STEP_PER_MS: f64 = 0.5 + 1e-9;

/// A joint without drive torque may be carried over its speed limit by gravity and inertia, but not by the drives.
pub(super) const SPEED_MARGIN: f64 = 1.05;

/// The same where a controller is led to full torque by numbers far out of range: that gains 4 % of a PUMA's limit in the millisecond before the
/// drives see the excess, and they turn a torque round in four.
pub(super) const SPEED_MARGIN_AT_FULL_TORQUE: f64 = 1.1;

/// How long after a drive has failed its arm may still be too fast; s.
const AFTERMATH_S: f64 = 1.0;

/// Slower than this it is at rest; rad/s.
const REST: f64 = 0.05;

/// Why a torque is not a fresh one.
const NOT_FRESH: u32 = DRIVE_ABSENT | DRIVE_REFUSED | DRIVE_STALE | DRIVE_ENCODER;

/// A fault of a drive: it excuses a step of its own joint's torque while it lasts, and the speed until shortly after.
#[derive(Clone, Copy, Debug)]
struct DriveFault {
    joint: usize,
    from: u64,
    until: u64,
}

/// The guaranteed bounds of an arm's motion.
#[derive(Clone, Debug)]
pub(super) struct Guarantee {
    limits: Limits,
    hold_ticks: u32,
    step: f64,
    speed: f64,
    aftermath: u64,
    drive_faults: Vec<DriveFault>,
}

impl Guarantee {
    /// For a robot in a scenario, with the faults that came to pass; `speed` is the most that is allowed, over the limit.
    pub(super) fn new<'a>(
        robot: &Robot,
        scenario: &Scenario,
        speed: f64,
        faults: impl Iterator<Item = &'a Fault>,
    ) -> Self {
        let rate_hz = f64::from(scenario.rate_hz);
        let drive_fault = |fault: &Fault| {
            let from = fault.at_tick.unwrap_or_default();
            let until = fault
                .for_ticks
                .map_or(u64::MAX, |ticks| from.saturating_add(ticks));
            DriveFault {
                joint: fault.joint.unwrap_or(1).saturating_sub(1) as usize,
                from,
                until,
            }
        };
        Self {
            limits: recorder::Limits::of(robot),
            hold_ticks: scenario.plant.hold_ticks,
            step: STEP_PER_MS * 1e3 / rate_hz,
            speed,
            aftermath: (AFTERMATH_S * rate_hz) as u64,
            drive_faults: faults
                .filter(|fault| fault.kind == Kind::Drive)
                .map(drive_fault)
                .collect(),
        }
    }

    /// Whether the step of a joint's torque to that of `tick` is its drive's own: a tick's torque is reported with the next tick.
    fn excuses_step(&self, joint: usize, tick: u64) -> bool {
        self.drive_faults.iter().any(|fault| {
            fault.joint == joint && (fault.from..=fault.until.saturating_add(1)).contains(&tick)
        })
    }

    fn excuses_speed(&self, tick: u64) -> bool {
        self.drive_faults
            .iter()
            .any(|fault| (fault.from..=fault.until.saturating_add(self.aftermath)).contains(&tick))
    }
}

/// The arm's motion, message by message.
#[derive(Clone, Debug)]
pub(super) struct Motion {
    guarantee: Guarantee,
    /// Largest torque over its limit.
    pub torque_max_ratio: f64,
    /// Largest joint speed over its limit.
    pub speed_max_ratio: f64,
    /// Largest change of torque in one tick.
    pub torque_step_max_ratio: f64,
    /// Longest age of a torque in force; ticks.
    pub stale_ticks: u32,
    /// The last tick seen.
    pub last: Option<PlantState>,
    not_finite: Option<u64>,
    /// The largest step that no failing drive excuses, and its tick.
    step: (f64, u64),
    /// The highest speed that no failing drive excuses, and its tick.
    speed: (f64, u64),
    torque: (f64, u64),
    /// A tick at which the drives followed a torque that was not fresh.
    unfresh: Option<u64>,
}

impl Motion {
    /// Of an arm that has not moved yet.
    pub(super) fn new(guarantee: Guarantee) -> Self {
        Self {
            guarantee,
            torque_max_ratio: 0.0,
            speed_max_ratio: 0.0,
            torque_step_max_ratio: 0.0,
            stale_ticks: 0,
            last: None,
            not_finite: None,
            step: (0.0, 0),
            speed: (0.0, 0),
            torque: (0.0, 0),
            unfresh: None,
        }
    }

    /// Takes in a tick of the truth, in order; steps are judged between neighbours only.
    pub(super) fn add(&mut self, state: &PlantState) {
        let tick = state.header.tick;
        let before = self.last.filter(|before| before.header.tick + 1 == tick);
        let ratio = |value: f64, limit: f64| {
            if limit.is_finite() {
                value.abs() / limit
            } else {
                0.0
            }
        };
        for i in 0..self.guarantee.limits.effort.len() {
            if !(state.tau[i].is_finite() && state.q[i].is_finite() && state.qdot[i].is_finite()) {
                self.not_finite.get_or_insert(tick);
            }
            let (effort, velocity) = (
                self.guarantee.limits.effort[i],
                self.guarantee.limits.velocity[i],
            );
            let (torque, speed) = (ratio(state.tau[i], effort), ratio(state.qdot[i], velocity));
            raise(&mut self.torque, torque, tick);
            self.torque_max_ratio = self.torque_max_ratio.max(torque);
            self.speed_max_ratio = self.speed_max_ratio.max(speed);
            if !self.guarantee.excuses_speed(tick) {
                raise(&mut self.speed, speed, tick);
            }
            if let Some(before) = before {
                let step = ratio(state.tau[i] - before.tau[i], effort);
                self.torque_step_max_ratio = self.torque_step_max_ratio.max(step);
                if !self.guarantee.excuses_step(i, tick) {
                    raise(&mut self.step, step, tick);
                }
            }
        }
        if state.drive == DRIVE_ACTIVE && state.drive_flags & NOT_FRESH != 0 {
            self.unfresh.get_or_insert(tick);
        }
        self.last = Some(*state);
    }

    /// Takes in how old the torque in force was.
    pub(super) fn add_age(&mut self, sample: &SensorSample) {
        if matches!(sample.drive, DRIVE_ACTIVE | DRIVE_HOLDING) {
            self.stale_ticks = self.stale_ticks.max(sample.stale_ticks);
        }
    }

    /// At rest, or held by the brakes, at the end.
    pub(super) fn is_at_rest(&self) -> bool {
        self.last.is_some_and(|state| {
            state.drive == DRIVE_BRAKED || state.qdot.iter().all(|speed| speed.abs() < REST)
        })
    }

    /// A drive fails at the end, or has only just failed: then the arm is where it carries it.
    pub(super) fn ends_with_a_failed_drive(&self) -> bool {
        self.last
            .is_some_and(|state| self.guarantee.excuses_speed(state.header.tick))
    }

    /// The guarantees that were not kept, in words.
    pub(super) fn broken(&self) -> Vec<String> {
        let mut broken = Vec::new();
        let mut unless = |is_kept: bool, what: &dyn Fn() -> String| {
            if !is_kept {
                broken.push(what());
            }
        };
        unless(self.not_finite.is_none(), &|| {
            format!(
                "a number that is not finite reached the arm at tick {}",
                self.not_finite.unwrap_or_default()
            )
        });
        unless(self.torque.0 <= 1.0 + 1e-9, &|| {
            format!(
                "torque {:.3} of its limit at tick {}",
                self.torque.0, self.torque.1
            )
        });
        let hold_ticks = self.guarantee.hold_ticks;
        unless(self.stale_ticks <= hold_ticks, &|| {
            format!(
                "a torque {} ticks old was in force, {hold_ticks} are allowed",
                self.stale_ticks
            )
        });
        unless(self.step.0 <= self.guarantee.step, &|| {
            format!(
                "a torque step of {:.3} of its limit at tick {}",
                self.step.0, self.step.1
            )
        });
        unless(self.speed.0 <= self.guarantee.speed, &|| {
            format!(
                "speed {:.2} of its limit at tick {}",
                self.speed.0, self.speed.1
            )
        });
        unless(self.unfresh.is_none(), &|| {
            format!(
                "the drives said they followed a fresh torque at tick {}, and there was none",
                self.unfresh.unwrap_or_default()
            )
        });
        broken
    }
}

fn raise(most: &mut (f64, u64), value: f64, tick: u64) {
    if value > most.0 {
        *most = (value, tick);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::codes::DRIVE_STOPPING;

    fn scenario() -> Scenario {
        let name = "fig5-wrist-rotation";
        Scenario::parse(name, sim::scenarios::text(name).unwrap(), &[]).unwrap()
    }

    /// An arm at rest for 100 ticks, with one tick corrupted.
    fn broken(
        faults: &[Fault],
        corrupt: impl Fn(&mut PlantState, &mut SensorSample),
    ) -> Vec<String> {
        let mut motion = Motion::new(Guarantee::new(
            &Robot::builtin("puma560").unwrap(),
            &scenario(),
            SPEED_MARGIN,
            faults.iter(),
        ));
        for tick in 0..100 {
            let (mut state, mut sample) = (PlantState::default(), SensorSample::default());
            (state.header.tick, sample.header.tick) = (tick, tick);
            if tick == 50 {
                corrupt(&mut state, &mut sample);
            }
            motion.add(&state);
            motion.add_age(&sample);
        }
        motion.broken()
    }

    #[test]
    fn each_guarantee_that_is_broken_is_caught_and_named_with_its_tick() {
        assert_eq!(broken(&[], |_, _| ()), Vec::<String>::new());
        let caught =
            |words: &str, corrupt: &dyn Fn(&mut PlantState, &mut SensorSample)| {
                let broken = broken(&[], corrupt);
                assert!(
                    broken.iter().any(|what| what.contains(words)
                        && (what.contains("50") || words.contains("old"))),
                    "{words}: {broken:?}"
                );
            };
        caught("not finite", &|state, _| state.qdot[3] = f64::NAN);
        caught("torque 2.", &|state, _| state.tau[0] = -200.0);
        caught("torque step of", &|state, _| state.tau[5] = 20.0);
        caught("speed", &|state, _| state.qdot[1] = 50.0);
        caught("ticks old", &|_, sample| {
            (sample.drive, sample.stale_ticks) = (DRIVE_HOLDING, 4)
        });
        caught("and there was none", &|state, _| {
            state.drive_flags = DRIVE_ABSENT
        });
        let fine = broken(&[], |state, sample| {
            (state.drive, state.drive_flags) = (DRIVE_STOPPING, DRIVE_ABSENT);
            (sample.drive, sample.stale_ticks) = (DRIVE_STOPPING, 400);
        });
        assert_eq!(
            fine,
            Vec::<String>::new(),
            "an arm that stops without torque keeps every guarantee"
        );
    }

    #[test]
    fn a_drive_that_fails_answers_for_its_joint_and_its_time_only() {
        let fault = |joint: u32, at: u64, ticks: u64| Fault {
            joint: Some(joint),
            at_tick: Some(at),
            for_ticks: Some(ticks),
            ..Fault::new("plant", Kind::Drive)
        };
        let step = |state: &mut PlantState, _: &mut SensorSample| state.tau[5] = 20.0;
        assert!(broken(&[fault(6, 45, 10)], step).is_empty());
        assert_eq!(broken(&[fault(5, 45, 10)], step).len(), 1, "another joint");
        assert_eq!(broken(&[fault(6, 10, 10)], step).len(), 1, "another time");
        let fast = |state: &mut PlantState, _: &mut SensorSample| state.qdot[1] = 50.0;
        assert!(
            broken(&[fault(6, 10, 10)], fast).is_empty(),
            "an arm comes to rest after its drive has failed, not with it"
        );
        assert_eq!(broken(&[fault(6, 60, 10)], fast).len(), 1);
    }
}
