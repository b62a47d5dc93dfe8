//! The ticks of a run, made of its messages: those of a record, or those that come while it runs. Everything that is made of a run is made of these.

use std::collections::VecDeque;
use std::ops::RangeInclusive;
use std::path::Path;

use bytemuck::try_pod_read_unaligned;
use shared_types::event::Event;
use shared_types::job::Job;
use shared_types::summary::Summary;
use shared_types::topics::{ByTopic, COUNT, OfTopic, Received, Topic};

use crate::MESSAGES;
use crate::contents::{Contents, tick_of};
use crate::error::RecordError;
use crate::hash::TopicHash;
use crate::reader::{Item, RecordReader};

/// Ticks behind one that lacks messages, before it is given out without them: more than a round of the recorder takes in, so that a topic that is read
/// first is not taken for one ahead of the others.
const DEPTH: usize = 4096;

/// Ticks that may be missing on end; a minute at 1 kHz.
const HORIZON: u64 = 60_000;

/// The messages of one tick.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// The tick.
    pub tick: u64,
    messages: ByTopic<Received>,
    /// Topics of which a message has come, one bit each.
    come: u32,
}

const _: () = assert!(COUNT <= 32);

impl Row {
    fn empty(tick: u64) -> Self {
        Self {
            tick,
            ..Self::default()
        }
    }

    /// The messages that have come.
    pub fn messages(&self) -> &ByTopic<Received> {
        &self.messages
    }
}

/// A topic's place in a row.
#[derive(Clone, Copy, Debug)]
struct Column {
    /// Of [`Row::come`].
    bit: u32,
    /// Puts a message into a row, from its bytes.
    put: fn(&mut Row, &[u8]),
}

impl OfTopic for Column {
    fn of_topic<M: Topic>() -> Self {
        Self {
            bit: 1 << M::INDEX,
            put: |row, bytes| {
                if let Ok(message) = try_pod_read_unaligned::<M>(bytes) {
                    *M::of_mut(&mut row.messages) = Some(message);
                    row.come |= 1 << M::INDEX;
                }
            },
        }
    }
}

/// The messages of a topic so far.
#[derive(Clone, Debug)]
pub struct Account {
    /// The topic.
    pub topic: String,
    /// Number and hash of its messages.
    pub hash: TopicHash,
    /// The tick behind the last message's.
    next_tick: u64,
    /// Its place in a row; none of a topic that only the graph knows.
    column: Option<Column>,
    /// Whether the recorder takes it in.
    pub(crate) is_read: bool,
}

/// Makes ticks of messages: whole ones are given out at once, others when [`DEPTH`] ticks have begun behind them. Ticks of which nothing has come are given
/// out empty; where there are more than [`HORIZON`] of them on end they are not, because the tick behind them may be a wrong one.
#[derive(Debug)]
pub struct Assembler {
    accounts: Vec<Account>,
    /// By tick. They are large: they stay where they are while their places in the queue change.
    rows: VecDeque<Box<Row>>,
    next: u64,
    /// The topics of a whole tick.
    expected: u32,
}

impl Assembler {
    /// An assembler of the messages of these channels.
    pub fn new(contents: &Contents) -> Self {
        let mut expected = 0;
        let accounts = contents.layouts().iter().map(|layout| {
            let column = Column::named(&layout.topic);
            expected |= column.map_or(0, |column| column.bit);
            Account {
                topic: layout.topic.clone(),
                hash: TopicHash::default(),
                next_tick: 0,
                column,
                is_read: true,
            }
        });
        Self {
            accounts: accounts.collect(),
            rows: VecDeque::new(),
            next: 0,
            expected,
        }
    }

    /// Waits for no message of a channel that is not read.
    pub(crate) fn leave_out(&mut self, channel: usize) {
        let account = &mut self.accounts[channel];
        account.is_read = false;
        self.expected &= !account.column.map_or(0, |column| column.bit);
    }

    /// Takes in the next message of a channel.
    pub fn take(&mut self, channel: usize, message: &[u8]) {
        let account = &mut self.accounts[channel];
        account.hash.add(message);
        let tick = tick_of(message);
        account.next_tick = tick.saturating_add(1);
        if let Some(column) = account.column
            && let Some(row) = self.row(tick)
        {
            (column.put)(row, message);
        }
    }

    /// The row of a tick; `None` when it has been given out already.
    fn row(&mut self, tick: u64) -> Option<&mut Row> {
        if tick < self.next {
            return None;
        }
        // Rows are of ticks on end, but for gaps.
        let front = self.rows.front().map_or(tick, |row| row.tick);
        let place = usize::try_from(tick.saturating_sub(front)).unwrap_or(usize::MAX);
        let place = match self.rows.get(place) {
            Some(row) if row.tick == tick => place,
            _ => self.rows.partition_point(|row| row.tick < tick),
        };
        if self.rows.get(place).is_none_or(|row| row.tick != tick) {
            self.rows.insert(place, Box::new(Row::empty(tick)));
        }
        self.rows.get_mut(place).map(Box::as_mut)
    }

    /// The next tick, if it is whole or not waited for any longer.
    pub fn next_row(&mut self) -> Option<Box<Row>> {
        let front = self.rows.front()?;
        let is_whole = front.tick == self.next && front.come & self.expected == self.expected;
        (is_whole || self.rows.len() > DEPTH).then(|| self.rest())?
    }

