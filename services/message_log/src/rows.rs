//! A message log: every message of a topic as it was on the wire, packed, so that a run can be compared, replayed or read by others.
//!
//! ```text
//! file     "armkept\x02" · layout hash u64 · bytes of a message u32 · 0 u32 · blocks
//! block    messages n u32 · bytes of the rest u32 · LZ4 block of: which planes there are · planes
//! ```
//!
//! All integers little-endian. Inside a block a message is a row of 64-bit words, each word minus the one above it (the first row minus
//! nothing), zig-zagged so that small changes of either sign are small numbers. A plane is one byte of one word of all messages: of the first
//! word the lowest bytes, its second bytes, … then those of the second word. Planes of zeros, most of them, are left out: before the planes
//! there is a byte for each word, with a bit for each of its eight planes that follows. Blocks do not depend on each other: what a killed writer
//! leaves is readable up to its last whole block.

use std::fs::{File, OpenOptions};
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use lz4_flex::block::{CompressTable, compress_into_with_table, decompress_into, get_maximum_output_size};
use shared_types::Message;
use shared_types::layout::MessageLayout;

const MAGIC: [u8; 8] = *b"armkept\x02";
const HEAD: usize = 24;
/// Messages in a block: what a killed writer takes with it. Its replacement finds them in the retainer of the topic, which holds far more.
pub const BLOCK: usize = 128;
/// Numbers of a block before its messages.
const BLOCK_HEAD: usize = 8;

/// Why a message log cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file.
    #[error("cannot {action} the message log {path}: {source}")]
    File {
        /// The operation.
        action: &'static str,
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It was written by a program with other messages.
    #[error("the messages in {path} have the wire format {found:016x}, this program has {ours:016x}: use the program that made the run")]
    WireFormat {
        /// Which.
        path: PathBuf,
        /// The file's.
        found: u64,
        /// This program's.
        ours: u64,
    },
    /// Its writer was killed while it made the file.
    #[error("the message log {path} has no message: its writer was killed before the first")]
    Unbegun {
        /// Which.
        path: PathBuf,
    },
    /// It holds no messages of ours, or no longer.
    #[error("{path} is damaged or is no message log: {reason}")]
    Damaged {
        /// Which.
        path: PathBuf,
        /// The defect.
        reason: String,
    },
}

impl LogError {
    /// Whether there is no message log at all.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        matches!(self, Self::File { source, .. } if source.kind() == ErrorKind::NotFound)
    }

    /// Whether no message can have been written: there is no log, or only the beginning of its head.
    #[must_use]
    pub fn is_before_the_first_message(&self) -> bool {
        self.is_absent() || matches!(self, Self::Unbegun { .. })
    }
}

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
        const { assert!(size_of::<M>().is_multiple_of(8), "messages are rows of 64-bit words") };
        Self { topic: M::TOPIC.to_owned(), bytes: size_of::<M>(), hash: M::layout_hash() }
    }

    fn path_in(&self, folder: &Path) -> PathBuf {
        folder.join(format!("{}.log", self.topic))
    }

    /// 64-bit words of a message.
    fn words(&self) -> usize {
        self.bytes / size_of::<u64>()
    }

    fn head(&self) -> [u8; HEAD] {
        let mut head = [0; HEAD];
        head[..8].copy_from_slice(&MAGIC);
        head[8..16].copy_from_slice(&self.hash.to_le_bytes());
        head[16..20].copy_from_slice(&(self.bytes as u32).to_le_bytes());
        head
    }
}

impl From<&MessageLayout> for Shape {
    fn from(layout: &MessageLayout) -> Self {
        Self { topic: layout.topic.clone(), bytes: layout.bytes, hash: layout.hash }
    }
}

/// Gathers messages and packs them into blocks; its buffers are kept, so that nothing is allocated per block.
struct Packer {
    /// 64-bit words of a message.
    words: usize,
    /// Differences of each word of each gathered message from the one above it, zig-zagged; row by row.
    folded: Vec<u64>,
    /// The last message.
    above: Vec<u64>,
    /// All bits that any difference of a word has.
    any: Vec<u64>,
    planes: Vec<u8>,
    /// The block, as it is written.
    packed: Vec<u8>,
    table: CompressTable,
}

