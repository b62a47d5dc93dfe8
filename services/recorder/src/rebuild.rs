//! A run's recording and account made again from the messages that it kept: for a run whose launcher was killed.

use message_log::{LogError, LogReader, TopicHash};
use model::Robot;
use runtime::{Mode, ProcessError};
use shared_types::job::{self, Job};
use shared_types::summary::Summary;
use shared_types::topics::{self, Build, ByTopic, Each, Family, Topic};

use crate::assemble::{Assembler, Row, Set};
use crate::judge::{Judge, Tick};
use crate::tape::Tape;
use crate::{HORIZON, MESSAGES, PATIENCE, limits, summary, take};

/// Ticks that are taken from the messages at a time.
const STRIDE: u64 = 64;

/// The messages of all topics, in the order of their ticks.
struct Kept;

impl Family for Kept {
    type Of<M: Topic> = Option<Messages<M>>;
}

struct Messages<M: Topic> {
    reader: LogReader<M>,
    /// Read, and of a later tick than was asked for.
    next: Option<M>,
    hash: TopicHash,
}

/// Writes the recording of a run again, and judges it, from the messages in its folder, to the last that is whole.
///
/// # Errors
/// [`ProcessError`] where the messages cannot be read, or the recording cannot be written.
pub fn rebuild(robot: &Robot, job: &Job) -> Result<Summary, ProcessError> {
    struct Open<'a>(&'a Job);
    impl Build<Kept> for Open<'_> {
        type Error = LogError;
        fn build<M: Topic>(&mut self) -> Result<Option<Messages<M>>, LogError> {
            if self.0.graph.writer(M::TOPIC).is_none() {
                return Ok(None);
            }
            let reader = LogReader::open(&self.0.out.join(MESSAGES))?;
            Ok(Some(Messages { reader, next: None, hash: TopicHash::default() }))
        }
    }
    /// Puts the messages of the ticks before `until` into their rows; whether there are more.
    struct Put<'a>(&'a mut ByTopic<Kept>, &'a mut Assembler, u64);
    impl Each for Put<'_> {
        type Output = bool;
        fn each<M: Topic>(&mut self) -> bool {
            let Some(messages) = M::of_mut(self.0) else { return false };
            // A block that was being written when its writer died ends the messages of its topic.
            while let Some(message) = messages.next.take().or_else(|| messages.reader.next_message().ok().flatten()) {
                let tick = message.header().tick;
                if tick >= self.2 {
                    messages.next = Some(message);
                    return true;
                }
                messages.hash.add(&message);
                if let Some(row) = self.1.row(tick) {
                    row.put(&message);
                }
            }
            false
        }
    }
    struct Account<'a>(&'a ByTopic<Kept>);
    impl Each for Account<'_> {
        type Output = Option<(&'static str, TopicHash)>;
        fn each<M: Topic>(&mut self) -> Self::Output {
            M::of(self.0).as_ref().map(|messages| (M::TOPIC, messages.hash))
        }
    }
    let mut kept = ByTopic::try_build(&mut Open(job)).map_err(ProcessError::setup)?;
    let mut assembler = Assembler::new(Set::of(|topic| job.graph.writer(topic).is_some()), PATIENCE, HORIZON);
    let mut judge = Judge::new(limits(robot), job.scenario.goal.clone(), job.scenario.duration_s() * f64::from(job.scenario.rate_hz));
    let mode = if job.mode == job::Mode::Lockstep { Mode::Lockstep } else { Mode::Realtime };
    if mode == Mode::Realtime {
        judge = judge.on_grid(1_000_000_000 / u64::from(job.scenario.rate_hz));
    }
    let mut tape = Tape::start(robot, job, 1)?;
    // The messages of the topics end at different ticks: rows after the last whole one are left out.
    let mut partial: Vec<Row> = Vec::new();
    for until in (1..).map(|stride| stride * STRIDE) {
        let has_more = topics::each(&mut Put(&mut kept, &mut assembler, until)).contains(&true);
        while let Some(row) = assembler.pop(until, !has_more) {
            if Tick::of(&row.messages().lent()).is_none() {
                partial.push(row.clone());
                continue;
            }
            partial.drain(..).for_each(|row| take(&row, &mut judge, &mut tape));
            take(row, &mut judge, &mut tape);
        }
        if !has_more {
            break;
        }
    }
    let account: Vec<_> = topics::each(&mut Account(&kept)).into_iter().flatten().collect();
    Ok(summary(robot, job, mode, judge.verdict(), &account, tape.finish()))
}
