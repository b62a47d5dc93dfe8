//! The transport's view of a message: plain bytes that begin with a header, under a versioned type
//! name.

use bytemuck::{pod_read_unaligned, try_from_bytes};
use process::Port;
use shared_types::Message;
use shared_types::topics::{OfTopic, TOPICS, wire_hash};
use shared_types::wire::Header;

use crate::manifest::ForeignMessage;

/// The messages of a topic. The transport compares name, size and layout; types begin where a message is read or written.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Format {
    pub(crate) topic: &'static str,
    pub(crate) type_name: &'static str,
    /// Bytes of a message; a multiple of 8, no fewer than a header has.
    pub(crate) bytes: usize,
    /// Hash of the layout; that of all messages of armplane, if this is one of them.
    pub(crate) layout: u64,
    /// Whether every `f64` in a message of this size is finite.
    pub(crate) is_finite: fn(&[u8]) -> bool,
    /// The first field of a message that holds a number that is not.
    pub(crate) not_finite: fn(&[u8]) -> Option<&'static str>,
}

impl Format {
    /// The format of a message whose type this program knows.
    pub(crate) fn of<M: Message>() -> Self {
        Self::of_port(&Port::of::<M>())
    }

    /// The format of a topic of the list.
    pub(crate) fn named(topic: &str) -> Option<Self> {
        Some(Self::of_port(&Port::named(topic)?))
    }

    /// The format of a topic as a step sees it.
    pub(crate) fn of_port(port: &Port) -> Self {
        let layout = if TOPICS.contains(&port.topic) {
            wire_hash()
        } else {
            (port.layout)()
        };
        Self {
            topic: port.topic,
            type_name: port.type_name,
            bytes: port.bytes,
            layout,
            is_finite: port.is_finite,
            not_finite: port.not_finite,
        }
    }

    /// The format of a message whose type only the graph and other programs know. Its names are
    /// leaked; a run has few.
    pub(crate) fn foreign(message: &ForeignMessage) -> Self {
        let stays = |name: &str| -> &'static str { Box::leak(name.to_owned().into_boxed_str()) };
        let (topic, type_name) = (stays(&message.topic), stays(&message.type_name));
        Self {
            topic,
            type_name,
            bytes: message.bytes,
            layout: message.hash,
            is_finite: |_| true,
            not_finite: |_| None,
        }
    }

    /// Whether armplane itself has this message.
    pub(crate) fn is_listed(&self) -> bool {
        TOPICS.contains(&self.topic)
    }
}

/// Reads a message in place, or a copy of it where the bytes are not aligned; `None` if they are not as many as the message has.
pub(crate) fn read<M: Message, T>(bytes: &[u8], read: impl FnOnce(&M) -> T) -> Option<T> {
    if bytes.len() != size_of::<M>() {
        return None;
    }
    Some(match try_from_bytes(bytes) {
        Ok(message) => read(message),
        Err(_) => read_copy(bytes, read),
    })
}

/// Apart, for the copy takes room on the stack.
#[cold]
#[inline(never)]
fn read_copy<M: Message, T>(bytes: &[u8], read: impl FnOnce(&M) -> T) -> T {
    read(&pod_read_unaligned(bytes))
}

/// The header of a message; empty if the message is too short.
pub(crate) fn header(message: &[u8]) -> Header {
    message
        .get(..size_of::<Header>())
        .map(pod_read_unaligned)
        .unwrap_or_default()
}