impl Packer {
    fn new(words: usize) -> Self {
        Self {
            words,
            folded: Vec::with_capacity(BLOCK * words),
            above: vec![0; words],
            any: vec![0; words],
            planes: Vec::new(),
            packed: Vec::new(),
            table: CompressTable::large(),
        }
    }

    /// Messages gathered.
    fn len(&self) -> usize {
        self.folded.len() / self.words
    }

    /// Takes a message in while it is in the cache: one pass over its words.
    fn add(&mut self, row: &[u64]) {
        self.folded.extend(row.iter().zip(&mut self.above).zip(&mut self.any).map(|((value, above), any)| {
            let delta = value.wrapping_sub(*above).cast_signed();
            let folded = ((delta << 1) ^ (delta >> 63)).cast_unsigned();
            *above = *value;
            *any |= folded;
            folded
        }));
    }

    /// A block of what has been gathered; the next one begins with nothing.
    fn pack(&mut self) -> &[u8] {
        let n = self.len().min(BLOCK);
        let Self { words, folded, above, any, planes, packed, table } = self;
        planes.clear();
        planes.resize(*words, 0);
        let mut column = [0_u64; BLOCK];
        let mut bytes = [[0_u8; BLOCK]; size_of::<u64>()];
        for (word, any) in any.iter().enumerate().filter(|(_, any)| **any != 0) {
            column.iter_mut().zip(folded[word..].iter().step_by(*words)).for_each(|(to, from)| *to = *from);
            for (group, rows) in column.as_chunks::<8>().0.iter().enumerate() {
                for (plane, eight) in bytes.iter_mut().zip(transposed(*rows)) {
                    plane[8 * group..][..8].copy_from_slice(&eight.to_le_bytes());
                }
            }
            for (byte, plane) in bytes.iter().enumerate().filter(|(byte, _)| any >> (8 * byte) & 0xff != 0) {
                planes[word] |= 1 << byte;
                planes.extend_from_slice(&plane[..n]);
            }
        }
        folded.clear();
        above.fill(0);
        any.fill(0);
        packed.resize(BLOCK_HEAD + get_maximum_output_size(planes.len()), 0);
        // The buffer holds the worst case.
        let size = compress_into_with_table(planes, &mut packed[BLOCK_HEAD..], table).unwrap_or(0);
        packed[..4].copy_from_slice(&(n as u32).to_le_bytes());
        packed[4..BLOCK_HEAD].copy_from_slice(&(size as u32).to_le_bytes());
        &packed[..BLOCK_HEAD + size]
    }
}

/// Eight words as a square of bytes, its rows as columns: word *b* holds byte *b* of each. Halves, quarters and eighths are swapped in turn.
fn transposed(mut words: [u64; 8]) -> [u64; 8] {
    for (step, mask) in [(4, 0x0000_0000_ffff_ffff_u64), (2, 0x0000_ffff_0000_ffff), (1, 0x00ff_00ff_00ff_00ff)] {
        for i in (0..8).filter(|i| i & step == 0) {
            let swapped = (words[i] >> (8 * step) ^ words[i + step]) & mask;
            words[i + step] ^= swapped;
            words[i] ^= swapped << (8 * step);
        }
    }
    words
}

/// The inverse of [`Packer::pack`], of what follows a block's head: rows of as many words, one after the other.
fn unpack(n: usize, words: usize, packed: &[u8]) -> Result<Vec<u64>, String> {
    let mut unpacked = vec![0; words + n * words * size_of::<u64>()];
    let size = decompress_into(packed, &mut unpacked).map_err(|error| error.to_string())?;
    let (present, planes) = unpacked.split_at(words);
    let expected = words + n * present.iter().map(|byte| byte.count_ones() as usize).sum::<usize>();
    if size != expected {
        return Err(format!("a block of {n} messages unpacks to {size} bytes and not to {expected}"));
    }
    let mut rows = vec![0_u64; n * words];
    let mut planes = planes.chunks_exact(n);
    for (word, present) in present.iter().enumerate() {
        for byte in (0..8).filter(|byte| present & 1 << byte != 0) {
            for (row, part) in rows.chunks_exact_mut(words).zip(planes.next().unwrap_or_default()) {
                row[word] |= u64::from(*part) << (8 * byte);
            }
        }
        let mut above = 0_u64;
        for row in rows.chunks_exact_mut(words) {
            let folded = row[word];
            above = above.wrapping_add((folded >> 1) ^ (folded & 1).wrapping_neg());
            row[word] = above;
        }
    }
    Ok(rows)
}

