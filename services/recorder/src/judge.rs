//! The recorder's pure step: whole ticks in, the summary out. Judged on the simulator's truth, never on the controller's opinion.

use std::collections::BTreeMap;

use hdrhistogram::Histogram;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use shared_types::codes::{self, MODE_REGULAR};
use shared_types::scenario::Goal;
use shared_types::summary::{JointSummary, Latency, ModeChange, SingularitySummary, TaskSummary, TurnSummary};
use shared_types::topics::{ByTopic, Lent};
use shared_types::wire::HOPS;
use shared_types::{MAX_SINGULARITIES, PlantState, SensorSample, SingularityReport, SingularityState, StateEstimate, TorqueCommand};

/// One tick, whole: what each process said about it.
#[derive(Clone, Copy, Debug)]
pub struct Tick<'a> {
    /// From the plant.
    pub sensor: &'a SensorSample,
    /// From the plant.
    pub truth: &'a PlantState,
    /// From the estimator.
    pub estimate: &'a StateEstimate,
    /// From the analyzer.
    pub report: &'a SingularityReport,
    /// From the controller.
    pub command: &'a TorqueCommand,
}

impl<'a> Tick<'a> {
    /// What is judged of a tick; `None` where something of it is missing.
    #[must_use]
    pub fn of(messages: &ByTopic<Lent<'a>>) -> Option<Self> {
        Some(Self {
            sensor: messages.sensor?,
            truth: messages.plant_state?,
            estimate: messages.estimate?,
            report: messages.singularity?,
            command: messages.torque?,
        })
    }
}

/// What the judge needs to know of the arm: limits, one entry a joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// N·m.
    pub effort: Vec<f64>,
    /// rad/s.
    pub velocity: Vec<f64>,
}

/// Gathers a run's figures tick by tick.
#[derive(Debug, Serialize, Deserialize)]
pub struct Judge {
    limits: Limits,
    goal: Goal,
    planned_ticks: f64,
    ticks: u64,
    task: TaskSummary,
    position_square_sum: f64,
    joints: JointSummary,
    #[serde(with = "stored")]
    torque_steps: Histogram<u64>,
    last_tau: Option<Vec<f64>>,
    singularities: Vec<Watched>,
    modes: Vec<ModeChange>,
    turns: Vec<Turn>,
    /// Of each span that is timed.
    #[serde(with = "stored_all")]
    latencies: Vec<Histogram<u64>>,
    /// Not stored: who goes on after a gap measures no latency over it.
    #[serde(skip)]
    last_sensor: Option<SensorSample>,
    /// Between two points of the real-time grid; 0 without one.
    period_ns: u64,
    /// When the tick before the last one was due.
    due_before_ns: u64,
    clipped: bool,
    phase: u32,
    refusal: u32,
    first_ns: u64,
    last_ns: u64,
}

/// A null-space turn, followed while it lasts.
#[derive(Debug, Serialize, Deserialize)]
struct Turn {
    summary: TurnSummary,
    q_start: Vec<f64>,
    /// `TorqueCommand::planned` while it lasts, and the task segment; 0 once it is over.
    planned: u32,
    segment: u32,
}

#[derive(Debug, Serialize, Deserialize)]
struct Watched {
    summary: SingularitySummary,
    mode: u32,
    inside: bool,
    /// ζ when the neighbourhood was entered last.
    zeta_at_entry: [f64; 3],
}

/// The judge's findings.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Whole ticks seen.
    pub ticks: u64,
    /// Whether the task ran to its end.
    pub completed: bool,
    /// `"goal reached"`, `"goal missed"` or `"stopped"`.
    pub outcome: String,
    /// Why, in one sentence.
    pub reason: String,
    /// Wall-clock time between the first and the last sample; s.
    pub wall_s: f64,
    /// Task errors.
    pub task: TaskSummary,
    /// Joint loads.
    pub joints: JointSummary,
    /// Per singularity.
    pub singularities: Vec<SingularitySummary>,
    /// Null-space turns of singular directions.
    pub turns: Vec<TurnSummary>,
    /// Mode changes.
    pub modes: Vec<ModeChange>,
    /// Per hop and end to end.
    pub latency_us: BTreeMap<String, Latency>,
}

