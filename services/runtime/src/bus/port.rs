//! The two ends of a topic, as bytes: iceoryx2's part, compiled once for all messages.

use std::ops::Deref;
use std::slice::from_raw_parts;

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::{ConnectionFailure, UpdateConnections};
use iceoryx2::port::{LoanError, ReceiveError, SendError};
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use shared_types::wire::Header;

use crate::bus::format::Format;
use crate::context::{Connect, Context};
use crate::wait::Interrupted;

/// A payload whose size the topic knows.
pub(crate) type Bytes = [CustomPayloadMarker];
/// No header of ours beside iceoryx2's own: a message carries its own.
pub(crate) type NoHeader = CustomHeaderMarker;

/// The end of a topic that writes.
pub(crate) struct Sender {
    format: Format,
    publisher: Publisher<ipc::Service, Bytes, NoHeader>,
}

/// The end of a topic that reads.
pub(crate) struct Receiver {
    format: Format,
    subscriber: Subscriber<ipc::Service, Bytes, NoHeader>,
}

impl Sender {
    pub(crate) fn new(format: Format, publisher: Publisher<ipc::Service, Bytes, NoHeader>) -> Self {
        Self { format, publisher }
    }

    /// Loans memory for one message, as [`Sender::loan`] does, into a place of the caller's; where its bytes begin.
    pub(crate) fn loan_into(&self, place: &mut Option<Outgoing>) -> Result<*mut u8, LoanError> {
        // One message is on loan at a time.
        *place = None;
        Ok(place.insert(self.loan()?).payload)
    }

    /// Loans memory for one message, still filled with an earlier message.
    pub(crate) fn loan(&self) -> Result<Outgoing, LoanError> {
        // SAFETY: one element; the topic's type has a fixed size.
        let mut sample = unsafe { self.publisher.loan_custom_payload(1) }?;
        let payload = sample.payload_mut().as_mut_ptr().cast();
        // SAFETY: the memory is a mapped file, whose bytes are those of an earlier message or zero, and every byte is a payload.
        let sample = unsafe { sample.assume_init() };
        Ok(Outgoing { sample, payload })
    }
}

impl Connect for Sender {
    fn connect(&self, shared: &Context) -> Result<(), Interrupted> {
        self.publisher
            .update_connections()
            .map_err(|error| shared.port_failed(self.format.topic, error))
    }
}

impl Receiver {
    pub(crate) fn new(
        format: Format,
        subscriber: Subscriber<ipc::Service, Bytes, NoHeader>,
    ) -> Self {
        Self { format, subscriber }
    }

    /// The messages of the topic.
    pub(crate) fn format(&self) -> &Format {
        &self.format
    }

    /// The next message that is there.
    #[inline(always)]
    pub(crate) fn receive(&self) -> Result<Option<Incoming>, ReceiveError> {
        let sample = self.subscriber.receive()?;
        Ok(sample.map(|sample| Incoming {
            payload: sample.payload().as_ptr().cast(),
            bytes: self.format.bytes,
            _sample: sample,
        }))
    }

    /// Whether a message is there.
    pub(crate) fn has_samples(&self) -> Result<bool, ConnectionFailure> {
        self.subscriber.has_samples()
    }

    /// Connects to writers that are new.
    pub(crate) fn update_connections(&self) -> Result<(), ConnectionFailure> {
        self.subscriber.update_connections()
    }
}

impl Connect for Receiver {
    fn connect(&self, shared: &Context) -> Result<(), Interrupted> {
        self.update_connections()
            .map_err(|error| shared.port_failed(self.format.topic, error))
    }
}

/// A message on loan: not sent yet, in shared memory.
pub(crate) struct Outgoing {
    sample: SampleMut<ipc::Service, Bytes, NoHeader>,
    payload: *mut u8,
}

impl Outgoing {
    /// Start of its bytes, aligned to 8, as many as the topic's messages have. Valid while it is on
    /// loan.
    #[inline]
    pub(crate) fn payload(&self) -> *mut u8 {
        self.payload
    }

    #[inline]
    pub(crate) fn header(&self) -> &Header {
        // SAFETY: a message is aligned to 8 and no shorter than its header, which has no padding and no invalid values.
        unsafe { &*self.payload.cast() }
    }

    /// Delivers it to all readers; never blocks.
    pub(crate) fn send(self) -> Result<(), SendError> {
        self.sample.send().map(|_readers| ())
    }
}

/// A received message, in shared memory still.
pub(crate) struct Incoming {
    payload: *const u8,
    /// Length according to the topic; a foreign writer's own length does not count.
    bytes: usize,
    _sample: Sample<ipc::Service, Bytes, NoHeader>,
}

impl Incoming {
    #[inline]
    pub(crate) fn header(&self) -> &Header {
        // SAFETY: a message is aligned to 8 and no shorter than its header, which has no padding and no invalid values.
        unsafe { &*self.payload.cast() }
    }

    #[inline]
    pub(crate) fn tick(&self) -> u64 {
        self.header().tick
    }
}

impl Deref for Incoming {
    type Target = [u8];
    #[inline]
    fn deref(&self) -> &[u8] {
        // SAFETY: the topic's chunks have this size, and stay as they are while the sample is held.
        unsafe { from_raw_parts(self.payload, self.bytes) }
    }
}
