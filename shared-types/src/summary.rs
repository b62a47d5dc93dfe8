//! The results of a run, `summary.json`. Names end with their units. The simulator's true state is
//! judged.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::fault::Fault;
use crate::job::{Branch, Job};

/// The outcome of a run that a signal has ended, or whose launcher was killed.
pub const INTERRUPTED: &str = "interrupted";

/// The outcome of a run of which a process could not go on.
pub const FAILED: &str = "failed";

/// The outcome of a task that was done within its goal's bounds.
pub const REACHED: &str = "goal reached";
/// The outcome of a task whose path leaves the arm's reach, done up to the boundary of reach.
pub const BOUNDARY: &str = "followed to the boundary";
/// The outcome of a task that was done, but not within its goal's bounds or the arm's limits.
pub const MISSED: &str = "goal missed";

/// The result of a run, `summary.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// The run.
    #[serde(flatten)]
    pub of: RunOf,
    /// Ticks begun, including those that a process did not answer.
    pub ticks: u64,
    /// The task ran to its end.
    pub completed: bool,
    /// `"goal reached"`, `"followed to the boundary"`, `"goal missed"`, `"stopped"`,
    /// `"interrupted"` or `"failed"`.
    pub outcome: String,
    /// Reason for the outcome, in one sentence.
    pub reason: String,
    /// The pace.
    #[serde(flatten)]
    pub pace: Pace,
    /// Messages of each topic: their number, and a hash of their contents without time stamps.
    pub topics: BTreeMap<String, TopicSummary>,
    /// Errors of the hand.
    pub task: TaskSummary,
    /// Loads of the joints.
    pub joints: JointSummary,
    /// Events at each singularity.
    pub singularities: Vec<SingularitySummary>,
    /// Null-space turns of singular directions: the motion planned before each began, and the
    /// actual one.
    pub turns: Vec<TurnSummary>,
    /// Changes of mode, in order.
    pub modes: Vec<ModeChange>,
    /// A steered run: how the arm followed its targets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub servo: Option<ServoSummary>,
    /// Faults and refusals, in order.
    pub faults: Vec<FaultSummary>,
    /// Ticks with torque in time, late, or without. Absent in lockstep, and in a recovered run that
    /// lost some of these ticks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deadlines: Option<Deadlines>,
    /// Latency of each hop, and of the `chain` from sensor sample to received torque; µs. In real
    /// time, `chain` and `plant` count from the tick's due time, and include ticks that never began
    /// or were never answered.
    pub latency_us: BTreeMap<String, Latency>,
    /// Keys of this file whose value was NaN or infinite, from messages that a fault corrupted.
    /// JSON has no such numbers, so the largest one stands there instead.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_finite: Vec<String>,
    /// The record.
    pub recorder: RecorderSummary,
    /// The processes.
    pub processes: Vec<ProcessSummary>,
    /// The machine.
    #[serde(default)]
    pub machine: Machine,
}

/// The run that a summary describes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunOf {
    /// Version of armplane.
    pub version: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Name of the robot.
    pub robot: String,
    /// `"lockstep"` or `"realtime"`.
    pub mode: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Identifier of the run.
    pub run: String,
    /// Control rate; Hz.
    pub rate_hz: u32,
    /// The run that it goes on from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<Branch>,
}

impl From<&Job> for RunOf {
    fn from(job: &Job) -> Self {
        Self {
            version: job.version.clone(),
            scenario: job.scenario.name.clone(),
            robot: job.robot.name.clone(),
            mode: job.mode.name().to_owned(),
            seed: job.scenario.seed,
            run: job.run.clone(),
            rate_hz: job.scenario.rate_hz,
            from: job.from.clone(),
        }
    }
}

/// Pace of the ticks.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pace {
    /// Wall-clock time from the first to the last tick; s.
    pub wall_s: f64,
    /// Ticks per second of wall-clock time.
    pub ticks_per_s: f64,
}

/// The machine of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Name of the processor.
    pub cpu: String,
    /// Cores that the run could use.
    pub cores: usize,
    /// Name and version of the kernel.
    pub kernel: String,
}

/// The messages of one topic.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TopicSummary {
    /// Messages that the recorder has taken in, repeated ones included.
    pub count: u64,
    /// 64-bit XXH3 of their contents in order, hexadecimal.
    pub hash: String,
}

