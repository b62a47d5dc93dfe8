//! The recorder process: reads every topic, judges and hashes the run, and writes the recording. Nobody waits for it in real time.
#![allow(non_snake_case)]

mod assemble;
mod judge;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use model::{Robot, with_dof};
use runtime::{Drain, Keep, Mode, ProcessError, Shell, TopicHash};
use shared_types::job::Job;
use shared_types::scenario::{Record, Scenario};
use shared_types::summary::{RecorderSummary, Summary, TopicSummary};
use shared_types::{Message, PlantState, SensorSample, SingularityReport, StateEstimate, TorqueCommand};
use viz::{RecordError, Recording, RunInfo, TickRow};

pub use assemble::{Assembler, Row};
pub use judge::{Judge, Limits, TaskError, Tick, Verdict};

/// Name of the recorder's part of the summary in the run's directory.
pub const SUMMARY: &str = "summary.json";

/// Name of the folder with the messages in the results folder.
pub const MESSAGES: &str = "messages";

/// Pause between two rounds; the buffers hold a second.
const POLL: Duration = Duration::from_micros(500);

/// Ticks for which an incomplete row waits for its missing messages.
const PATIENCE: usize = 256;

/// Ticks that one topic may be ahead of another while they are drained in turn: twice what a buffer holds.
const HORIZON: usize = 2 * runtime::RECORDER_DEPTH;

/// Records and judges until the run has stopped and everything on the way has arrived, then leaves its part of the summary in `run_dir`.
///
/// # Errors
/// [`ProcessError`] where the recorder cannot begin, the graph breaks, or the summary cannot be written. A recording that fails
/// (a full disk) does not end the run: it is said in the summary.
pub fn run(shell: &Shell, robot: &Robot, job: &Job, run_dir: &Path) -> Result<(), ProcessError> {
    let summary = with_dof!(robot.dof(), N => record::<N>(shell, robot, job))
        .unwrap_or_else(|| Err(ProcessError::setup("unsupported number of joints")))?;
    let path = run_dir.join(SUMMARY);
    serde_json::to_vec(&summary)
        .map_err(std::io::Error::from)
        .and_then(|text| std::fs::write(&path, text))
        .map_err(|error| ProcessError::setup(format!("cannot write {}: {error}", path.display())))
}

fn record<const N: usize>(shell: &Shell, robot: &Robot, job: &Job) -> Result<Summary, ProcessError> {
    let folder = job.out.join(MESSAGES);
    let mut topics = Topics::open(shell, job.messages.then_some(folder.as_path()))?;
    let mut assembler = Assembler::new(PATIENCE, HORIZON);
    let mut judge = Judge::new(limits(robot), job.scenario.goal.clone(), job.scenario.duration_s() * f64::from(job.scenario.rate_hz));
    if shell.mode() == Mode::Realtime {
        judge = judge.on_grid(shell.manifest().period_ns());
    }
    let mut tape = Tape::<N>::start(robot, job)?;
    while shell.poll(POLL)? {
        topics.drain(&mut assembler)?;
        while let Some(row) = assembler.pop(false) {
            take(&row, &mut judge, &mut tape);
        }
    }
    while let Some(row) = assembler.pop(true) {
        take(&row, &mut judge, &mut tape);
    }
    let (kept, mut tape) = (topics.finish(), tape.finish());
    tape.messages_bytes = kept.bytes;
    if tape.error.is_empty() {
        tape.error = kept.error;
    }
    tape.cpu_s = runtime::realtime::cpu_time_s();
    Ok(summary(robot, job, shell.mode(), judge.verdict(), &topics, tape))
}

fn take<const N: usize>(row: &Row, judge: &mut Judge, tape: &mut Tape<N>) {
    if let Row {
        sensor: Some(sensor), truth: Some(truth), estimate: Some(estimate), report: Some(report), command: Some(command), ..
    } = row
    {
        judge.tick(Tick { sensor, truth, estimate, report, command });
    } else if let Some(sensor) = &row.sensor {
        judge.torn(sensor);
    }
    tape.tick(row);
}

/// A robot's limits, as the judge wants them.
#[must_use]
pub fn limits(robot: &Robot) -> Limits {
    let of = |value: fn(&model::Joint) -> f64| robot.joints.iter().map(value).collect();
    Limits { effort: of(|joint| joint.effort), velocity: of(|joint| joint.velocity) }
}

