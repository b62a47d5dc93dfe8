//! The recorder process: reads every topic, judges and hashes the run, and writes the recording. No process waits for it in real time.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod contents;
mod cut;
mod error;
mod event;
mod fault_reporter;
mod hash;
mod judge;
mod reader;
mod rebuild;
#[cfg(test)]
mod tests;
mod ticks;
mod writer;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use model::Robot;
use runtime::{CUT_TICKS, Collector, Count, Mode, ProcessError, Shell, write_reserved};
use serde_json::Value;
use shared_types::job::Job;
use shared_types::summary::{RecorderSummary, Summary};

use fault_reporter::FaultReporter;

pub use contents::{Contents, tick_of};
pub use cut::Cut;
pub use error::RecordError;
pub use event::{Event, Level, Source};
pub use hash::TopicHash;
pub use judge::{Bounds, Judge, Limits, TaskError, Tick, Verdict};
pub use reader::{Item, RecordReader, part};
pub use rebuild::{is_in_parts, rebuild};
pub use ticks::{Account, Assembler, Row, Ticks};
pub use writer::RecordWriter;

/// Name of the record in the results folder.
pub const MESSAGES: &str = "messages.mcap";

/// Name of the recorder's part of the summary in the run's directory.
pub const SUMMARY: &str = "summary.json";

/// A chunk of the record is closed after so much time: a recorder that is killed in real time takes it along.
const CHUNK: Duration = Duration::from_millis(50);

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
    topics: Vec<Topic>,
    assembler: Assembler,
    judge: Judge,
    record: Record,
    /// Ticks judged.
    rows: u64,
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
    /// A replacement begins another file; what it judges is judged again from all files at the end of the run.
    fn open(shell: &'a Shell, robot: &'a Robot, job: &'a Job) -> Result<Self, ProcessError> {
        let from = shell.manifest().from;
        let contents = Contents::of(job).from(from);
        let mut assembler = Assembler::new(&contents);
        let (record, last) = Record::begin(job, &contents, shell.incarnation());
        let (mut topics, is_first) = (Vec::new(), shell.incarnation() == 1);
        for (channel, layout) in contents.layouts().iter().enumerate() {
            if !shell.reads(&layout.topic) {
                assembler.leave_out(channel);
                continue;
            }
            let mut collector = shell.collector(&layout.topic)?;
            if !is_first {
                let last = last.get(channel).and_then(Option::as_deref);
                collector.go_on(last.map(tick_of));
            }
            topics.push(Topic { channel, collector });
        }
        Ok(Self {
            judge: judge(robot, job)?,
            shell,
            job,
            topics,
            assembler,
            record,
            rows: 0,
            next_cut: (from / CUT_TICKS + 1) * CUT_TICKS,
            faults: FaultReporter::default(),
        })
    }

    /// Takes in everything that is there.
    fn round(&mut self) -> Result<(), ProcessError> {
        let Self { shell, job, .. } = *self;
        // Read before the messages are: all of earlier ticks are among them.
        let closed = shell.closed_by_all();
        for Topic { channel, collector } in &mut self.topics {
            collector.collect(|message| {
                self.assembler.take(*channel, message);
                self.record.write(|record| record.append(*channel, message));
            })?;
        }
        self.keep_cut(closed);
        shell.has_taken_in();
        // Before the ticks in which it shows: their words name it.
        self.faults.report(shell, &job.graph, &mut self.record);
        while let Some(row) = self.assembler.next_row() {
            self.judge(&row);
        }
        self.record.close_chunk();
        if !self.record.error.is_empty() {
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
                self.record
                    .write(|record| record.cut(&Cut { tick, processes }));
            }
            Ok(None) if closed < tick + CUT_TICKS / 2 => return,
            Ok(None) => {}
            Err(error) => runtime::complain(&format_args!("no cut at tick {tick}: {error}")),
        }
        self.next_cut += CUT_TICKS;
    }

    fn judge(&mut self, row: &Row) {
        self.rows += 1;
        for event in take(row, &mut self.judge) {
            self.record.write(|record| record.event(&event));
        }
    }

    fn finish(mut self) -> Summary {
        while let Some(row) = self.assembler.rest() {
            self.judge(&row);
        }
        let shell = self.shell;
        let graph = &self.job.graph;
        self.faults.report(shell, graph, &mut self.record);
        let mut recorded = RecorderSummary {
            rows: self.rows,
            bytes: self.record.finish(),
            error: self.record.error,
            cpu_s: runtime::realtime::cpu_time_s(),
            ..RecorderSummary::default()
        };
        // Messages sent less messages received: a gap in the ticks may be a message that a fault kept from being sent.
        let refused = shell.count(Count::Refused) + shell.count(Count::Fenced);
        let accounts = self.assembler.accounts().iter();
        let received: u64 = accounts.map(|one| one.hash.count()).sum();
        recorded.lost = shell.sent_by_all().saturating_sub(received + refused);
        summary(self.job, self.judge, &self.assembler, recorded)
    }
}

