//! A block: a seal, a chunk of messages, and an index of each of its topics.
//!
//! ```text
//! seal   record 0x80: CRC-32 u32 of the block behind it · numbers u64: bytes of the block, format, run, ticks begun, bytes of the chunk, of its messages,
//!        times of the first and the last of them, topics; messages of each topic before the block; of each in it
//! ```
//!
//! A block without a chunk ends a log whose writer was not killed.

use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::FileExt;

use lz4_flex::frame::{BlockSize, FrameDecoder, FrameEncoder, FrameInfo};

use crate::contents::Contents;
use crate::record::{
    CHUNK, MAGIC, MESSAGE, MESSAGE_INDEX, PREFIX, SEAL, numbers, record, sized, text, u16_at,
    u64_at,
};

/// The compression of every chunk.
pub(crate) const LZ4: &str = "lz4";
/// Bytes of a chunk record before its compressed messages.
const CHUNK_HEAD: usize = PREFIX + 3 * 8 + 4 + (4 + LZ4.len()) + 8;
/// Bytes of a message record before the message: channel, sequence, two times; and the mark of CDR, little endian.
const MESSAGE_HEAD: usize = PREFIX + 2 + 4 + 2 * 8 + CDR.len();
const CDR: [u8; 4] = [0, 1, 0, 0];
/// Bytes of an index before its entries, and of an entry.
const INDEX_HEAD: usize = PREFIX + 2 + 4;
const ENTRY: usize = 16;
/// Bytes of a seal's record up to the checksum, and up to the numbers of messages.
const CHECKED: usize = PREFIX + 4;
const SEALED: usize = CHECKED + 9 * 8;
/// More topics than a run has.
const MOST_TOPICS: u64 = 1024;
/// More bytes than a chunk has: messages have 4 MiB at most.
const MOST_BYTES: u64 = 64 << 20;

/// A block in a file.
#[derive(Clone, Debug, Default)]
pub(crate) struct Block {
    /// Its start and its length.
    pub(crate) at: u64,
    pub(crate) bytes: u64,
    /// Start and length of its chunk; 0 without one.
    pub(crate) chunk_at: u64,
    pub(crate) chunk: u64,
    /// Bytes of its messages, and the times of the first and the last; ns.
    pub(crate) uncompressed: u64,
    pub(crate) times: [u64; 2],
    /// Its messages, by channel.
    pub(crate) messages: Vec<u64>,
    /// Format and run.
    pub(crate) identity: [u64; 2],
    /// Ticks that had begun when the recorder had last taken in everything.
    pub(crate) begun: u64,
    /// Messages of each topic in the blocks before it.
    pub(crate) before: Vec<u64>,
}

impl Block {
    pub(crate) fn is_end(&self) -> bool {
        self.chunk == 0
    }

    pub(crate) fn compressed(&self) -> u64 {
        self.chunk - CHUNK_HEAD as u64
    }

    /// Messages of each topic up to its end.
    pub(crate) fn after(&self) -> Vec<u64> {
        self.before
            .iter()
            .zip(&self.messages)
            .map(|(before, more)| before.saturating_add(*more))
            .collect()
    }

    /// Start of each channel's index in the file, and the length of all.
    pub(crate) fn indexes(&self) -> (Vec<(u16, u64)>, u64) {
        let begin = self.chunk_at + self.chunk;
        let (mut places, mut end) = (Vec::new(), begin);
        for (id, messages) in (1..).zip(&self.messages).filter(|(_, n)| **n > 0) {
            places.push((id, end));
            end += INDEX_HEAD as u64 + ENTRY as u64 * messages;
        }
        (places, end - begin)
    }
}

/// Gathers messages into blocks; its buffers are kept.
pub(crate) struct Packer {
    chunk: Vec<u8>,
    /// Time and place of each message, by channel.
    indexes: Vec<Vec<[u64; 2]>>,
    /// The part after a block's seal, and the whole block.
    rest: Vec<u8>,
    block: Vec<u8>,
}

impl Packer {
    pub(crate) fn new(topics: usize) -> Self {
        Self {
            chunk: Vec::new(),
            indexes: vec![Vec::new(); topics],
            rest: Vec::new(),
            block: Vec::new(),
        }
    }

    /// Bytes gathered.
    pub(crate) fn bytes(&self) -> usize {
        self.chunk.len()
    }

    /// Messages gathered of a channel.
    pub(crate) fn messages_of(&self, channel: usize) -> u64 {
        self.indexes[channel].len() as u64
    }

    /// Takes a message in; `sequence`: its number in its topic.
    pub(crate) fn add(&mut self, channel: usize, sequence: u64, time_ns: u64, message: &[u8]) {
        let Self { chunk, indexes, .. } = self;
        indexes[channel].push([time_ns, chunk.len() as u64]);
        record(chunk, MESSAGE, |out| {
            out.extend((channel as u16 + 1).to_le_bytes());
            out.extend((sequence as u32).to_le_bytes());
            numbers(out, [time_ns, time_ns]);
            out.extend(CDR);
            out.extend(message);
        });
    }

