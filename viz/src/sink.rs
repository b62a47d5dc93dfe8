//! Rerun's stream into a file that ends cleanly when its volume is full.
//!
//! Rerun's own file sink writes from a thread that returns on the first error, after which flushing waits for an answer that never
//! comes. This one keeps the first error, cuts the file back to its last whole message, and ignores what comes later.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use re_chunk::{Chunk, ChunkBatcherConfig, ChunkResult};
use re_log_encoding::{CrateVersion, EncodeError, Encoder, EncodingOptions, StreamHeader};
use re_log_types::external::re_tuid::Tuid;
use re_log_types::{
    BlueprintActivationCommand, LogMsg, SetStoreInfo, StoreId, StoreInfo, StoreSource,
};
use re_sdk::sink::{LogSink, SinkFlushError};
use re_sdk::{RecordingStream, RecordingStreamBuilder};

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

/// Keeps nothing.
impl Storage for io::Sink {
    fn cut(&mut self, _: u64) -> io::Result<()> {
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
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
    /// The volume refused a write. The number of bytes is not told: the file gets its end, and may get a table of contents, after this.
    #[error("the recording {}: {source}{}. {}, choose another folder with --out, or run with --no-record",
        if *bytes == 0 { "cannot begin" } else { "ends early" },
        if *bytes == 0 { "" } else { "; what came before is kept and readable" },
        match source.kind() {
            io::ErrorKind::FileTooLarge => "Raise the shell's limit on the size of files with `ulimit -f unlimited`",
            _ => "Free space there",
        })]
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

    fn defect(bytes: u64, reason: &dyn std::fmt::Display) -> Self {
        Self::Encode {
            bytes,
            reason: reason.to_string(),
        }
    }
}

/// Whole messages that wait for [`Write::flush`]: it writes all of them, or none.
struct Waiting {
    storage: Box<dyn Storage>,
    messages: Vec<u8>,
    written: u64,
}

impl Write for Waiting {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.messages.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let written = self.storage.write_all(&self.messages);
        let written = written.and_then(|()| self.storage.flush());
        match written {
            Ok(()) => self.written += self.messages.len() as u64,
            // The first error is the one to report, not the error of the cut.
            Err(_) => drop(self.storage.cut(self.written)),
        }
        self.messages.clear();
        written
    }
}

/// The file at the end of Rerun's stream.
struct Disk {
    /// `None` once closed.
    encoder: Option<Encoder<Waiting>>,
    bytes: u64,
    /// The error that closed it, until it is answered.
    error: Option<RecordError>,
}

impl Disk {
    fn attempt(&mut self, work: impl FnOnce(&mut Encoder<Waiting>) -> Result<u64, EncodeError>) {
        match self.encoder.as_mut().map(work) {
            None => {}
            Some(Ok(more)) => self.bytes += more,
            Some(Err(EncodeError::Write(source))) => {
                self.fail(|bytes| RecordError::Write { bytes, source })
            }
            Some(Err(defect)) => self.fail(|bytes| RecordError::defect(bytes, &defect)),
        }
    }

    /// Closes the file for good; the first error is the one to answer.
    fn fail(&mut self, error: impl FnOnce(u64) -> RecordError) {
        if self.encoder.is_some() {
            let _ = self.close();
            self.error = Some(error(self.bytes));
        }
    }

    /// Makes what is flushed durable.
    fn close(&mut self) -> io::Result<()> {
        let end = self.encoder.take().map(Encoder::into_inner);
        end.and_then(Result::ok).map_or(Ok(()), |mut end| {
            self.bytes = end.written;
            end.storage.sync()
        })
    }
}

/// The disk, as Rerun's thread has it.
#[derive(Clone)]
struct Shared(Arc<Mutex<Disk>>);

impl Shared {
    fn disk(&self) -> MutexGuard<'_, Disk> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LogSink for Shared {
    fn send(&self, message: LogMsg) {
        self.disk().attempt(|encoder| encoder.append(&message));
    }

    fn flush_blocking(&self, _: Duration) -> Result<(), SinkFlushError> {
        self.disk()
            .attempt(|encoder| encoder.flush_blocking().map(|()| 0));
        Ok(())
    }
}

