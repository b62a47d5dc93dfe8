//! Gathers every message of a topic, in order, also after a death: the same for messages whose type is known and for those of other programs.

use std::ops::Deref;

use crate::bus::recall::Recall;
use crate::context::Context;
use crate::control_page::Count;
use crate::memory::HandedOver;
use crate::wait::Interrupted;

/// The end of a topic from which messages are gathered.
pub(crate) trait Port {
    /// A message, borrowed.
    type Message: ?Sized;
    /// A message that has come, in shared memory still.
    type Incoming: Deref<Target = Self::Message>;
    /// A message from the files of the run.
    type Past: Deref<Target = Self::Message>;

    fn context(&self) -> &Context;
    fn topic(&self) -> &'static str;
    /// Bytes of a message.
    fn size(&self) -> usize;
    /// The next message, whether it counts or not.
    fn receive(&self) -> Result<Option<Self::Incoming>, Interrupted>;
    /// Whether a message counts; one that does not is counted as what it is.
    fn admits(&mut self, message: &Self::Message) -> bool;
    fn past(bytes: Vec<u8>) -> Self::Past;
    fn bytes(message: &Self::Message) -> &[u8];
    fn tick(message: &Self::Message) -> u64;
}

/// How often the keeper's messages are asked for again where they lack one that has come by the usual way.
const ATTEMPTS: u32 = 5;

/// Gathers everything of a topic; never waits.
pub(crate) struct Gathering<P> {
    port: P,
    last: Option<u64>,
    lost: u64,
    /// In a replacement, until it is in step: the messages that were on their way to its predecessor.
    recall: Option<Recall>,
}

impl<P: Port> Gathering<P> {
    pub(crate) fn new(port: P) -> Self {
        Self { port, last: None, lost: 0, recall: None }
    }

    /// Hands over all messages that are there, oldest first.
    pub(crate) fn collect(&mut self, take: &mut impl FnMut(&P::Message)) -> Result<(), Interrupted> {
        if let Some(recall) = self.recall.take() {
            self.recall = self.catch_up(recall, take)?;
        }
        while self.recall.is_none()
            && let Some(message) = self.port.receive()?
        {
            self.hand_over(&message, take);
        }
        Ok(())
    }

    fn hand_over(&mut self, message: &P::Message, take: &mut impl FnMut(&P::Message)) {
        if self.port.admits(message) {
            self.count(P::tick(message));
            take(message);
        }
    }

    /// First the keeper's messages, then those received since; returns the number left to recall.
    ///
    /// A writer sends to the keeper first. So a message that has come by the usual way is in the keeper too, with all that lies before it, and a
    /// message that a writer sent without knowing of this reader is in the keeper alone.
    fn catch_up(&mut self, mut recall: Recall, take: &mut impl FnMut(&P::Message)) -> Result<Option<Recall>, Interrupted> {
        self.port.context().await_hand_over(self.port.topic())?;
        while let Some(message) = recall.take() {
            self.hand_over(&P::past(message), take);
        }
        loop {
            let Some(message) = self.port.receive()? else { break };
            if recall.knows(P::bytes(&message)) {
                continue;
            }
            // It came after the file was read: what lies before it comes first, and nothing after it can be missed.
            let mut place = None;
            for _ in 0..ATTEMPTS {
                self.port.context().await_hand_over(self.port.topic())?;
                place = recall.place_ahead(P::bytes(&message));
                if place.is_some() {
                    break;
                }
            }
            // Without a place the keeper has lost it again, by its depth: then what lay before it is lost too, and the gap is counted.
            while let Some(before) = place.and_then(|place| recall.take_before(place)) {
                self.hand_over(&P::past(before), take);
            }
            self.hand_over(&message, take);
            return Ok(None);
        }
        Ok((!recall.is_in_step()).then_some(recall))
    }

    /// Counts a message of a tick.
    pub(crate) fn count(&mut self, tick: u64) {
        let expected = self.last.map_or(0, |last| last + 1);
        if tick > expected {
            self.lost += tick - expected;
            self.port.context().entry().add(Count::Lost, tick - expected);
        } else if tick < expected {
            self.port.context().entry().add(Count::Repeated, 1);
        }
        self.last = Some(tick.max(expected));
    }

    pub(crate) fn resume(&mut self, last: Option<u64>, lost: u64) {
        (self.last, self.lost) = (last, lost);
    }

    /// Goes on behind the last message that an earlier reader has left in its files.
    pub(crate) fn recall(&mut self, last: Option<&[u8]>) -> Result<(), Interrupted> {
        let (context, topic) = (self.port.context(), self.port.topic());
        // The predecessor's files are complete before they are read.
        context.await_hand_over(topic)?;
        let handed_over = HandedOver::open(&context.run, topic, self.port.size());
        let handed_over = handed_over.map_err(|error| context.port_failed(topic, error))?;
        self.recall = Some(Recall::after(handed_over, last));
        Ok(())
    }

    pub(crate) fn last(&self) -> Option<u64> {
        self.last
    }

    pub(crate) fn lost(&self) -> u64 {
        self.lost
    }
}
