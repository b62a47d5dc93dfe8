//! The recorder process: reads every topic, judges and hashes the run, and writes the recording. No process waits for it in real time.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod assemble;
mod checkpoint;
mod fault_reporter;
mod foreign;
mod judge;
mod log_account;
mod log_result;
mod message_rows;
mod pace;
mod rebuild;
mod tape;

use std::collections::BTreeMap;
use std::path::Path;

use bytemuck::{bytes_of, try_pod_read_unaligned};
use message_log::{LogWriter, Logs, Place, TopicHash};
use model::Robot;
use runtime::{Collector, Count, Mode, ProcessError, Shell, write_reserved};
use serde_json::Value;
use shared_types::Message;
use shared_types::graph::Graph;
use shared_types::job::Job;
use shared_types::summary::{RecorderSummary, Summary};
use shared_types::topics::{self, Build, ByTopic, COUNT, Each, Family, Topic};
use viz::Level;

use checkpoint::{Bytes, Checkpoint, Memory, Past, Progress, StoredRow, most_ticks};
use fault_reporter::FaultReporter;
use foreign::ForeignTap;
use log_result::{Keep, LogResult};
use pace::Pace;

pub use assemble::{Assembler, Row, Set};
pub use judge::{Bounds, Judge, Limits, TaskError, Tick, Verdict};
pub use message_rows::MessageRows;
pub use rebuild::rebuild;
pub use tape::Tape;

/// Name of the recorder's part of the summary in the run's directory.
pub const SUMMARY: &str = "summary.json";

/// Name of the folder with the messages in the results folder.
pub const MESSAGES: &str = "messages";

/// Ticks for which an incomplete row waits for its missing messages.
pub const PATIENCE: u64 = 256;

/// Ticks that may be missing on end; a minute at 1 kHz.
pub const HORIZON: u64 = 60_000;

/// Records and judges until the run has stopped and everything on the way has arrived, then leaves its part of the summary in `run_dir`.
///
/// # Errors
/// [`ProcessError`] where the recorder cannot begin, the graph breaks, or the summary cannot be written. A recording that fails
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