/// The force of the hand's segments with one, by the simulator's true contact. *Moving* are the ticks
/// after the approach, in which the segment's path goes on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForceSummary {
    /// Source of the force that the controller takes: `"wrist sensor"` or `"observer"`.
    pub source: String,
    /// Largest set-point.
    pub newtons: f64,
    /// Ticks moving.
    pub ticks: u64,
    /// Root mean square of the force error, moving, of the segment in which it is largest.
    pub rms_n: f64,
    /// Largest force error, moving.
    pub error_max_n: f64,
    /// Forces that were asked for for at least 1 s, and did not come about.
    #[serde(default)]
    pub unreached: u64,
    /// Ticks without contact, moving.
    pub lift_off_ticks: u64,
    /// Largest force before the path went on: impact and rise.
    pub impact_max_n: f64,
    /// Ticks before the path went on: approach, impact and rise.
    pub approach_ticks: u64,
    /// Largest position error across the force's direction, moving.
    pub tangential_max_mm: f64,
    /// Largest share of the force's axis or of a moment's, 0 to 1, that lay along a lost direction: the
    /// structure bears it, and no motion controls it.
    pub borne_max: f64,
    /// Root mean square of the error of the moments together, moving, of the segment in which it is
    /// largest; N·m. None: no moment is controlled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moment_rms_nm: Option<f64>,
    /// Largest such error; N·m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moment_max_nm: Option<f64>,
}

/// Errors of the hand: desired against true pose. *Orthogonal* leaves out the singular directions
/// inside their neighbourhoods.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TaskSummary {
    /// Largest position error.
    pub position_max_mm: f64,
    /// Root mean square of the position error.
    pub position_rms_mm: f64,
    /// Largest orientation error.
    pub orientation_max_deg: f64,
    /// Largest position error orthogonal to the singular directions.
    pub orthogonal_max_mm: f64,
    /// Largest orientation error orthogonal to the singular directions.
    pub orthogonal_max_deg: f64,
    /// Largest position error along the singular directions.
    #[serde(default)]
    pub along_max_mm: f64,
    /// Largest orientation error about the singular directions.
    #[serde(default)]
    pub along_max_deg: f64,
    /// Largest distance by which the path lay beyond the arm's reach.
    #[serde(default)]
    pub beyond_max_mm: f64,
    /// Ticks in which the path lay beyond reach by more than the deviation and the error that the goal allows.
    #[serde(default)]
    pub beyond_ticks: u64,
    /// Position error at the end.
    pub final_position_mm: f64,
    /// Orientation error at the end.
    pub final_orientation_deg: f64,
    /// Actual duration of the task, as a ratio of the planned one.
    pub time_stretch: f64,
    /// Ticks in which the arm touched the floor, a surface or itself with more than twice the force asked for, if any.
    #[serde(default)]
    pub contact_ticks: u64,
    /// Largest sum of contact forces on the arm.
    #[serde(default)]
    pub contact_max_n: f64,
    /// Segments with a force: how the hand kept it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<ForceSummary>,
    /// Success by the strict bar S1: within 1 mm and 0.5° at the end and orthogonal to ζ, and no
    /// limit broken.
    #[serde(default)]
    pub s1: bool,
    /// Success by the bar S2, for motions that are not along ζ: like S1, but 3° orthogonal to ζ,
    /// and 10 mm and 5° along ζ.
    #[serde(default)]
    pub s2: bool,
    /// Conditions of S2 that failed.
    #[serde(default)]
    pub missed: Vec<String>,
    /// Causes of an error that `reason` states in words: `held` at a singularity, `inside` (the run ended in a
    /// neighbourhood, too far off along ζ), `orthogonal` (off orthogonal to ζ, by more than the goal allows), `beyond` (the
    /// path left the arm's reach), `braked` (the drives had the arm for a while).
    #[serde(default)]
    pub causes: Vec<String>,
}

impl Summary {
    /// Whether the task was done as asked, or as far as the arm reaches.
    #[must_use]
    pub fn is_success(&self) -> bool {
        [REACHED, BOUNDARY].contains(&self.outcome.as_str())
    }
}

impl TaskSummary {
    /// How many times the planned time the task took, where the path waited for the arm.
    #[must_use]
    pub fn slowed(&self) -> Option<f64> {
        /// A path counts as on time up to here, as in the arena.
        const ON_TIME: f64 = 1.01;
        Some(self.time_stretch).filter(|stretch| *stretch > ON_TIME)
    }
}

