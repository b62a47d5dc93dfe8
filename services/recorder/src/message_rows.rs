//! The messages of a run, tick by tick, as the recorder kept them.

use std::path::Path;

use message_log::{LogError, LogReader, TopicHash};
use shared_types::graph::Graph;
use shared_types::summary::Summary;
use shared_types::topics::{self, Build, ByTopic, Each, Family, Topic};

use crate::assemble::{Assembler, Row, Set};
use crate::{HORIZON, PATIENCE};

/// Ticks that are taken from the messages at a time.
const STRIDE: u64 = 64;

/// The messages of all topics, in the order of their ticks.
struct StoredMessages;

impl Family for StoredMessages {
    type Of<M: Topic> = Option<Messages<M>>;
}

struct Messages<M: Topic> {
    /// `None`: no message has reached a file.
    reader: Option<LogReader<M>>,
    /// Read, and of a later tick than was asked for.
    next: Option<M>,
    hash: TopicHash,
    /// Tick of the last message read.
    last: Option<u64>,
    gaps: Vec<Gap>,
}

/// The messages that a damaged place of a log has cost: those behind one tick and before another; without end where none follows.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Gap {
    after: Option<u64>,
    before: Option<u64>,
}

impl<M: Topic> Messages<M> {
    /// The next message; a damaged place is noted and passed over. A block that was being written when its writer died ends the log.
    fn read(&mut self) -> Option<M> {
        loop {
            let reader = self.reader.as_mut()?;
            match reader.next_message() {
                Ok(message) => {
                    let tick = message.map(|message| message.header().tick);
                    self.gaps.last_mut().filter(|gap| gap.before.is_none()).into_iter().for_each(|gap| gap.before = tick);
                    self.last = tick.or(self.last);
                    return message;
                }
                Err(_) => {
                    if self.gaps.last().is_none_or(|gap| gap.before.is_some()) {
                        self.gaps.push(Gap { after: self.last, before: None });
                    }
                    if !reader.skip().unwrap_or(false) {
                        self.reader = None;
                    }
                }
            }
        }
    }

    /// The damage in words, where there is any; `end` is the first tick of which no topic has a message.
    fn damage(&self, end: u64) -> Option<String> {
        let ticks = |gap: &Gap| (gap.after.map_or(0, |after| after + 1), gap.before.unwrap_or(end));
        let first = self.gaps.first().map(ticks)?;
        let lost: u64 = self.gaps.iter().map(ticks).map(|(from, until)| until.saturating_sub(from)).sum();
        let places = if self.gaps.len() > 1 { format!("in {} places, first at", self.gaps.len()) } else { "at".to_owned() };
        Some(format!("{}.log is damaged {places} tick {}: its messages of {lost} ticks are lost", M::TOPIC, first.0))
    }
}

/// The rows of a run's message logs: whatever there is of each tick, in order.
pub struct MessageRows {
    messages: ByTopic<StoredMessages>,
    assembler: Assembler,
    until: u64,
    has_more: bool,
}

impl MessageRows {
    /// The messages in a folder, of the topics that the graph's processes write.
    ///
    /// # Errors
    /// [`LogError`] where a topic's messages are not there or not this program's.
    pub fn open(folder: &Path, graph: &Graph) -> Result<Self, LogError> {
        Self::open_with(folder, graph, |_| false)
    }

    /// The same of a run whose launcher was killed: a topic may have no log yet, or a damaged one.
    ///
    /// # Errors
    /// [`LogError`] where a topic's messages cannot be read or are not this program's.
    pub fn open_left(folder: &Path, graph: &Graph) -> Result<Self, LogError> {
        Self::open_with(folder, graph, |error| error.is_before_the_first_message() || error.is_damage())
    }