/// Torque steps are kept in millionths of the limit: a ratio of 1 is 1 000 000.
const STEP_UNIT: f64 = 1e6;

/// Larger steps than this many limits, which only a fault makes, count as it.
const STEP_MOST: f64 = 1e3;
/// Time over which the jump of a switch is taken back, s: the default velocity feedback's, 1/k_v.
const SWITCH_S: f64 = 0.025;

fn histogram() -> Histogram<u64> {
    // 3 significant digits up to 100 s in ns; resizes by itself beyond, so that no sample is left out.
    let mut histogram = Histogram::new_with_bounds(1, 100_000_000_000, 3).expect("constant bounds are valid");
    histogram.auto(true);
    histogram
}

/// A histogram as the values in it and how often each occurred.
mod stored {
    use super::{Histogram, histogram};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) type Values = Vec<(u64, u64)>;

    pub(super) fn values(histogram: &Histogram<u64>) -> Values {
        histogram.iter_recorded().map(|one| (one.value_iterated_to(), one.count_at_value())).collect()
    }

    pub(super) fn of(values: Values) -> Histogram<u64> {
        let mut histogram = histogram();
        values.into_iter().for_each(|(value, count)| histogram.saturating_record_n(value, count));
        histogram
    }

    pub(super) fn serialize<S: Serializer>(histogram: &Histogram<u64>, serializer: S) -> Result<S::Ok, S::Error> {
        values(histogram).serialize(serializer)
    }

    pub(super) fn deserialize<'a, D: Deserializer<'a>>(deserializer: D) -> Result<Histogram<u64>, D::Error> {
        Values::deserialize(deserializer).map(of)
    }
}

mod stored_all {
    use super::{Histogram, Span, stored};
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(all: &[Histogram<u64>], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(all.iter().map(stored::values))
    }

    pub(super) fn deserialize<'a, D: Deserializer<'a>>(deserializer: D) -> Result<Vec<Histogram<u64>>, D::Error> {
        let all: Vec<_> = Vec::deserialize(deserializer)?.into_iter().map(stored::of).collect();
        if all.len() == Span::all().count() { Ok(all) } else { Err(D::Error::invalid_length(all.len(), &"one for each span")) }
    }
}

/// A span of time that is measured each tick.
#[derive(Clone, Copy)]
enum Span {
    /// Sensor to torque in the plant's hands.
    Chain,
    /// What a process takes for its own part.
    Own(usize),
    /// The way to a process from the one before it.
    Way(usize),
}

impl Span {
    fn all() -> impl Iterator<Item = Self> {
        std::iter::once(Self::Chain).chain((0..HOPS.len()).map(Self::Own)).chain((1..HOPS.len()).map(Self::Way))
    }

    /// Its place among all.
    const fn place(self) -> usize {
        match self {
            Self::Chain => 0,
            Self::Own(hop) => 1 + hop,
            Self::Way(hop) => HOPS.len() + hop,
        }
    }

    fn name(self) -> String {
        match self {
            Self::Chain => "chain".to_owned(),
            Self::Own(hop) => HOPS[hop].to_owned(),
            Self::Way(hop) => format!("{} to {}", HOPS[hop - 1], HOPS[hop]),
        }
    }
}

/// Desired against true pose at one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaskError {
    /// Whole, across the engaged singular directions, and along them; mm.
    pub position: [f64; 3],
    /// The same; degrees.
    pub orientation: [f64; 3],
}

