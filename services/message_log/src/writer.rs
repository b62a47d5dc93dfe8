//! Writes a message log: every message of a run, byte for byte.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::BLOCK;
use crate::block::{Block, Blocks, Found, Packer};
use crate::contents::{Contents, tick_of};
use crate::error::LogError;
use crate::reader::Log;
use crate::record::{
    CHUNK_INDEX, DATA_END, FOOTER, MAGIC, STATISTICS, numbers, record, sized, text,
};

/// Bytes of a chunk, about.
const CHUNK: usize = 256 << 10;

/// A place behind a whole block: byte, and messages of each topic before it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Bytes of the file before it.
    pub bytes: u64,
    /// Messages before it, by channel.
    pub messages: Vec<u64>,
}

/// Writes the message log of a run.
pub struct Writer {
    path: PathBuf,
    file: File,
    contents: Contents,
    packer: Packer,
    place: Place,
    begun: u64,
}

impl Writer {
    /// An empty file.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn create(path: &Path, contents: &Contents) -> Result<Self, LogError> {
        let head = contents.head();
        let made = files::create(path).and_then(|mut file| {
            file.write_all(&head)?;
            Ok(file)
        });
        let place = Place {
            bytes: head.len() as u64,
            messages: vec![0; contents.layouts().len()],
        };
        Ok(Self::on(
            path,
            made.map_err(LogError::file("write", path))?,
            contents,
            place,
        ))
    }

    /// Goes on behind the last whole block that an earlier writer of the run left. The messages behind a place (a [`Writer::place`] at which everything
    /// had been [flushed](Writer::flush)) are handed to `each`, with their channel. Where that writer was killed before it had made its file, and the place
    /// is the beginning, the file is made.
    ///
    /// # Errors
    /// When there is no such file and the place is not the beginning, when it is of another run or of another wire format, or damaged behind the place.
    pub fn resume(
        path: &Path,
        contents: &Contents,
        from: &Place,
        mut each: impl FnMut(usize, &[u8]),
    ) -> Result<Self, LogError> {
        let log = match Log::open_behind(path, contents, from) {
            Err(error) if error.is_before_the_first_message() && from.bytes == 0 => {
                return Self::create(path, contents);
            }
            opened => opened?,
        };
        if let Some(flaw) = log.flaws().first() {
            let reason = format!("{:?} behind byte {}", flaw.defect, from.bytes);
            return Err(LogError::damaged(path, &reason));
        }
        for block in 0..log.blocks() {
            let chunk = log.chunk(block)?;
            for channel in 0..contents.layouts().len() {
                chunk
                    .messages(channel)
                    .for_each(|message| each(channel, message));
            }
        }
        let place = log.end();
        let cut = files::amend(path).and_then(|file| {
            file.set_len(place.bytes)?;
            Ok(file)
        });
        let mut writer = Self::on(
            path,
            cut.map_err(LogError::file("write", path))?,
            contents,
            place,
        );
        writer.rewind()?;
        Ok(writer)
    }

    fn on(path: &Path, file: File, contents: &Contents, place: Place) -> Self {
        Self {
            path: path.to_owned(),
            file,
            packer: Packer::new(contents.layouts().len()),
            contents: contents.clone(),
            place,
            begun: 0,
        }
    }

    /// Adds a message, stamps included, of the size of its channel.
    ///
    /// # Errors
    /// When the file cannot be written: then it ends with the last whole block.
    pub fn add(&mut self, channel: usize, message: &[u8]) -> Result<(), LogError> {
        let number = self.place.messages[channel] + self.packer.messages_of(channel);
        let time_ns = self.contents.time_ns(tick_of(message));
        self.packer.add(channel, number, time_ns, message);
        if self.packer.bytes() < CHUNK {
            Ok(())
        } else {
            self.flush()
        }
    }

    /// All messages that were there have been added, when so many ticks had begun: no topic keeps a block's messages in memory.
    ///
    /// # Errors
    /// See [`Writer::add`].
    pub fn end_round(&mut self, begun: u64) -> Result<(), LogError> {
        self.begun = begun;
        let has_block = |channel| self.packer.messages_of(channel) >= BLOCK as u64;
        if (0..self.place.messages.len()).any(has_block) {
            self.flush()
        } else {
            Ok(())
        }
    }

    /// Writes the pending messages.
    ///
    /// # Errors
    /// See [`Writer::add`].
    pub fn flush(&mut self) -> Result<(), LogError> {
        if self.packer.bytes() == 0 {
            Ok(())
        } else {
            self.write_block()
        }
    }

    fn write_block(&mut self) -> Result<(), LogError> {
        let channels = 0..self.place.messages.len();
        let after: Vec<u64> = channels
            .map(|channel| self.place.messages[channel] + self.packer.messages_of(channel))
            .collect();
        let packed = self
            .packer
            .pack(&self.contents, self.begun, &self.place.messages);
        let written = packed.and_then(|block| {
            self.file.write_all(block)?;
            Ok(block.len() as u64)
        });
        match written {
            Ok(bytes) => {
                self.place.bytes += bytes;
                self.place.messages = after;
                Ok(())
            }
            Err(error) => {
                // What is whole shall be read by others, too, where there is room for the summary.
                if self.rewind().and_then(|()| self.write_tail()).is_err() {
                    let _ = self.rewind();
                }
                Err(LogError::file("write", &self.path)(error))
            }
        }
    }

    /// Cuts the file behind its last whole block.
    fn rewind(&mut self) -> Result<(), LogError> {
        self.file
            .set_len(self.place.bytes)
            .and_then(|()| self.file.seek(SeekFrom::End(0)))
            .map(drop)
            .map_err(LogError::file("write", &self.path))
    }

    fn write_tail(&mut self) -> Result<(), LogError> {
        let head = self.contents.head().len() as u64;
        let tail = files::open(&self.path)
            .and_then(Blocks::new)
            .and_then(|blocks| {
                let (mut list, mut at) = (Vec::new(), head);
                while at < self.place.bytes
                    && let Found::Whole(block) = blocks.at(at)?
                {
                    at += block.bytes;
                    list.push(block);
                }
                Ok(tail(&self.contents, at, &list))
            });
        tail.and_then(|tail| self.file.write_all(&tail))
            .map_err(LogError::file("write", &self.path))
    }

    /// Ends the log. A log with this end is complete. Returns the size of the file in bytes.
    ///
    /// # Errors
    /// See [`Writer::add`].
    pub fn finish(mut self) -> Result<u64, LogError> {
        self.flush()?;
        self.write_block()?;
        self.write_tail()?;
        self.bytes().map_err(LogError::file("write", &self.path))
    }

    /// The place behind the last block.
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// Bytes of the file.
    ///
    /// # Errors
    /// The system's.
    pub fn bytes(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }
}

