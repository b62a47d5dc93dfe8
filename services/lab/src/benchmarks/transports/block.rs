//! A payload of any size of which only the header is touched.

use std::fmt;
use std::mem::MaybeUninit;

/// Words of a block's header.
pub(crate) const HEADER_WORDS: usize = 8;

/// Bytes of a block's header: a cache line.
pub(crate) const HEADER_BYTES: usize = HEADER_WORDS * size_of::<u64>();

/// A header, and `N` words that nobody writes or reads.
#[derive(Clone, Copy)]
#[repr(C)]
pub(crate) struct Block<const N: usize> {
    /// All words are the same.
    pub header: [u64; HEADER_WORDS],
    rest: [MaybeUninit<u64>; N],
}

impl<const N: usize> fmt::Debug for Block<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Block").field("header", &self.header).field("rest", &self.rest.len()).finish()
    }
}

/// Whether a header arrived as it was sent.
pub(crate) fn is_whole(header: &[u64; HEADER_WORDS]) -> bool {
    header.iter().all(|word| *word == header[0])
}
