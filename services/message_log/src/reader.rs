//! Reading a message log: its blocks in the order in which they were written, and every place that is not as it was written.

use std::collections::VecDeque;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::block::unpack;
use crate::error::{Defect, LogError};
use crate::head::{self, FILE_HEAD, Identity, MAGIC};
use crate::logs::Logs;

use crate::scan::{Bytes, Entry, Flaw, Scan, StoredBlock, scan};
use crate::shape::{Place, Shape};

/// Reads the message log of a topic, in order.
///
/// The heads of all blocks are read first: they tell which messages each block holds. Blocks that are not in their place are read in it, those that are
/// there twice once, those of other logs not at all; an error names each of these places, and each that is damaged or at which blocks are missing, and the
/// reader goes on behind it.
pub struct RowReader {
    shape: Shape,
    path: PathBuf,
    bytes: Bytes,
    identity: Identity,
    entries: VecDeque<Entry>,
    tail: Vec<Flaw>,
    known: Vec<u64>,
    /// Messages that the log had, as far as is known.
    total: u64,
    end: Place,
    is_ended: bool,
    /// Words of the block in hand, and how many of them have been given out.
    block: (Vec<u64>, usize),
    packed: Vec<u8>,
}

impl RowReader {
    /// The file that [`RowWriter`](crate::RowWriter) left in a folder, whatever run it is of.
    ///
    /// # Errors
    /// When there is none, or its messages are not this program's.
    pub fn open(folder: &Path, shape: &Shape) -> Result<Self, LogError> {
        Self::open_at(folder, shape, None, Place::default())
    }

    /// The log of a run.
    ///
    /// # Errors
    /// When there is none, when it is of another run, or its messages are not this program's.
    pub fn open_of(folder: &Path, shape: &Shape, logs: &Logs) -> Result<Self, LogError> {
        Self::open_at(folder, shape, Some(logs), Place::default())
    }

    /// The same from a place behind a block on.
    pub(crate) fn open_behind(
        folder: &Path,
        shape: &Shape,
        logs: &Logs,
        from: Place,
    ) -> Result<Self, LogError> {
        Self::open_at(folder, shape, Some(logs), from)
    }

    fn open_at(
        folder: &Path,
        shape: &Shape,
        logs: Option<&Logs>,
        from: Place,
    ) -> Result<Self, LogError> {
        let path = shape.path_in(folder);
        let bytes = match files::open(&path).and_then(Bytes::of) {
            Ok(bytes) => bytes,
            Err(source)
                if matches!(
                    source.kind(),
                    ErrorKind::InvalidInput | ErrorKind::IsADirectory
                ) =>
            {
                return Err(LogError::Damaged {
                    path,
                    reason: source.to_string(),
                });
            }
            Err(source) => {
                return Err(LogError::File {
                    action: "read",
                    path,
                    source,
                });
            }
        };
        let ours = logs
            .map(|logs| head::identity(logs, shape, &path))
            .transpose()?;
        let (identity, is_head_whole) = identity(&bytes, &path, shape, ours)?;
        let from = if from.byte == 0 {
            Place {
                byte: FILE_HEAD as u64,
                messages: 0,
            }
        } else {
            from
        };
        let scanned = scan(&bytes, from, identity, shape.bytes);
        let Scan {
            mut entries,
            tail,
            known,
            end,
            is_ended,
        } = scanned.map_err(|source| LogError::File {
            action: "read",
            path: path.clone(),
            source,
        })?;
        if !is_head_whole {
            entries.push_front(Entry::Flaw(Flaw::of(
                Defect::Damaged,
                "its first bytes are not what was written".to_owned(),
            )));
        }
        let total = known
            .get(usize::from(identity.log))
            .copied()
            .unwrap_or_default();
        let (block, packed) = Default::default();
        Ok(Self {
            shape: shape.clone(),
            path,
            bytes,
            identity,
            entries,
            tail,
            known,
            total,
            end,
            is_ended,
            block,
            packed,
        })
    }

    /// How many messages each log of the run had when a block of this one was written, at least; in the order of [`Logs`].
    #[must_use]
    pub fn known(&self) -> &[u64] {
        &self.known
    }

    /// How many messages it has had, as another log of its run tells: at its end the reader names those that are missing.
    pub fn expect(&mut self, messages: u64) {
        self.total = self.total.max(messages);
    }

    /// Whether its writer has ended it: it lacks nothing of what that was given.
    #[must_use]
    pub fn is_ended(&self) -> bool {
        self.is_ended
    }

    /// The place behind its last whole block.
    pub(crate) fn end(&self) -> Place {
        self.end
    }

    pub(crate) fn identity(&self) -> Identity {
        self.identity
    }

    pub(crate) fn into_path(self) -> PathBuf {
        self.path
    }

