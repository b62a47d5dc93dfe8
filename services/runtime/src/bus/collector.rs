//! The end of a topic that the recorder reads: every message, in order, also after a death.

use std::rc::Rc;

use bytemuck::bytes_of;
use shared_types::Message;

use crate::bus::inlet::{Admission, Incoming, Inlet};
use crate::bus::topic::Subscribing;
use crate::context::Context;
use crate::control_page::Count;
use crate::memory::HandedOver;
use crate::wait::Interrupted;

/// Reads everything of a topic, in order; never waits.
pub struct Collector<M: Message> {
    inlet: Inlet<M>,
    last: Option<u64>,
    lost: u64,
    /// In a replacement, until it is in step: what was on its way to its predecessor.
    recall: Option<Recall<M>>,
}

/// The messages that no living reader has received: delivered to none, or received by a process that has died since.
struct Recall<M: Message> {
    handed_over: HandedOver<M>,
    /// Number of the next one to take from the file.
    next: u64,
    /// Below it all are known to have come by the usual way too.
    known: u64,
    /// One that was taken from the file has come by the usual way too: from then on its writer is connected, and all that follows it comes.
    is_connected: bool,
}

/// How often the keeper's messages are asked for again where they lack one that has come by the usual way.
const ATTEMPTS: u32 = 5;

impl<M: Message> Recall<M> {
    /// Goes on behind the last message that its predecessor has left in its files; from the oldest on, where that one is gone.
    fn after(handed_over: HandedOver<M>, last: Option<&M>) -> Self {
        let (count, oldest) = (handed_over.count(), Self::oldest(&handed_over));
        let is_last = |number: &u64| handed_over.get(*number).is_some_and(|one| last.is_some_and(|last| bytes_of(&one) == bytes_of(last)));
        let next = (oldest..count).rev().find(is_last).map_or(oldest, |number| number + 1);
        Self { handed_over, next, known: next, is_connected: false }
    }

    /// The oldest number that is there for long enough to be read: the very oldest is the next to be overwritten.
    fn oldest(handed_over: &HandedOver<M>) -> u64 {
        handed_over.count().saturating_sub(HandedOver::<M>::LENGTH - 1)
    }

    /// The next one that nobody has taken.
    fn take(&mut self) -> Option<M> {
        loop {
            // Messages overwritten meanwhile are lost, and the gap is counted.
            self.next = self.next.max(Self::oldest(&self.handed_over));
            if self.next >= self.handed_over.count() {
                return None;
            }
            self.next += 1;
            if let Some(message) = self.handed_over.get(self.next - 1) {
                return Some(message);
            }
        }
    }

    fn place_of(&self, message: &M, range: std::ops::Range<u64>) -> Option<u64> {
        range.into_iter().find(|number| self.handed_over.get(*number).is_some_and(|one| bytes_of(&one) == bytes_of(message)))
    }

    /// Whether a message that has come by the usual way has been taken from the file before.
    fn knows(&mut self, message: &M) -> bool {
        let place = self.place_of(message, self.known..self.next);
        self.known = place.map_or(self.known, |number| number + 1);
        self.is_connected |= place.is_some();
        place.is_some()
    }

    /// All that was taken from the file has come by the usual way too: from here on nothing can be missed.
    fn is_in_step(&self) -> bool {
        self.is_connected && self.known == self.next
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

    /// First the keeper's messages, then those received since; returns the number left to recall.
    ///
    /// A writer sends to the keeper first. So a message that has come by the usual way is in the keeper too, with all that lies before it, and a
    /// message that a writer sent without knowing of this reader is in the keeper alone.
    fn catch_up(&mut self, mut recall: Recall<M>, take: &mut impl FnMut(&M)) -> Result<Option<Recall<M>>, Interrupted> {
        let mut hand_over = |this: &mut Self, message: &M| {
            if this.inlet.admits(message) {
                this.count(message.header().tick);
                take(message);
            }
        };
        self.inlet.shared.await_hand_over(M::TOPIC)?;
        while let Some(message) = recall.take() {
            hand_over(self, &message);
        }
        loop {
            let sample = self.inlet.subscriber.receive().map_err(|error| self.inlet.shared.port_failed(M::TOPIC, error))?;
            let Some(message) = sample.map(Incoming) else { break };
            if recall.knows(&message) {
                continue;
            }
            // It came after the file was read: what lies before it comes first, and nothing after it can be missed.
            let mut place = None;
            for _ in 0..ATTEMPTS {
                self.inlet.shared.await_hand_over(M::TOPIC)?;
                place = recall.place_of(&message, recall.next..recall.handed_over.count());
                if place.is_some() {
                    break;
                }
            }
            // Without a place the keeper has lost it again, by its depth: then what lay before it is lost too, and the gap is counted.
            while place.is_some_and(|place| recall.next < place)
                && let Some(before) = recall.take()
            {
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
    /// When the launcher does not answer, or the file of the topic cannot be mapped.
    pub fn recall(&mut self, last: Option<&M>) -> Result<(), Interrupted> {
        // The predecessor's files are complete before they are read.
        self.inlet.shared.await_hand_over(M::TOPIC)?;
        let handed_over = HandedOver::open(&self.inlet.shared.run);
        let handed_over = handed_over.map_err(|error| self.inlet.shared.port_failed(M::TOPIC, error))?;
        self.recall = Some(Recall::after(handed_over, last));
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