/// Arms have limits, where a summary of an earlier version does not say.
const fn limited() -> bool {
    true
}

/// Loads of the joints, as ratios of each joint's limit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointSummary {
    /// Some joint has a speed limit. Otherwise `speed_max_ratio` means nothing.
    #[serde(default = "limited")]
    pub has_speed_limit: bool,
    /// Some joint has a torque limit. Otherwise the torque ratios mean nothing.
    #[serde(default = "limited")]
    pub has_torque_limit: bool,
    /// Largest speed.
    pub speed_max_ratio: f64,
    /// Largest torque applied by the drives.
    pub torque_max_ratio: f64,
    /// Largest torque commanded.
    #[serde(default)]
    pub torque_commanded_max_ratio: f64,
    /// Largest change of torque in one tick.
    pub torque_step_max_ratio: f64,
    /// 95th percentile of the change of torque in one tick.
    pub torque_step_p95_ratio: f64,
    /// 99th percentile of the change of torque in one tick.
    #[serde(default)]
    pub torque_step_p99_ratio: f64,
    /// Ticks with a torque at its limit.
    pub saturated_ticks: u64,
    /// Ticks in which the law asked for a faster change of torque than the drive accepts.
    #[serde(default)]
    pub rate_limited_ticks: u64,
    /// Ticks in which the controller ignored the estimate, because no torque within the limits can
    /// move the arm like that.
    #[serde(default)]
    pub rejected_estimate_ticks: u64,
    /// Torque steps of more than a tenth of the limit that reverse such a step of the same joint
    /// within 10 ms.
    #[serde(default)]
    pub chatter: u64,
    /// Σ ½ΔΓᵀA⁻¹ΔΓ/k_v² over all ticks with a torque step of more than a tenth of a limit: the
    /// energy that the steps put in before the loop reacts; J.
    #[serde(default)]
    pub jump_energy_j: f64,
    /// Ticks with a joint against its stop, or with the drives not active.
    #[serde(default)]
    pub stopped_ticks: u64,
    /// Changes of mode of all singularities, listed in `modes`.
    pub switches: u64,
    /// Energy put in by changes of mode: the jump |Δτᵀq̇| in commanded power, times the 25 ms in
    /// which velocity feedback takes it back; J.
    pub switch_energy_j: f64,
    /// Limits that joints reached (stops, speeds, torques), in the order in which they were first
    /// reached.
    #[serde(default)]
    pub limits: Vec<LimitSummary>,
    /// Joint positions at the start, in `units`.
    pub q_start: Vec<f64>,
    /// Joint positions at the end, in `units`.
    pub q_end: Vec<f64>,
    /// Units of the joint positions: `rad`, or `m` for a sliding joint.
    #[serde(default)]
    pub units: Vec<String>,
}

/// A limit that a joint reached.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LimitSummary {
    /// Name of the joint.
    pub joint: String,
    /// `"lower stop"`, `"upper stop"`, `"speed"` (above the limit), `"torque"` (at the limit), or
    /// `"drive speed"` and `"drive rate"` (the drive cut or delayed the torque for that reason).
    pub limit: String,
    /// First tick at the limit.
    pub first_tick: u64,
    /// Ticks at the limit.
    pub ticks: u64,
}

/// One singularity during the run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SingularitySummary {
    /// Name of the singularity.
    pub name: String,
    /// Type of the singularity at the end.
    #[serde(rename = "type")]
    pub class: String,
    /// κ₁: second-order motion along ζ per null motion.
    pub kappa_1: f64,
    /// κ₂: turning rate of ζ per null motion.
    pub kappa_2: f64,
    /// Smallest |s|.
    pub s_min: f64,
    /// Ticks inside the neighbourhood.
    pub inside_ticks: u64,
    /// Times that the arm entered the neighbourhood.
    pub entries: u64,
    /// Largest angle between ζ and its value at the last entry; degrees.
    pub zeta_turned_deg: f64,
    /// Ticks in mode hold or slide with a larger error along ζ than the goal allows at the end.
    #[serde(default)]
    pub hold_ticks: u64,
    /// Largest position error along ζ in those ticks; mm.
    #[serde(default)]
    pub hold_max_mm: f64,
    /// Largest orientation error about ζ in those ticks; degrees.
    #[serde(default)]
    pub hold_max_deg: f64,
}