    /// The block of the gathered messages; the next one starts empty.
    ///
    /// # Errors
    /// None that memory does not give.
    pub(crate) fn pack(
        &mut self,
        contents: &Contents,
        begun: u64,
        before: &[u64],
    ) -> io::Result<&[u8]> {
        let Self {
            chunk,
            indexes,
            rest,
            block,
        } = self;
        let times = || indexes.iter().flatten().map(|[time, _]| *time);
        let times = [times().min(), times().max()].map(Option::unwrap_or_default);
        let messages: Vec<u64> = indexes.iter().map(|index| index.len() as u64).collect();
        let uncompressed = chunk.len() as u64;
        rest.clear();
        if !chunk.is_empty() {
            let packed = compress(chunk)?;
            record(rest, CHUNK, |out| {
                numbers(out, [times[0], times[1], uncompressed]);
                out.extend(crc32fast::hash(chunk).to_le_bytes());
                text(out, LZ4);
                numbers(out, [packed.len() as u64]);
                out.extend(packed);
            });
            chunk.clear();
        }
        let chunk = rest.len() as u64;
        for (id, index) in (1_u16..).zip(indexes) {
            if !index.is_empty() {
                record(rest, MESSAGE_INDEX, |out| {
                    out.extend(id.to_le_bytes());
                    sized(out, |out| {
                        index.drain(..).for_each(|entry| numbers(out, entry))
                    });
                });
            }
        }
        block.clear();
        record(block, SEAL, |out| {
            let bytes = (SEALED + 16 * before.len() + rest.len()) as u64;
            let [format, run] = contents.identity();
            let [first, last] = times;
            out.extend([0; 4]);
            numbers(out, [bytes, format, run, begun, chunk]);
            numbers(out, [uncompressed, first, last, before.len() as u64]);
            let both = before.iter().chain(&messages);
            both.for_each(|messages| numbers(out, [*messages]));
        });
        block.append(rest);
        sign(block);
        Ok(block)
    }
}

/// The checksum of a block, from its begin.
fn checksum(block: &[u8]) -> [u8; 4] {
    crc32fast::hash(block.get(CHECKED..).unwrap_or_default()).to_le_bytes()
}

fn sign(block: &mut [u8]) {
    let checksum = checksum(block);
    if let Some(place) = block.get_mut(PREFIX..CHECKED) {
        place.copy_from_slice(&checksum);
    }
}

fn compress(chunk: &[u8]) -> io::Result<Vec<u8>> {
    let frame = FrameInfo::new().block_size(BlockSize::Max256KB);
    let mut encoder = FrameEncoder::with_frame_info(frame, Vec::new());
    io::Write::write_all(&mut encoder, chunk)?;
    encoder.finish().map_err(io::Error::other)
}

/// The item that begins at a place of a file.
pub(crate) enum Found {
    /// A block with a seal of the right length.
    Whole(Block),
    /// The beginning of one: its writer was killed.
    Torn,
    Nothing,
}

/// A file of blocks.
pub(crate) struct Blocks {
    file: File,
    pub(crate) length: u64,
}

impl Blocks {
    pub(crate) fn new(file: File) -> io::Result<Self> {
        let length = file.metadata()?.len();
        Ok(Self { file, length })
    }