/// Writes the message log of a topic, in a folder, as `TOPIC.log`: messages are rows of 64-bit words.
pub struct RowWriter {
    path: PathBuf,
    file: File,
    packer: Packer,
    bytes: u64,
}

impl RowWriter {
    /// An empty file in a folder, which is made if there is none.
    ///
    /// # Errors
    /// When the folder or the file cannot be made.
    pub fn create(folder: &Path, shape: &Shape) -> Result<Self, LogError> {
        let path = shape.path_in(folder);
        let made = std::fs::create_dir_all(folder).and_then(|()| File::create(&path)).and_then(|mut file| {
            file.write_all(&shape.head())?;
            Ok(file)
        });
        match made {
            Ok(file) => Ok(Self::on(path, file, shape, HEAD as u64)),
            Err(source) => Err(LogError::File { action: "write", path, source }),
        }
    }

    /// Goes on behind the last whole block that an earlier writer of the same run left. The rest after byte `from` (of
    /// [`RowWriter::bytes`], when everything before it had been written) is handed to `each`. Where that writer was killed before it had made its file,
    /// and `from` is 0, the file is made.
    ///
    /// # Errors
    /// When there is no such file and `from` is not 0, or it is not of this program's wire format.
    pub fn resume(folder: &Path, shape: &Shape, from: u64, each: impl FnMut(Vec<u64>)) -> Result<Self, LogError> {
        let has_head = std::fs::metadata(shape.path_in(folder)).is_ok_and(|file| file.len() >= HEAD as u64);
        if from == 0 && !has_head {
            return Self::create(folder, shape);
        }
        let mut kept = RowReader::open(folder, shape)?;
        kept.seek(from)?;
        std::iter::from_fn(|| kept.next_row().transpose()).collect::<Result<Vec<_>, _>>()?.into_iter().for_each(each);
        let (path, end) = (kept.path, kept.place);
        let opened = OpenOptions::new().write(true).open(&path).and_then(|mut file| {
            file.set_len(end)?;
            file.seek(SeekFrom::End(0))?;
            Ok(file)
        });
        match opened {
            Ok(file) => Ok(Self::on(path, file, shape, end)),
            Err(source) => Err(LogError::File { action: "write", path, source }),
        }
    }

    fn on(path: PathBuf, file: File, shape: &Shape, bytes: u64) -> Self {
        Self { path, file, packer: Packer::new(shape.words()), bytes }
    }

    /// Adds a message, stamps included.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, row: &[u64]) -> Result<(), LogError> {
        self.packer.add(row);
        if self.packer.len() < BLOCK { Ok(()) } else { self.write_block() }
    }

    /// Writes what has not been written yet; returns the size of the file in bytes.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(mut self) -> Result<u64, LogError> {
        self.flush()?;
        Ok(self.bytes)
    }

    /// Writes what has not been written yet, in a block that is shorter than usual.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn flush(&mut self) -> Result<(), LogError> {
        if self.packer.len() == 0 { Ok(()) } else { self.write_block() }
    }

    /// Bytes in the file so far.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    fn write_block(&mut self) -> Result<(), LogError> {
        let block = self.packer.pack();
        match self.file.write_all(block) {
            Ok(()) => {
                self.bytes += block.len() as u64;
                Ok(())
            }
            Err(source) => Err(LogError::File { action: "write", path: self.path.clone(), source }),
        }
    }
}