impl TaskError {
    /// The error split at the directions of the singularities that are engaged: inside their neighbourhood, or not yet left by the law.
    #[must_use]
    pub fn of(tick: &Tick<'_>) -> Self {
        let (truth, command) = (tick.truth, tick.command);
        let position = Vector3::from(command.p_BE_d) - Vector3::from(truth.p_BE);
        let orientation = rotation_vector(&(matrix(&command.R_BE_d) * matrix(&truth.R_BE).transpose()));
        let (mut across_m, mut across_rad) = (position, orientation);
        for (i, singularity) in active(tick.report).iter().enumerate() {
            if command.mode[i] == MODE_REGULAR && singularity.inside == 0 {
                continue;
            }
            let (linear, angular) = halves(&singularity.zeta_B);
            across_m -= linear * linear.dot(&across_m);
            across_rad -= angular * angular.dot(&across_rad);
        }
        let split = |whole: Vector3<f64>, across: Vector3<f64>, unit: f64| [whole, across, whole - across].map(|x| x.norm() * unit);
        Self { position: split(position, across_m, 1e3), orientation: split(orientation, across_rad, 1f64.to_degrees()) }
    }
}

impl Judge {
    /// A judge for an arm with these limits and a task planned to take `planned_ticks`.
    #[must_use]
    pub fn new(limits: Limits, goal: Goal, planned_ticks: f64) -> Self {
        Self {
            limits,
            goal,
            planned_ticks,
            ticks: 0,
            task: TaskSummary::default(),
            position_square_sum: 0.0,
            joints: JointSummary::default(),
            torque_steps: histogram(),
            last_tau: None,
            singularities: Vec::new(),
            modes: Vec::new(),
            turns: Vec::new(),
            latencies: Span::all().map(|_| histogram()).collect(),
            last_sensor: None,
            period_ns: 0,
            due_before_ns: 0,
            clipped: false,
            phase: 0,
            refusal: 0,
            first_ns: 0,
            last_ns: 0,
        }
    }

    /// The same for a run paced on a grid: a grid point at which no tick began, because the one before took too long, is a sample too.
    #[must_use]
    pub fn on_grid(self, period_ns: u64) -> Self {
        Self { period_ns, ..self }
    }

    /// Takes in one whole tick.
    pub fn tick(&mut self, tick: Tick<'_>) {
        let switches = self.modes.len();
        self.watch_singularities(&tick);
        self.watch_turns(&tick);
        self.measure_switches(&tick, self.modes.len() - switches);
        self.measure_task(&tick);
        self.measure_joints(&tick);
        self.measure_hops(tick.command);
        self.measure_chain(tick.sensor);
        self.clipped |= tick.command.clipped != 0;
        (self.phase, self.refusal) = (tick.command.phase, tick.command.refusal);
        self.ticks += 1;
    }

    /// Takes in a tick that not every process answered: nothing can be judged on it but that it took its time.
    pub fn torn(&mut self, sensor: &SensorSample) {
        self.measure_chain(sensor);
    }

    fn measure_task(&mut self, tick: &Tick<'_>) {
        let TaskError { position: [mm, across_mm, _], orientation: [deg, across_deg, _] } = TaskError::of(tick);
        let task = &mut self.task;
        task.position_max_mm = task.position_max_mm.max(mm);
        task.orientation_max_deg = task.orientation_max_deg.max(deg);
        task.orthogonal_max_mm = task.orthogonal_max_mm.max(across_mm);
        task.orthogonal_max_deg = task.orthogonal_max_deg.max(across_deg);
        (task.final_position_mm, task.final_orientation_deg) = (mm, deg);
        self.position_square_sum += mm * mm;
    }

