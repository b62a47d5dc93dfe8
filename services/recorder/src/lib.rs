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
pub use judge::{Judge, Limits, Tick, Verdict};

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
    let summary = summary(robot, job, shell.mode(), judge.verdict(), &topics, tape.finish());
    topics.finish()?;
    Ok(summary)
}

fn take<const N: usize>(row: &Row, judge: &mut Judge, tape: &mut Tape<N>) {
    if let Row {
        sensor: Some(sensor), truth: Some(truth), estimate: Some(estimate), report: Some(report), command: Some(command), ..
    } = row
    {
        judge.tick(Tick { sensor, truth, estimate, report, command });
    }
    tape.tick(row);
}

fn limits(robot: &Robot) -> Limits {
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
        // A restarted recorder goes on in the next part; the launcher has removed what an older run left.
        let part = viz::parts_in(&job.out).len() as u32;
        let recording = Recording::create_part(&job.out, part, &info).map_err(ProcessError::setup)?;
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
}

impl<M: Message> Tap<M> {
    fn open(shell: &Shell, messages: Option<&Path>) -> Result<Self, ProcessError> {
        let keep = messages.map(Keep::create).transpose().map_err(ProcessError::setup)?;
        Ok(Self { drain: shell.drain()?, hash: TopicHash::default(), keep })
    }

    fn drain(&mut self, assembler: &mut Assembler, place: impl Fn(&mut Row) -> &mut Option<M>) -> Result<(), ProcessError> {
        let (hash, keep) = (&mut self.hash, &mut self.keep);
        let mut kept = Ok(());
        self.drain.drain(|message| {
            hash.add(message);
            if let (Ok(()), Some(keep)) = (&kept, keep.as_mut()) {
                kept = keep.add(message);
            }
            if let Some(row) = assembler.row(message.header().tick) {
                *place(row) = Some(*message);
            }
        })?;
        kept.map_err(ProcessError::setup)
    }

    fn finish(self) -> Result<(), ProcessError> {
        self.keep.map_or(Ok(()), |keep| keep.finish().map_err(ProcessError::setup))
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

    fn finish(self) -> Result<(), ProcessError> {
        self.sensor.finish()?;
        self.truth.finish()?;
        self.estimate.finish()?;
        self.report.finish()?;
        self.command.finish()
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
        machine: Default::default(),
    }
}