/// A recording's stream into a file. What is logged into it is written at the next [`flush`](Self::flush), a chunk for each entity.
pub(crate) struct Sink {
    pub(crate) stream: RecordingStream,
    shared: Shared,
}

impl Sink {
    /// Starts a file.
    pub(crate) fn new(storage: Box<dyn Storage>, store: &StoreId) -> Result<Self, RecordError> {
        let waiting = Waiting {
            storage,
            messages: Vec::new(),
            written: 0,
        };
        let options = EncodingOptions::PROTOBUF_COMPRESSED;
        let encoder = Encoder::new_eager(CrateVersion::LOCAL, options, waiting);
        let shared = Shared(Arc::new(Mutex::new(Disk {
            encoder: Some(encoder.map_err(|error| RecordError::defect(0, &error))?),
            bytes: StreamHeader::ENCODED_SIZE_BYTES as u64,
            error: None,
        })));
        // Alone: whatever comes of the rest, this is a stream.
        let _ = shared.flush_blocking(Duration::MAX);
        let stream = RecordingStreamBuilder::from_store_id(store)
            .enabled(true)
            .send_properties(false)
            .store_source(source())
            .batcher_config(ChunkBatcherConfig::NEVER)
            .buffered()
            .map_err(|error| RecordError::defect(0, &error))?;
        stream.set_log_tick_enabled(false);
        stream.set_log_time_enabled(false);
        stream.set_sink(Box::new(shared.clone()));
        let mut sink = Self { stream, shared };
        sink.flush();
        sink.check().map(|()| sink)
    }

    /// Adds a blueprint, which is complete then and shall be shown. All that has been logged before comes before it.
    pub(crate) fn send_blueprint(
        &self,
        store: &StoreId,
        chunks: impl IntoIterator<Item = ChunkResult<Chunk>>,
    ) {
        self.flush();
        let info = LogMsg::SetStoreInfo(SetStoreInfo {
            row_id: Tuid::new(),
            info: StoreInfo::new(store.clone(), source()),
        });
        let chunks = chunks.into_iter().map(|chunk| {
            let message = chunk.and_then(|chunk| chunk.to_arrow_msg())?;
            Ok(LogMsg::ArrowMsg(store.clone(), message))
        });
        let messages: ChunkResult<Vec<_>> = std::iter::once(Ok(info)).chain(chunks).collect();
        let activation = BlueprintActivationCommand {
            blueprint_id: store.clone(),
            make_active: true,
            make_default: true,
        };
        self.done(messages.map(|messages| self.stream.send_blueprint(messages, activation)));
        self.flush();
    }

    /// Writes what has been logged: from then on it outlives the process.
    pub(crate) fn flush(&self) {
        self.done(self.stream.flush_blocking());
    }

    /// Ends the file where something could not be logged.
    pub(crate) fn done<E: std::fmt::Display>(&self, done: Result<(), E>) {
        if let Err(defect) = done {
            self.shared
                .disk()
                .fail(|bytes| RecordError::defect(bytes, &defect));
        }
    }

    /// Size so far; bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.shared.disk().bytes
    }

    /// Whether the file has ended.
    pub(crate) fn is_closed(&self) -> bool {
        self.shared.disk().encoder.is_none()
    }

    /// The error that closed the file, once.
    pub(crate) fn check(&mut self) -> Result<(), RecordError> {
        self.shared.disk().error.take().map_or(Ok(()), Err)
    }

    /// Ends the file with its footer, which a reader that seeks needs, and makes it durable; where the footer does not fit, the file ends without one,
    /// after its last whole message. Returns the size.
    pub(crate) fn finish(&mut self) -> Result<u64, RecordError> {
        self.flush();
        let mut disk = self.shared.disk();
        disk.attempt(|encoder| encoder.finish().map(|()| 0));
        disk.attempt(|encoder| encoder.flush_blocking().map(|()| 0));
        if let Err(source) = disk.close() {
            let bytes = disk.bytes;
            disk.error
                .get_or_insert(RecordError::Write { bytes, source });
        }
        drop(disk);
        self.check().map(|()| self.bytes())
    }
}

fn source() -> StoreSource {
    StoreSource::Other(concat!("armplane ", env!("CARGO_PKG_VERSION")).into())
}