    /// The bytes at a place, as far as the file goes.
    pub(crate) fn read(&self, at: u64, length: u64) -> io::Result<Vec<u8>> {
        let length = length.min(self.length.saturating_sub(at)) as usize;
        let (mut bytes, mut n) = (vec![0; length], 0);
        while n < length {
            match self.file.read_at(&mut bytes[n..], at + n as u64) {
                Ok(0) => break,
                Ok(more) => n += more,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        bytes.truncate(n);
        Ok(bytes)
    }

    /// The block that begins at a place, by its seal.
    pub(crate) fn at(&self, at: u64) -> io::Result<Found> {
        let head = self.read(at, SEALED as u64)?;
        if head.first().is_some_and(|op| *op != SEAL) {
            return Ok(Found::Nothing);
        }
        if head.len() < SEALED {
            return Ok(Found::Torn);
        }
        let number = |i: usize| u64_at(&head, CHECKED + 8 * i);
        let [bytes, chunk, topics] = [0, 4, 8].map(number);
        let seal = SEALED as u64 + 16 * topics.min(MOST_TOPICS);
        if u64_at(&head, 1) != seal - PREFIX as u64
            || topics > MOST_TOPICS
            || !(seal..MOST_BYTES).contains(&bytes)
            || chunk > bytes - seal
            || chunk > 0 && chunk < CHUNK_HEAD as u64
        {
            return Ok(Found::Nothing);
        }
        if bytes > self.length - at {
            return Ok(Found::Torn);
        }
        let counts = self.read(at + SEALED as u64, 16 * topics)?;
        let mut counts = (0..2 * topics as usize).map(|i| u64_at(&counts, 8 * i));
        let block = Block {
            at,
            bytes,
            chunk_at: at + seal,
            chunk,
            identity: [1, 2].map(number),
            begun: number(3),
            uncompressed: number(5),
            times: [6, 7].map(number),
            before: counts.by_ref().take(topics as usize).collect(),
            messages: counts.collect(),
        };
        Ok(
            match block.messages.iter().all(|messages| *messages < bytes) {
                true => Found::Whole(block),
                false => Found::Nothing,
            },
        )
    }

    /// The bytes of a block; `None` if they are damaged.
    pub(crate) fn bytes(&self, block: &Block) -> io::Result<Option<Vec<u8>>> {
        let bytes = self.read(block.at, block.bytes)?;
        let is_whole = bytes.len() as u64 == block.bytes
            && bytes.get(PREFIX..CHECKED) == Some(&checksum(&bytes));
        Ok(is_whole.then_some(bytes))
    }

    /// The first block from a place on that is as it was written.
    pub(crate) fn next(&self, from: u64) -> io::Result<Option<Block>> {
        const WINDOW: u64 = 1 << 16;
        let mut begin = from;
        while begin < self.length {
            let window = self.read(begin, WINDOW + PREFIX as u64)?;
            for (at, head) in (begin..begin + WINDOW).zip(window.windows(PREFIX)) {
                if head[0] == SEAL
                    && u64_at(head, 1) <= MOST_BYTES
                    && let Found::Whole(block) = self.at(at)?
                    && self.bytes(&block)?.is_some()
                {
                    return Ok(Some(block));
                }
            }
            begin += WINDOW;
        }
        Ok(None)
    }
}

/// The messages of a block.
#[derive(Debug)]
pub struct Chunk {
    bytes: Vec<u8>,
    /// Place of each message, by channel.
    places: Vec<Vec<(usize, usize)>>,
}

impl Chunk {
    /// Reads a block's bytes; `None` if they are no messages of these layouts, although the
    /// checksum is right.
    pub(crate) fn of(block: &Block, bytes: &[u8], contents: &Contents) -> Option<Self> {
        let begin = (block.chunk_at - block.at) as usize;
        let packed = bytes.get(begin..begin + block.chunk as usize)?;
        let mut chunk = Self {
            bytes: Vec::new(),
            places: vec![Vec::new(); contents.layouts.len()],
        };
        if block.is_end() {
            return Some(chunk);
        }
        FrameDecoder::new(packed.get(CHUNK_HEAD..)?)
            .take(MOST_BYTES)
            .read_to_end(&mut chunk.bytes)
            .ok()?;
        let mut at = 0;
        while at < chunk.bytes.len() {
            let rest = &chunk.bytes[at..];
            let end = at
                .checked_add(PREFIX)?
                .checked_add(u64_at(rest, 1) as usize)?;
            let channel = usize::from(u16_at(rest, PREFIX)).checked_sub(1)?;
            let layout = contents.layouts.get(channel)?;
            let is_message = rest[0] == MESSAGE && end - at == MESSAGE_HEAD + layout.bytes;
            if !is_message || end > chunk.bytes.len() {
                return None;
            }
            chunk.places[channel].push((at + MESSAGE_HEAD, end));
            at = end;
        }
        let found = chunk.places.iter().map(|places| places.len() as u64);
        found.eq(block.messages.iter().copied()).then_some(chunk)
    }

    pub(crate) fn message(&self, channel: usize, number: usize) -> Option<&[u8]> {
        let (begin, end) = *self.places.get(channel)?.get(number)?;
        self.bytes.get(begin..end)
    }

    /// All messages of a channel, in order.
    pub fn messages(&self, channel: usize) -> impl Iterator<Item = &[u8]> {
        (0..).map_while(move |number| self.message(channel, number))
    }
}

/// Gives every block in a file's bytes the right checksum, which arbitrary bytes cannot have by
/// chance.
#[doc(hidden)]
pub fn seal(file: &mut [u8]) {
    let mut at = if file.starts_with(&MAGIC) {
        MAGIC.len()
    } else {
        0
    };
    while at + CHECKED < file.len() {
        let is_block = file[at] == SEAL;
        let length = match is_block {
            true => u64_at(file, at + CHECKED),
            false => u64_at(file, at + 1).saturating_add(PREFIX as u64),
        };
        let end = usize::try_from(length)
            .ok()
            .filter(|length| *length > 0)
            .and_then(|length| at.checked_add(length))
            .filter(|end| *end <= file.len());
        let Some(end) = end else { return };
        if is_block {
            sign(&mut file[at..end]);
        }
        at = end;
    }
}
