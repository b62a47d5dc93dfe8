//! The result of a run: the schema of `summary.json`. Field names carry their units; everything is judged on the simulator's truth.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::fault::Fault;
use crate::job::Job;

/// The outcome of a run that a signal has ended, or whose launcher was killed.
pub const INTERRUPTED: &str = "interrupted";

/// The outcome of a task that was done within its goal's bounds.
pub const REACHED: &str = "goal reached";
/// The outcome of a task whose goal is beyond reach, done up to the boundary of reach.
pub const BOUNDARY: &str = "followed to the boundary";
/// The outcome of a task that was done, but not within its goal's bounds or the arm's limits.
pub const MISSED: &str = "goal missed";

/// `summary.json`, whole.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// The run.
    #[serde(flatten)]
    pub of: RunOf,
    /// Ticks begun: the plant's samples, whether or not every process answered them.
    pub ticks: u64,
    /// Whether the task ran to its end.
    pub completed: bool,
    /// `"goal reached"`, `"followed to the boundary"`, `"goal missed"`, `"stopped"`, `"interrupted"` or `"failed"`.
    pub outcome: String,
    /// Why, in one sentence.
    pub reason: String,
    /// Its pace.
    #[serde(flatten)]
    pub pace: Pace,
    /// Per topic: how many messages, and a hash over their contents (stamps left out).
    pub topics: BTreeMap<String, TopicSummary>,
    /// Task errors.
    pub task: TaskSummary,
    /// Joint loads.
    pub joints: JointSummary,
    /// The events at each singularity.
    pub singularities: Vec<SingularitySummary>,
    /// Null-space turns of singular directions: the planned motion, announced before each began, and the actual one.
    pub turns: Vec<TurnSummary>,
    /// Mode changes, in order.
    pub modes: Vec<ModeChange>,
    /// How the arm followed its targets, of a steered run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub servo: Option<ServoSummary>,
    /// Faults and refusals, in order.
    pub faults: Vec<FaultSummary>,
    /// The plant's account of torque in time, late and absent; left out in lockstep, and where it is not known of every tick of a recovered run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deadlines: Option<Deadlines>,
    /// Latency of each hop, and of the whole `chain` from the sensor sample to the torque in the plant's hands; µs. In real time the
    /// chain's and the plant's own count from when the tick was due; ticks that never began or were never answered count too.
    pub latency_us: BTreeMap<String, Latency>,
    /// Figures that are NaN or infinite, by their place in this file, as messages give them that a fault has corrupted: JSON has no such number, the
    /// largest one stands there instead.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_finite: Vec<String>,
    /// The recorder's account.
    pub recorder: RecorderSummary,
    /// The processes.
    pub processes: Vec<ProcessSummary>,
    /// The machine.
    #[serde(default)]
    pub machine: Machine,
}

/// The run that a summary is of.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunOf {
    /// Version of armplane that made it.
    pub version: String,
    /// The scenario's name.
    pub scenario: String,
    /// The robot's name.
    pub robot: String,
    /// `"lockstep"` or `"realtime"`.
    pub mode: String,
    /// Seed of every random number.
    pub seed: u64,
    /// Identifies the run.
    pub run: String,
    /// Control rate; 1/s.
    pub rate_hz: u32,
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
        }
    }
}

/// Ticks against the clock.
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
    /// The processor's name.
    pub cpu: String,
    /// Cores that the run could use.
    pub cores: usize,
    /// Kernel name and version.
    pub kernel: String,
}

/// One topic.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TopicSummary {
    /// Messages recorded.
    pub count: u64,
    /// XXH3-64 over the contents in order, hexadecimal.
    pub hash: String,
}

/// Task errors, desired against true pose. Orthogonal: with the singular directions left out while inside their neighbourhood.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TaskSummary {
    /// Largest position error.
    pub position_max_mm: f64,
    /// Root mean square position error.
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
    /// Largest orientation error about them.
    #[serde(default)]
    pub along_max_deg: f64,
    /// Position error at the end.
    pub final_position_mm: f64,
    /// Orientation error at the end.
    pub final_orientation_deg: f64,
    /// Time the task took beyond its plan, as a ratio (the governor's stretch).
    pub time_stretch: f64,
    /// Ticks in which the arm touched the floor, or itself.
    #[serde(default)]
    pub contact_ticks: u64,
    /// Largest sum of contact forces on the arm.
    #[serde(default)]
    pub contact_max_n: f64,
    /// Success by the strict bar S1: end within 1 mm and 0.5°, error orthogonal to the singular directions too, no limit broken.
    #[serde(default)]
    pub s1: bool,
    /// Success by the bar S2, for motions that are not along ζ: as S1, with 3° orthogonal, and 10 mm and 5° along ζ.
    #[serde(default)]
    pub s2: bool,
    /// The conditions of S2 that failed.
    #[serde(default)]
    pub missed: Vec<String>,
}

