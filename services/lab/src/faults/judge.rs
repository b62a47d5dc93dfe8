//! The verdict on a run with faults: the guarantees that hold under every fault, on the simulator's truth.

use std::collections::BTreeSet;

use launcher::Failure as Mishap;
use session::{Failure, Run};
use shared_types::bounds::{larger, share};
use shared_types::codes::{
    DRIVE_ABSENT, DRIVE_ACTIVE, DRIVE_BRAKED, DRIVE_ENCODER, DRIVE_HOLDING, DRIVE_REFUSED,
    DRIVE_STALE,
};
use shared_types::fault::{Fault, Kind};
use shared_types::job::Mode;
use shared_types::process::Program;
use shared_types::summary::FaultSummary;
use shared_types::{MAX_DOF, PlantState, SensorSample};

use serde::Serialize;

use super::bounds::{self, ORDINARY, REST_MS, STALE_MS};
use super::plan::ends_world;
use super::run::{Ran, Stage};
use crate::row::is_at_goal;

/// Torque may change by so much of its limit in a millisecond, whatever happens (`sim::Drive`); the rounding of a sum is allowed for.
const STEP_PER_MS: f64 = 0.5 + 1e-9;

/// A joint without drive torque may be carried over its speed limit by gravity and inertia, but not by the drives. In real time a controller may be
/// led to full torque by numbers far out of range: that gains 4 % of a PUMA's limit in the millisecond before the drives see the excess, and they turn
/// a torque round in four.
const SPEED: [f64; 2] = [1.05, 1.1];

/// Slower than this the arm is at rest; rad/s.
const REST: f64 = 0.05;

/// Why a torque is not a fresh one.
const NOT_FRESH: u32 = DRIVE_ABSENT | DRIVE_REFUSED | DRIVE_STALE | DRIVE_ENCODER;

/// A recorder that dies in real time may cost the record of so much; s.
const LOST_PER_DEATH_S: f64 = 0.1;

/// Time that a volume that fills up may cost the record besides; s.
const IN_HAND_S: f64 = 1.5;

/// A process that dies later than this before the end of the run may miss it; s.
const TIME_TO_RETURN_S: f64 = 2.0;

/// A guarantee that a run did not keep.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Broken {
    /// Which, in a word.
    pub check: &'static str,
    /// In words, with the numbers.
    pub detail: String,
}

/// What the arm did.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Motion {
    /// Largest torque over its limit.
    pub torque_max_ratio: f64,
    /// Largest joint speed over its limit.
    pub speed_max_ratio: f64,
    /// Largest change of torque in one tick over the torque's limit.
    pub torque_step_max_ratio: f64,
    /// Longest age of a torque in force; ticks.
    pub stale_ticks: u32,
}

/// How far the arm left the path of the run without a fault.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Excursion {
    /// Of a joint, rad.
    pub excursion_max_rad: f64,
    /// Of the end-effector, mm.
    pub excursion_max_mm: f64,
    /// The most that is allowed of a joint's, rad.
    pub excursion_allowed_rad: f64,
    /// The most that is allowed of the end-effector's, mm.
    pub excursion_allowed_mm: f64,
    /// From the fault to the first tick of fresh torque after the drives had taken over, or to rest; null where they never had to, ms.
    pub settled_ms: Option<f64>,
}

/// One run with faults.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Cell {
    /// Name of the scenario.
    pub scenario: String,
    /// Seed of the run.
    pub seed: u64,
    /// Ticks run.
    pub ticks: u64,
    /// Its faults, and the deaths that no plan had.
    pub faults: Vec<FaultSummary>,
    /// What the arm did.
    #[serde(flatten)]
    pub motion: Motion,
    /// In lockstep only.
    #[serde(flatten)]
    pub excursion: Option<Excursion>,
    /// `goal`, `rest` or `ended`.
    pub end: &'static str,
    /// The reason of the end.
    pub reason: String,
    /// Whether the goal was reached.
    pub goal_reached: bool,
    /// The drives follow the controller at the end.
    pub recovered: bool,
    /// Restarts.
    pub restarts: u32,
    /// In lockstep: whether the run of its saved plan gave the same bytes.
    pub replayed_identically: Option<bool>,
    /// Guarantees that were broken.
    pub broken: Vec<Broken>,
}

/// Where the guarantees that are broken go.
#[derive(Default)]
struct Verdict(Vec<Broken>);