/// The recording, as long as it can be written; the first error ends it and is kept.
struct Tape<const N: usize> {
    recording: Option<Recording<N>>,
    folder: PathBuf,
    limits: PartLimits,
    result: RecorderSummary,
}

/// When a recording goes on in a further file.
#[derive(Clone, Copy)]
struct PartLimits {
    ticks: u64,
    bytes: u64,
}

impl PartLimits {
    fn new(scenario: &Scenario) -> Self {
        let Record { part_s, part_mb } = scenario.record;
        Self { ticks: (part_s * f64::from(scenario.rate_hz)).round().max(1.0) as u64, bytes: part_mb.saturating_mul(1_000_000) }
    }
}

impl<const N: usize> Tape<N> {
    fn start(robot: &Robot, job: &Job) -> Result<Self, ProcessError> {
        let tape =
            Self { recording: None, folder: job.out.clone(), limits: PartLimits::new(&job.scenario), result: RecorderSummary::default() };
        if !job.record {
            return Ok(tape);
        }
        let info = RunInfo { scenario: &job.scenario, robot, run: &job.run, version: &job.version, seed: job.scenario.seed };
        // A folder given with --out may hold an older recording with more parts.
        for old in viz::parts_in(&job.out) {
            std::fs::remove_file(&old).map_err(|error| ProcessError::setup(format!("cannot replace {}: {error}", old.display())))?;
        }
        let recording = Recording::create(&job.out, &info).map_err(ProcessError::setup)?;
        Ok(Self { recording: Some(recording), result: RecorderSummary { file: viz::part_name(0), ..RecorderSummary::default() }, ..tape })
    }

    fn tick(&mut self, row: &Row) {
        let Some(recording) = &mut self.recording else { return };
        let row = TickRow {
            tick: row.tick,
            sensor: row.sensor.as_ref(),
            plant_state: row.truth.as_ref(),
            estimate: row.estimate.as_ref(),
            report: row.report.as_ref(),
            command: row.command.as_ref(),
        };
        let full = recording.part_ticks() >= self.limits.ticks || recording.part_bytes() >= self.limits.bytes;
        let turned = if full { recording.next_part(&self.folder) } else { Ok(()) };
        if let Err(error) = turned.and_then(|()| recording.tick(&row)) {
            self.fail(&error);
        }
    }

    /// Keeps the first error; what was written before it stays.
    fn fail(&mut self, error: &RecordError) {
        eprintln!("{error}");
        self.result.error = error.to_string();
        if let Some(recording) = self.recording.take() {
            (self.result.bytes, self.result.parts) = (recording.bytes(), recording.part() + 1);
            // A part that could not be followed by another still gets its end.
            let _ = recording.finish();
        }
    }

    fn finish(mut self) -> RecorderSummary {
        if let Some(recording) = self.recording.take() {
            (self.result.bytes, self.result.parts) = (recording.bytes(), recording.part() + 1);
            match recording.finish() {
                Ok(info) => self.result.bytes = info.bytes,
                Err(error) => self.fail(&error),
            }
        }
        self.result
    }
}

/// One topic's end: its messages, its fingerprint, and the file they are kept in where that is wanted.
struct Tap<M: Message> {
    drain: Drain<M>,
    hash: TopicHash,
    keep: Option<Keep<M>>,
    kept: Kept,
}

/// What became of the kept messages; a disk that is full ends the keeping, not the run.
#[derive(Clone, Debug, Default)]
struct Kept {
    bytes: u64,
    error: String,
}

impl<M: Message> Tap<M> {
    fn open(shell: &Shell, messages: Option<&Path>) -> Result<Self, ProcessError> {
        // A restarted recorder goes on where its predecessor was killed.
        let keep = |folder| if shell.incarnation() > 1 { Keep::resume(folder) } else { Keep::create(folder) };
        let keep = messages.map(keep).transpose().map_err(ProcessError::setup)?;
        Ok(Self { drain: shell.drain()?, hash: TopicHash::default(), keep, kept: Kept::default() })
    }

    fn drain(&mut self, assembler: &mut Assembler, place: impl Fn(&mut Row) -> &mut Option<M>) -> Result<(), ProcessError> {
        let (hash, keep, kept) = (&mut self.hash, &mut self.keep, &mut self.kept);
        self.drain.drain(|message| {
            hash.add(message);
            if let Some(keeping) = keep
                && let Err(error) = keeping.add(message)
            {
                eprintln!("{error}");
                *kept = Kept { bytes: keeping.bytes(), error: error.to_string() };
                *keep = None;
            }
            if let Some(row) = assembler.row(message.header().tick) {
                *place(row) = Some(*message);
            }
        })?;
        Ok(())
    }