impl Summary {
    /// Whether the task was done as asked, or as far as the arm reaches.
    #[must_use]
    pub fn is_success(&self) -> bool {
        [REACHED, BOUNDARY].contains(&self.outcome.as_str())
    }
}

/// Arms have limits, where a summary of an earlier version does not say.
const fn limited() -> bool {
    true
}

/// Joint loads, each a ratio of the robot's own limit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointSummary {
    /// A joint's speed has a limit; without one the ratio says nothing.
    #[serde(default = "limited")]
    pub has_speed_limit: bool,
    /// A joint's torque has a limit; without one its ratios say nothing.
    #[serde(default = "limited")]
    pub has_torque_limit: bool,
    /// Largest speed.
    pub speed_max_ratio: f64,
    /// Largest torque that the drives applied.
    pub torque_max_ratio: f64,
    /// Largest torque that was commanded.
    #[serde(default)]
    pub torque_commanded_max_ratio: f64,
    /// Largest change of torque in one tick.
    pub torque_step_max_ratio: f64,
    /// 95th percentile of the change of torque in one tick.
    pub torque_step_p95_ratio: f64,
    /// 99th percentile of it.
    #[serde(default)]
    pub torque_step_p99_ratio: f64,
    /// Ticks with any torque at its limit.
    pub saturated_ticks: u64,
    /// Ticks at which the law asked for a faster change of any torque than its drive accepts.
    #[serde(default)]
    pub rate_limited_ticks: u64,
    /// Ticks for which the controller set the estimate aside, because no torque within the limits moves the arm so.
    #[serde(default)]
    pub rejected_estimate_ticks: u64,
    /// Steps of a torque by more than a tenth of its limit that the same joint had made the other way within 10 ms.
    #[serde(default)]
    pub chatter: u64,
    /// Σ ½ΔΓᵀA⁻¹ΔΓ/k_v² over the ticks with a step by more than a tenth: what each puts in until the loop has answered; J.
    #[serde(default)]
    pub jump_energy_j: f64,
    /// Ticks with a joint against its stop, or with the drives not active.
    #[serde(default)]
    pub stopped_ticks: u64,
    /// Changes of mode, all singularities together; each also stands in `modes`.
    pub switches: u64,
    /// Energy put in at them: the jump in commanded power, |Δτᵀq̇| of the tick of the change, over the 25 ms in which velocity feedback takes it back; J.
    pub switch_energy_j: f64,
    /// Limits that joints reached: stops, speeds above the limit, torques at it; in the order in which they were first reached.
    #[serde(default)]
    pub limits: Vec<LimitSummary>,
    /// Position at the start; rad.
    pub q_start: Vec<f64>,
    /// Position at the end; rad.
    pub q_end: Vec<f64>,
    /// Units of these: `rad`, or `m` of a joint that slides.
    #[serde(default)]
    pub units: Vec<String>,
}

/// A limit that a joint reached.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LimitSummary {
    /// The joint's name.
    pub joint: String,
    /// `"lower stop"`, `"upper stop"`, `"speed"` (above the limit), `"torque"` (at the limit), `"drive speed"` or `"drive rate"` (the drive cut or
    /// delayed the torque because of that).
    pub limit: String,
    /// The first tick at which it was reached.
    pub first_tick: u64,
    /// Ticks spent there.
    pub ticks: u64,
}

/// One singularity over the run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SingularitySummary {
    /// Its name.
    pub name: String,
    /// Its type, as classified at the end.
    #[serde(rename = "type")]
    pub class: String,
    /// Second-order motion along ζ per null motion.
    pub kappa_1: f64,
    /// Turning rate of ζ along the null motion.
    pub kappa_2: f64,
    /// Smallest |s_i|.
    pub s_min: f64,
    /// Ticks inside the neighbourhood.
    pub inside_ticks: u64,
    /// Times it was entered.
    pub entries: u64,
    /// Largest angle between ζ and what it was when the neighbourhood was entered; degrees.
    pub zeta_turned_deg: f64,
    /// Ticks in mode hold or slide with an error along the singular directions beyond the goal's final bounds.
    #[serde(default)]
    pub hold_ticks: u64,
    /// Largest position error along the singular directions in those ticks; mm.
    #[serde(default)]
    pub hold_max_mm: f64,
    /// Largest orientation error about the singular directions in those ticks; degrees.
    #[serde(default)]
    pub hold_max_deg: f64,
}