impl Verdict {
    fn unless(&mut self, is_kept: bool, check: &'static str, detail: impl ToString) {
        if !is_kept {
            self.0.push(Broken {
                check,
                detail: detail.to_string(),
            });
        }
    }
}

impl Ran {
    /// The faults that came to pass, as a scenario plans them.
    pub(super) fn faults(&self) -> impl Iterator<Item = (&FaultSummary, &Fault)> {
        self.summary
            .faults
            .iter()
            .filter(|fault| fault.occurred)
            .filter_map(|fault| Some((fault, fault.plan.as_ref()?)))
    }

    fn has(&self, kind: Kind) -> bool {
        self.faults().any(|(_, fault)| fault.kind == kind)
    }

    fn is_lockstep(&self) -> bool {
        self.job.mode == Mode::Lockstep
    }

    fn rate_hz(&self) -> f64 {
        f64::from(self.job.scenario.rate_hz)
    }

    /// The tick from which on the recorder's volume was full.
    fn full_at(&self) -> Option<u64> {
        self.faults()
            .find(|(_, fault)| fault.kind == Kind::DiskFull)
            .map(|(fault, _)| fault.tick)
    }

    /// The longest age of a torque in force.
    fn stale_ticks(&self) -> u32 {
        let in_force =
            |sample: &&SensorSample| matches!(sample.drive, DRIVE_ACTIVE | DRIVE_HOLDING);
        let ages = self.samples.iter().filter(in_force);
        ages.map(|sample| sample.stale_ticks)
            .max()
            .unwrap_or_default()
    }

    fn ending(&self, is_at_rest: bool) -> &'static str {
        match self.failure {
            None if self.goal_reached() => "goal",
            None if is_at_rest => "rest",
            _ => "ended",
        }
    }

    fn goal_reached(&self) -> bool {
        is_at_goal(self.summary.completed, &self.summary.task)
    }
}