    /// The next message; `None` at the end.
    ///
    /// # Errors
    /// When the file cannot be read, or is not as it was written: the next call goes on behind that place.
    pub fn next_row(&mut self) -> Result<Option<Vec<u64>>, LogError> {
        let words = self.shape.words();
        loop {
            let (rows, begin) = &mut self.block;
            if let Some(row) = rows.get(*begin..*begin + words) {
                *begin += words;
                return Ok(Some(row.to_vec()));
            }
            match self.entries.pop_front() {
                Some(Entry::Block(block)) => self.block = (self.unpacked(&block)?, 0),
                Some(Entry::Flaw(flaw)) => return Err(self.place(flaw)),
                None => {
                    return self
                        .take_tail()
                        .map_or(Ok(None), |flaw| Err(self.place(flaw)));
                }
            }
        }
    }

    /// The next defect at the end.
    fn take_tail(&mut self) -> Option<Flaw> {
        let lost = self.total.saturating_sub(self.end.messages);
        // Named once.
        self.total = 0;
        match self.tail.is_empty() {
            true => (lost > 0).then(|| Flaw {
                lost,
                ..Flaw::of(
                    Defect::Missing,
                    format!("its last {lost} messages are missing"),
                )
            }),
            false => Some(Flaw {
                lost,
                ..self.tail.remove(0)
            }),
        }
    }

    fn place(
        &self,
        Flaw {
            defect,
            reason,
            lost,
            tick,
        }: Flaw,
    ) -> LogError {
        LogError::Place {
            path: self.path.clone(),
            defect,
            reason,
            lost,
            tick,
        }
    }

    /// The rows of a block.
    fn unpacked(&mut self, block: &StoredBlock) -> Result<Vec<u64>, LogError> {
        self.packed.resize(block.bytes, 0);
        let read = self.bytes.read(&mut self.packed, block.byte);
        let n = read.map_err(|source| LogError::File {
            action: "read",
            path: self.path.clone(),
            source,
        })?;
        let is_whole = n == block.bytes && crc32fast::hash(&self.packed) == block.checksum;
        let rows = if is_whole {
            unpack(block.messages, self.shape.words(), &self.packed)
        } else {
            Err("its checksum differs".to_owned())
        };
        rows.map_err(|reason| {
            let reason = format!(
                "the block at byte {} is not what was written: {reason}",
                block.byte
            );
            self.place(Flaw {
                defect: Defect::Damaged,
                reason,
                lost: block.messages as u64,
                tick: Some(block.tick),
            })
        })
    }
}

/// The identity of a log from the head of its file, and whether that is as it was written. Where it is not, the first block tells.
fn identity(
    bytes: &Bytes,
    path: &Path,
    shape: &Shape,
    ours: Option<Identity>,
) -> Result<(Identity, bool), LogError> {
    let (path, mut head) = (path.to_owned(), [0; FILE_HEAD]);
    let n = match bytes.read(&mut head, 0) {
        Ok(n) => n,
        Err(source) => {
            return Err(LogError::File {
                action: "read",
                path,
                source,
            });
        }
    };
    if n < FILE_HEAD {
        let begun = Identity {
            run: 0,
            log: 0,
            logs: 0,
            layout: shape.hash,
        }
        .file_head(shape.bytes);
        let is_prefix = ours.map_or_else(
            || begun[..20].starts_with(&head[..n.min(20)]),
            |ours| ours.file_head(shape.bytes).starts_with(&head[..n]),
        );
        return Err(match is_prefix {
            true => LogError::Unbegun { path },
            false => LogError::Damaged {
                path,
                reason: "its first bytes are not those of such a file".to_owned(),
            },
        });
    }
    let of_file = Identity::of_file(&head).filter(|_| head[..8] == MAGIC);
    let Some((found, message_bytes)) = of_file else {
        if let Some(ours) = ours.filter(|ours| {
            bytes
                .block_head(FILE_HEAD as u64, *ours, shape.bytes)
                .is_ok_and(|block| block.is_some_and(|block| block.is_of(*ours)))
        }) {
            return Ok((ours, false));
        }
        let reason = match () {
            () if head[..7] != MAGIC[..7] => "its first bytes are not those of such a file",
            () if head[7] != MAGIC[7] => "another version of armplane packed it",
            () => "its first bytes are not what was written",
        };
        return Err(LogError::Damaged {
            path,
            reason: reason.to_owned(),
        });
    };
    if let Some(ours) = ours {
        if found.run != ours.run {
            return Err(LogError::OtherRun { path });
        }
        if (found.log, found.logs) != (ours.log, ours.logs) {
            return Err(LogError::OtherLog { path });
        }
    }
    if found.layout != shape.hash {
        return Err(LogError::WireFormat {
            path,
            found: found.layout,
            ours: shape.hash,
        });
    }
    if message_bytes != shape.bytes {
        return Err(LogError::Damaged {
            path,
            reason: "its first bytes are not what was written".to_owned(),
        });
    }
    Ok((found, true))
}
