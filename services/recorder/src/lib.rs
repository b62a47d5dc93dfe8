//! The recorder process: reads every topic, judges and hashes the run, and writes the recording. No process waits for it in real time.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod book;
mod contents;
mod cut;
mod error;
mod event;
mod fault_reporter;
mod hash;
mod judge;
mod reader;
#[cfg(test)]
mod tests;
mod ticks;
mod writer;

use std::path::Path;
use std::time::Duration;

use model::Robot;
use runtime::{CUT_TICKS, Collector, Count, Mode, ProcessError, Shell, write_reserved};
use serde_json::Value;
use shared_types::job::Job;
use shared_types::summary::Summary;

use book::{Book, CHUNK, Record};
use fault_reporter::FaultReporter;

pub use book::rebuild;
pub use contents::{Contents, tick_of};
pub use cut::Cut;
pub use error::RecordError;
pub use hash::TopicHash;
pub use judge::{Bounds, Judge, Limits, TaskError, Verdict};
pub use reader::{Item, RecordReader};
pub use ticks::{Account, Assembler, Row, Ticks};
pub use writer::RecordWriter;

/// Name of the record in the results folder.
pub const MESSAGES: &str = "messages.mcap";

/// Name of the recorder's part of the summary in the run's directory.
pub const SUMMARY: &str = "summary.json";

/// Records and judges until the run has stopped and everything on the way has arrived, then leaves its part of the summary in `run_dir`.
///
/// # Errors
/// [`ProcessError`] if the recorder cannot begin, the graph breaks, or the summary cannot be written. A recording that fails
/// (a full disk) does not end the run: the summary names it.
pub fn run(shell: &Shell, robot: &Robot, job: &Job, run_dir: &Path) -> Result<(), ProcessError> {
    runtime::realtime::keep_memory();
    // Two recorders would write the same files.
    let _recording = shell.hold("recording")?;
    let summary = record(shell, robot, job)?;
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
        match value {
            // Nothing else is null: what is absent is left out.
            Value::Null => {
                *value = f64::MAX.into();
                found.push(path.trim_start_matches('.').to_owned());
            }
            Value::Array(values) => {
                for (i, value) in values.iter_mut().enumerate() {
                    bound(value, &format!("{path}.{i}"), found);
                }
            }
            Value::Object(values) => {
                for (key, value) in values {
                    bound(value, &format!("{path}.{key}"), found);
                }
            }
            _ => {}
        }
    }
    let mut value = serde_json::to_value(summary)?;
    let mut found = Vec::new();
    bound(&mut value, "", &mut found);
    if !found.is_empty() {
        value["not_finite"] = found.into();
    }
    serde_json::to_vec(&value)
}

/// The remedy for a record that cannot be written.
const REMEDY: &str = "give a folder with more room by --out, or use --no-record";

/// A recorder in its process.
struct Recorder<'a> {
    shell: &'a Shell,
    job: &'a Job,
    topics: Vec<Topic>,
    book: Book<'a>,
    /// Messages that were sent before this start of all processes.
    earlier: u64,
    /// The tick of the next cut.
    next_cut: u64,
    faults: FaultReporter,
}

/// A topic that the recorder reads.
struct Topic {
    channel: usize,
    collector: Collector,
}

fn record(shell: &Shell, robot: &Robot, job: &Job) -> Result<Summary, ProcessError> {
    let mut recorder = Recorder::open(shell, robot, job)?;
    while shell.poll(pace(shell.mode()))? {
        recorder.round()?;
    }
    Ok(recorder.finish())
}

/// Time from one round to the next. To wake up with a cold cache costs more than one tick's messages, so a round takes several ticks in: in real time a
/// chunk's; in lockstep, where all processes wait for a recorder that is too far behind, half of that distance at 50,000 ticks per second.
fn pace(mode: Mode) -> Duration {
    match mode {
        Mode::Realtime => CHUNK,
        Mode::Lockstep => Duration::from_micros(2_500),
    }
}

impl<'a> Recorder<'a> {
    fn open(shell: &'a Shell, robot: &'a Robot, job: &'a Job) -> Result<Self, ProcessError> {
        let from = shell.manifest().from;
        let is_first = shell.incarnation() == 1;
        let path = job.out.join(MESSAGES);
        let contents = Contents::of(job);
        let mut book = Book::new(robot, job)?;
        let last = if job.record && !is_first {
            // None where its predecessor has died before its first chunk.
            RecordReader::last_ticks(&path, &contents).unwrap_or_default()
        } else {
            Vec::new()
        };
        let mut topics = Vec::new();
        for (channel, layout) in contents.layouts().iter().enumerate() {
            if !shell.reads(&layout.topic) {
                book.assembler.leave_out(channel);
                continue;
            }
            let mut collector = shell.collector(&layout.topic)?;
            if !is_first {
                collector.go_on(last.get(channel).copied().flatten());
            }
            topics.push(Topic { channel, collector });
        }
        let mut recorder = Self {
            shell,
            job,
            topics,
            book,
            earlier: 0,
            next_cut: (from / CUT_TICKS + 1) * CUT_TICKS,
            faults: FaultReporter::default(),
        };
        recorder.begin(&path, &contents)?;
        Ok(recorder)
    }

