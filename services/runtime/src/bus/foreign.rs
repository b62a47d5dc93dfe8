//! Topics of which only other programs know the type: bytes with a header, under the name and size that the graph gives them.
//!
//! The launcher makes such a topic and keeps its last messages, and the recorder reads it, as every other one. The program that knows the type
//! opens it with that type: iceoryx2 compares type name, size and alignment, and the layout's hash is an attribute of the topic.

use std::ops::Deref;
use std::rc::Rc;

use bytemuck::pod_read_unaligned;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::marker::CustomPayloadMarker;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use shared_types::wire::Header;

use crate::bus::depth::{RECORDER_DEPTH, depth};
use crate::bus::gather::{Gathering, Port};
use crate::bus::topic::{Bus, Keep, MORE_READERS, TopicError, create_attributes, settings};
use crate::context::{Connect, Context};
use crate::control_page::Count;
use crate::manifest::ForeignMessage;
use crate::memory::HandedOver;
use crate::run_dir::RunDir;
use crate::validation::Fence;
use crate::wait::Interrupted;

type Bytes = [CustomPayloadMarker];
type Subscribing = Subscriber<ipc::Service, Bytes, ()>;

/// The name of a topic for as long as the process lives; a run has few of them.
fn for_ever(topic: &str) -> &'static str {
    Box::leak(topic.to_owned().into_boxed_str())
}

fn failed(action: &'static str, topic: &str, reason: impl std::fmt::Display) -> TopicError {
    TopicError::Service { action, topic: for_ever(topic), reason: reason.to_string() }
}

fn builder(node: &Bus, message: &ForeignMessage) -> Result<Builder<Bytes, (), ipc::Service>, TopicError> {
    let name = ServiceName::new(&message.topic).map_err(|e| failed("name", &message.topic, format!("{e:?}")))?;
    let details = TypeDetail::__internal_new_from_parts(TypeVariant::FixedSize, &message.type_name, message.bytes, align_of::<u64>());
    let details = details.map_err(|e| failed("name", &message.topic, format!("{e:?}")))?;
    // SAFETY: a message is `message.bytes` plain bytes, of any value. iceoryx2's own bindings for other languages describe types like this.
    let builder = unsafe { node.service_builder(&name).publish_subscribe::<Bytes>().__internal_set_payload_type_details(&details) };
    Ok(settings(builder, message.bytes))
}

/// Makes the topic, and its keeper.
pub(crate) fn create(node: &Bus, run: &RunDir, readers: usize, message: &ForeignMessage) -> Result<Box<dyn Keep>, TopicError> {
    let topic = message.topic.as_str();
    let attributes = create_attributes(for_ever(topic), message.hash)?;
    let service = builder(node, message)?
        .max_subscribers(readers + MORE_READERS)
        .create_with_attributes(&attributes)
        .map_err(|e| failed("create", topic, e))?;
    // The first of all subscribers: a message is in the keeper's buffer before any other reader has it.
    let subscriber = service.subscriber_builder().buffer_size(depth(message.bytes)).create().map_err(|e| failed("keep", topic, e))?;
    let handed_over = HandedOver::open(run, topic, message.bytes)
        .map_err(|error| TopicError::Memory { topic: for_ever(topic), reason: error.to_string() })?;
    Ok(Box::new(ForeignKeeper { topic: for_ever(topic), subscriber, handed_over, _service: service }))
}

struct ForeignKeeper {
    topic: &'static str,
    subscriber: Subscribing,
    handed_over: HandedOver,
    _service: PortFactory<ipc::Service, Bytes, ()>,
}

impl Keep for ForeignKeeper {
    fn connect(&self) -> Result<(), TopicError> {
        self.subscriber.update_connections().map_err(|e| failed("keep", self.topic, e))
    }

    fn hand_over(&self) -> Result<(), TopicError> {
        while let Some(sample) = self.subscriber.receive().map_err(|e| failed("keep", self.topic, e))? {
            self.handed_over.push(&Incoming(sample));
        }
        Ok(())
    }
}

