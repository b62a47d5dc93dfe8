//! A payload of any size of which only the header is touched.

use std::fmt;

use bytemuck::{Pod, Zeroable};
use shared_types::wire::{Field, Part};
use shared_types::{Header, Layout, Message};

/// Words of a block's header where it is not a message.
pub(crate) const HEADER_WORDS: usize = 8;

/// Bytes of a block's header: a cache line.
pub(crate) const HEADER_BYTES: usize = HEADER_WORDS * size_of::<u64>();

/// Whether a header arrived as it was sent.
pub(crate) fn is_whole(header: &[u64; HEADER_WORDS]) -> bool {
    header.iter().all(|word| *word == header[0])
}

/// Bytes of the blocks that are measured.
pub(crate) const BLOCKS: [usize; 6] = [64, 1024, 4096, 16_384, 262_144, 4_194_304];

/// The topics of [`BLOCKS`], one for each direction.
pub(crate) const BLOCK_TOPICS: [[&str; 2]; 6] = [
    ["block-64-there", "block-64-back"],
    ["block-1024-there", "block-1024-back"],
    ["block-4096-there", "block-4096-back"],
    ["block-16384-there", "block-16384-back"],
    ["block-262144-there", "block-262144-back"],
    ["block-4194304-there", "block-4194304-back"],
];

/// Words of a message of [`BLOCKS`] behind its header; the smallest block is smaller than the header and comes on top of it.
pub(crate) const fn message_words(block: usize) -> usize {
    let (bytes, header) = (BLOCKS[block], size_of::<Header>());
    (if bytes > header {
        bytes - header
    } else {
        bytes
    }) / size_of::<u64>()
}

/// A block as the message of a topic: number `BLOCK` of [`BLOCKS`], `N` is its [`message_words`], `WAY` 0 there and 1 back.
#[derive(Clone, Copy)]
#[repr(C)]
pub(crate) struct BlockMessage<const BLOCK: usize, const N: usize, const WAY: usize> {
    header: Header,
    /// Never written or read.
    rest: [u64; N],
}

// SAFETY: plain words, for which zero is a value.
unsafe impl<const BLOCK: usize, const N: usize, const WAY: usize> Zeroable
    for BlockMessage<BLOCK, N, WAY>
{
}
// SAFETY: plain words aligned as the header is, without padding.
unsafe impl<const BLOCK: usize, const N: usize, const WAY: usize> Pod
    for BlockMessage<BLOCK, N, WAY>
{
}

impl<const BLOCK: usize, const N: usize, const WAY: usize> fmt::Debug
    for BlockMessage<BLOCK, N, WAY>
{
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct(Self::TYPE_NAME)
            .field("header", &self.header)
            .field("rest", &self.rest.len())
            .finish()
    }
}

impl<const BLOCK: usize, const N: usize, const WAY: usize> Part for BlockMessage<BLOCK, N, WAY> {
    const ELEMENT: &'static str = "block";
    fn is_finite(&self) -> bool {
        true
    }
}

impl<const BLOCK: usize, const N: usize, const WAY: usize> Layout for BlockMessage<BLOCK, N, WAY> {
    const TYPE_NAME: &'static str = BLOCK_TOPICS[BLOCK][WAY];
    const FIELDS: &'static [Field] = &[
        Field::known(
            "header",
            ["Header", "Header"],
            0,
            size_of::<Header>(),
            "The header",
        ),
        Field::known(
            "rest",
            ["[u64; N]", "u64"],
            size_of::<Header>(),
            N * size_of::<u64>(),
            "words that are never touched",
        ),
    ];
    const ABOUT: &'static str = "A block of a benchmark.";
}

impl<const BLOCK: usize, const N: usize, const WAY: usize> Message for BlockMessage<BLOCK, N, WAY> {
    const TOPIC: &'static str = BLOCK_TOPICS[BLOCK][WAY];

    fn header(&self) -> &Header {
        &self.header
    }

    fn header_mut(&mut self) -> &mut Header {
        &mut self.header
    }
}