impl Stage<'_> {
    /// Judges a run; in lockstep beside the run without a fault, and the one from the plan that it left.
    pub(super) fn judge(&self, ran: &Ran, lockstep: Option<(&Ran, &Ran)>) -> Result<Cell, Failure> {
        let mut verdict = Verdict::default();
        // Where the messages end early and the topics are the fault-free ones, the arm did what it did without a fault.
        let is_base = |base: &Ran| {
            !base.summary.topics.is_empty() && ran.summary.topics == base.summary.topics
        };
        let truth = lockstep
            .filter(|(base, _)| is_base(base))
            .map_or(&ran.truth, |(base, _)| &base.truth);
        let last = truth.last();
        let is_at_rest = last.is_some_and(|state| {
            state.drive == DRIVE_BRAKED || state.qdot.iter().all(|speed| speed.abs() < REST)
        });
        let goal_reached = ran.goal_reached();
        let mut cell = Cell {
            scenario: ran.job.scenario.name.clone(),
            seed: ran.job.scenario.seed,
            ticks: ran.summary.ticks,
            faults: ran.summary.faults.clone(),
            motion: self.motion(ran, truth, &mut verdict),
            end: ran.ending(is_at_rest),
            reason: ran.summary.reason.clone(),
            goal_reached,
            recovered: ran.failure.is_none()
                && last.is_some_and(|state| state.drive == DRIVE_ACTIVE),
            restarts: ran.summary.processes.iter().map(|one| one.restarts).sum(),
            ..Cell::default()
        };
        ends(ran, goal_reached || is_at_rest, &mut verdict);
        lives(ran, &mut verdict);
        follows(ran, truth, &mut verdict);
        age(ran, cell.motion.stale_ticks, &mut verdict);
        record(ran, &mut verdict);
        if let Some((base, again)) = lockstep {
            let excursion = self.excursion(ran, base, truth, &mut verdict)?;
            let is_same = ran.summary.topics == again.summary.topics
                && ran.summary.ticks == again.summary.ticks;
            verdict.unless(is_same, "repeat", "the saved plan gives other bytes");
            (cell.excursion, cell.replayed_identically) = (Some(excursion), Some(is_same));
            // Nothing of a dead incarnation is taken in: it leaves no trace in any message.
            let is_zombie = !ran.summary.faults.is_empty()
                && ran.faults().all(|(_, fault)| fault.kind == Kind::Zombie);
            verdict.unless(
                !is_zombie || is_base(base),
                "fence",
                "messages of a dead incarnation have changed the run",
            );
            verdict.unless(
                again.left_behind.is_empty(),
                "left-behind",
                again.left_behind.join(", "),
            );
        }
        verdict.unless(
            ran.left_behind.is_empty(),
            "left-behind",
            ran.left_behind.join(", "),
        );
        cell.broken = verdict.0;
        Ok(cell)
    }

    /// The arm's motion, and the physical guarantees. While a drive fails neither a step of its torque nor the speed that gravity gives the arm is the
    /// drives' doing.
    fn motion(&self, ran: &Ran, truth: &[PlantState], verdict: &mut Verdict) -> Motion {
        let limits = recorder::Limits::of(self.robot);
        let pairs = truth.array_windows();
        let pairs = pairs.filter(|[a, b]| a.header.tick + 1 == b.header.tick);
        let steps = pairs.map(|[a, b]| std::array::from_fn(|i| b.tau[i] - a.tau[i]));
        let motion = Motion {
            torque_max_ratio: most(truth.iter().map(|state| state.tau), &limits.effort),
            speed_max_ratio: most(truth.iter().map(|state| state.qdot), &limits.velocity),
            torque_step_max_ratio: most(steps, &limits.effort),
            stale_ticks: ran.stale_ticks(),
        };
        let is_finite = |PlantState { tau, q, qdot, .. }: &PlantState| {
            [tau, q, qdot].into_iter().flatten().all(|x| x.is_finite())
        };
        verdict.unless(truth.iter().all(is_finite), "finite", "the plant's state");
        let mut unfresh = truth
            .iter()
            .filter(|state| state.drive == DRIVE_ACTIVE && state.drive_flags & NOT_FRESH != 0);
        let tick = unfresh.next().map(|state| state.header.tick);
        verdict.unless(tick.is_none(), "fresh", format_args!("at tick {tick:?}"));
        let has_drives = !ran.has(Kind::Drive);
        for (check, value, most, is_meant) in [
            ("torque", motion.torque_max_ratio, 1.0 + 1e-9, true),
            (
                "step",
                motion.torque_step_max_ratio,
                STEP_PER_MS * 1e3 / ran.rate_hz(),
                has_drives,
            ),
            (
                "speed",
                motion.speed_max_ratio,
                SPEED[usize::from(!ran.is_lockstep())],
                has_drives,
            ),
        ] {
            verdict.unless(
                !is_meant || value <= most,
                check,
                format_args!("{check} {value:.3} of its limit, {most:.3} is allowed"),
            );
        }
        motion
    }

    /// How far the arm left its path; where a drive or a sensor fails, the bound follows from the speeds that it has without a fault.
    fn excursion(
        &self,
        ran: &Ran,
        base: &Ran,
        truth: &[PlantState],
        verdict: &mut Verdict,
    ) -> Result<Excursion, Failure> {
        let fastest = |joint: usize| {
            base.truth
                .iter()
                .fold(0.0_f64, |most, state| most.max(state.qdot[joint].abs()))
        };
        let speed: [f64; MAX_DOF] = std::array::from_fn(fastest);
        let [mut joint, mut hand] = ORDINARY;
        for (_, fault) in ran.faults() {
            let [rad, mm] = bounds::allowed(self.robot, &self.job.scenario, &speed, fault)
                .map_err(Failure::input)?;
            (joint, hand) = (joint.max(rad), hand.max(mm));
        }
        let first = ran.faults().map(|(fault, _)| fault.tick).min();
        let settled_ms = first
            .and_then(|at| settled(truth, at))
            .map(|ticks| ticks as f64 * 1e3 / ran.rate_hz());
        let rad = farthest(&base.truth, truth, joints_apart);
        let mm = 1e3 * farthest(&base.truth, truth, hands_apart);
        verdict.unless(
            rad <= joint,
            "joint-excursion",
            format_args!("{rad:.3} rad off the path, {joint:.3} are allowed"),
        );
        verdict.unless(
            mm <= hand,
            "hand-excursion",
            format_args!("{mm:.0} mm off the path, {hand:.0} are allowed"),
        );
        let late_ms = settled_ms.unwrap_or_default();
        verdict.unless(
            late_ms <= REST_MS,
            "settled",
            format_args!("no rest for {late_ms:.0} ms"),
        );
        Ok(Excursion {
            excursion_max_rad: rad,
            excursion_max_mm: mm,
            excursion_allowed_rad: joint,
            excursion_allowed_mm: hand,
            settled_ms,
        })
    }
}

