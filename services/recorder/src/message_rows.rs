//! The messages of a run, tick by tick, as the recorder kept them; and the defects of their log, in
//! words.

use std::path::Path;

use message_log::{Contents, Defect, FILE, Log, LogError, TopicHash};
use shared_types::job::Job;
use shared_types::summary::Summary;

use crate::assemble::{Assembler, Row, Set};
use crate::topics::{Taken, account};
use crate::{HORIZON, PATIENCE};

/// The rows of a run's message log: whatever there is of each tick, in order.
pub struct MessageRows {
    /// `None`: there is none that can be read.
    log: Option<Log>,
    topics: Vec<Taken>,
    /// Messages of each topic that are known to be lost.
    lost: Vec<u64>,
    assembler: Assembler,
    /// Blocks that have been read, and flaws that have been noted.
    block: usize,
    flaw: usize,
    damage: Vec<Damage>,
}

/// A place that is not as it was written.
struct Damage {
    words: &'static str,
    /// The first tick that it concerns, and of how many the messages are lost.
    tick: u64,
    ticks: u64,
    /// Nothing follows that would tell how much is lost.
    is_open: bool,
}

const OTHER_RUN: &str = "is the log of another run";
const ABSENT: &str = "is missing or empty";

/// The words for a defect behind the name of the file.
fn words(defect: Defect) -> &'static str {
    match defect {
        Defect::Damaged => "is damaged",
        Defect::Missing => "lacks blocks",
        Defect::Repeated => "holds blocks twice",
        Defect::Displaced => "holds blocks out of their order",
        Defect::OtherRun => "holds blocks of another run",
    }
}

impl MessageRows {
    /// The messages of a job's run in a file, of the topics that its graph's processes write.
    ///
    /// # Errors
    /// [`LogError`] if the messages are not there, are of another run, or are not this program's.
    pub fn open(path: &Path, job: &Job) -> Result<Self, LogError> {
        let contents = Contents::of(job);
        let log = Log::open(path, &contents)?;
        Ok(Self::new(Some(log), &contents))
    }

    /// The same where there may be no log yet, or one that is damaged or of another run.
    ///
    /// # Errors
    /// [`LogError`] if the file cannot be read or its messages are not this program's.
    pub fn open_left(path: &Path, job: &Job) -> Result<Self, LogError> {
        let contents = Contents::of(job);
        let words = match Log::open(path, &contents) {
            Ok(log) => return Ok(Self::new(Some(log), &contents)),
            Err(error) if error.is_before_the_first_message() => None,
            Err(LogError::OtherRun { .. }) => Some(OTHER_RUN),
            Err(error) if error.is_damage() => Some(words(Defect::Damaged)),
            Err(error) => return Err(error),
        };
        let mut rows = Self::new(None, &contents);
        rows.damage.extend(words.map(|words| Damage {
            words,
            tick: 0,
            ticks: 0,
            is_open: true,
        }));
        Ok(rows)
    }

    fn new(log: Option<Log>, contents: &Contents) -> Self {
        let topics = contents.layouts().iter();
        let topics: Vec<_> = topics.map(|layout| Taken::new(&layout.topic)).collect();
        let expected = Set::of(|topic| contents.channel(topic).is_some());
        Self {
            log,
            lost: vec![0; topics.len()],
            topics,
            assembler: Assembler::new(expected, PATIENCE, HORIZON),
            block: 0,
            flaw: 0,
            damage: Vec::new(),
        }
    }

    /// The next row; `None` at the end.
    pub fn next_row(&mut self) -> Option<Box<Row>> {
        let (mut begun, mut is_over) = (0, false);
        while !is_over && !self.assembler.is_ready(begun) {
            let log = self.log.clone().filter(|log| self.block < log.blocks());
            match log {
                Some(log) => {
                    self.read_block(&log);
                    begun = log.begun(self.block - 1);
                }
                None => {
                    self.note_flaws();
                    is_over = true;
                }
            }
        }
        self.assembler.pop(begun, is_over)
    }

    fn read_block(&mut self, log: &Log) {
        self.note_flaws();
        match log.chunk(self.block) {
            Ok(chunk) => {
                for (channel, taken) in self.topics.iter_mut().enumerate() {
                    let messages = chunk.messages(channel);
                    messages.for_each(|message| taken.take(message, &mut self.assembler));
                }
            }
            // It was whole when the log was opened.
            Err(error) => {
                runtime::complain(&error);
                self.damage.push(Damage {
                    words: words(Defect::Damaged),
                    tick: self.assembler.next_tick(),
                    ticks: 0,
                    is_open: true,
                });
            }
        }
        self.block += 1;
    }