/// The record, as long as it can be written; the first error ends it and is kept. A disk that is full ends the record, not the run.
struct Record {
    writer: Option<RecordWriter>,
    bytes: u64,
    error: String,
    closed: Instant,
}

impl Record {
    /// The record of a recorder's incarnation, where messages are kept, and the last messages of its predecessors.
    fn begin(job: &Job, contents: &Contents, incarnation: u32) -> (Self, Vec<Option<Vec<u8>>>) {
        let mut record = Self {
            writer: None,
            bytes: 0,
            error: String::new(),
            closed: Instant::now(),
        };
        let first = job.out.join(MESSAGES);
        let mut last = Vec::new();
        if !job.record {
            return (record, last);
        }
        let number = match contents.from {
            0 => incarnation,
            _ => (1..)
                .find(|number| !part(&first, *number).exists())
                .unwrap_or(1),
        };
        if number == 1 {
            // Those of a run before, in the same folder.
            remove_parts(&first);
        }
        let path = part(&first, number);
        for number in 1..incarnation {
            // One that died before its first chunk has left none.
            let read = RecordReader::last_messages(&part(&first, number), contents);
            last.resize(contents.layouts().len(), None);
            let read = read.into_iter().flatten();
            for (last, read) in last.iter_mut().zip(read) {
                *last = read.or(last.take());
            }
        }
        match RecordWriter::create(&path, contents) {
            Ok(writer) => record.writer = Some(writer),
            Err(error) => record.fail(&error),
        }
        (record, last)
    }

    fn write(&mut self, write: impl FnOnce(&mut RecordWriter) -> Result<(), RecordError>) {
        if let Some(writer) = &mut self.writer
            && let Err(error) = write(writer)
        {
            self.bytes = writer.bytes();
            self.fail(&error);
        }
    }

    /// Closes the chunk, if it is time.
    fn close_chunk(&mut self) {
        if self.closed.elapsed() >= CHUNK {
            self.closed = Instant::now();
            self.write(RecordWriter::close_chunk);
        }
    }

    fn fail(&mut self, error: &RecordError) {
        runtime::complain(error);
        self.error = format!("{error}; give a folder with more room by --out, or use --no-record");
        self.writer = None;
    }

    /// Ends it; its size in bytes.
    fn finish(&mut self) -> u64 {
        match self.writer.take().map(RecordWriter::finish) {
            None => {}
            Some(Ok(bytes)) => self.bytes = bytes,
            Some(Err(error)) => self.fail(&error),
        }
        self.bytes
    }
}

/// Removes the files that replacements of a recorder have written beside a record.
fn remove_parts(first: &Path) {
    let parts = (2..).map(|number| part(first, number));
    parts
        .map_while(|part: PathBuf| std::fs::remove_file(part).ok())
        .for_each(drop);
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

/// Judges a tick; the words on it.
fn take(row: &Row, judge: &mut Judge) -> Vec<Event> {
    let messages = row.messages().lent();
    if let Some(tick) = Tick::of(&messages) {
        judge.tick(tick);
    } else if let Some(sensor) = messages.sensor {
        judge.torn(sensor);
    }
    let events = judge.events().map(|(tick, text)| Event {
        tick,
        level: Level::Warning,
        source: Source::Judge,
        text,
    });
    events.collect()
}

/// The recorder's part of the summary; the launcher adds the processes.
fn summary(job: &Job, judge: Judge, assembler: &Assembler, recorded: RecorderSummary) -> Summary {
    let accounts = || assembler.accounts().iter().filter(|one| one.is_read());
    Summary {
        of: job.into(),
        topics: accounts()
            .map(|one| (one.topic.clone(), one.hash.summary()))
            .collect(),
        recorder: RecorderSummary {
            messages: accounts().map(|one| one.hash.count()).sum(),
            not_drawn: assembler.foreign(),
            file: match job.record {
                true => MESSAGES.to_owned(),
                false => String::new(),
            },
            ..recorded
        },
        ..judge.verdict()
    }
}