fn record(
    shell: &Shell,
    robot: &Robot,
    job: &Job,
    run_dir: &Path,
) -> Result<Summary, ProcessError> {
    let folder = job.out.join(MESSAGES);
    let unusable = |error| {
        ProcessError::setup(format!(
            "cannot keep what a replacement must know in {}: {error}",
            run_dir.display()
        ))
    };
    let mut memory = Memory::open(run_dir).map_err(unusable)?;
    let past = if shell.incarnation() > 1 {
        memory.last()
    } else {
        None
    };
    let mut assembler = Assembler::new(Set::of(|topic| shell.reads(topic)), PATIENCE, HORIZON);
    let mut judge =
        Judge::in_processes(&job.graph, robot, &job.scenario).map_err(ProcessError::setup)?;
    if shell.mode() == Mode::Realtime {
        judge = judge.on_grid(shell.manifest().period_ns());
    }
    let mut tape = if shell.incarnation() > 1 {
        Tape::go_on(robot, job, memory.written())
    } else {
        Tape::start(robot, job)
    }?;
    let mut fault_reporter = FaultReporter::default();
    let mut progress = Past::default();
    if let Some(past) = past {
        progress = past.progress;
        assembler.resume(past.next, past.rows.into_iter().map(Row::from));
        if tape.result.error.is_empty() {
            tape.result.error = past.result.error;
        }
        // Those since then come again.
        tape.result.rows = past.result.rows;
        judge = past
            .judge
            .resumed(robot, &job.scenario)
            .map_err(ProcessError::setup)?;
        fault_reporter = FaultReporter::resume(past.reported);
    }
    let logs = Logs::of(job);
    let keep = job.messages.then_some((folder.as_path(), &logs));
    let mut topics = Topics::open(shell, &job.graph, keep, &progress, &mut assembler)?;
    let mut pace = Pace::new(shell.mode(), job.live, shell.most_ahead());
    while shell.poll(pace.next(shell.ticks_begun()))? {
        topics.drain(&mut assembler)?;
        shell.has_taken_in();
        // Before the ticks in which it shows: their words name it.
        fault_reporter.report(shell, &job.graph, &mut tape);
        while let Some(row) = assembler.pop(shell.ticks_begun(), false) {
            take(row, &mut judge, &mut tape);
            // With every row: a replacement writes again what is not noted.
            tape.written()
                .into_iter()
                .for_each(|written| memory.note(written));
        }
        if !tape.result.error.is_empty() || topics.has_failed() {
            shell.mark_detected();
        }
        let most_ticks = most_ticks(job.messages && !topics.has_failed(), shell.most_ahead());
        if shell.is_about_to_go_down() || memory.is_due(assembler.next_tick(), most_ticks) {
            tape.flush();
            topics.flush();
            tape.written()
                .into_iter()
                .for_each(|written| memory.note(written));
            let (next, rows) = assembler.pending();
            let rows = rows.map(StoredRow::from).collect();
            let checkpoint = Checkpoint {
                judge,
                progress: topics.progress(),
                next,
                rows,
                result: tape.result,
                reported: fault_reporter.reported(),
            };
            shell.elsewhere(|| memory.save(&checkpoint));
            (judge, tape.result) = (checkpoint.judge, checkpoint.result);
        }
    }
    while let Some(row) = assembler.pop(0, true) {
        take(row, &mut judge, &mut tape);
    }
    fault_reporter.report(shell, &job.graph, &mut tape);
    let (logged, mut tape) = (topics.finish(), tape.finish());
    tape.messages_bytes = logged.bytes;
    if tape.error.is_empty() {
        tape.error = logged.error;
    }
    tape.cpu_s = runtime::realtime::cpu_time_s();
    // Messages sent less messages received: a gap in the ticks may be a message that a fault kept from being sent.
    let refused = shell.count(Count::Refused) + shell.count(Count::Fenced);
    tape.lost = shell.sent_by_all().saturating_sub(
        topics
            .account()
            .iter()
            .map(|(_, hash)| hash.count())
            .sum::<u64>()
            + refused,
    );
    tape.not_drawn = topics.foreign.iter().map(|tap| tap.topic.clone()).collect();
    Ok(summary(
        robot,
        job,
        judge.verdict(),
        &topics.account(),
        tape,
    ))
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

/// One topic's end: its messages, its fingerprint, and the file they are kept in where that is wanted.
struct Tap<M: Message> {
    drain: Collector<M>,
    hash: TopicHash,
    last: Option<M>,
    keep: Option<LogWriter<M>>,
    logged: LogResult,
}

impl<M: Topic> Tap<M> {
    /// A replacement goes on where its predecessor was killed: `each` is given what that one had kept after its last checkpoint, and
    /// the first [`drain`](Self::drain) what was on its way to it.
    fn open(
        shell: &Shell,
        messages: Option<Keep<'_>>,
        past: &Progress,
        mut each: impl FnMut(&M),
    ) -> Result<Self, ProcessError> {
        let mut drain = shell.collector()?;
        if shell.incarnation() == 1 {
            let (keep, logged) =
                log_result::first(messages.map(|(folder, logs)| LogWriter::create(folder, logs)));
            return Ok(Self {
                drain,
                hash: TopicHash::default(),
                last: None,
                keep,
                logged,
            });
        }
        drain.resume(past.last, past.lost);
        let mut hash = past.hash;
        let mut last: Option<M> = past
            .message
            .as_ref()
            .and_then(|bytes| try_pod_read_unaligned(&bytes.0).ok());
        let mut logged = LogResult {
            bytes: past.log_bytes,
            error: past.log_error.clone(),
        };
        let place = Place {
            byte: past.log_bytes,
            messages: past.hash.count(),
        };
        let resumed = messages
            .filter(|_| logged.error.is_empty())
            .map(|(folder, logs)| {
                LogWriter::resume(folder, logs, place, |message: M| {
                    hash.add(&message);
                    drain.recount(&message);
                    each(&message);
                    last = Some(message);
                })
            });
        let keep = resumed.transpose().unwrap_or_else(|error| {
            runtime::complain(&error);
            logged.error = error.to_string();
            None
        });
        drain.recall(last.as_ref())?;
        Ok(Self {
            drain,
            hash,
            last,
            keep,
            logged,
        })
    }

    fn drain(&mut self, assembler: &mut Assembler) -> Result<(), ProcessError> {
        let Self {
            drain,
            hash,
            last,
            keep,
            logged,
        } = self;
        let mut newest = None;
        drain.collect(|message| {
            hash.add(message);
            if let Some(keeping) = keep
                && let Err(error) = keeping.add(message)
            {
                runtime::complain(&error);
                *logged = LogResult {
                    bytes: keeping.place().byte,
                    error: error.to_string(),
                };
                *keep = None;
            }
            let tick = message.header().tick;
            newest = assembler.row(tick).map(|row| {
                row.put(message);
                tick
            });
            if newest.is_none() {
                *last = Some(*message);
            }
        })?;
        // A second copy of the last of them alone.
        if let Some(row) = newest.and_then(|tick| assembler.row(tick)) {
            *last = *M::of(row.messages());
        }
        Ok(())
    }

    fn flush(&mut self) {
        if let Some(keep) = &mut self.keep
            && let Err(error) = keep.flush()
        {
            runtime::complain(&error);
            self.logged = LogResult {
                bytes: keep.place().byte,
                error: error.to_string(),
            };
            self.keep = None;
        }
    }

    fn progress(&self) -> Progress {
        Progress {
            hash: self.hash,
            last: self.drain.last(),
            lost: self.drain.lost(),
            message: self
                .last
                .as_ref()
                .map(|message| Bytes(bytes_of(message).to_vec())),
            log_bytes: self
                .keep
                .as_ref()
                .map_or(self.logged.bytes, |keep| keep.place().byte),
            log_error: self.logged.error.clone(),
        }
    }

    fn finish(&mut self) -> LogResult {
        match self
            .keep
            .take()
            .map(|keep| (keep.place().byte, keep.finish()))
        {
            None => self.logged.clone(),
            Some((_, Ok(bytes))) => LogResult {
                bytes,
                error: String::new(),
            },
            Some((bytes, Err(error))) => LogResult {
                bytes,
                error: error.to_string(),
            },
        }
    }
}

/// The end of each topic that the graph has.
struct Taps;

impl Family for Taps {
    type Of<M: Topic> = Option<Tap<M>>;
}

/// The end of every topic that the recorder reads.
struct Topics {
    listed: ByTopic<Taps>,
    foreign: Vec<ForeignTap>,
}

impl Topics {
    fn open(
        shell: &Shell,
        graph: &Graph,
        messages: Option<Keep<'_>>,
        past: &Past,
        assembler: &mut Assembler,
    ) -> Result<Self, ProcessError> {
        struct Open<'a>(
            &'a Shell,
            Option<Keep<'a>>,
            &'a [Progress; COUNT],
            &'a mut Assembler,
        );
        impl Build<Taps> for Open<'_> {
            type Error = ProcessError;
            fn build<M: Topic>(&mut self) -> Result<Option<Tap<M>>, ProcessError> {
                let Self(shell, messages, past, assembler) = self;
                if !shell.reads(M::TOPIC) {
                    return Ok(None);
                }
                // Repeated messages of ticks that are already written are dropped.
                let again = |message: &M| {
                    assembler
                        .row(message.header().tick)
                        .into_iter()
                        .for_each(|row| row.put(message))
                };
                Tap::open(shell, *messages, &past[M::INDEX], again).map(Some)
            }
        }
        let listed = ByTopic::try_build(&mut Open(shell, messages, &past.listed, assembler))?;
        let layouts = graph
            .own_messages()
            .filter(|layout| shell.reads(&layout.topic));
        let open = |(place, layout)| {
            let nothing = Progress::default();
            ForeignTap::open(
                shell,
                &layout,
                messages,
                past.foreign.get(place).unwrap_or(&nothing),
            )
        };
        let foreign = layouts.enumerate().map(open).collect::<Result<_, _>>()?;
        Ok(Self { listed, foreign })
    }

    /// Ends the keeping of messages: how many bytes there are, and the first thing that went wrong.
    fn finish(&mut self) -> LogResult {
        // The end of a log states how many messages the others hold.
        self.flush();
        struct Finish<'a>(&'a mut ByTopic<Taps>);
        impl Each for Finish<'_> {
            type Output = LogResult;
            fn each<M: Topic>(&mut self) -> LogResult {
                M::of_mut(self.0)
                    .as_mut()
                    .map(Tap::finish)
                    .unwrap_or_default()
            }
        }
        let listed = topics::each(&mut Finish(&mut self.listed));
        let all: Vec<_> = listed
            .into_iter()
            .chain(self.foreign.iter_mut().map(ForeignTap::finish))
            .collect();
        let error = all
            .iter()
            .find(|logged| !logged.error.is_empty())
            .map(|logged| logged.error.clone())
            .unwrap_or_default();
        LogResult {
            bytes: all.iter().map(|logged| logged.bytes).sum(),
            error,
        }
    }

    fn drain(&mut self, assembler: &mut Assembler) -> Result<(), ProcessError> {
        struct Drain<'a>(&'a mut ByTopic<Taps>, &'a mut Assembler);
        impl Each for Drain<'_> {
            type Output = Result<(), ProcessError>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                M::of_mut(self.0)
                    .as_mut()
                    .map_or(Ok(()), |tap| tap.drain(self.1))
            }
        }
        topics::try_each(&mut Drain(&mut self.listed, assembler))?;
        self.foreign.iter_mut().try_for_each(ForeignTap::drain)
    }

    fn flush(&mut self) {
        struct Flush<'a>(&'a mut ByTopic<Taps>);
        impl Each for Flush<'_> {
            type Output = ();
            fn each<M: Topic>(&mut self) {
                M::of_mut(self.0).iter_mut().for_each(Tap::flush);
            }
        }
        topics::each(&mut Flush(&mut self.listed));
        self.foreign.iter_mut().for_each(ForeignTap::flush);
    }

    fn has_failed(&self) -> bool {
        struct Failed<'a>(&'a ByTopic<Taps>);
        impl Each for Failed<'_> {
            type Output = bool;
            fn each<M: Topic>(&mut self) -> bool {
                M::of(self.0)
                    .as_ref()
                    .is_some_and(|tap| !tap.logged.error.is_empty())
            }
        }
        topics::each(&mut Failed(&self.listed)).contains(&true)
            || self.foreign.iter().any(ForeignTap::has_failed)
    }

    fn progress(&self) -> Past {
        struct Come<'a>(&'a ByTopic<Taps>);
        impl Each for Come<'_> {
            type Output = Progress;
            fn each<M: Topic>(&mut self) -> Progress {
                M::of(self.0)
                    .as_ref()
                    .map(Tap::progress)
                    .unwrap_or_default()
            }
        }
        Past {
            listed: topics::each(&mut Come(&self.listed)),
            foreign: self.foreign.iter().map(ForeignTap::progress).collect(),
        }
    }

    /// Name and hash of each topic that the graph has.
    fn account(&self) -> Vec<(&str, TopicHash)> {
        struct Hashes<'a>(&'a ByTopic<Taps>);
        impl Each for Hashes<'_> {
            type Output = Option<(&'static str, TopicHash)>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                M::of(self.0).as_ref().map(|tap| (M::TOPIC, tap.hash))
            }
        }
        let listed = topics::each(&mut Hashes(&self.listed))
            .into_iter()
            .flatten();
        listed
            .chain(
                self.foreign
                    .iter()
                    .map(|tap| (tap.topic.as_str(), tap.hash())),
            )
            .collect()
    }
}