    fn measure_joints(&mut self, tick: &Tick<'_>) {
        let n = self.limits.effort.len();
        let ratio = |value: f64, limit: f64| if limit.is_finite() { value.abs() / limit } else { 0.0 };
        let joints = &mut self.joints;
        let tau = &tick.command.tau[..n];
        for (i, torque) in tau.iter().enumerate() {
            joints.speed_max_ratio = joints.speed_max_ratio.max(ratio(tick.truth.qdot[i], self.limits.velocity[i]));
            joints.torque_max_ratio = joints.torque_max_ratio.max(ratio(*torque, self.limits.effort[i]));
        }
        if let Some(last) = &self.last_tau {
            let step = (0..n).fold(0.0f64, |step, i| step.max(ratio(tau[i] - last[i], self.limits.effort[i])));
            joints.torque_step_max_ratio = joints.torque_step_max_ratio.max(step);
            self.torque_steps.saturating_record((step.min(STEP_MOST) * STEP_UNIT) as u64 + 1);
        } else {
            joints.q_start = tick.truth.q[..n].to_vec();
        }
        joints.q_end.clear();
        joints.q_end.extend_from_slice(&tick.truth.q[..n]);
        joints.saturated_ticks += u64::from(tick.command.saturation_mask != 0);
        let last = self.last_tau.get_or_insert_default();
        last.clear();
        last.extend_from_slice(tau);
    }

    /// The jump in power that a change of mode commands.
    fn measure_switches(&mut self, tick: &Tick<'_>, changes: usize) {
        self.joints.switches += changes as u64;
        if changes > 0
            && let Some(last) = &self.last_tau
        {
            let jump: f64 = last.iter().enumerate().map(|(i, before)| (tick.command.tau[i] - before) * tick.truth.qdot[i]).sum();
            self.joints.switch_energy_j += jump.abs() * SWITCH_S;
        }
    }

    /// What is said of null-space turns, and what comes of them.
    fn watch_turns(&mut self, tick: &Tick<'_>) {
        let (command, n) = (tick.command, self.limits.effort.len());
        let place = (command.planned as usize).wrapping_sub(1);
        let going_on =
            self.turns.last().is_some_and(|turn| turn.planned != 0 && (turn.planned, turn.segment) == (command.planned, command.segment));
        if let Some(singularity) = active(tick.report).get(place)
            && !going_on
        {
            let summary = TurnSummary {
                tick: command.header.tick,
                singularity: codes::singularity_name(singularity.kind, place),
                planned_deg: command.planned_dq[..n].iter().map(|by| by.to_degrees()).collect(),
                planned_s: command.planned_s,
                ..TurnSummary::default()
            };
            let turn = Turn { summary, q_start: tick.truth.q[..n].to_vec(), planned: command.planned, segment: command.segment };
            self.turns.push(turn);
        }
        if let Some(turn) = self.turns.last_mut()
            && turn.planned != 0
        {
            turn.summary.moved_deg = turn.q_start.iter().zip(&tick.truth.q).map(|(from, to)| (to - from).to_degrees()).collect();
            turn.summary.took_ticks = command.header.tick.saturating_sub(turn.summary.tick);
            if command.planned == 0 {
                turn.planned = 0;
            }
        }
    }

    fn watch_singularities(&mut self, tick: &Tick<'_>) {
        for (i, singularity) in active(tick.report).iter().enumerate() {
            if self.singularities.len() <= i {
                let name = codes::singularity_name(singularity.kind, i);
                let summary = SingularitySummary { name, s_min: f64::INFINITY, ..SingularitySummary::default() };
                self.singularities.push(Watched { summary, mode: MODE_REGULAR, inside: false, zeta_at_entry: [0.0; 3] });
            }
            let watched = &mut self.singularities[i];
            let summary = &mut watched.summary;
            summary.s_min = summary.s_min.min(singularity.s.abs());
            codes::name_of(codes::TYPES, singularity.class).clone_into(&mut summary.class);
            (summary.kappa_1, summary.kappa_2) = (singularity.kappa_1, singularity.kappa_2);
            let inside = singularity.inside != 0;
            summary.inside_ticks += u64::from(inside);
            summary.entries += u64::from(inside && !watched.inside);
            let (linear, angular) = halves(&singularity.zeta_B);
            let zeta = if singularity.angular != 0 { angular } else { linear };
            if inside && !watched.inside {
                watched.zeta_at_entry = zeta.into();
            }
            if inside {
                let entry = Vector3::from(watched.zeta_at_entry);
                let turned = entry.cross(&zeta).norm().atan2(entry.dot(&zeta)).to_degrees();
                summary.zeta_turned_deg = summary.zeta_turned_deg.max(turned);
            }
            watched.inside = inside;
            let mode = tick.command.mode[i];
            if mode != watched.mode {
                watched.mode = mode;
                self.modes.push(ModeChange {
                    tick: tick.command.header.tick,
                    singularity: summary.name.clone(),
                    mode: codes::name_of(codes::MODES, mode).to_owned(),
                });
            }
        }
    }