/// Gives a log whose writer was killed its summary, so that other programs read it. One that is not as it was written stays as it is.
///
/// # Errors
/// When it cannot be read, or not be written.
pub fn complete(path: &Path, contents: &Contents) -> Result<(), LogError> {
    let log = Log::open(path, contents)?;
    if log.flaws().is_empty() && !log.has_tail() {
        let at = log.end().bytes;
        drop(log);
        let file = files::amend(path).map_err(LogError::file("write", path))?;
        let place = Place {
            bytes: at,
            messages: Vec::new(),
        };
        let mut writer = Writer::on(path, file, contents, place);
        writer.rewind()?;
        writer.write_tail()?;
    }
    Ok(())
}

/// The bytes of a file behind its blocks, which end at a place: the end of the data, and the summary.
pub(crate) fn tail(contents: &Contents, at: u64, blocks: &[Block]) -> Vec<u8> {
    let mut out = Vec::new();
    record(&mut out, DATA_END, |out| out.extend([0; 4]));
    let summary = out.len();
    contents.channels(&mut out);
    let chunks = || blocks.iter().filter(|block| !block.is_end());
    let topics = contents.layouts().len();
    let mut messages = vec![0; topics];
    for block in chunks() {
        messages
            .iter_mut()
            .zip(&block.messages)
            .for_each(|(sum, more)| *sum += more);
    }
    record(&mut out, STATISTICS, |out| {
        numbers(out, [messages.iter().sum()]);
        out.extend((topics as u16).to_le_bytes());
        for count in [topics, 0, 0, chunks().count()] {
            out.extend((count as u32).to_le_bytes());
        }
        let times = || chunks().flat_map(|block| block.times);
        let (first, last) = (times().min(), times().max());
        numbers(out, [first.unwrap_or(0), last.unwrap_or(0)]);
        by_channel(out, (1..).zip(messages));
    });
    for block in chunks() {
        let (indexes, length) = block.indexes();
        let [first, last] = block.times;
        record(&mut out, CHUNK_INDEX, |out| {
            numbers(out, [first, last, block.chunk_at, block.chunk]);
            by_channel(out, indexes.into_iter());
            numbers(out, [length]);
            text(out, crate::block::LZ4);
            numbers(out, [block.compressed(), block.uncompressed]);
        });
    }
    let begin = at + summary as u64;
    out.push(FOOTER);
    numbers(&mut out, [20, begin, 0]);
    // Of the summary up to here.
    let checksum = crc32fast::hash(&out[summary..]);
    out.extend(checksum.to_le_bytes());
    out.extend(MAGIC);
    out
}

/// A map from the identifiers of channels.
fn by_channel(out: &mut Vec<u8>, entries: impl Iterator<Item = (u16, u64)>) {
    sized(out, |out| {
        for (id, number) in entries {
            out.extend(id.to_le_bytes());
            numbers(out, [number]);
        }
    });
}
