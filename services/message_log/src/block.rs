//! A block: a chunk of messages, an index of each of its topics, and a seal.
//!
//! ```text
//! seal   record 0x80: format u64 · run u64 · ticks begun u64 · messages of each topic before the block u64 … · CRC-32 u32 of the block up to here
//! ```
//!
//! A block without a chunk is the end of a log whose writer was not killed.

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
/// Bytes of a seal besides its numbers of messages.
const SEALED: usize = 3 * 8 + 4;
/// More topics than a run has.
const MOST_TOPICS: usize = 1024;
/// More bytes than a chunk has: messages have 4 MiB at most.
const MOST_BYTES: u64 = 64 << 20;

/// A block in a file.
#[derive(Clone, Debug, Default)]
pub(crate) struct Block {
    /// Where it begins, and its length.
    pub(crate) at: u64,
    pub(crate) bytes: u64,
    /// Bytes of its chunk record; 0 without one.
    pub(crate) chunk: u64,
    /// The times of its messages; ns.
    pub(crate) times: [u64; 2],
    pub(crate) uncompressed: u64,
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

    /// Where the index of each channel that has one begins, behind the block's begin, and the length of all.
    pub(crate) fn indexes(&self) -> (Vec<(u16, u64)>, u64) {
        let (mut places, mut end) = (Vec::new(), self.chunk);
        for (id, messages) in (1..).zip(&self.messages).filter(|(_, n)| **n > 0) {
            places.push((id, end));
            end += INDEX_HEAD as u64 + ENTRY as u64 * messages;
        }
        (places, end - self.chunk)
    }
}

/// Gathers messages into blocks; its buffers are kept.
pub(crate) struct Packer {
    chunk: Vec<u8>,
    /// Time and place of each message, by channel.
    indexes: Vec<Vec<[u64; 2]>>,
    block: Vec<u8>,
}

impl Packer {
    pub(crate) fn new(topics: usize) -> Self {
        Self {
            chunk: Vec::new(),
            indexes: vec![Vec::new(); topics],
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

    /// The block of what has been gathered; the next one begins with nothing.
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
            block,
        } = self;
        block.clear();
        if !chunk.is_empty() {
            let times = || indexes.iter().flatten().map(|[time, _]| *time);
            let mut packed = Ok(());
            record(block, CHUNK, |out| {
                let (first, last) = (times().min(), times().max());
                let size = chunk.len() as u64;
                numbers(out, [first.unwrap_or(0), last.unwrap_or(0), size]);
                out.extend(crc32fast::hash(chunk).to_le_bytes());
                text(out, LZ4);
                let at = out.len();
                numbers(out, [0]);
                packed = compress(chunk, out);
                let compressed = (out.len() - at - 8) as u64;
                out[at..at + 8].copy_from_slice(&compressed.to_le_bytes());
            });
            packed?;
            for (id, index) in (1_u16..).zip(&mut *indexes) {
                if !index.is_empty() {
                    record(block, MESSAGE_INDEX, |out| {
                        out.extend(id.to_le_bytes());
                        sized(out, |out| {
                            index.drain(..).for_each(|entry| numbers(out, entry))
                        });
                    });
                }
            }
            chunk.clear();
        }
        record(block, SEAL, |out| {
            let [format, run] = contents.identity();
            numbers(out, [format, run, begun]);
            before.iter().for_each(|before| numbers(out, [*before]));
            out.extend([0; 4]);
        });
        sign(block);
        Ok(block)
    }
}

/// Writes the checksum at the end of a block.
fn sign(block: &mut [u8]) {
    if let Some((rest, checksum)) = block.split_last_chunk_mut::<4>() {
        *checksum = crc32fast::hash(rest).to_le_bytes();
    }
}

fn compress(chunk: &[u8], out: &mut Vec<u8>) -> io::Result<()> {
    let frame = FrameInfo::new().block_size(BlockSize::Max256KB);
    let mut encoder = FrameEncoder::with_frame_info(frame, out);
    io::Write::write_all(&mut encoder, chunk)?;
    encoder.finish().map_err(io::Error::other)?;
    Ok(())
}

/// What begins at a place of a file.
pub(crate) enum Found {
    /// A block whose records are of the right kinds and lengths.
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