    fn open_with(folder: &Path, graph: &Graph, is_excused: fn(&LogError) -> bool) -> Result<Self, LogError> {
        struct Open<'a>(&'a Path, &'a Graph, fn(&LogError) -> bool);
        impl Build<StoredMessages> for Open<'_> {
            type Error = LogError;
            fn build<M: Topic>(&mut self) -> Result<Option<Messages<M>>, LogError> {
                if self.1.writer(M::TOPIC).is_none() {
                    return Ok(None);
                }
                let mut messages = Messages { reader: None, next: None, hash: TopicHash::default(), last: None, gaps: Vec::new() };
                match LogReader::open(self.0) {
                    Err(error) if (self.2)(&error) => messages.gaps.extend(error.is_damage().then_some(Gap { after: None, before: None })),
                    opened => messages.reader = Some(opened?),
                }
                Ok(Some(messages))
            }
        }
        let messages = ByTopic::try_build(&mut Open(folder, graph, is_excused))?;
        let assembler = Assembler::new(Set::of(|topic| graph.writer(topic).is_some()), PATIENCE, HORIZON);
        Ok(Self { messages, assembler, until: 0, has_more: true })
    }

    /// The next row; `None` at the end.
    pub fn next_row(&mut self) -> Option<&Row> {
        /// Puts the messages of the ticks before `until` into their rows; whether there are more.
        struct Put<'a>(&'a mut ByTopic<StoredMessages>, &'a mut Assembler, u64);
        impl Each for Put<'_> {
            type Output = bool;
            fn each<M: Topic>(&mut self) -> bool {
                let Some(messages) = M::of_mut(self.0) else { return false };
                while let Some(message) = messages.next.take().or_else(|| messages.read()) {
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
        while self.has_more && !self.assembler.is_ready(self.until) {
            self.until += STRIDE;
            self.has_more = topics::each(&mut Put(&mut self.messages, &mut self.assembler, self.until)).contains(&true);
        }
        self.assembler.pop(self.until, !self.has_more)
    }

    /// The topics whose log, read to its end, is damaged or does not hold what a run's summary counts: a clause for each. A topic that the summary does not
    /// name is left out.
    #[must_use]
    pub fn damage(mut self, summary: &Summary) -> Vec<String> {
        while self.next_row().is_some() {}
        let gaps = self.gaps();
        let differs = |(topic, found): (&'static str, TopicHash)| {
            let expected = summary.topics.get(topic).filter(|expected| **expected != found.summary())?;
            Some(match expected.count == found.count() {
                true => format!("{topic}.log holds other numbers than the run has sent"),
                false => format!("{topic}.log holds {} of {} messages", found.count(), expected.count),
            })
        };
        let of = |account: (&'static str, TopicHash)| {
            gaps.iter().find(|(topic, _)| *topic == account.0).map(|(_, gap)| gap.clone()).or_else(|| differs(account))
        };
        self.account().into_iter().filter_map(of).collect()
    }

    /// The damage in the logs as far as they have been read: topic and clause.
    pub(crate) fn gaps(&self) -> Vec<(&'static str, String)> {
        struct Last<'a>(&'a ByTopic<StoredMessages>);
        impl Each for Last<'_> {
            type Output = Option<u64>;
            fn each<M: Topic>(&mut self) -> Option<u64> {
                M::of(self.0).as_ref().and_then(|messages| messages.last)
            }
        }
        struct Gaps<'a>(&'a ByTopic<StoredMessages>, u64);
        impl Each for Gaps<'_> {
            type Output = Option<(&'static str, String)>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                M::of(self.0).as_ref()?.damage(self.1).map(|damage| (M::TOPIC, damage))
            }
        }
        let end = topics::each(&mut Last(&self.messages)).into_iter().flatten().max().map_or(0, |last| last + 1);
        topics::each(&mut Gaps(&self.messages, end)).into_iter().flatten().collect()
    }

    /// How many messages of each topic have been read, and their hash.
    pub(crate) fn account(&self) -> Vec<(&'static str, TopicHash)> {
        struct Account<'a>(&'a ByTopic<StoredMessages>);
        impl Each for Account<'_> {
            type Output = Option<(&'static str, TopicHash)>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                M::of(self.0).as_ref().map(|messages| (M::TOPIC, messages.hash))
            }
        }
        topics::each(&mut Account(&self.messages)).into_iter().flatten().collect()
    }
}
