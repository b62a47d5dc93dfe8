//! Where a recording goes, and why it may not get there.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

/// Where a recording goes: bytes that can be cut back.
pub trait Storage: Write + Send {
    /// Cuts to `bytes` and continues there.
    ///
    /// # Errors
    /// The medium's own errors.
    fn cut(&mut self, bytes: u64) -> io::Result<()>;

    /// Makes everything written durable.
    ///
    /// # Errors
    /// The medium's own errors.
    fn sync(&mut self) -> io::Result<()>;
}

impl Storage for File {
    fn cut(&mut self, bytes: u64) -> io::Result<()> {
        self.set_len(bytes)?;
        self.seek(SeekFrom::Start(bytes)).map(drop)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// Why a recording could not be made, or ended before its run; a file that exists is readable up to its last byte.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file could not be made.
    #[error(
        "cannot create the recording {path}: {source}; choose another folder with --out, or run with --no-record"
    )]
    Create {
        /// The file.
        path: String,
        /// The system's error.
        source: io::Error,
    },
    /// The arm cannot be drawn: its model does not fit.
    #[error("cannot record the robot {robot}: {reason}")]
    Arm {
        /// The robot's name.
        robot: String,
        /// The model's error.
        reason: String,
    },
    /// The volume refused a write.
    #[error("the recording {}: {source}{}. {}, choose another folder with --out, or run with --no-record", ends(*bytes), kept(*bytes), remedy(source))]
    Write {
        /// Bytes kept.
        bytes: u64,
        /// The system's error.
        source: io::Error,
    },
    /// There is no room to write a part anew with its table of contents.
    #[error("there is no room for a second copy of it: {source}; it is readable as it is")]
    Anew {
        /// The system's error.
        source: io::Error,
    },
    /// A chunk could not be built or encoded: a defect of ours.
    #[error(
        "the recording ends early because a chunk could not be encoded: {reason}; please report this"
    )]
    Encode {
        /// Bytes kept.
        bytes: u64,
        /// The defect.
        reason: String,
    },
}

impl RecordError {
    /// The same where so many bytes of the recording can be read, all of its parts together.
    #[must_use]
    pub fn keeping(mut self, kept: u64) -> Self {
        if let Self::Write { bytes, .. } | Self::Encode { bytes, .. } = &mut self {
            *bytes = kept;
        }
        self
    }
}

/// Without the number of bytes: the file gets its end, and may get a table of contents, after this.
fn ends(bytes: u64) -> &'static str {
    if bytes == 0 {
        "cannot begin"
    } else {
        "ends early"
    }
}

fn kept(bytes: u64) -> &'static str {
    if bytes == 0 {
        ""
    } else {
        "; what came before is kept and readable"
    }
}

fn remedy(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::FileTooLarge => {
            "Raise the shell's limit on the size of files with `ulimit -f unlimited`"
        }
        _ => "Free space there",
    }
}
