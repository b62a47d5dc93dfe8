//! A message of any topic.

use bytemuck::{bytes_of, cast_slice, cast_slice_mut, from_bytes, from_bytes_mut};
use shared_types::Header;

/// Bytes of a message's header.
const HEADER: usize = size_of::<Header>();

/// A message of any topic, as its words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packed(Box<[u64]>);

impl Packed {
    /// A copy of a message; of bytes that are none, a message of tick 0.
    #[must_use]
    pub fn of(message: &[u8]) -> Self {
        Self::checked(message)
            .unwrap_or_else(|| Self(cast_slice(bytes_of(&Header::default())).into()))
    }

    /// A copy of a message; `None` where the bytes are none.
    #[must_use]
    pub fn checked(message: &[u8]) -> Option<Self> {
        let words = message.chunks_exact(size_of::<u64>());
        let is_whole = message.len() >= HEADER && words.remainder().is_empty();
        is_whole.then(|| Self(words.map(bytemuck::pod_read_unaligned).collect()))
    }

    /// All its bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        cast_slice(&self.0)
    }

    /// All its bytes, to be changed.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        cast_slice_mut(&mut self.0)
    }

    /// Its header.
    #[must_use]
    pub fn header(&self) -> &Header {
        from_bytes(&self.bytes()[..HEADER])
    }

    /// Its header, to be changed.
    pub fn header_mut(&mut self) -> &mut Header {
        from_bytes_mut(&mut self.bytes_mut()[..HEADER])
    }
}