/// The recorder's part of the summary; the launcher adds the processes.
fn summary(
    robot: &Robot,
    job: &Job,
    verdict: Verdict,
    account: &[(&str, TopicHash)],
    tape: RecorderSummary,
) -> Summary {
    Summary {
        version: job.version.clone(),
        scenario: job.scenario.name.clone(),
        robot: robot.name.clone(),
        mode: job.mode.name().to_owned(),
        seed: job.scenario.seed,
        run: job.run.clone(),
        ticks: verdict.ticks,
        rate_hz: job.scenario.rate_hz,
        completed: verdict.completed,
        outcome: verdict.outcome,
        reason: verdict.reason,
        wall_s: verdict.wall_s,
        ticks_per_s: if verdict.wall_s > 0.0 {
            verdict.ticks as f64 / verdict.wall_s
        } else {
            0.0
        },
        topics: account
            .iter()
            .map(|(name, hash)| ((*name).to_owned(), hash.summary()))
            .collect::<BTreeMap<_, _>>(),
        task: verdict.task,
        joints: verdict.joints,
        singularities: verdict.singularities,
        turns: verdict.turns,
        modes: verdict.modes,
        servo: verdict.servo,
        faults: Vec::new(),
        deadlines: Default::default(),
        latency_us: verdict.latency_us,
        not_finite: Vec::new(),
        recorder: RecorderSummary {
            messages: account.iter().map(|(_, hash)| hash.count()).sum(),
            ..tape
        },
        processes: Vec::new(),
        machine: Default::default(),
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