/// A null-space turn of a singular direction.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TurnSummary {
    /// When it was announced.
    pub tick: u64,
    /// Which singularity.
    pub singularity: String,
    /// Planned motion of each joint; rad (m for prismatic joints).
    pub planned: Vec<f64>,
    /// Planned duration; s.
    pub planned_s: f64,
    /// Actual motion of each joint; rad (m for prismatic joints).
    pub actual: Vec<f64>,
    /// Actual duration, with the ticks in which the arm was brought to rest meanwhile; ticks.
    pub actual_ticks: u64,
}

/// A steered session.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ServoSummary {
    /// Seconds for each reason that the controller stated, in its words; of a joint limit, for each joint and side.
    pub seconds: BTreeMap<String, f64>,
    /// Targets refused, for each reason.
    pub refused: BTreeMap<String, u64>,
    /// How often the law stopped the arm for a moment, by reason.
    pub stops: BTreeMap<String, u64>,
    /// Targets of the file that follow its `end`: they have no effect.
    pub after_end: u64,
}

/// A change of the reported mode.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModeChange {
    /// When.
    pub tick: u64,
    /// Which singularity.
    pub singularity: String,
    /// The new mode.
    pub mode: String,
}

/// A fault, planned, live or detected, and its outcome; or a process's end that ended the run (`kind` `"exit"`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FaultSummary {
    /// The first tick it concerns.
    pub tick: u64,
    /// Which process.
    pub process: String,
    /// Its kind; `"exit"` of an end that ended the run.
    pub kind: String,
    /// One sentence.
    pub detail: String,
    /// `"planned"`, `"live"` or `"detected"`.
    pub origin: String,
    /// Whether it came to pass: a run may end before a planned fault.
    #[serde(alias = "injected")]
    pub occurred: bool,
    /// Time to detection, wall-clock; ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detected_ms: Option<f64>,
    /// How long it took until a process that was down worked again, wall-clock time; ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recovered_ms: Option<f64>,
    /// As a scenario plans it, so that a run repeats it: an end that nobody planned is planned as a `kill` at its tick.
    #[serde(alias = "fault", skip_serializing_if = "Option::is_none")]
    pub plan: Option<Fault>,
}

/// The plant's account of its ticks, each of which had torque in time, late, or none. A tick's deadline is a tenth of a period, at most 100 µs, before the
/// next one.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Deadlines {
    /// Ticks: `in_time`, `late` and `none` together.
    pub total: u64,
    /// Ticks whose torque came by its deadline.
    pub in_time: u64,
    /// Ticks whose torque came after it.
    pub late: u64,
    /// Ticks whose torque never came.
    pub none: u64,
    /// `late` and `none` together.
    pub missed: u64,
    /// Those missed, by cause: the first process of the chain whose message of the tick had not come by the deadline.
    pub by_cause: BTreeMap<String, u64>,
    /// Periods in which the plant began no tick, by what the kernel counted of it meanwhile.
    pub skipped: BTreeMap<String, u64>,
}

/// A latency distribution; µs, no sample left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Latency {
    /// Samples.
    pub count: u64,
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Largest.
    pub max: f64,
}

/// The recorder's account.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RecorderSummary {
    /// Messages received.
    pub messages: u64,
    /// Messages known to be lost (gaps in the ticks).
    pub lost: u64,
    /// Ticks given to the recording.
    #[serde(default)]
    pub rows: u64,
    /// Size of the recording, all parts; bytes.
    pub bytes: u64,
    /// The recording's first part, relative to `summary.json`; empty without one.
    pub file: String,
    /// Files it is spread over: `run.rrd`, `run-001.rrd`, …
    #[serde(default)]
    pub parts: u32,
    /// The checksum of each of these: XXH3 of 64 bits, in hexadecimal; none where they could not be read.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub checksums: Vec<String>,
    /// Size of the messages kept beside it, which `armplane replay` reads; bytes, 0 where none were kept.
    #[serde(default)]
    pub messages_bytes: u64,
    /// Topics that only the graph knows: counted, hashed and kept as bytes, but not in the recording.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_drawn: Vec<String>,
    /// Processor time that the recorder used, start and end included; s.
    #[serde(default)]
    pub cpu_s: f64,
    /// Why there is no (whole) recording; empty when there is.
    pub error: String,
}

/// One process.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProcessSummary {
    /// Its name.
    pub name: String,
    /// Its last process id.
    pub pid: u32,
    /// How often it was started again.
    pub restarts: u32,
    /// How it ended: `"0"`, `"1"`, `"signal 9"`.
    pub exit: String,
    /// Lines of its standard error that were dropped, because they came faster than they were taken.
    #[serde(default)]
    pub lines_dropped: u64,
}