    /// The next tick of those that are left, when no message comes any more.
    pub fn rest(&mut self) -> Option<Box<Row>> {
        let gap = self.rows.front()?.tick - self.next;
        let row = if gap == 0 || gap > HORIZON {
            self.rows.pop_front()?
        } else {
            Box::new(Row::empty(self.next))
        };
        self.next = row.tick.saturating_add(1);
        Some(row)
    }

    /// Number and hash of the messages of each topic.
    pub fn accounts(&self) -> &[Account] {
        &self.accounts
    }

    /// The topics that are in no row.
    pub fn foreign(&self) -> Vec<String> {
        let foreign = self.accounts.iter().filter(|one| one.column.is_none());
        foreign.map(|one| one.topic.clone()).collect()
    }
}

/// The ticks of a record, in order: whatever there is of each.
pub struct Ticks {
    /// `None`: there is none that can be read.
    record: Option<RecordReader>,
    assembler: Assembler,
    events: Vec<Event>,
    /// Why there is none.
    refused: Option<String>,
}

impl Ticks {
    /// The ticks of a job's run from its record. Where there is none, none yet, or one that is damaged or of another run, there is no tick.
    ///
    /// # Errors
    /// [`RecordError`] if the file cannot be read or its messages are not this program's.
    pub fn open(path: &Path, job: &Job) -> Result<Self, RecordError> {
        let contents = Contents::of(job);
        let opened = RecordReader::open(path, &contents);
        let (record, refused) = match opened {
            Ok(record) => (Some(record), None),
            Err(error) => (None, Some(refusal(error)?)),
        };
        Ok(Self {
            record,
            assembler: Assembler::new(&contents),
            events: Vec::new(),
            refused,
        })
    }

    /// The events that have been read since the last call; each has its tick.
    pub fn events(&mut self) -> impl Iterator<Item = Event> {
        self.events.drain(..)
    }

    /// The ways in which the record, read to its end, is not as it was written or does not hold what a run's summary counts, where there is one: a clause
    /// for each. A topic that the summary does not name is left out of the comparison.
    pub fn damage(mut self, summary: Option<&Summary>) -> Vec<String> {
        self.by_ref().for_each(drop);
        // A run that ended before its first message lacks none.
        if summary.is_some_and(|summary| summary.recorder.messages == 0) {
            self.refused = None;
        }
        let clauses = self.damage_so_far();
        let accounts = self.assembler.accounts().iter();
        let expected = summary.map(|summary| &summary.topics);
        let other = accounts.filter(|one| {
            let expected = expected.and_then(|topics| topics.get(&one.topic));
            expected.is_some_and(|expected| *expected != one.hash.summary())
        });
        let Some(one) = other
            .min_by_key(|one| one.next_tick)
            .filter(|_| clauses.is_empty())
        else {
            return clauses;
        };
        let (topic, tick, count) = (&one.topic, one.next_tick, one.hash.count());
        let is_ended = self.record.is_some_and(|record| record.is_ended);
        vec![match is_ended {
            true => format!(
                "{MESSAGES} holds other messages than the run has sent: of `{topic}` {count} to tick {tick}"
            ),
            false => format!("{MESSAGES} is cut off: messages from tick {tick} on are missing"),
        }]
    }

    /// The damage as far as the record has been read, in words.
    pub fn damage_so_far(&self) -> Vec<String> {
        let read = self.record.as_ref().map_or(&[][..], RecordReader::damage);
        let refused = self.refused.as_ref();
        let refused = refused.map(|words| format!("{MESSAGES} {words}"));
        places(read).into_iter().chain(refused).collect()
    }
}

/// The ticks of which a record may lack messages, in words.
pub(crate) fn places(damage: &[RangeInclusive<u64>]) -> Option<String> {
    let (from, to) = (damage.first()?.start(), damage.last()?.end());
    let places = match damage.len() {
        1 => String::new(),
        count => format!(" in {count} places"),
    };
    Some(format!(
        "{MESSAGES} is damaged{places}: messages of ticks {from} to {to} may be missing"
    ))
}

/// Why there is no record that can be read, in words, where its file can be.
pub(crate) fn refusal(error: RecordError) -> Result<String, RecordError> {
    match error {
        RecordError::Unbegun { .. } => Ok("has no message".to_owned()),
        error if error.is_absent() => Ok("is missing".to_owned()),
        RecordError::OtherRun { .. } => Ok("is the record of another run".to_owned()),
        RecordError::Damaged { reason, .. } => Ok(format!("is no record of a run: {reason}")),
        error => Err(error),
    }
}

impl Iterator for Ticks {
    type Item = Box<Row>;

    fn next(&mut self) -> Option<Box<Row>> {
        loop {
            if let Some(row) = self.assembler.next_row() {
                return Some(row);
            }
            match self.record.as_mut().and_then(RecordReader::next_item) {
                Some(Item::Message { channel, message }) => self.assembler.take(channel, message),
                Some(Item::Event(event)) => self.events.push(event),
                Some(Item::Cut(_)) => {}
                None => return self.assembler.rest(),
            }
        }
    }
}