/// Reads the message log of a topic, in order.
pub struct RowReader {
    shape: Shape,
    path: PathBuf,
    file: BufReader<File>,
    /// Where the next block begins; bytes.
    place: u64,
    /// Words of the block in hand, and how many of them have been given out.
    block: (Vec<u64>, usize),
    packed: Vec<u8>,
}

impl RowReader {
    /// The file that [`RowWriter`] left in a folder.
    ///
    /// # Errors
    /// When there is none, or its messages are not this program's.
    pub fn open(folder: &Path, shape: &Shape) -> Result<Self, LogError> {
        let path = shape.path_in(folder);
        let mut found = [0; HEAD];
        let opened = File::open(&path).map(BufReader::new).and_then(|mut file| {
            let n = read_whole(&mut file, &mut found)?;
            Ok((file, n))
        });
        let (file, n) = match opened {
            Ok(opened) => opened,
            Err(source) => return Err(LogError::File { action: "read", path, source }),
        };
        if n < HEAD && shape.head().starts_with(&found[..n]) {
            return Err(LogError::Unbegun { path });
        }
        if n < HEAD || found[..8] != MAGIC {
            return Err(LogError::Damaged { path, reason: "its first bytes are not those of such a file".to_owned() });
        }
        if found != shape.head() {
            let mut theirs = [0; 8];
            theirs.copy_from_slice(&found[8..16]);
            return Err(LogError::WireFormat { path, found: u64::from_le_bytes(theirs), ours: shape.hash });
        }
        Ok(Self { path, file, place: HEAD as u64, block: Default::default(), packed: Vec::new(), shape: shape.clone() })
    }

    /// The next message; `None` after the last whole block.
    ///
    /// # Errors
    /// When the file cannot be read, or is damaged.
    pub fn next_row(&mut self) -> Result<Option<Vec<u64>>, LogError> {
        let words = self.shape.words();
        if self.block.1 >= self.block.0.len() {
            let Some(n) = self.read_block()? else { return Ok(None) };
            let damaged = |reason| LogError::Damaged { path: self.path.clone(), reason };
            self.block = (unpack(n, words, &self.packed).map_err(damaged)?, 0);
        }
        let (rows, begin) = &mut self.block;
        let row = rows.get(*begin..*begin + words).map(<[u64]>::to_vec);
        *begin += words;
        Ok(row)
    }

    /// Goes on at a byte at which a block begins.
    fn seek(&mut self, place: u64) -> Result<(), LogError> {
        let failed = |source| LogError::File { action: "read", path: self.path.clone(), source };
        self.file.seek(SeekFrom::Start(place.max(HEAD as u64))).map_err(failed)?;
        self.place = place.max(HEAD as u64);
        Ok(())
    }

    /// Reads the next block, still packed; returns how many messages it holds.
    fn read_block(&mut self) -> Result<Option<usize>, LogError> {
        let failed = |path: &Path, source| LogError::File { action: "read", path: path.to_owned(), source };
        let mut head = [0; BLOCK_HEAD];
        if read_whole(&mut self.file, &mut head).map_err(|source| failed(&self.path, source))? < head.len() {
            return Ok(None);
        }
        let number = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]) as usize;
        let (n, size) = (number(0), number(4));
        if n == 0 || n > BLOCK || size > get_maximum_output_size((n + 1) * self.shape.bytes) {
            let reason = format!("a block at byte {} claims {n} messages in {size} bytes", self.place);
            return Err(LogError::Damaged { path: self.path.clone(), reason });
        }
        self.packed.resize(size, 0);
        if read_whole(&mut self.file, &mut self.packed).map_err(|source| failed(&self.path, source))? < size {
            return Ok(None);
        }
        self.place += (head.len() + size) as u64;
        Ok(Some(n))
    }
}

/// Fills the buffer as far as the file goes.
fn read_whole(file: &mut impl Read, buffer: &mut [u8]) -> std::io::Result<usize> {
    let mut n = 0;
    while n < buffer.len() {
        match file.read(&mut buffer[n..]) {
            Ok(0) => break,
            Ok(more) => n += more,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(n)
}
