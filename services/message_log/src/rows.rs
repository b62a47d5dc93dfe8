//! Writing a message log: every message of a topic as it was on the wire, packed, so that a run can be compared, replayed or read by others.
//!
//! A file is a head and blocks ([`crate::head`], [`crate::block`]), which do not depend on each other: a killed writer takes with it what it had not written.

use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::block::{BLOCK, Packer};
use crate::error::LogError;
use crate::head::{self, BlockHead, FILE_HEAD, Identity};
use crate::logs::Logs;
use crate::reader::RowReader;
use crate::shape::{Place, Shape, tick_of};

/// Writes the message log of a topic, in a folder, as `TOPIC.log`: messages are rows of 64-bit words.
pub struct RowWriter {
    path: PathBuf,
    file: File,
    packer: Packer,
    identity: Identity,
    logs: Logs,
    place: Place,
    /// Tick of the first message that has been gathered.
    tick: u64,
}

impl RowWriter {
    /// An empty file in a folder, which is made if there is none.
    ///
    /// # Errors
    /// When the folder or the file cannot be made, or the run has no such log.
    pub fn create(folder: &Path, shape: &Shape, logs: &Logs) -> Result<Self, LogError> {
        let path = shape.path_in(folder);
        let identity = head::identity(logs, shape, &path)?;
        let made = std::fs::create_dir_all(folder)
            .and_then(|()| File::create(&path))
            .and_then(|mut file| {
                file.write_all(&identity.file_head(shape.bytes))?;
                Ok(file)
            });
        match made {
            Ok(file) => Ok(Self::on(
                path,
                file,
                shape,
                identity,
                logs,
                Place {
                    byte: FILE_HEAD as u64,
                    messages: 0,
                },
            )),
            Err(source) => Err(LogError::File {
                action: "write",
                path,
                source,
            }),
        }
    }

    /// Goes on behind the last whole block that an earlier writer of the same run left. The rest after a place (of [`RowWriter::place`], when everything
    /// before it had been written) is handed to `each`. Where that writer was killed before it had made its file, and the place is the beginning, the
    /// file is made.
    ///
    /// # Errors
    /// When there is no such file and the place is not the beginning, when it is of another run or not of this program's wire format, or damaged behind
    /// the place.
    pub fn resume(
        folder: &Path,
        shape: &Shape,
        logs: &Logs,
        from: Place,
        each: impl FnMut(Vec<u64>),
    ) -> Result<Self, LogError> {
        let has_head = std::fs::metadata(shape.path_in(folder))
            .is_ok_and(|file| file.len() >= FILE_HEAD as u64);
        if from.byte == 0 && !has_head {
            return Self::create(folder, shape, logs);
        }
        let mut kept = RowReader::open_behind(folder, shape, logs, from)?;
        std::iter::from_fn(|| kept.next_row().transpose())
            .collect::<Result<Vec<_>, _>>()?
            .into_iter()
            .for_each(each);
        let (identity, end, path) = (kept.identity(), kept.end(), kept.into_path());
        let opened = OpenOptions::new()
            .write(true)
            .open(&path)
            .and_then(|mut file| {
                file.set_len(end.byte)?;
                file.seek(SeekFrom::End(0))?;
                Ok(file)
            });
        match opened {
            Ok(file) => Ok(Self::on(path, file, shape, identity, logs, end)),
            Err(source) => Err(LogError::File {
                action: "write",
                path,
                source,
            }),
        }
    }

    fn on(
        path: PathBuf,
        file: File,
        shape: &Shape,
        identity: Identity,
        logs: &Logs,
        place: Place,
    ) -> Self {
        logs.set_written(usize::from(identity.log), place.messages);
        Self {
            path,
            file,
            packer: Packer::new(shape.words(), identity.block_head()),
            identity,
            logs: logs.clone(),
            place,
            tick: 0,
        }
    }

    /// Adds a message, stamps included.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, row: &[u64]) -> Result<(), LogError> {
        if self.packer.len() == 0 {
            self.tick = tick_of(row);
        }
        self.packer.add(row);
        if self.packer.len() < BLOCK {
            Ok(())
        } else {
            self.write_block()
        }
    }

    /// Ends the log, when every log of the run has been [flushed](Self::flush): one with this end lacks nothing of what its writer was given. Returns the
    /// size of the file in bytes.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(mut self) -> Result<u64, LogError> {
        self.flush()?;
        self.write_block()?;
        Ok(self.place.byte)
    }

    /// Writes what has not been written yet, in a block that is shorter than usual.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn flush(&mut self) -> Result<(), LogError> {
        if self.packer.len() == 0 {
            Ok(())
        } else {
            self.write_block()
        }
    }

    /// Bytes and messages in the file so far.
    #[must_use]
    pub fn place(&self) -> Place {
        self.place
    }

    fn write_block(&mut self) -> Result<(), LogError> {
        let Self {
            path,
            file,
            packer,
            identity,
            logs,
            place,
            tick,
        } = self;
        let tick = if packer.len() == 0 { 0 } else { *tick };
        let (block, messages) = if packer.len() == 0 {
            (packer.end(), 0)
        } else {
            packer.pack()
        };
        BlockHead::write(*identity, messages, (place.messages, tick), logs, block);
        match file.write_all(block) {
            Ok(()) => {
                *place = Place {
                    byte: place.byte + block.len() as u64,
                    messages: place.messages + messages as u64,
                };
                logs.set_written(usize::from(identity.log), place.messages);
                Ok(())
            }
            Err(source) => Err(LogError::File {
                action: "write",
                path: path.clone(),
                source,
            }),
        }
    }
}