/// The largest share that values of the joints have of their limits.
fn most(values: impl Iterator<Item = [f64; MAX_DOF]>, limits: &[f64]) -> f64 {
    let values = values.flat_map(|joints| joints.into_iter().zip(limits));
    values.fold(0.0, |most, (value, limit)| {
        larger(most, share(value, *limit))
    })
}

/// A torque is in force for a few milliseconds at most.
fn age(ran: &Ran, stale_ticks: u32, verdict: &mut Verdict) {
    let stale_ms = 1e3 * f64::from(stale_ticks) / ran.rate_hz();
    let is_late = ran.is_lockstep() && stale_ms > STALE_MS;
    let is_young = stale_ticks <= ran.job.scenario.plant.hold_ticks && !is_late;
    verdict.unless(
        is_young,
        "age",
        format_args!("a torque was in force for {stale_ms:.0} ms"),
    );
}

/// A run ends at its goal or at rest, or at the death of the plant in real time, with a sentence that names the process.
fn ends(ran: &Ran, is_well: bool, verdict: &mut Verdict) {
    let is_of_world = |fault: &Fault| fault.process == Program::Plant.name();
    match &ran.failure {
        None => {
            let ends_world = !ran.is_lockstep() && ran.faults().any(|(_, fault)| ends_world(fault));
            verdict.unless(
                !ends_world,
                "end",
                "the end of the plant did not end the run",
            );
            // The record of how it ended goes with the volume.
            verdict.unless(
                is_well || ran.full_at().is_some(),
                "end",
                "neither the goal nor rest at the end",
            );
        }
        // A busy machine may continue a plant that stands still too late.
        Some(Mishap::Died { process, .. })
            if process == Program::Plant.name()
                && ran
                    .faults()
                    .any(|(_, fault)| is_of_world(fault) && fault.kind.takes_down()) => {}
        Some(mishap) => {
            let text = mishap.to_string();
            verdict.unless(false, "end", text.lines().next().unwrap_or_default());
        }
    }
}

/// Every death is detected and recovered, and no process ends unrequested.
fn lives(ran: &Ran, verdict: &mut Verdict) {
    let is_corrupted = ran.has(Kind::Corrupt);
    let detected = |fault: &&FaultSummary| fault.origin == "detected";
    for seen in ran.summary.faults.iter().filter(detected) {
        // A process that stands still is killed; one that is led to a number that is not finite stops rather than send it.
        let hangs = |fault: &Fault| fault.process == seen.process && fault.kind == Kind::Hang;
        let is_ours = seen.kind == "exit" && is_corrupted
            || seen.plan.is_some() && ran.faults().any(|(_, fault)| hangs(fault));
        verdict.unless(is_ours, "unrequested-end", &seen.detail);
    }
    for (seen, fault) in ran.faults().filter(|(seen, _)| !detected(seen)) {
        let is_due = seen.tick + (TIME_TO_RETURN_S * ran.rate_hz()) as u64 <= ran.summary.ticks;
        let ends_run = ends_world(fault) && !ran.is_lockstep();
        if fault.kind.ends_process(fault.way) && is_due && !ends_run {
            let is_back = seen.detected_ms.is_some() && seen.recovered_ms.is_some();
            verdict.unless(
                is_back,
                "death",
                format_args!("{}: not detected, or not started again", seen.detail),
            );
        }
    }
}

/// In real time a replacement keeps up: at the end the drives follow the controller again, unless another fault still holds messages back.
fn follows(ran: &Ran, truth: &[PlantState], verdict: &mut Verdict) {
    let second = ran.rate_hz() as u64;
    let is_old = |(seen, fault): (&FaultSummary, &Fault)| {
        let has_time = seen.tick + (TIME_TO_RETURN_S * ran.rate_hz()) as u64 + second;
        fault.kind.ends_process(fault.way) && !ends_world(fault) && has_time <= ran.summary.ticks
    };
    if ran.is_lockstep() || ran.failure.is_some() || !ran.faults().all(is_old) {
        return;
    }
    let last = truth.iter().rev().take(second as usize);
    let (total, following) = last.fold((0, 0), |(total, following), state| {
        let follows = state.drive == DRIVE_ACTIVE;
        (total + 1, following + u64::from(follows))
    });
    verdict.unless(
        2 * following >= total,
        "follow",
        format_args!("the drives followed the controller in {following} of the last {total} ticks"),
    );
}

