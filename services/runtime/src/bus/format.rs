//! The transport's view of a message: plain bytes that begin with a header, under a versioned type
//! name.

use process::Port;
use shared_types::Message;
use shared_types::topics::{OfTopic, TOPICS, wire_hash};

use crate::manifest::Manifest;

/// The messages of a topic. The transport compares name, size and layout; types begin where a message is read or written.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Format {
    pub(crate) topic: &'static str,
    pub(crate) type_name: &'static str,
    /// Bytes of a message; a multiple of 8, no fewer than a header has.
    pub(crate) bytes: usize,
    /// Hash of the layout; that of all messages of armplane, if this is one of them.
    pub(crate) layout: u64,
    /// The first field of a message that holds a number that is not finite.
    pub(crate) not_finite: fn(&[u8]) -> Option<&'static str>,
}

impl Format {
    /// The format of a message whose type this program knows.
    pub(crate) fn of<M: Message>() -> Self {
        Self::of_port(&Port::of::<M>())
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
            not_finite: port.not_finite,
        }
    }

    /// The format of a topic of a run. Where only the graph and other programs know the type of its messages, its names are leaked; a run has few.
    pub(crate) fn in_run(manifest: &Manifest, topic: &str) -> Option<Self> {
        if let Some(port) = Port::named(topic) {
            return Some(Self::of_port(&port));
        }
        let message = manifest.message(topic)?;
        let stays = |name: &String| -> &'static str { name.clone().leak() };
        Some(Self {
            topic: stays(&message.topic),
            type_name: stays(&message.type_name),
            bytes: message.bytes,
            layout: message.hash,
            not_finite: |_| None,
        })
    }

    /// Whether armplane itself has this message.
    pub(crate) fn is_listed(&self) -> bool {
        TOPICS.contains(&self.topic)
    }
}
