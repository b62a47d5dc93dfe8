//! Reasons why a message log cannot be written or read, and kinds of damage.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// A place of a log that is not as it was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Defect {
    /// Bytes have changed.
    Damaged,
    /// Blocks are not there.
    Missing,
    /// A block holds messages that another one holds.
    Repeated,
    /// A block stands before one that was written before it. Its messages are read in their place.
    Displaced,
    /// A block is of another run.
    OtherRun,
}

/// Why a message log cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The operating system refuses.
    #[error("cannot {action} the message log {path}: {source}")]
    File {
        /// The operation.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It was written by a program with other messages.
    #[error(
        "the messages in {path} have the wire format {found:016x}, this program has {ours:016x}: use the program that made the run"
    )]
    WireFormat {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u64,
        /// This program's.
        ours: u64,
    },
    /// Its writer was killed while it made the file.
    #[error("the message log {path} has no message: its writer was killed before the first")]
    Unbegun {
        /// The file.
        path: PathBuf,
    },
    /// It is no message log, or no longer.
    #[error("{path} is damaged or is no message log: {reason}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The defect.
        reason: String,
    },
    /// All of it is of another run.
    #[error("{path} is the message log of another run")]
    OtherRun {
        /// The file.
        path: PathBuf,
    },
    /// Messages of a topic are lost at a place; the reader continues after it.
    #[error("{path} is damaged: {lost} messages of `{topic}` are lost ({defect:?})")]
    Lost {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// The kind.
        defect: Defect,
        /// Messages that are lost there.
        lost: u64,
    },
}

impl LogError {
    pub(crate) fn file(action: &'static str, path: &Path) -> impl Fn(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::File {
            action,
            path: path.clone(),
            source,
        }
    }

    pub(crate) fn damaged(path: &Path, reason: &dyn std::fmt::Display) -> Self {
        Self::Damaged {
            path: path.to_owned(),
            reason: reason.to_string(),
        }
    }

    /// Whether the file is damaged.
    pub fn is_damage(&self) -> bool {
        matches!(
            self,
            Self::Damaged { .. } | Self::OtherRun { .. } | Self::Lost { .. }
        )
    }

    /// Whether no message can have been written: there is no log, or only the beginning of its head.
    pub fn is_before_the_first_message(&self) -> bool {
        match self {
            Self::File { source, .. } => source.kind() == ErrorKind::NotFound,
            Self::Unbegun { .. } => true,
            _ => false,
        }
    }
}