/// Nothing is lost but what a dead recorder could not take in, and everything that was written can be read.
fn record(ran: &Ran, verdict: &mut Verdict) {
    let (rate_hz, recorder, full_at) = (ran.rate_hz(), &ran.summary.recorder, ran.full_at());
    let mut processes = ran.summary.processes.iter();
    let deaths = processes
        .find(|one| one.name == Program::Recorder.name() && !ran.is_lockstep())
        .map_or(0, |one| one.restarts);
    let ticks = (LOST_PER_DEATH_S * rate_hz).ceil() as u64 * u64::from(deaths);
    let topics = ran.summary.topics.len() as u64;
    let (has_account, lost) = (recorder.messages > 0, recorder.lost);
    verdict.unless(
        !has_account || lost <= ticks * topics,
        "lost",
        format_args!("{lost} messages lost, {} are allowed", ticks * topics),
    );
    match full_at {
        Some(full) => {
            let is_known = !has_account
                || !recorder.error.is_empty()
                || ran.summary.ticks <= full + rate_hz as u64;
            verdict.unless(
                is_known,
                "volume",
                "no message said that the volume was full",
            );
        }
        None if has_account => {
            verdict.unless(recorder.error.is_empty(), "recording", &recorder.error);
            let run = Run {
                folder: ran.job.out.clone(),
            };
            let (damage, _) = run.message_damage(&ran.job, Some(&ran.summary));
            verdict.unless(damage.is_empty(), "files", damage.join("; "));
        }
        None => {}
    }
    if ran.job.record && has_account {
        rows(ran, ticks, verdict);
    }
}

/// The record has messages of the plant of every tick but those that may be missing: one whose numbers a fault has spoilt is refused, the other one is
/// there.
fn rows(ran: &Ran, ticks: u64, verdict: &mut Verdict) {
    let (rate_hz, full_at) = (ran.rate_hz(), ran.full_at());
    let samples = ran.samples.iter().map(|sample| sample.header.tick);
    let states = ran.truth.iter().map(|state| state.header.tick);
    let rows = samples.chain(states).collect::<BTreeSet<_>>().len() as u64;
    // A full volume costs the messages in hand, and those that come until it is detected.
    let in_hand = (IN_HAND_S * rate_hz) as u64;
    let due = full_at.map_or(ran.summary.ticks, |full| {
        full.saturating_sub(in_hand).min(ran.summary.ticks)
    });
    verdict.unless(
        rows + ticks + 1 >= due,
        "rows",
        format_args!("the record has messages of {rows} ticks of {due}, {ticks} may be missing"),
    );
}

/// Largest difference of a joint; rad.
fn joints_apart(a: &PlantState, b: &PlantState) -> f64 {
    (0..MAX_DOF).fold(0.0_f64, |most, i| most.max((a.q[i] - b.q[i]).abs()))
}

/// Distance of the end-effectors; m.
fn hands_apart(a: &PlantState, b: &PlantState) -> f64 {
    (0..3)
        .map(|i| (a.p_BE[i] - b.p_BE[i]).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// Largest distance from the base's path. Not the time lost on it: each state is compared with those that the base had come to by then, back to the
/// one that matched last.
fn farthest(
    base: &[PlantState],
    truth: &[PlantState],
    apart: fn(&PlantState, &PlantState) -> f64,
) -> f64 {
    let (mut most, mut from) = (0.0_f64, 0);
    for state in truth {
        let to = (state.header.tick as usize).min(base.len().saturating_sub(1));
        let nearest = (from.min(to)..=to).filter_map(|k| Some((k, apart(state, base.get(k)?))));
        if let Some((k, distance)) = nearest.min_by(|a, b| a.1.total_cmp(&b.1)) {
            (most, from) = (most.max(distance), k);
        }
    }
    most
}

/// Ticks from the fault until the drives follow the controller again, or have braked for good; `None` where they never left it.
fn settled(truth: &[PlantState], at_tick: u64) -> Option<u64> {
    let after = || truth.iter().filter(|state| state.header.tick >= at_tick);
    let last = after()
        .rfind(|state| state.drive != DRIVE_ACTIVE)?
        .header
        .tick;
    let braked = after()
        .find(|state| state.drive == DRIVE_BRAKED)
        .map_or(last, |state| state.header.tick);
    let is_back = after().any(|state| state.header.tick > last);
    Some(if is_back { last + 1 } else { braked } - at_tick)
}

#[cfg(test)]
mod tests;