    /// Adds a time to a distribution; the histogram grows with its samples: there is no time that it cannot hold.
    fn measure(&mut self, span: Span, from_ns: u64, to_ns: u64) {
        if from_ns != 0 && to_ns != 0 {
            let _ = self.latencies[span.place()].record(to_ns.saturating_sub(from_ns));
        }
    }

    /// Each hand-over and each computation, from the stamps of the last message of the way.
    fn measure_hops(&mut self, command: &TorqueCommand) {
        let stamps = command.header.stamps;
        for hop in 1..HOPS.len() {
            self.measure(Span::Way(hop), stamps.sent_ns[hop - 1], stamps.received_ns[hop]);
            self.measure(Span::Own(hop), stamps.received_ns[hop], stamps.sent_ns[hop]);
        }
    }

    /// Sensor to torque in the plant's hands, and the plant's own part; on a grid both from when the tick was due.
    fn measure_chain(&mut self, sensor: &SensorSample) {
        let now = sensor.header.stamps;
        let sent = now.sent_ns[0];
        // The sample of tick k + 1 says when the plant received torque k.
        if let Some(last) = self.last_sensor
            && last.header.tick + 1 == sensor.header.tick
        {
            let then = last.header.stamps;
            // A torque that never came counts with all the time that the plant gave it.
            let ended = if now.received_ns[0] > then.sent_ns[0] { now.received_ns[0] } else { sent };
            self.measure(Span::Chain, then.origin_ns(), ended);
            if self.period_ns > 0 && self.due_before_ns > 0 {
                // No coordinated omission: who asked at a skipped grid point had to wait for this answer.
                let skipped = (self.due_before_ns + self.period_ns..then.due_ns).step_by(self.period_ns as usize);
                skipped.for_each(|due| self.measure(Span::Chain, due, ended));
            }
            self.due_before_ns = then.due_ns;
            let began = if now.due_ns > 0 { now.due_ns } else { now.received_ns[0] };
            self.measure(Span::Own(0), began, sent);
        }
        self.first_ns = if self.first_ns == 0 { sent } else { self.first_ns };
        self.last_ns = sent.max(self.last_ns);
        self.last_sensor = Some(*sensor);
    }

    /// Speaks the verdict.
    #[must_use]
    pub fn verdict(mut self) -> Verdict {
        if self.ticks > 0 {
            self.task.position_rms_mm = (self.position_square_sum / self.ticks as f64).sqrt();
            self.task.time_stretch = self.ticks as f64 / self.planned_ticks.max(1.0);
            self.joints.torque_step_p95_ratio = self.torque_steps.value_at_quantile(0.95) as f64 / STEP_UNIT;
        }
        let (outcome, reason) = self.outcome();
        Verdict {
            ticks: self.ticks,
            completed: self.phase == codes::PHASE_DONE,
            outcome: outcome.to_owned(),
            reason,
            wall_s: self.last_ns.saturating_sub(self.first_ns) as f64 * 1e-9,
            task: self.task,
            joints: self.joints,
            singularities: self.singularities.into_iter().map(|watched| watched.summary).collect(),
            turns: self.turns.into_iter().map(|turn| turn.summary).collect(),
            modes: self.modes,
            latency_us: Span::all().map(|span| (span.name(), latency(&self.latencies[span.place()]))).collect(),
        }
    }

