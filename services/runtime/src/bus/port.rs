//! The two ends of a topic, as bytes: iceoryx2's part, compiled once for all messages.

use std::ops::{Deref, DerefMut};
use std::slice::{from_raw_parts, from_raw_parts_mut};

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
    pub(super) format: Format,
    pub(super) publisher: Publisher<ipc::Service, Bytes, NoHeader>,
}

/// The end of a topic that reads.
pub(crate) struct Receiver {
    pub(super) format: Format,
    pub(super) subscriber: Subscriber<ipc::Service, Bytes, NoHeader>,
}

impl Sender {
    /// Loans memory for one message, still filled with an earlier message.
    pub(crate) fn loan(&self) -> Result<Outgoing, LoanError> {
        // SAFETY: one element; the topic's type has a fixed size.
        let mut sample = unsafe { self.publisher.loan_custom_payload(1) }?;
        let payload = sample.payload_mut().as_mut_ptr().cast();
        // SAFETY: the memory is a mapped file, whose bytes are those of an earlier message or zero, and every byte is a payload.
        let sample = unsafe { sample.assume_init() };
        Ok(Outgoing {
            sample,
            payload,
            bytes: self.format.bytes,
        })
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
}

impl Connect for Receiver {
    fn connect(&self, shared: &Context) -> Result<(), Interrupted> {
        self.subscriber
            .update_connections()
            .map_err(|error| shared.port_failed(self.format.topic, error))
    }
}

/// A message on loan: not sent yet, in shared memory.
pub(crate) struct Outgoing {
    sample: SampleMut<ipc::Service, Bytes, NoHeader>,
    /// Start of its bytes, aligned to 8.
    payload: *mut u8,
    bytes: usize,
}

impl Outgoing {
    #[inline]
    pub(crate) fn header(&mut self) -> &mut Header {
        // SAFETY: a message is aligned to 8 and no shorter than its header, which has no padding and no invalid values.
        unsafe { &mut *self.payload.cast() }
    }

    /// Delivers it to all readers; never blocks.
    pub(crate) fn send(self) -> Result<(), SendError> {
        self.sample.send().map(|_readers| ())
    }
}

impl Deref for Outgoing {
    type Target = [u8];
    #[inline]
    fn deref(&self) -> &[u8] {
        // SAFETY: on loan for as long as the sample is held; the topic's chunks have this size.
        unsafe { from_raw_parts(self.payload, self.bytes) }
    }
}

impl DerefMut for Outgoing {
    #[inline]
    fn deref_mut(&mut self) -> &mut [u8] {
        // SAFETY: as above, and nobody else has it before it is sent.
        unsafe { from_raw_parts_mut(self.payload, self.bytes) }
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