    /// Begins the record, with all that there is of it before a cut or, in real time, before the death of a recorder.
    fn begin(&mut self, path: &Path, contents: &Contents) -> Result<(), ProcessError> {
        let from = self.shell.manifest().from;
        let is_recorded = self.job.record;
        let before = match from {
            0 => u64::MAX,
            from => from,
        };
        let goes_on = from > 0 || is_recorded && self.shell.incarnation() > 1;
        let earlier = goes_on.then(|| RecordReader::open_before(path, contents, before));
        let earlier = match earlier {
            Some(Err(error)) if !error.is_absent() => return Err(ProcessError::setup(error)),
            earlier => earlier.and_then(Result::ok),
        };
        if is_recorded {
            self.book.record = Record::create(path, contents, earlier.is_some());
        }
        let Some(mut earlier) = earlier else {
            return Ok(());
        };
        let topics = &mut self.topics;
        let mut waiting = Vec::new();
        let taken = self.book.take_up(&mut earlier, || {
            // In real time messages come meanwhile.
            topics
                .iter_mut()
                .try_for_each(|Topic { channel, collector }| {
                    let keep = |message: &[u8]| waiting.push((*channel, message.to_vec()));
                    collector.collect(keep).map(drop)
                })
        })?;
        self.book.record.place();
        for (channel, message) in waiting {
            self.book.take(channel, &message);
        }
        self.earlier = if from > 0 { taken } else { 0 };
        Ok(())
    }

    /// Takes in everything that is there.
    fn round(&mut self) -> Result<(), ProcessError> {
        let Self { shell, job, .. } = *self;
        // Read before the messages are: all of earlier ticks are among them.
        let closed = shell.closed_by_all();
        let book = &mut self.book;
        let mut has_all = true;
        for Topic { channel, collector } in &mut self.topics {
            has_all &= collector.collect(|message| book.take(*channel, message))?;
        }
        self.keep_cut(closed);
        // In real time the end of a run waits until all is there, and in a chunk: not for what has yet to be given to a recorder that was started again.
        match shell.mode() {
            Mode::Lockstep => shell.has_taken_in(),
            Mode::Realtime if !has_all => shell.has_missed(),
            Mode::Realtime => {}
        }
        // Before the ticks in which it shows: their words name it.
        self.faults.report(shell, &job.graph, &mut self.book.record);
        self.book.judge_ready();
        self.book.record.close_chunk();
        if !self.book.record.error.is_empty() {
            shell.mark_detected();
        }
        Ok(())
    }

    /// Keeps what all processes have saved at the cut that comes next, when its ticks are closed. One that lacks a process's part is passed over.
    fn keep_cut(&mut self, closed: u64) {
        let tick = self.next_cut;
        if closed < tick || self.shell.mode() == Mode::Realtime {
            return;
        }
        match self.shell.cut(tick) {
            Ok(Some(processes)) => {
                let cut = Cut { tick, processes };
                self.book.record.write(|record| record.cut(&cut));
            }
            Ok(None) if closed < tick + CUT_TICKS / 2 => return,
            Ok(None) => {}
            Err(error) => runtime::complain(&format_args!("no cut at tick {tick}: {error}")),
        }
        self.next_cut += CUT_TICKS;
    }

    fn finish(self) -> Summary {
        let Self {
            shell,
            job,
            mut book,
            earlier,
            mut faults,
            ..
        } = self;
        book.judge_rest(false);
        faults.report(shell, &job.graph, &mut book.record);
        book.record.finish();
        let error = &mut book.record.error;
        if !error.is_empty() {
            *error = format!("{error}; {REMEDY}");
        }
        // Messages sent less messages received: a gap in the ticks may be a message that a fault kept from being sent.
        let refused = shell.count(Count::Refused) + shell.count(Count::Fenced);
        let sent = earlier + shell.sent_by_all();
        let lost = sent.saturating_sub(book.messages() + refused);
        let mut summary = book.summary(lost);
        summary.recorder.cpu_s = runtime::realtime::cpu_time_s();
        summary
    }
}