    /// The block that begins at a place, by the heads of its records.
    pub(crate) fn at(&self, at: u64) -> io::Result<Found> {
        let mut block = Block {
            at,
            ..Block::default()
        };
        let mut place = at;
        loop {
            let head = self.read(place, CHUNK_HEAD as u64)?;
            let length = u64_at(&head, 1);
            let is_ours = matches!(head.first(), None | Some(&(CHUNK | MESSAGE_INDEX | SEAL)));
            if !is_ours || length > MOST_BYTES {
                return Ok(Found::Nothing);
            }
            if head.len() < PREFIX || PREFIX as u64 + length > self.length.saturating_sub(place) {
                return Ok(Found::Torn);
            }
            match head[0] {
                CHUNK if place == at && head.len() == CHUNK_HEAD => {
                    block.chunk = PREFIX as u64 + length;
                    block.times = [u64_at(&head, PREFIX), u64_at(&head, PREFIX + 8)];
                    block.uncompressed = u64_at(&head, PREFIX + 16);
                    if block.chunk < CHUNK_HEAD as u64 {
                        return Ok(Found::Nothing);
                    }
                }
                MESSAGE_INDEX if block.chunk > 0 => {
                    let channel = usize::from(u16_at(&head, PREFIX)).wrapping_sub(1);
                    if channel >= MOST_TOPICS || channel < block.messages.len() {
                        return Ok(Found::Nothing);
                    }
                    block.messages.resize(channel, 0);
                    block.messages.push(length.saturating_sub(6) / ENTRY as u64);
                }
                SEAL => {
                    let seal = self.read(place + PREFIX as u64, length)?;
                    let topics = seal.len().saturating_sub(SEALED) / 8;
                    let is_one = seal.len() == SEALED + 8 * topics
                        && seal.len() as u64 == length
                        && topics <= MOST_TOPICS
                        && block.messages.len() <= topics;
                    block.messages.resize(topics, 0);
                    block.identity = [u64_at(&seal, 0), u64_at(&seal, 8)];
                    block.begun = u64_at(&seal, 16);
                    block.before = (0..topics).map(|i| u64_at(&seal, 24 + 8 * i)).collect();
                    block.bytes = place + PREFIX as u64 + length - at;
                    return Ok(if is_one {
                        Found::Whole(block)
                    } else {
                        Found::Nothing
                    });
                }
                _ => return Ok(Found::Nothing),
            }
            place += PREFIX as u64 + length;
        }
    }

    /// The bytes of a block; `None` where they are not as they were written.
    pub(crate) fn bytes(&self, block: &Block) -> io::Result<Option<Vec<u8>>> {
        let bytes = self.read(block.at, block.bytes)?;
        let is_whole = bytes.len() as u64 == block.bytes
            && bytes
                .split_last_chunk::<4>()
                .is_some_and(|(rest, checksum)| {
                    crc32fast::hash(rest) == u32::from_le_bytes(*checksum)
                });
        Ok(is_whole.then_some(bytes))
    }

    /// The first block from a place on that is as it was written.
    pub(crate) fn next(&self, from: u64) -> io::Result<Option<Block>> {
        const WINDOW: u64 = 1 << 16;
        let mut begin = from;
        while begin < self.length {
            let window = self.read(begin, WINDOW + PREFIX as u64)?;
            for (at, head) in (begin..begin + WINDOW).zip(window.windows(PREFIX)) {
                if matches!(head[0], CHUNK | SEAL)
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
    /// Where each message is, by channel.
    places: Vec<Vec<(usize, usize)>>,
}

impl Chunk {
    /// Of the bytes of a block; `None` where they are no messages of the layouts, though their checksum is right.
    pub(crate) fn of(block: &Block, bytes: &[u8], contents: &Contents) -> Option<Self> {
        let packed = bytes.get(CHUNK_HEAD.min(block.chunk as usize)..block.chunk as usize)?;
        let mut chunk = Self {
            bytes: Vec::new(),
            places: vec![Vec::new(); contents.layouts.len()],
        };
        if block.is_end() {
            return Some(chunk);
        }
        FrameDecoder::new(packed)
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

/// Gives every block in the bytes of a file its right checksum: what a file of any bytes cannot have by chance.
#[doc(hidden)]
pub fn seal(file: &mut [u8]) {
    let mut at = if file.starts_with(&MAGIC) {
        MAGIC.len()
    } else {
        0
    };
    let mut begin = at;
    while at + PREFIX < file.len() {
        let length = u64_at(file, at + 1);
        let end = usize::try_from(length)
            .ok()
            .and_then(|length| (at + PREFIX).checked_add(length))
            .filter(|end| *end <= file.len());
        let Some(end) = end else { return };
        match file[at] {
            CHUNK => begin = at,
            MESSAGE_INDEX => {}
            SEAL => {
                sign(&mut file[begin..end]);
                begin = end;
            }
            _ => begin = end,
        }
        at = end;
    }
}