/// A received message, in shared memory still.
pub(crate) struct Incoming(Sample<ipc::Service, Bytes, ()>);

impl Deref for Incoming {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        let payload = self.0.payload();
        // SAFETY: a marker is a byte, and any byte of the payload may be read.
        unsafe { std::slice::from_raw_parts(payload.as_ptr().cast(), payload.len()) }
    }
}

/// The header of a message; that of a message too short for one is empty.
pub(crate) fn header(message: &[u8]) -> Header {
    message.get(..size_of::<Header>()).map(pod_read_unaligned).unwrap_or_default()
}

/// Reads everything of such a topic, in order; never waits.
pub struct ForeignCollector(Gathering<Inlet>);

struct Inlet {
    shared: Rc<Context>,
    subscriber: Rc<Ending>,
    fence: Fence,
    size: usize,
}

/// The end of the topic, and its name.
pub(crate) struct Ending {
    topic: &'static str,
    subscriber: Subscribing,
}

impl Connect for Ending {
    fn connect(&self, shared: &Context) -> Result<(), Interrupted> {
        self.subscriber.update_connections().map_err(|error| shared.port_failed(self.topic, error))
    }
}

impl Port for Inlet {
    type Message = [u8];
    type Incoming = Incoming;
    type Past = Vec<u8>;

    fn context(&self) -> &Context {
        &self.shared
    }
    fn topic(&self) -> &'static str {
        self.subscriber.topic
    }
    fn size(&self) -> usize {
        self.size
    }
    fn receive(&self) -> Result<Option<Incoming>, Interrupted> {
        let sample = self.subscriber.subscriber.receive().map_err(|error| self.shared.port_failed(self.subscriber.topic, error))?;
        Ok(sample.map(Incoming))
    }
    fn admits(&mut self, message: &[u8]) -> bool {
        let refused = if message.len() != self.size {
            Count::Refused
        } else if !self.fence.admits(&header(message), None) {
            Count::Fenced
        } else {
            return true;
        };
        self.shared.entry().add(refused, 1);
        self.shared.message_fault_detected();
        false
    }
    fn past(bytes: Vec<u8>) -> Vec<u8> {
        bytes
    }
    fn bytes(message: &[u8]) -> &[u8] {
        message
    }
    fn tick(message: &[u8]) -> u64 {
        header(message).tick
    }
}

/// Opens the end of the topic that the recorder reads.
pub(crate) fn subscriber(node: &Bus, message: &ForeignMessage) -> Result<Rc<Ending>, TopicError> {
    let topic = message.topic.as_str();
    let service = builder(node, message)?.open().map_err(|e| failed("open", topic, e))?;
    let subscriber = service.subscriber_builder().buffer_size(RECORDER_DEPTH.min(depth(message.bytes))).create();
    Ok(Rc::new(Ending { topic: for_ever(topic), subscriber: subscriber.map_err(|e| failed("read", topic, e))? }))
}

impl ForeignCollector {
    pub(crate) fn new(shared: Rc<Context>, subscriber: Rc<Ending>, size: usize) -> Self {
        Self(Gathering::new(Inlet { shared, subscriber, fence: Fence::default(), size }))
    }

    /// Hands over all messages that are there, oldest first, as their bytes.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn collect(&mut self, mut take: impl FnMut(&[u8])) -> Result<(), Interrupted> {
        self.0.collect(&mut take)
    }

    /// Goes on where an earlier reader of the topic had come to.
    pub fn resume(&mut self, last: Option<u64>, lost: u64) {
        self.0.resume(last, lost);
    }

    /// Counts a message that an earlier reader has left in its files.
    pub fn recount(&mut self, message: &[u8]) {
        self.0.count(header(message).tick);
    }

    /// Goes on behind the last message that an earlier reader has left in its files: what was on its way to it comes first.
    ///
    /// # Errors
    /// When the launcher does not answer, or the file of the topic cannot be mapped.
    pub fn recall(&mut self, last: Option<&[u8]>) -> Result<(), Interrupted> {
        self.0.recall(last)
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
