//! The end of a topic that the recorder reads: every message, in order, also after a death.

use std::rc::Rc;

use bytemuck::bytes_of;
use shared_types::Message;

use crate::bus::inlet::{Admission, Incoming, Inlet};
use crate::bus::topic::{Subscribing, TopicError};
use crate::context::Context;
use crate::control_page::Count;
use crate::memory::{Memory, RING};
use crate::wait::Interrupted;

/// Reads everything of a topic, in order; never waits.
pub struct Collector<M: Message> {
    inlet: Inlet<M>,
    last: Option<u64>,
    lost: u64,
    /// In a replacement, until it is in step: what was on its way to its predecessor.
    recall: Option<Recall<M>>,
}

/// The messages that were delivered while nobody received them, and those that were received and died with who had them.
struct Recall<M: Message> {
    memory: Memory<M>,
    /// Number of the next one to take from the ring.
    next: u64,
    /// Below it all are known to have come by the usual way too.
    known: u64,
}

impl<M: Message> Recall<M> {
    /// Goes on behind the last message that its predecessor has left in its files; from the oldest on, where that one is gone.
    fn after(memory: Memory<M>, last: Option<&M>) -> Self {
        let count = memory.delivered_so_far();
        // One less than the ring holds: the oldest is the next to be overwritten.
        let oldest = count.saturating_sub(RING as u64 - 1);
        let is_last = |number: &u64| memory.delivered(*number).is_some_and(|one| last.is_some_and(|last| bytes_of(&one) == bytes_of(last)));
        let next = (oldest..count).rev().find(is_last).map_or(oldest, |number| number + 1);
        Self { memory, next, known: next }
    }

    /// The next one that nobody has taken.
    fn take(&mut self) -> Option<M> {
        loop {
            let count = self.memory.delivered_so_far();
            // What has been overwritten meanwhile is lost, and the gap is counted.
            self.next = self.next.max(count.saturating_sub(RING as u64 - 1));
            if self.next >= count {
                return None;
            }
            self.next += 1;
            if let Some(message) = self.memory.delivered(self.next - 1) {
                return Some(message);
            }
        }
    }

    /// Whether a message that has come by the usual way has been taken from the ring before.
    fn knows(&mut self, message: &M) -> bool {
        let same = |number: &u64| self.memory.delivered(*number).is_some_and(|one| bytes_of(&one) == bytes_of(message));
        let place = (self.known..self.next).find(same);
        self.known = place.map_or(self.known, |number| number + 1);
        place.is_some()
    }

    /// All that was taken from the ring has come by the usual way too: from here on nothing can be missed.
    fn is_in_step(&self) -> bool {
        self.known == self.next
    }
}

impl<M: Message> Collector<M> {
    pub(crate) fn new(shared: Rc<Context>, subscriber: Rc<Subscribing<M>>) -> Self {
        Self { inlet: Inlet::new(shared, subscriber, Admission::InOrder), last: None, lost: 0, recall: None }
    }

    /// Hands over all messages that are there, oldest first.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn collect(&mut self, mut take: impl FnMut(&M)) -> Result<(), Interrupted> {
        if let Some(recall) = self.recall.take() {
            self.recall = self.catch_up(recall, &mut take)?;
        }
        while self.recall.is_none()
            && let Some(message) = self.inlet.receive()?
        {
            self.count(message.header().tick);
            take(&message);
        }
        Ok(())
    }

    /// What the ring has, then what has come since; answers with what is left to be recalled.
    fn catch_up(&mut self, mut recall: Recall<M>, take: &mut impl FnMut(&M)) -> Result<Option<Recall<M>>, Interrupted> {
        let mut hand_over = |this: &mut Self, message: &M| {
            if this.inlet.admits(message) {
                this.count(message.header().tick);
                take(message);
            }
        };
        while let Some(message) = recall.take() {
            hand_over(self, &message);
        }
        loop {
            let sample = self.inlet.subscriber.receive().map_err(|error| self.inlet.shared.port_failed(M::TOPIC, error))?;
            let Some(message) = sample.map(Incoming) else { break };
            if recall.knows(&message) {
                continue;
            }
            // It came after the ring was read, and with it what lies before it there: nothing after it can be missed.
            while let Some(before) = recall.take() {
                if bytes_of(&before) == bytes_of(&*message) {
                    break;
                }
                hand_over(self, &before);
            }
            hand_over(self, &message);
            return Ok(None);
        }
        Ok((!recall.is_in_step()).then_some(recall))
    }

    fn count(&mut self, tick: u64) {
        let expected = self.last.map_or(0, |last| last + 1);
        if tick > expected {
            self.lost += tick - expected;
            self.inlet.shared.entry().add(Count::Lost, tick - expected);
        } else if tick < expected {
            self.inlet.shared.entry().add(Count::Repeated, 1);
        }
        self.last = Some(tick.max(expected));
    }

    /// Goes on where an earlier reader of the topic had come to.
    pub fn resume(&mut self, last: Option<u64>, lost: u64) {
        (self.last, self.lost) = (last, lost);
    }

    /// Counts a message that an earlier reader has left in its files.
    pub fn recount(&mut self, message: &M) {
        self.count(message.header().tick);
    }

    /// Goes on behind the last message that an earlier reader has left in its files: what was on its way to it comes first.
    ///
    /// # Errors
    /// When the topic's memory cannot be mapped.
    pub fn recall(&mut self, last: Option<&M>) -> Result<(), TopicError> {
        let memory = Memory::open(&self.inlet.shared.run);
        let memory = memory.map_err(|error| TopicError::Memory { topic: M::TOPIC, reason: error.to_string() })?;
        self.recall = Some(Recall::after(memory, last));
        Ok(())
    }

    /// The last tick taken in.
    #[must_use]
    pub fn last(&self) -> Option<u64> {
        self.last
    }

    /// Ticks that never came: gaps between the ticks that did, from tick 0.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }
}