    fn finish(&mut self) -> Kept {
        match self.keep.take().map(|keep| (keep.bytes(), keep.finish())) {
            None => self.kept.clone(),
            Some((_, Ok(bytes))) => Kept { bytes, error: String::new() },
            Some((bytes, Err(error))) => Kept { bytes, error: error.to_string() },
        }
    }
}

struct Topics {
    sensor: Tap<SensorSample>,
    truth: Tap<PlantState>,
    estimate: Tap<StateEstimate>,
    report: Tap<SingularityReport>,
    command: Tap<TorqueCommand>,
}

impl Topics {
    fn open(shell: &Shell, messages: Option<&Path>) -> Result<Self, ProcessError> {
        Ok(Self {
            sensor: Tap::open(shell, messages)?,
            truth: Tap::open(shell, messages)?,
            estimate: Tap::open(shell, messages)?,
            report: Tap::open(shell, messages)?,
            command: Tap::open(shell, messages)?,
        })
    }

    /// Ends the keeping of messages: how many bytes there are, and the first thing that went wrong.
    fn finish(&mut self) -> Kept {
        let all = [self.sensor.finish(), self.truth.finish(), self.estimate.finish(), self.report.finish(), self.command.finish()];
        let error = all.iter().find(|kept| !kept.error.is_empty()).map(|kept| kept.error.clone()).unwrap_or_default();
        Kept { bytes: all.iter().map(|kept| kept.bytes).sum(), error }
    }

    fn drain(&mut self, assembler: &mut Assembler) -> Result<(), ProcessError> {
        self.sensor.drain(assembler, |row| &mut row.sensor)?;
        self.truth.drain(assembler, |row| &mut row.truth)?;
        self.estimate.drain(assembler, |row| &mut row.estimate)?;
        self.report.drain(assembler, |row| &mut row.report)?;
        self.command.drain(assembler, |row| &mut row.command)
    }

    /// Per topic: name, count, hash, lost.
    fn account(&self) -> [(&'static str, &TopicHash, u64); 5] {
        [
            (SensorSample::TOPIC, &self.sensor.hash, self.sensor.drain.lost()),
            (PlantState::TOPIC, &self.truth.hash, self.truth.drain.lost()),
            (StateEstimate::TOPIC, &self.estimate.hash, self.estimate.drain.lost()),
            (SingularityReport::TOPIC, &self.report.hash, self.report.drain.lost()),
            (TorqueCommand::TOPIC, &self.command.hash, self.command.drain.lost()),
        ]
    }
}

/// The recorder's part of the summary; the launcher adds the processes.
fn summary(robot: &Robot, job: &Job, mode: Mode, verdict: Verdict, topics: &Topics, tape: RecorderSummary) -> Summary {
    let account = topics.account();
    Summary {
        version: job.version.clone(),
        scenario: job.scenario.name.clone(),
        robot: robot.name.clone(),
        mode: if mode == Mode::Lockstep { "lockstep" } else { "realtime" }.to_owned(),
        seed: job.scenario.seed,
        run: job.run.clone(),
        ticks: verdict.ticks,
        rate_hz: job.scenario.rate_hz,
        completed: verdict.completed,
        outcome: verdict.outcome,
        reason: verdict.reason,
        wall_s: verdict.wall_s,
        ticks_per_s: if verdict.wall_s > 0.0 { verdict.ticks as f64 / verdict.wall_s } else { 0.0 },
        topics: account
            .iter()
            .map(|(name, hash, _)| ((*name).to_owned(), TopicSummary { count: hash.count(), hash: format!("{:016x}", hash.digest()) }))
            .collect::<BTreeMap<_, _>>(),
        task: verdict.task,
        joints: verdict.joints,
        singularities: verdict.singularities,
        modes: verdict.modes,
        faults: Vec::new(),
        deadlines: Default::default(),
        latency_us: verdict.latency_us,
        recorder: RecorderSummary {
            messages: account.iter().map(|(_, hash, _)| hash.count()).sum(),
            lost: account.iter().map(|(_, _, lost)| lost).sum(),
            ..tape
        },
        processes: Vec::new(),
    }
}
