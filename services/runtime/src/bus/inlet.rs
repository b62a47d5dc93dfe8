//! Where messages enter a process: connection, fence and validation, the same for all readers.

use std::rc::Rc;

use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample;
use shared_types::Message;

use crate::bus::topic::{Publishing, Subscribing, Wire};
use crate::context::{Connect, Context};
use crate::control_page::Count;
use crate::validation::Fence;
use crate::wait::Interrupted;

impl<M: Message> Connect for Subscribing<M> {
    fn connect(&self, shared: &Context) -> Result<(), Interrupted> {
        self.update_connections().map_err(|error| shared.port_failed(M::TOPIC, error))
    }
}

impl<M: Message> Connect for Publishing<M> {
    fn connect(&self, shared: &Context) -> Result<(), Interrupted> {
        self.update_connections().map_err(|error| shared.port_failed(M::TOPIC, error))
    }
}

/// The writers whose messages count.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Admission {
    /// In real time those of the living: nobody acts on the word of the dead.
    OfTheLiving,
    /// All, as long as they come in order: what the dead have sent is part of the record.
    InOrder,
}

/// Where messages enter the process.
pub(crate) struct Inlet<M: Message> {
    pub(crate) shared: Rc<Context>,
    pub(crate) subscriber: Rc<Subscribing<M>>,
    writer: Option<usize>,
    fence: Fence,
    admission: Admission,
}

impl<M: Message> Inlet<M> {
    pub(crate) fn new(shared: Rc<Context>, subscriber: Rc<Subscribing<M>>, admission: Admission) -> Self {
        let writer = shared.manifest.writer_of(M::TOPIC);
        Self { shared, subscriber, writer, fence: Fence::default(), admission }
    }

    /// The next message that counts, in shared memory still: of a living incarnation, and all its numbers finite.
    pub(crate) fn receive(&mut self) -> Result<Option<Incoming<M>>, Interrupted> {
        loop {
            let sample = self.subscriber.receive().map_err(|error| self.shared.port_failed(M::TOPIC, error))?;
            let Some(message) = sample.map(Incoming) else { return Ok(None) };
            if self.admits(&message) {
                return Ok(Some(message));
            }
        }
    }

    /// Whether a message counts; one that does not is counted as what it is.
    pub(crate) fn admits(&mut self, message: &M) -> bool {
        let living = match (self.shared.is_lockstep() || self.admission == Admission::InOrder, self.writer) {
            (false, Some(writer)) => Some(self.shared.control_page.process(writer).incarnation()),
            _ => None,
        };
        let refused = if !self.fence.admits(message.header(), living) {
            Count::Fenced
        } else if !message.is_finite() {
            Count::Refused
        } else {
            return true;
        };
        self.shared.entry().add(refused, 1);
        self.shared.message_fault_detected();
        false
    }

    /// In lockstep: whether the writer sends nothing more at a tick.
    pub(crate) fn is_over(&self, tick: u64) -> bool {
        self.shared.learn();
        self.shared.protocol().has_closed(self.writer, tick)
    }

    /// Whether something has come since the last look.
    pub(crate) fn has_more(&self) -> Result<bool, Interrupted> {
        self.subscriber.has_samples().map_err(|error| self.shared.port_failed(M::TOPIC, error))
    }
}

/// A received message, in shared memory still.
pub(crate) struct Incoming<M: Message>(pub(crate) Sample<ipc::Service, Wire<M>, ()>);

impl<M: Message> std::ops::Deref for Incoming<M> {
    type Target = M;
    fn deref(&self) -> &M {
        &self.0.payload().0
    }
}
