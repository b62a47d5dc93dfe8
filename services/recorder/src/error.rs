//! Why a record cannot be written or read.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use mcap::McapError;

/// Why a record cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The operating system refuses.
    #[error("cannot {action} the messages {path}: {source}")]
    File {
        /// The operation.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Its writer was killed while it made the file.
    #[error("{path} has no message: its writer was killed before the first")]
    Unbegun {
        /// The file.
        path: PathBuf,
    },
    /// It was written by a program with other messages.
    #[error(
        "the messages in {path} have another wire format than this program: use the program that made the run"
    )]
    WireFormat {
        /// The file.
        path: PathBuf,
    },
    /// It is of another run.
    #[error("{path} is the record of another run")]
    OtherRun {
        /// The file.
        path: PathBuf,
    },
    /// It is no record, or no longer.
    #[error("{path} is damaged or is no record of a run: {reason}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The defect.
        reason: String,
    },
}

impl RecordError {
    pub(crate) fn file(action: &'static str, path: &Path) -> impl Fn(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::File {
            action,
            path: path.clone(),
            source,
        }
    }

    pub(crate) fn write(path: &Path, error: McapError) -> Self {
        let source = match error {
            McapError::Io(source) => source,
            other => io::Error::other(other),
        };
        Self::file("write", path)(source)
    }

    pub(crate) fn damaged(path: &Path, reason: &dyn std::fmt::Display) -> Self {
        Self::Damaged {
            path: path.to_owned(),
            reason: reason.to_string(),
        }
    }

    /// Whether there is no record, or only the beginning of one.
    pub fn is_absent(&self) -> bool {
        match self {
            Self::File { source, .. } => source.kind() == ErrorKind::NotFound,
            Self::Unbegun { .. } => true,
            _ => false,
        }
    }
}
