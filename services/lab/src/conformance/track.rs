//! The recorded messages of one topic, tick by tick, and how computed ones compare with them.

use std::collections::BTreeMap;

use recorder::RecordError;
use serde::Serialize;
use shared_types::Header;
use shared_types::fault::MOST_DELAY_TICKS;
use shared_types::topics::{Build, ByTopic, Family, Topic};

use super::compared::{Kept, Place};
use super::difference::{Differences, FieldDifference, first_difference};

/// A track for each topic.
pub(super) struct Tracks;

impl Family for Tracks {
    type Of<M: Topic> = Track<M>;
}

/// Messages in the order of their ticks, each tick once: faults make them late, old, or two.
pub(super) struct Track<M> {
    left: Option<Box<dyn Iterator<Item = M>>>,
    ahead: BTreeMap<u64, M>,
    /// The first tick that has not been handed out.
    next: u64,
    messages: u64,
    first: Option<Place>,
    differences: Differences<M>,
}

/// The replayed process's messages of one topic, beside those of the run.
#[derive(Serialize)]
pub struct Compared {
    /// Name of the topic.
    pub topic: &'static str,
    /// Messages compared.
    pub messages: u64,
    /// Largest difference per field.
    pub fields: Vec<FieldDifference>,
}

/// Opens the tracks of some topics of a run; those of others are empty.
pub(super) fn open(record: &Kept, topics: &[&str]) -> Result<ByTopic<Tracks>, RecordError> {
    struct Open<'a>(&'a Kept, &'a [&'a str]);
    impl Build<Tracks> for Open<'_> {
        type Error = RecordError;
        fn build<M: Topic>(&mut self) -> Result<Track<M>, RecordError> {
            let wanted = self.1.contains(&M::TOPIC).then(|| self.0.read());
            Ok(Track {
                left: wanted
                    .transpose()?
                    .map(|record| Box::new(record.messages()) as _),
                ahead: BTreeMap::new(),
                next: 0,
                messages: 0,
                first: None,
                differences: Differences::default(),
            })
        }
    }
    ByTopic::try_build(&mut Open(record, topics))
}

impl<M: Topic> Track<M> {
    /// More than a fault can hold a message back; messages.
    const AHEAD: usize = 2 * MOST_DELAY_TICKS as usize + 4;

    /// The next message.
    pub(super) fn peek(&mut self) -> Option<&M> {
        while self.ahead.len() < Self::AHEAD
            && let Some(message) = self.left.as_mut().and_then(Iterator::next)
        {
            let tick = message.header().tick;
            if tick >= self.next {
                self.ahead.entry(tick).or_insert(message);
            }
        }
        self.ahead.values().next()
    }

    pub(super) fn header(&mut self) -> Option<Header> {
        self.peek().map(|message| *message.header())
    }

    /// The message of a tick; those of earlier ones are passed over.
    pub(super) fn at(&mut self, tick: u64) -> Option<M> {
        while let Some(header) = self.header().filter(|header| header.tick <= tick) {
            self.next = header.tick.saturating_add(1);
            let message = self.ahead.remove(&header.tick);
            if header.tick == tick {
                return message;
            }
        }
        None
    }

    /// Compares the recorded message of a tick, if there is one, with the computed one.
    pub(super) fn compare(&mut self, mut computed: M, tick: u64) {
        if let Some(recorded) = self.at(tick) {
            // The runtime sets the incarnation, not the step.
            computed.header_mut().incarnation = recorded.header().incarnation;
            self.messages += 1;
            if self.first.is_none() {
                let found = first_difference(&recorded, &computed);
                self.first = found.map(|difference| Place::new(tick, M::TOPIC, difference));
            }
            self.differences.add(&recorded, &computed);
        }
    }

    /// The first difference, and all.
    pub(super) fn compared(&mut self) -> (Option<Place>, Compared) {
        let fields = std::mem::take(&mut self.differences).fields();
        let compared = Compared {
            topic: M::TOPIC,
            messages: self.messages,
            fields,
        };
        (self.first.take(), compared)
    }
}