    fn outcome(&self) -> (&'static str, String) {
        let (task, goal) = (&self.task, &self.goal);
        if self.phase == codes::PHASE_REFUSED {
            let why = codes::name_of(codes::REFUSALS, self.refusal);
            return ("stopped", format!("the controller refused to go on and brought the arm to rest: {why}"));
        }
        if self.phase != codes::PHASE_DONE {
            return ("stopped", format!("the run ended after {} ticks, before the task did", self.ticks));
        }
        let missed: Vec<String> = [
            ("end position", task.final_position_mm, goal.position_mm, "mm"),
            ("end orientation", task.final_orientation_deg, goal.orientation_deg, "°"),
            ("position across the singular directions", task.orthogonal_max_mm, goal.orthogonal_mm, "mm"),
            ("orientation across the singular directions", task.orthogonal_max_deg, goal.orthogonal_deg, "°"),
        ]
        .iter()
        .filter(|(_, value, bound, _)| value > bound)
        .map(|(what, value, bound, unit)| format!("{what} off by {value:.3} {unit}, allowed {bound} {unit}"))
        .collect();
        let clipped = if self.clipped { "; the goal was beyond reach and has been clipped to the boundary" } else { "" };
        if missed.is_empty() {
            ("goal reached", format!("all errors within the goal{clipped}"))
        } else {
            ("goal missed", format!("{}{clipped}", missed.join("; ")))
        }
    }
}

/// The singularities that are meant, bounded by what the message can carry.
fn active(report: &SingularityReport) -> &[SingularityState] {
    &report.singularities[..(report.count as usize).min(MAX_SINGULARITIES)]
}

fn halves(twist: &[f64; 6]) -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(twist[0], twist[1], twist[2]), Vector3::new(twist[3], twist[4], twist[5]))
}

fn matrix(columns: &[f64; 9]) -> Matrix3<f64> {
    Matrix3::from_column_slice(columns)
}

/// Axis times angle of a rotation matrix, rad; exact near 0 and near π.
fn rotation_vector(R: &Matrix3<f64>) -> Vector3<f64> {
    nalgebra::Rotation3::from_matrix_unchecked(*R).scaled_axis()
}