    /// Notes the flaws before the next block.
    fn note_flaws(&mut self) {
        let Some(log) = self.log.clone() else { return };
        while let Some(flaw) = log.flaws().get(self.flaw)
            && flaw.block <= self.block
        {
            self.flaw += 1;
            let is_last = flaw.block == log.blocks() && !log.is_ended();
            let (tick, ticks) = self.lose(&flaw.lost);
            self.damage.push(Damage {
                words: words(flaw.defect),
                tick: flaw.tick.unwrap_or(tick),
                ticks,
                is_open: is_last && ticks == 0,
            });
        }
    }

    /// Counts messages of each topic as lost; the tick of the first, and of how many ticks they are.
    fn lose(&mut self, lost: &[u64]) -> (u64, u64) {
        for (known, lost) in self.lost.iter_mut().zip(lost) {
            *known = known.saturating_add(*lost);
        }
        let next = self.topics.iter().map(Taken::next_tick);
        let losing = next.clone().zip(lost).filter(|(_, lost)| **lost > 0);
        let first = losing.map(|(next, _)| next).min();
        let first = first.or(next.max()).unwrap_or(0);
        (first, lost.iter().copied().max().unwrap_or(0))
    }

    /// The ways in which the log, read to its end, is not as it was written or does not hold what a run's summary counts, where there is one: a clause
    /// for each. A topic that the summary does not name is left out of the comparison.
    pub fn damage(mut self, summary: Option<&Summary>) -> Vec<String> {
        while self.next_row().is_some() {}
        let Some(summary) = summary else {
            return self.damage_so_far();
        };
        let expected = |taken: &Taken| summary.topics.get(&taken.topic);
        let missing = |(taken, lost): (&Taken, &u64)| {
            let known = taken.hash.count().saturating_add(*lost);
            expected(taken).map_or(0, |all| all.count.saturating_sub(known))
        };
        let lost: Vec<u64> = self.topics.iter().zip(&self.lost).map(missing).collect();
        let (tick, ticks) = self.lose(&lost);
        let open = self.damage.iter_mut().find(|damage| damage.is_open);
        match open {
            Some(open) => (open.tick, open.ticks, open.is_open) = (tick, ticks, false),
            None if ticks > 0 => self.damage.push(Damage {
                words: match self.log {
                    Some(_) => words(Defect::Missing),
                    None => ABSENT,
                },
                tick,
                ticks,
                is_open: false,
            }),
            None => {}
        }
        let differs = |taken: &&Taken| {
            expected(taken).is_some_and(|expected| *expected != taken.hash.summary())
        };
        let mut clauses = self.damage_so_far();
        if clauses.is_empty() {
            let others = self.topics.iter().filter(differs);
            clauses.extend(others.map(|Taken { topic, .. }| {
                format!("{FILE} holds other messages of `{topic}` than the run has sent")
            }));
        }
        clauses
    }

    /// The damage as far as the log has been read: a clause for each kind.
    pub(crate) fn damage_so_far(&self) -> Vec<String> {
        let mut clauses = Vec::new();
        for (number, damage) in self.damage.iter().enumerate() {
            let alike = || self.damage.iter().filter(|one| one.words == damage.words);
            let is_first = self.damage[..number]
                .iter()
                .all(|before| before.words != damage.words);
            if !is_first {
                continue;
            }
            let first = alike().map(|one| one.tick).min().unwrap_or(0);
            let ticks = alike().fold(0, |ticks: u64, one| ticks.saturating_add(one.ticks));
            let place = match alike().count() {
                _ if [OTHER_RUN, ABSENT].contains(&damage.words) => String::new(),
                1 => format!(" at tick {first}"),
                places => format!(" in {places} places, first at tick {first}"),
            };
            let lost = match ticks {
                0 if alike().any(|one| one.is_open) => {
                    "its messages from there on are lost".to_owned()
                }
                0 => "no message is lost".to_owned(),
                ticks => format!("its messages of {ticks} ticks are lost"),
            };
            clauses.push(format!("{FILE} {}{place}: {lost}", damage.words));
        }
        clauses
    }

    /// As [`account`], of the messages that have been read.
    pub(crate) fn account(&self) -> (Vec<(&str, TopicHash)>, Vec<String>) {
        account(self.topics.iter())
    }
}
