//! A message log: every message of a topic as it was on the wire, packed, so that a run can be compared, replayed or read by others.
//!
//! ```text
//! file     "armkept\x03" · layout hash u64 · bytes of a message u32 · 0 u32 · blocks
//! ```
//!
//! All integers little-endian. Blocks ([`crate::block`]) do not depend on each other: what a killed writer XX

use std::fs::{File, OpenOptions};
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use shared_types::Message;
use shared_types::layout::MessageLayout;

use crate::block::{self, BLOCK, Head, Packer, unpack};

const MAGIC: [u8; 8] = *b"armkept\x03";
const HEAD: usize = 24;
/// Bytes that are searched for a whole block at a time, at least.
const WINDOW: usize = 1 << 20;

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

    /// Whether the file is not what was written.
    #[must_use]
    pub fn is_damage(&self) -> bool {
        matches!(self, Self::Damaged { .. })
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

/// Gives every block of a whole file's bytes the checksum of what it holds; for tests, which change blocks.
pub fn seal(file: &mut [u8]) {
    let mut rest = file.get_mut(HEAD..).unwrap_or_default();
    while let Some(head) = rest.first_chunk().map(|head| Head::from(*head)) {
        let end = Head::BYTES + head.rest();
        let Some((block, behind)) = std::mem::take(&mut rest).split_at_mut_checked(end) else { return };
        block::seal(block);
        rest = behind;
    }
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
        // To open a pipe is to wait for its writer.
        if std::fs::metadata(&path).is_ok_and(|file| !file.is_file()) {
            return Err(LogError::Damaged { path, reason: "it is no file".to_owned() });
        }
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
            let is_other = n == HEAD && found[..7] == MAGIC[..7];
            let reason = if is_other { "another version of armplane packed it" } else { "its first bytes are not those of such a file" };
            return Err(LogError::Damaged { path, reason: reason.to_owned() });
        }
        let mut theirs = [0; 8];
        theirs.copy_from_slice(&found[8..16]);
        let theirs = u64::from_le_bytes(theirs);
        if theirs != shape.hash {
            return Err(LogError::WireFormat { path, found: theirs, ours: shape.hash });
        }
        if found != shape.head() {
            return Err(LogError::Damaged { path, reason: "its first bytes are not what was written".to_owned() });
        }
        Ok(Self { path, file, place: HEAD as u64, block: Default::default(), packed: Vec::new(), shape: shape.clone() })
    }

    /// The next message; `None` after the last whole block.
    ///
    /// # Errors
    /// When the file cannot be read, or is damaged: [`RowReader::skip`] goes on behind the damage.
    pub fn next_row(&mut self) -> Result<Option<Vec<u64>>, LogError> {
        let words = self.shape.words();
        if self.block.1 >= self.block.0.len() {
            let Some(head) = self.read_block()? else { return Ok(None) };
            let rows = unpack(head, words, &self.packed[Head::BYTES..]).map_err(|reason| self.damaged(&reason))?;
            self.place += self.packed.len() as u64;
            self.block = (rows, 0);
        }
        let (rows, begin) = &mut self.block;
        let row = rows.get(*begin..*begin + words).map(<[u64]>::to_vec);
        *begin += words;
        Ok(row)
    }

    /// Goes on at the next whole block behind the place where the file is damaged; whether there is one.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn skip(&mut self) -> Result<bool, LogError> {
        let next = self.find_block(self.place + 1)?;
        let is_found = next.is_some();
        let end = self.file.get_ref().metadata().map_or(self.place, |file| file.len());
        self.seek(next.unwrap_or(end))?;
        Ok(is_found)
    }

    /// Goes on at a byte at which a block begins.
    fn seek(&mut self, place: u64) -> Result<(), LogError> {
        self.place = place.max(HEAD as u64);
        self.file.seek(SeekFrom::Start(self.place)).map_err(|source| self.unread(source))?;
        Ok(())
    }

    fn unread(&self, source: std::io::Error) -> LogError {
        LogError::File { action: "read", path: self.path.clone(), source }
    }

    fn damaged(&self, reason: &str) -> LogError {
        LogError::Damaged { path: self.path.clone(), reason: format!("the block at byte {} is not what was written: {reason}", self.place) }
    }

    /// Reads the block at the reader's place, still packed, head included. A beginning of one that no whole block follows is what a killed writer has
    /// left.
    fn read_block(&mut self) -> Result<Option<Head>, LogError> {
        let mut head = [0; Head::BYTES];
        if read_whole(&mut self.file, &mut head).map_err(|source| self.unread(source))? < head.len() {
            return Ok(None);
        }
        let block = Head::from(head);
        if !block.is_possible(self.shape.bytes) {
            let Head { messages, packed, plain, .. } = block;
            return Err(self.damaged(&format!("it claims {messages} messages in {packed} bytes and {plain} plain planes")));
        }
        self.packed.resize(Head::BYTES + block.rest(), 0);
        self.packed[..Head::BYTES].copy_from_slice(&head);
        if read_whole(&mut self.file, &mut self.packed[Head::BYTES..]).map_err(|source| self.unread(source))? < block.rest() {
            return match self.find_block(self.place + 1)? {
                Some(_) => Err(self.damaged("its end is missing")),
                None => Ok(None),
            };
        }
        if block.has_checksum_of(&self.packed) { Ok(Some(block)) } else { Err(self.damaged("its checksum differs")) }
    }

    /// The first byte from `from` on at which a whole block begins.
    fn find_block(&mut self, from: u64) -> Result<Option<u64>, LogError> {
        let longest = block::longest(self.shape.bytes);
        let mut window = vec![0; WINDOW.max(2 * longest)];
        let mut begin = from;
        loop {
            self.file.seek(SeekFrom::Start(begin)).map_err(|source| self.unread(source))?;
            let n = read_whole(&mut self.file, &mut window).map_err(|source| self.unread(source))?;
            let is_last = n < window.len();
            // Beyond these a block could end behind the window.
            let places = if is_last { n } else { n - longest };
            if let Some(at) = (0..places).find(|at| block::begins_whole(&window[*at..n], self.shape.bytes)) {
                return Ok(Some(begin + at as u64));
            }
            if is_last {
                return Ok(None);
            }
            begin += places as u64;
        }
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