fn latency(histogram: &Histogram<u64>) -> Latency {
    let us = |quantile: f64| histogram.value_at_quantile(quantile) as f64 * 1e-3;
    Latency { count: histogram.len(), p50: us(0.5), p99: us(0.99), p999: us(0.999), max: histogram.max() as f64 * 1e-3 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDENTITY: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

    fn judged(ticks: u64, shape: impl Fn(u64, &mut SensorSample, &mut PlantState, &mut SingularityReport, &mut TorqueCommand)) -> Verdict {
        let mut judge = Judge::new(Limits { effort: vec![10.0; 6], velocity: vec![2.0; 6] }, Goal::default(), ticks as f64);
        for k in 0..ticks {
            let (mut sensor, mut truth, mut report, mut command) = Default::default();
            let estimate = StateEstimate::default();
            (sensor, truth) = (SensorSample { ..sensor }, PlantState { R_BE: IDENTITY, ..truth });
            (report, command) = (SingularityReport { ..report }, TorqueCommand { R_BE_d: IDENTITY, ..command });
            sensor.header.tick = k;
            command.header.tick = k;
            command.phase = if k + 1 == ticks { codes::PHASE_DONE } else { codes::PHASE_RUNNING };
            shape(k, &mut sensor, &mut truth, &mut report, &mut command);
            judge.tick(Tick { sensor: &sensor, truth: &truth, estimate: &estimate, report: &report, command: &command });
        }
        judge.verdict()
    }

    #[test]
    fn a_perfect_run_reaches_its_goal() {
        let verdict = judged(10, |_, _, _, _, _| ());
        assert_eq!((verdict.outcome.as_str(), verdict.completed, verdict.ticks), ("goal reached", true, 10));
    }

    #[test]
    fn an_error_at_the_end_misses_the_goal_and_says_by_how_much() {
        let verdict = judged(10, |k, _, truth, _, _| truth.p_BE[0] = if k == 9 { 2e-3 } else { 0.0 });
        assert_eq!(verdict.outcome, "goal missed");
        assert!(verdict.reason.contains("end position off by 2.000 mm, allowed 1 mm"), "{}", verdict.reason);
        assert!((verdict.task.position_max_mm - 2.0).abs() < 1e-12);
    }

    #[test]
    fn an_error_along_the_singular_direction_is_not_across_it() {
        let verdict = judged(10, |k, _, truth, report, command| {
            report.count = 1;
            report.singularities[0].zeta_B[0] = 1.0;
            report.singularities[0].inside = 1;
            command.mode[0] = codes::MODE_TRACK;
            truth.p_BE[0] = if k == 4 { 5e-3 } else { 0.0 };
        });
        assert!(verdict.task.position_max_mm > 4.9 && verdict.task.orthogonal_max_mm < 1e-12);
        assert_eq!(verdict.outcome, "goal reached");
        assert_eq!((verdict.modes.len(), verdict.modes[0].mode.as_str()), (1, "track"));
    }

    #[test]
    fn the_angle_through_which_zeta_turns_is_measured_from_the_entry() {
        let verdict = judged(91, |k, _, _, report, _| {
            report.count = 1;
            let angle = (k as f64).to_radians();
            let zeta = &mut report.singularities[0];
            (zeta.angular, zeta.inside, zeta.kind) = (1, 1, codes::KIND_WRIST);
            (zeta.zeta_B[3], zeta.zeta_B[4]) = (angle.cos(), angle.sin());
        });
        assert!((verdict.singularities[0].zeta_turned_deg - 90.0).abs() < 1e-9);
        assert_eq!(verdict.singularities[0].name, "wrist");
    }

    #[test]
    fn a_switch_puts_in_the_power_that_jumps() {
        let verdict = judged(20, |k, _, truth, report, command| {
            report.count = 1;
            command.mode[0] = if k >= 10 { codes::MODE_TRACK } else { codes::MODE_REGULAR };
            // 4 N·m at 0.5 rad/s against 1 N·m at 1 rad/s: 1 W for 25 ms.
            (command.tau[0], command.tau[1]) = if k >= 10 { (4.0, -1.0) } else { (0.0, 0.0) };
            (truth.qdot[0], truth.qdot[1]) = (0.5, 1.0);
        });
        assert_eq!(verdict.joints.switches, 1);
        assert!((verdict.joints.switch_energy_j - 0.025).abs() < 1e-12, "{}", verdict.joints.switch_energy_j);
    }

    #[test]
    fn a_turn_is_followed_from_its_announcement_to_its_end() {
        let verdict = judged(30, |k, _, truth, report, command| {
            report.count = 2;
            report.singularities[1].kind = codes::KIND_WRIST;
            if (10..20).contains(&k) {
                (command.planned, command.planned_s, command.planned_dq[3]) = (2, 0.009, 1.5);
            }
            truth.q[3] = 0.1 * k.clamp(10, 20) as f64;
        });
        let turn = &verdict.turns[0];
        assert_eq!((verdict.turns.len(), turn.tick, turn.singularity.as_str()), (1, 10, "wrist"));
        assert!((turn.moved_deg[3] - 1f64.to_degrees()).abs() < 1e-9 && turn.took_ticks == 10, "{turn:?}");
        assert!((turn.planned_deg[3] - 1.5f64.to_degrees()).abs() < 1e-9);
    }

    #[test]
    fn a_refusal_says_why() {
        let verdict = judged(5, |_, _, _, _, command| (command.phase, command.refusal) = (codes::PHASE_REFUSED, codes::REFUSAL_ROOM));
        assert!(verdict.reason.contains("the joints have no room for it"), "{}", verdict.reason);
    }

    #[test]
    fn loads_are_ratios_and_steps_have_a_tail() {
        let verdict = judged(100, |k, _, truth, _, command| {
            command.tau[1] = if k == 50 { 5.0 } else { 0.0 };
            truth.qdot[2] = if k == 3 { -1.0 } else { 0.0 };
        });
        assert!((verdict.joints.torque_max_ratio - 0.5).abs() < 1e-12 && (verdict.joints.torque_step_max_ratio - 0.5).abs() < 1e-12);
        assert!((verdict.joints.speed_max_ratio - 0.5).abs() < 1e-12);
        assert!(verdict.joints.torque_step_p95_ratio < 1e-3, "two steps of a hundred lie above the 95th percentile");
    }

    #[test]
    fn latencies_come_from_the_stamps_and_an_unfinished_run_is_stopped() {
        let verdict = judged(10, |k, sensor, _, _, command| {
            let start = 1_000_000 * (k + 1);
            sensor.header.stamps.sent_ns[0] = start;
            sensor.header.stamps.received_ns[0] = start - 900_000;
            command.header.stamps.sent_ns[0] = start;
            command.header.stamps.received_ns[1] = start + 2_000;
            command.header.stamps.sent_ns[1] = start + 5_000;
            command.phase = codes::PHASE_RUNNING;
        });
        assert_eq!(verdict.outcome, "stopped");
        let hop = &verdict.latency_us["plant to estimator"];
        assert_eq!(hop.count, 10);
        assert!((hop.p50 - 2.0).abs() < 0.01 && (verdict.latency_us["chain"].p50 - 100.0).abs() < 0.2);
    }

    #[test]
    fn on_a_grid_latencies_count_from_the_due_time_and_skipped_points_count_too() {
        const MS: u64 = 1_000_000;
        // Due at 10, 11, then 14 ms: the second tick took until 13.5 ms. It began 0.2 ms late. The third torque never came.
        let (due, sent, received) = ([10, 11, 14, 15].map(|ms| ms * MS), [10_000, 11_200, 14_000, 15_000], [0, 10_500, 13_500, 13_500]);
        let mut judge = Judge::new(Limits { effort: vec![10.0; 6], velocity: vec![2.0; 6] }, Goal::default(), 4.0).on_grid(MS);
        for k in 0..4 {
            let mut sensor = SensorSample::default();
            sensor.header.tick = k as u64;
            (sensor.header.stamps.due_ns, sensor.header.stamps.sent_ns[0]) = (due[k], sent[k] * 1000);
            sensor.header.stamps.received_ns[0] = received[k] * 1000;
            let (truth, estimate) = (PlantState { R_BE: IDENTITY, ..PlantState::default() }, StateEstimate::default());
            let (report, command) = (SingularityReport::default(), TorqueCommand { R_BE_d: IDENTITY, ..TorqueCommand::default() });
            judge.tick(Tick { sensor: &sensor, truth: &truth, estimate: &estimate, report: &report, command: &command });
        }
        let mut chain: Vec<f64> =
            judge.latencies[Span::Chain.place()].iter_recorded().map(|bucket| bucket.value_iterated_to() as f64 / MS as f64).collect();
        chain.sort_by(f64::total_cmp);
        // 0.5 from 10; 2.5 from 11; of the third 1.0 until the plant went on, and 3.0 and 2.0 from the skipped points 12 and 13.
        let expected = [0.5, 1.0, 2.0, 2.5, 3.0];
        assert!(chain.len() == 5 && chain.iter().zip(expected).all(|(a, b)| (a / b - 1.0).abs() < 2e-3), "{chain:?}");
        let plant = &judge.verdict().latency_us["plant"];
        assert!(plant.count == 3 && (plant.max - 200.0).abs() < 1.0, "late beginnings: {plant:?}");
    }
}
