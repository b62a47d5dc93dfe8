//! Why a message log cannot be written or read, and the ways in which it is not what was written.

use std::io::ErrorKind;
use std::path::PathBuf;

/// A place of a log that is not as it was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Defect {
    /// Bytes have changed.
    Damaged,
    /// Blocks are not there.
    Missing,
    /// A block holds messages that another one holds.
    Repeated,
    /// A block stands behind one that was written after it. Its messages are read in their place.
    Displaced,
    /// A block is of another run.
    OtherRun,
    /// A block is of another log of the run.
    OtherLog,
}

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
    /// The run has no such topic.
    #[error("the message log {path} cannot be: the run has no topic {topic:?}")]
    Unlisted {
        /// Which.
        path: PathBuf,
        /// Its topic.
        topic: String,
    },
    /// It was written by a program with other messages.
    #[error(
        "the messages in {path} have the wire format {found:016x}, this program has {ours:016x}: use the program that made the run"
    )]
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
    /// The whole file is of another run.
    #[error("{path} is the message log of another run")]
    OtherRun {
        /// Which.
        path: PathBuf,
    },
    /// The whole file is another log of the run.
    #[error("{path} is another message log of its run, renamed")]
    OtherLog {
        /// Which.
        path: PathBuf,
    },
    /// A place of it is not as it was written; the reader goes on behind it.
    #[error("{path} is damaged: {reason}")]
    Place {
        /// Which.
        path: PathBuf,
        /// The kind.
        defect: Defect,
        /// In words.
        reason: String,
        /// Messages that are lost there, as far as the blocks around it tell.
        lost: u64,
        /// Tick of the first message of the block, where it is known.
        tick: Option<u64>,
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
        matches!(
            self,
            Self::Damaged { .. }
                | Self::OtherRun { .. }
                | Self::OtherLog { .. }
                | Self::Place { .. }
        )
    }

    /// Whether no message can have been written: there is no log, or only the beginning of its head.
    #[must_use]
    pub fn is_before_the_first_message(&self) -> bool {
        self.is_absent() || matches!(self, Self::Unbegun { .. })
    }
}
