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
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use lz4_flex::block::{CompressTable, compress_into_with_table, decompress_into, get_maximum_output_size};
use shared_types::Message;

const MAGIC: [u8; 8] = *b"armkept\x02";
const HEAD: usize = 24;
/// Messages in a block: what a killed writer takes with it. Its replacement finds them in the keeper of the topic, which holds far more.
const BLOCK: usize = 128;
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
    #[error("the messages in {path} have the wire format {found:016x}, this program speaks {ours:016x}: use the program that made the run")]
    WireFormat {
        /// Which.
        path: PathBuf,
        /// The file's.
        found: u64,
        /// This program's.
        ours: u64,
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
}

fn path_in<M: Message>(folder: &Path) -> PathBuf {
    folder.join(format!("{}.log", M::TOPIC))
}

fn head<M: Message>() -> [u8; HEAD] {
    let mut head = [0; HEAD];
    head[..8].copy_from_slice(&MAGIC);
    head[8..16].copy_from_slice(&M::layout_hash().to_le_bytes());
    head[16..20].copy_from_slice(&(size_of::<M>() as u32).to_le_bytes());
    head
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
    fn new<M: Message>() -> Self {
        const { assert!(size_of::<M>().is_multiple_of(8), "messages are rows of 64-bit words") };
        let words = size_of::<M>() / 8;
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
    fn add<M: Message>(&mut self, message: &M) {
        let row: &[u64] = bytemuck::cast_slice(std::slice::from_ref(message));
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
        for (word, any) in any.iter().enumerate().filter(|(_, any)| **any != 0) {
            column.iter_mut().zip(folded[word..].iter().step_by(*words)).for_each(|(to, from)| *to = *from);
            for byte in any.to_le_bytes().into_iter().enumerate().filter_map(|(byte, part)| (part != 0).then_some(byte)) {
                planes[word] |= 1 << byte;
                planes.extend(column[..n].iter().map(|value| (value >> (8 * byte)) as u8));
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

/// The inverse of [`Packer::pack`], of what follows a block's head, onto the end of `messages`.
fn unpack<M: Message>(n: usize, packed: &[u8], messages: &mut Vec<M>) -> Result<(), String> {
    let words = size_of::<M>() / 8;
    let mut unpacked = vec![0; words + n * size_of::<M>()];
    let size = decompress_into(packed, &mut unpacked).map_err(|error| error.to_string())?;
    let (present, planes) = unpacked.split_at(words);
    let expected = words + n * present.iter().map(|byte| byte.count_ones() as usize).sum::<usize>();
    if size != expected {
        return Err(format!("a block of {n} messages unpacks to {size} bytes and not to {expected}"));
    }
    let begin = messages.len();
    messages.resize(begin + n, M::zeroed());
    let rows: &mut [u64] = bytemuck::cast_slice_mut(&mut messages[begin..]);
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
    Ok(())
}

/// Writes the message log of a topic, in a folder, as `TOPIC.log`.
pub struct LogWriter<M> {
    path: PathBuf,
    file: File,
    packer: Packer,
    bytes: u64,
    _messages: PhantomData<M>,
}

impl<M: Message> LogWriter<M> {
    /// An empty file in a folder, which is made if there is none.
    ///
    /// # Errors
    /// When the folder or the file cannot be made.
    pub fn create(folder: &Path) -> Result<Self, LogError> {
        let path = path_in::<M>(folder);
        let made = std::fs::create_dir_all(folder).and_then(|()| File::create(&path)).and_then(|mut file| {
            file.write_all(&head::<M>())?;
            Ok(file)
        });
        match made {
            Ok(file) => Ok(Self::on(path, file, HEAD as u64)),
            Err(source) => Err(LogError::File { action: "write", path, source }),
        }
    }

    /// Goes on behind the last whole block that an earlier writer of the same run left. What follows after byte `from` (of
    /// [`LogWriter::bytes`], when everything before it had been written) is handed to `each`.
    ///
    /// # Errors
    /// When there is no such file, or it is not of this program's wire format.
    pub fn resume(folder: &Path, from: u64, each: impl FnMut(M)) -> Result<Self, LogError> {
        let mut kept = LogReader::<M>::open(folder)?;
        kept.seek(from)?;
        std::iter::from_fn(|| kept.next_message().transpose()).collect::<Result<Vec<_>, _>>()?.into_iter().for_each(each);
        let (path, end) = (kept.path, kept.place);
        let opened = OpenOptions::new().write(true).open(&path).and_then(|mut file| {
            file.set_len(end)?;
            file.seek(SeekFrom::End(0))?;
            Ok(file)
        });
        match opened {
            Ok(file) => Ok(Self::on(path, file, end)),
            Err(source) => Err(LogError::File { action: "write", path, source }),
        }
    }

    fn on(path: PathBuf, file: File, bytes: u64) -> Self {
        Self { path, file, packer: Packer::new::<M>(), bytes, _messages: PhantomData }
    }

    /// Adds a message, stamps included.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, message: &M) -> Result<(), LogError> {
        self.packer.add(message);
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
pub struct LogReader<M> {
    path: PathBuf,
    file: BufReader<File>,
    /// Where the next block begins; bytes.
    place: u64,
    block: std::vec::IntoIter<M>,
    packed: Vec<u8>,
    _messages: PhantomData<M>,
}

impl<M: Message> LogReader<M> {
    /// The file that [`LogWriter`] left in a folder.
    ///
    /// # Errors
    /// When there is none, or its messages are not this program's.
    pub fn open(folder: &Path) -> Result<Self, LogError> {
        let path = path_in::<M>(folder);
        let mut found = [0; HEAD];
        let opened = File::open(&path).map(BufReader::new).and_then(|mut file| {
            let n = read_whole(&mut file, &mut found)?;
            Ok((file, n))
        });
        let (file, n) = match opened {
            Ok(opened) => opened,
            Err(source) => return Err(LogError::File { action: "read", path, source }),
        };
        if n < HEAD || found[..8] != MAGIC {
            return Err(LogError::Damaged { path, reason: "its first bytes are not those of such a file".to_owned() });
        }
        if found != head::<M>() {
            let mut theirs = [0; 8];
            theirs.copy_from_slice(&found[8..16]);
            return Err(LogError::WireFormat { path, found: u64::from_le_bytes(theirs), ours: M::layout_hash() });
        }
        Ok(Self { path, file, place: HEAD as u64, block: Vec::new().into_iter(), packed: Vec::new(), _messages: PhantomData })
    }

    /// The next message; `None` after the last whole block.
    ///
    /// # Errors
    /// When the file cannot be read, or is damaged.
    pub fn next_message(&mut self) -> Result<Option<M>, LogError> {
        if let Some(message) = self.block.next() {
            return Ok(Some(message));
        }
        let Some(n) = self.read_block()? else { return Ok(None) };
        let mut messages = Vec::with_capacity(n);
        unpack(n, &self.packed, &mut messages).map_err(|reason| LogError::Damaged { path: self.path.clone(), reason })?;
        self.block = messages.into_iter();
        Ok(self.block.next())
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
        if n == 0 || n > BLOCK || size > get_maximum_output_size((n + 1) * size_of::<M>()) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{Layout, PlantState, SensorSample};
    use tempfile::TempDir;

    fn message(tick: u64) -> SensorSample {
        let mut message = SensorSample::default();
        message.header.tick = tick;
        message.header.stamps.sent_ns[0] = 1_000_000 * tick + tick % 7;
        message.q_encoder[2] = (0.1 * tick as f64).sin();
        message.tau_drive[5] = if tick.is_multiple_of(5) { f64::from_bits(0x7ff8_0000_0000_1234) } else { -0.0 };
        message.stale_ticks = u32::MAX - tick as u32;
        message
    }

    fn bytes_of(folder: &Path) -> Vec<Vec<u8>> {
        let mut kept = LogReader::<SensorSample>::open(folder).unwrap();
        std::iter::from_fn(|| kept.next_message().unwrap()).map(|message| bytemuck::bytes_of(&message).to_vec()).collect()
    }

    fn expected(n: u64) -> Vec<Vec<u8>> {
        (0..n).map(|tick| bytemuck::bytes_of(&message(tick)).to_vec()).collect()
    }

    #[test]
    fn what_is_kept_comes_back_byte_for_byte_in_less_room() {
        let run = TempDir::new().unwrap();
        let folder = run.path().join("messages");
        let n = 3 * BLOCK as u64 + 5;
        let mut keep = LogWriter::create(&folder).unwrap();
        (0..n).for_each(|tick| keep.add(&message(tick)).unwrap());
        let bytes = keep.finish().unwrap();
        assert_eq!(bytes, std::fs::metadata(folder.join("sensor.log")).unwrap().len());
        assert!(bytes < n * size_of::<SensorSample>() as u64 / 5, "{bytes} bytes for {n} messages");
        assert_eq!(bytes_of(&folder), expected(n));
    }

    #[test]
    fn a_torn_end_is_the_end_and_a_new_writer_goes_on_behind_it() {
        let run = TempDir::new().unwrap();
        let mut keep = LogWriter::create(run.path()).unwrap();
        (0..2 * BLOCK as u64).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.finish().unwrap();
        let path = run.path().join("sensor.log");
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 1]).unwrap();
        assert_eq!(bytes_of(run.path()), expected(BLOCK as u64));
        let mut left = Vec::new();
        let mut keep = LogWriter::resume(run.path(), 0, |message: SensorSample| left.push(message.header.tick)).unwrap();
        assert_eq!(left, (0..BLOCK as u64).collect::<Vec<_>>());
        let end = BLOCK as u64 + 36;
        (BLOCK as u64..end).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.flush().unwrap();
        let place = keep.bytes();
        (end..end + 3).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.flush().unwrap();
        left.clear();
        let keep = LogWriter::resume(run.path(), place, |message: SensorSample| left.push(message.header.tick)).unwrap();
        assert_eq!(left, [end, end + 1, end + 2]);
        keep.finish().unwrap();
        assert_eq!(bytes_of(run.path()), expected(end + 3));
    }

    #[test]
    fn files_that_are_not_ours_are_refused_and_never_believed() {
        let run = TempDir::new().unwrap();
        assert!(LogReader::<SensorSample>::open(run.path()).err().unwrap().is_absent());
        let mut keep = LogWriter::create(run.path()).unwrap();
        (0..10).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.finish().unwrap();
        let path = run.path().join("sensor.log");
        std::fs::copy(&path, run.path().join("plant_state.log")).unwrap();
        let error = LogReader::<PlantState>::open(run.path()).err().unwrap().to_string();
        let both = [SensorSample::layout_hash(), PlantState::layout_hash()].map(|hash| format!("{hash:016x}"));
        assert!(both.iter().all(|hash| error.contains(hash)), "{error}");
        let whole = std::fs::read(&path).unwrap();
        for (place, bit) in (0..whole.len()).flat_map(|place| [(place, 1), (place, 0x80)]) {
            let mut damaged = whole.clone();
            damaged[place] ^= bit;
            std::fs::write(&path, &damaged).unwrap();
            // Any answer but a crash: a flipped bit inside a number cannot be seen.
            if let Ok(mut kept) = LogReader::<SensorSample>::open(run.path()) {
                while let Ok(Some(_)) = kept.next_message() {}
            }
        }
    }
}
