//! The messages of a log, and places in it.

use std::mem::offset_of;
use std::path::{Path, PathBuf};

use shared_types::Message;
use shared_types::layout::MessageLayout;
use shared_types::wire::Header;

/// The word of a message that is its tick.
const TICK: usize = offset_of!(Header, tick) / size_of::<u64>();

/// The messages of a log: their topic, size and layout.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Their topic, which names the file.
    pub topic: String,
    /// Bytes of a message, a multiple of 8.
    pub bytes: usize,
    /// The hash of their layout.
    pub hash: u64,
}

impl Shape {
    /// Of messages whose type is known.
    #[must_use]
    pub fn of<M: Message>() -> Self {
        const {
            assert!(
                size_of::<M>().is_multiple_of(8),
                "messages are rows of 64-bit words"
            )
        };
        Self {
            topic: M::TOPIC.to_owned(),
            bytes: size_of::<M>(),
            hash: M::layout_hash(),
        }
    }

    pub(crate) fn path_in(&self, folder: &Path) -> PathBuf {
        folder.join(format!("{}.log", self.topic))
    }

    /// 64-bit words of a message.
    pub(crate) fn words(&self) -> usize {
        self.bytes / size_of::<u64>()
    }
}

impl From<&MessageLayout> for Shape {
    fn from(layout: &MessageLayout) -> Self {
        Self {
            topic: layout.topic.clone(),
            bytes: layout.bytes,
            hash: layout.hash,
        }
    }
}

/// The tick of a message.
#[must_use]
pub fn tick_of(row: &[u64]) -> u64 {
    row.get(TICK).copied().unwrap_or_default()
}

/// A place in a log behind a whole block: byte, and messages before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Bytes of the file before it.
    pub byte: u64,
    /// Messages before it.
    pub messages: u64,
}
