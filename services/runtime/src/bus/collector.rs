//! The end of a topic that the recorder reads: every message, in order, also after a death.

use std::rc::Rc;

use bytemuck::{bytes_of, pod_read_unaligned};
use shared_types::Message;

use crate::bus::gather::{Gathering, Port};
use crate::bus::inlet::{Admission, Incoming, Inlet};
use crate::bus::topic::Subscribing;
use crate::context::Context;
use crate::wait::Interrupted;

/// Reads everything of a topic, in order; never waits.
pub struct Collector<M: Message>(Gathering<Inlet<M>>);

impl<M: Message> Port for Inlet<M> {
    type Message = M;
    type Incoming = Incoming<M>;
    type Past = Box<M>;

    fn context(&self) -> &Context {
        &self.shared
    }
    fn topic(&self) -> &'static str {
        M::TOPIC
    }
    fn size(&self) -> usize {
        size_of::<M>()
    }
    fn receive(&self) -> Result<Option<Incoming<M>>, Interrupted> {
        let sample = self.subscriber.receive().map_err(|error| self.shared.port_failed(M::TOPIC, error))?;
        Ok(sample.map(Incoming))
    }
    fn admits(&mut self, message: &M) -> bool {
        Inlet::admits(self, message)
    }
    fn past(bytes: Vec<u8>) -> Box<M> {
        Box::new(pod_read_unaligned(&bytes))
    }
    fn bytes(message: &M) -> &[u8] {
        bytes_of(message)
    }
    fn tick(message: &M) -> u64 {
        message.header().tick
    }
}

impl<M: Message> Collector<M> {
    pub(crate) fn new(shared: Rc<Context>, subscriber: Rc<Subscribing<M>>) -> Self {
        Self(Gathering::new(Inlet::new(shared, subscriber, Admission::InOrder)))
    }

    /// Hands over all messages that are there, oldest first.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn collect(&mut self, mut take: impl FnMut(&M)) -> Result<(), Interrupted> {
        self.0.collect(&mut take)
    }

    /// Goes on where an earlier reader of the topic had come to.
    pub fn resume(&mut self, last: Option<u64>, lost: u64) {
        self.0.resume(last, lost);
    }

    /// Counts a message that an earlier reader has left in its files.
    pub fn recount(&mut self, message: &M) {
        self.0.count(message.header().tick);
    }

    /// Goes on behind the last message that an earlier reader has left in its files: what was on its way to it comes first.
    ///
    /// # Errors
    /// When the launcher does not answer, or the file of the topic cannot be mapped.
    pub fn recall(&mut self, last: Option<&M>) -> Result<(), Interrupted> {
        self.0.recall(last.map(bytes_of))
    }

    /// The last tick taken in.
    #[must_use]
    pub fn last(&self) -> Option<u64> {
        self.0.last()
    }

    /// Ticks that never came: gaps between the ticks that did, from tick 0.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.0.lost()
    }
}
