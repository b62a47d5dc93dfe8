//! The recorder process: reads every topic, judges and hashes the run, and writes the recording. No process waits for it in real time.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod assemble;
mod checkpoint;
mod fault_reporter;
mod judge;
mod message_rows;
mod rebuild;
mod tape;
mod topics;

use std::path::Path;
use std::time::Duration;

use message_log::{Contents, TopicHash};
use model::Robot;
use runtime::{Count, Mode, ProcessError, Shell, write_reserved};
use serde_json::Value;
use shared_types::job::Job;
use shared_types::summary::{RecorderSummary, Summary};
use viz::Level;

use checkpoint::{Checkpoint, Memory, most_ticks};
use fault_reporter::FaultReporter;
use topics::{Past, Topics};

pub use assemble::{Assembler, Row, Set};
pub use judge::{Bounds, Judge, Limits, TaskError, Tick, Verdict};
pub use message_log::FILE as MESSAGES;
pub use message_rows::MessageRows;
pub use rebuild::rebuild;
pub use tape::Tape;

/// Name of the recorder's part of the summary in the run's directory.
pub const SUMMARY: &str = "summary.json";

/// Ticks for which an incomplete row waits for its missing messages.
pub const PATIENCE: u64 = 256;

/// Ticks that may be missing on end; a minute at 1 kHz.
pub const HORIZON: u64 = 60_000;

/// Records and judges until the run has stopped and everything on the way has arrived, then leaves its part of the summary in `run_dir`.
///
/// # Errors
/// [`ProcessError`] if the recorder cannot begin, the graph breaks, or the summary cannot be written. A recording that fails
/// (a full disk) does not end the run: the summary names it.
pub fn run(shell: &Shell, robot: &Robot, job: &Job, run_dir: &Path) -> Result<(), ProcessError> {
    runtime::realtime::keep_memory();
    // Two recorders would write the same files.
    let _recording = shell.hold("recording")?;
    let summary = record(shell, robot, job, run_dir)?;
    let path = run_dir.join(SUMMARY);
    written(&summary)
        .map_err(std::io::Error::from)
        .and_then(|text| write_reserved(&path, &text))
        .map_err(|error| ProcessError::setup(format!("cannot write {}: {error}", path.display())))
}

/// The summary as JSON that reads back. JSON has no infinity, and messages that a fault has corrupted give errors beyond all numbers: such a figure is
/// the largest number there is, and `not_finite` names it.
fn written(summary: &Summary) -> serde_json::Result<Vec<u8>> {
    fn bound(value: &mut Value, path: &str, found: &mut Vec<String>) {
        let below = |key: &str| {
            if path.is_empty() {
                key.to_owned()
            } else {
                format!("{path}.{key}")
            }
        };
        match value {
            // Nothing else is null: what is absent is left out.
            Value::Null => {
                *value = f64::MAX.into();
                found.push(path.to_owned());
            }
            Value::Array(values) => values
                .iter_mut()
                .enumerate()
                .for_each(|(i, value)| bound(value, &below(&i.to_string()), found)),
            Value::Object(values) => values
                .iter_mut()
                .for_each(|(key, value)| bound(value, &below(key), found)),
            _ => {}
        }
    }
    let (mut value, mut found) = (serde_json::to_value(summary)?, Vec::new());
    bound(&mut value, "", &mut found);
    if !found.is_empty() {
        value["not_finite"] = found.into();
    }
    serde_json::to_vec(&value)
}

/// A recorder in its process.
struct Recorder<'a> {
    shell: &'a Shell,
    job: &'a Job,
    memory: Memory,
    assembler: Assembler,
    judge: Judge,
    tape: Tape,
    topics: Topics,
    faults: FaultReporter,
}

fn record(
    shell: &Shell,
    robot: &Robot,
    job: &Job,
    run_dir: &Path,
) -> Result<Summary, ProcessError> {
    let mut recorder = Recorder::open(shell, robot, job, run_dir)?;
    while shell.poll(pace(shell.mode(), job.live))? {
        recorder.round()?;
    }
    Ok(recorder.finish())
}

/// Time from one round to the next. To wake up with a cold cache costs more than one tick's messages, so a round takes several ticks in: in real time a
/// quarter of the buffers at 1 kHz, or less where a viewer shows motion; in lockstep, where all processes wait for a recorder that is too far behind, half of
/// that distance at 50,000 ticks per second.
fn pace(mode: Mode, is_watched: bool) -> Duration {
    Duration::from_micros(match mode {
        Mode::Realtime if is_watched => 100_000,
        Mode::Realtime => 250_000,
        Mode::Lockstep => 2_500,
    })
}

impl<'a> Recorder<'a> {
    /// A replacement continues from its predecessor's last checkpoint.
    fn open(
        shell: &'a Shell,
        robot: &'a Robot,
        job: &'a Job,
        run_dir: &Path,
    ) -> Result<Self, ProcessError> {
        let unusable = |error| {
            ProcessError::setup(format!(
                "cannot keep what a replacement must know in {}: {error}",
                run_dir.display()
            ))
        };
        let memory = Memory::open(run_dir).map_err(unusable)?;
        let is_first = shell.incarnation() == 1;
        let past = if is_first { None } else { memory.last() };
        let mut assembler = Assembler::new(Set::of(|topic| shell.reads(topic)), PATIENCE, HORIZON);
        let mut judge = judge(robot, job)?;
        let mut tape = match is_first {
            true => Tape::start(robot, job),
            false => Tape::go_on(robot, job, memory.written()),
        }?;
        let (mut faults, mut progress) = (FaultReporter::default(), Past::default());
        if let Some(past) = past {
            progress = past.progress;
            assembler.resume(past.next, past.rows);
            if tape.result.error.is_empty() {
                tape.result.error = past.result.error;
            }
            // Those since then come again.
            tape.result.rows = past.result.rows;
            let resumed = past.judge.resumed(robot, &job.scenario);
            judge = resumed.map_err(ProcessError::setup)?;
            faults = FaultReporter::resume(past.reported);
        }
        let path = job.out.join(MESSAGES);
        let log = job.messages.then_some(path.as_path());
        let topics = Topics::open(shell, &Contents::of(job), log, &progress, &mut assembler)?;
        Ok(Self {
            shell,
            job,
            memory,
            assembler,
            judge,
            tape,
            topics,
            faults,
        })
    }