/// A null-space turn of a singular direction.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TurnSummary {
    /// Tick of the announcement.
    pub tick: u64,
    /// Name of the singularity.
    pub singularity: String,
    /// Planned motion of each joint; rad (sliding joints: m).
    pub planned: Vec<f64>,
    /// Planned duration; s.
    pub planned_s: f64,
    /// Actual motion of each joint; rad (sliding joints: m).
    pub actual: Vec<f64>,
    /// Actual duration, including pauses at rest; ticks.
    pub actual_ticks: u64,
}

/// A steered run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ServoSummary {
    /// Seconds per reason, in the controller's words; joint limits by joint and side; s.
    pub seconds: BTreeMap<String, f64>,
    /// Refused targets per reason.
    pub refused: BTreeMap<String, u64>,
    /// Momentary stops by the law, per reason.
    pub stops: BTreeMap<String, u64>,
    /// Targets after the file's `end`, which have no effect.
    pub after_end: u64,
}

/// A change of mode.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModeChange {
    /// Tick of the change.
    pub tick: u64,
    /// Name of the singularity.
    pub singularity: String,
    /// The new mode.
    pub mode: String,
}

/// A fault with its outcome, or the death that ended the run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FaultSummary {
    /// First tick of the fault.
    pub tick: u64,
    /// Name of the process.
    pub process: String,
    /// Kind of the fault; `"exit"` for a death that ended the run.
    pub kind: String,
    /// Description in one sentence.
    pub detail: String,
    /// `"planned"`, `"live"` or `"detected"`.
    pub origin: String,
    /// The fault happened. A run may end before a planned fault.
    #[serde(alias = "injected")]
    pub occurred: bool,
    /// Wall-clock time until it was detected; ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detected_ms: Option<f64>,
    /// Wall-clock time until the process worked again; of an unplanned death in lockstep the time lost; ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recovered_ms: Option<f64>,
    /// The fault as a scenario plans it. Absent for an unplanned death in lockstep, which changes no byte.
    #[serde(alias = "fault", skip_serializing_if = "Option::is_none")]
    pub plan: Option<Fault>,
}

/// Ticks with torque in time, late, or without. The deadline is a tenth of a period, at most 100
/// µs, before the next tick.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Deadlines {
    /// Sum of `in_time`, `late` and `none`.
    pub total: u64,
    /// Ticks whose torque came by the deadline.
    pub in_time: u64,
    /// Ticks whose torque came after the deadline.
    pub late: u64,
    /// Ticks whose torque never came.
    pub none: u64,
    /// Sum of `late` and `none`.
    pub missed: u64,
    /// Missed ticks by cause: the first process of the chain whose message was missing at the
    /// deadline.
    pub by_cause: BTreeMap<String, u64>,
    /// Periods in which the plant began no tick, by what the kernel reported about it.
    pub skipped: BTreeMap<String, u64>,
}

/// Distribution of a latency, without leaving out any sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Latency {
    /// Samples.
    pub count: u64,
    /// Median; µs.
    pub p50: f64,
    /// 99th percentile; µs.
    pub p99: f64,
    /// 99.9th percentile; µs.
    pub p999: f64,
    /// Largest; µs.
    pub max: f64,
}

/// The record.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RecorderSummary {
    /// Messages that the recorder has taken in, repeated ones included.
    pub messages: u64,
    /// Messages that were sent and that the recorder has not taken in, as far as known. A message that a fault drops is not sent.
    pub lost: u64,
    /// Ticks judged, also those that a full disk kept from the record.
    #[serde(default)]
    pub rows: u64,
    /// Size of the record; bytes.
    pub bytes: u64,
    /// The record, relative to `summary.json`: every message. Empty without one.
    pub file: String,
    /// Topics declared by the graph: counted, hashed and kept in the record, but not drawn.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_drawn: Vec<String>,
    /// Processor time of the recorder, including start and end; s.
    #[serde(default)]
    pub cpu_s: f64,
    /// Reason why the record is missing or incomplete. Empty if it is complete.
    pub error: String,
}

/// One process.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProcessSummary {
    /// Name of the process.
    pub name: String,
    /// Its last process id.
    pub pid: u32,
    /// Number of restarts.
    pub restarts: u32,
    /// How it ended: `"0"`, `"1"`, `"signal 9"`.
    pub exit: String,
    /// Lines of standard error that were dropped because they came too fast.
    #[serde(default)]
    pub lines_dropped: u64,
}