    /// Takes in everything that is there.
    fn round(&mut self) -> Result<(), ProcessError> {
        let Self { shell, job, .. } = *self;
        let begun = shell.ticks_begun();
        self.topics.drain(begun, &mut self.assembler)?;
        shell.has_taken_in();
        // Before the ticks in which it shows: their words name it.
        self.faults.report(shell, &job.graph, &mut self.tape);
        while let Some(row) = self.assembler.pop(begun, false) {
            take(&row, &mut self.judge, &mut self.tape);
            // With every row: a replacement writes again what is not noted.
            self.memory.note(self.tape.written());
        }
        if !self.tape.result.error.is_empty() || self.topics.has_failed() {
            shell.mark_detected();
        }
        let are_kept = job.messages && !self.topics.has_failed();
        let most_ticks = most_ticks(are_kept, shell.most_ahead());
        let next = self.assembler.next_tick();
        if shell.is_about_to_go_down() || self.memory.is_due(next, most_ticks) {
            self.save();
        }
        Ok(())
    }

    fn save(&mut self) {
        self.tape.flush();
        self.topics.flush();
        self.memory.note(self.tape.written());
        let checkpoint = Checkpoint {
            judge: &self.judge,
            progress: self.topics.progress(),
            next: self.assembler.next_tick(),
            rows: self.assembler.pending(),
            result: self.tape.result.clone(),
            reported: self.faults.reported(),
        };
        self.shell.elsewhere(|| self.memory.save(&checkpoint));
    }

    fn finish(mut self) -> Summary {
        while let Some(row) = self.assembler.pop(0, true) {
            take(&row, &mut self.judge, &mut self.tape);
        }
        let shell = self.shell;
        self.faults.report(shell, &self.job.graph, &mut self.tape);
        let (logged, mut recorded) = (self.topics.finish(), self.tape.finish());
        recorded.messages_bytes = logged.bytes;
        if recorded.error.is_empty() {
            recorded.error = logged.error;
        }
        recorded.cpu_s = runtime::realtime::cpu_time_s();
        let (account, not_drawn) = self.topics.account();
        // Messages sent less messages received: a gap in the ticks may be a message that a fault kept from being sent.
        let refused = shell.count(Count::Refused) + shell.count(Count::Fenced);
        let received: u64 = account.iter().map(|(_, hash)| hash.count()).sum();
        recorded.lost = shell.sent_by_all().saturating_sub(received + refused);
        recorded.not_drawn = not_drawn;
        summary(self.job, self.judge, &account, recorded)
    }
}

/// The judge of a run at its beginning.
fn judge(robot: &Robot, job: &Job) -> Result<Judge, ProcessError> {
    let judge = Judge::in_processes(&job.graph, robot, &job.scenario);
    let judge = judge.map_err(ProcessError::setup)?;
    Ok(match job.mode {
        Mode::Realtime => judge.on_grid(1_000_000_000 / u64::from(job.scenario.rate_hz)),
        Mode::Lockstep => judge,
    })
}

fn take(row: &Row, judge: &mut Judge, tape: &mut Tape) {
    let messages = row.messages().lent();
    if let Some(tick) = Tick::of(&messages) {
        judge.tick(tick);
    } else if let Some(sensor) = messages.sensor {
        judge.torn(sensor);
    }
    tape.tick(row);
    judge
        .events()
        .for_each(|(tick, text)| tape.event(tick, Level::Warning, &text));
}

/// The recorder's part of the summary; the launcher adds the processes.
fn summary(
    job: &Job,
    judge: Judge,
    account: &[(&str, TopicHash)],
    tape: RecorderSummary,
) -> Summary {
    let hashes = account.iter();
    Summary {
        of: job.into(),
        topics: hashes
            .map(|(name, hash)| ((*name).to_owned(), hash.summary()))
            .collect(),
        recorder: RecorderSummary {
            messages: account.iter().map(|(_, hash)| hash.count()).sum(),
            ..tape
        },
        ..judge.verdict()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_beyond_all_numbers_do_not_cost_the_account() {
        let mut summary = Summary {
            ticks: 7,
            ..Summary::default()
        };
        (
            summary.task.position_rms_mm,
            summary.task.final_orientation_deg,
        ) = (f64::INFINITY, f64::NAN);
        summary.joints.q_end = vec![0.5, f64::NEG_INFINITY];
        let read: Summary = serde_json::from_slice(&written(&summary).unwrap()).unwrap();
        assert_eq!(
            (
                read.ticks,
                read.task.position_rms_mm,
                read.task.final_orientation_deg
            ),
            (7, f64::MAX, f64::MAX)
        );
        assert_eq!(read.joints.q_end, [0.5, f64::MAX]);
        assert_eq!(
            read.not_finite,
            [
                "joints.q_end.1",
                "task.final_orientation_deg",
                "task.position_rms_mm"
            ]
        );
    }
}
