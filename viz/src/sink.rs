//! An `.rrd` stream that ends cleanly when its volume does.
//!
//! Rerun's own file sink writes from a thread that returns on the first error, after which flushing waits for an answer that never
//! comes. This one writes where it is called: the first error is kept, the stream is cut back to its last whole message, and every
//! later call returns at once.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use re_chunk::{Chunk, ChunkResult};
use re_log_encoding::{CrateVersion, EncodeError, Encoder, EncodingOptions};
use re_log_types::external::re_tuid::Tuid;
use re_log_types::{BlueprintActivationCommand, LogMsg, SetStoreInfo, StoreId, StoreInfo, StoreSource};

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
    #[error("cannot create the recording {path}: {source}; choose another folder with --out, or run with --no-record")]
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
    #[error(
        "the recording ends after {bytes} bytes: {source}; what came before is kept and readable. Free space there, choose another folder with --out, or run with --no-record"
    )]
    Write {
        /// Bytes kept.
        bytes: u64,
        /// The system's error.
        source: io::Error,
    },
    /// A chunk could not be built or encoded: a defect of ours.
    #[error("the recording ends after {bytes} bytes because a chunk could not be encoded: {reason}; please report this")]
    Encode {
        /// Bytes kept.
        bytes: u64,
        /// The defect.
        reason: String,
    },
}

/// A finished recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FileInfo {
    /// Size; bytes.
    pub bytes: u64,
    /// Chunks of data.
    pub chunks: u64,
    /// Ticks recorded.
    pub ticks: u64,
    /// Files it is spread over.
    pub parts: u32,
}

/// Writes a whole message or, where the storage refuses, nothing. Rerun's encoder hands over one message per call.
struct Whole {
    storage: Box<dyn Storage>,
    /// Bytes of whole messages.
    bytes: Arc<AtomicU64>,
}

impl Write for Whole {
    fn write(&mut self, message: &[u8]) -> io::Result<usize> {
        let before = self.bytes.load(Ordering::Relaxed);
        if let Err(error) = self.storage.write_all(message) {
            // The first error is the one to report, not the error of the cut.
            let _ = self.storage.cut(before);
            return Err(error);
        }
        self.bytes.store(before + message.len() as u64, Ordering::Relaxed);
        Ok(message.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.storage.flush()
    }
}

/// A stream of stores' messages.
pub(crate) struct Sink {
    /// `None` once closed.
    encoder: Option<Encoder<Whole>>,
    bytes: Arc<AtomicU64>,
    chunks: u64,
    /// The error that closed it, until it is answered.
    error: Option<RecordError>,
}

impl Sink {
    /// Starts a stream.
    pub(crate) fn new(storage: Box<dyn Storage>) -> Result<Self, RecordError> {
        let bytes = Arc::new(AtomicU64::new(0));
        let whole = Whole { storage, bytes: Arc::clone(&bytes) };
        let encoder =
            Encoder::new_eager(CrateVersion::LOCAL, EncodingOptions::PROTOBUF_COMPRESSED, whole).map_err(|error| describe(error, 0))?;
        Ok(Self { encoder: Some(encoder), bytes, chunks: 0, error: None })
    }

    /// Announces a store, before its first chunk.
    pub(crate) fn announce(&mut self, store: &StoreId) {
        let source = StoreSource::Other(concat!("armplane ", env!("CARGO_PKG_VERSION")).into());
        self.send(&LogMsg::SetStoreInfo(SetStoreInfo { row_id: Tuid::new(), info: StoreInfo::new(store.clone(), source) }));
    }

    /// Appends a chunk of a store.
    pub(crate) fn chunk(&mut self, store: &StoreId, chunk: ChunkResult<Chunk>) {
        match chunk.and_then(|chunk| chunk.to_arrow_msg()) {
            Ok(message) => {
                self.chunks += 1;
                self.send(&LogMsg::ArrowMsg(store.clone(), message));
            }
            Err(error) => self.fail(RecordError::Encode { bytes: self.bytes(), reason: error.to_string() }),
        }
    }

    /// Says that a blueprint is complete and shall be shown.
    pub(crate) fn activate(&mut self, blueprint: &StoreId) {
        self.send(&LogMsg::BlueprintActivationCommand(BlueprintActivationCommand {
            blueprint_id: blueprint.clone(),
            make_active: true,
            make_default: true,
        }));
    }

    fn send(&mut self, message: &LogMsg) {
        let Some(encoder) = &mut self.encoder else { return };
        if let Err(error) = encoder.append(message) {
            let error = describe(error, self.bytes());
            self.fail(error);
        }
    }

    /// Closes the stream for good; the first error is the one to answer.
    fn fail(&mut self, error: RecordError) {
        self.error.get_or_insert(error);
        let _ = self.close();
    }

    /// Size so far; bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Chunks so far.
    pub(crate) fn chunks(&self) -> u64 {
        self.chunks
    }

    /// Whether the stream has ended.
    pub(crate) fn is_closed(&self) -> bool {
        self.encoder.is_none()
    }

    /// The error that closed the stream, once.
    pub(crate) fn check(&mut self) -> Result<(), RecordError> {
        self.error.take().map_or(Ok(()), Err)
    }

    /// Closes the stream without a word: the one before it could not be ended.
    pub(crate) fn abandon(&mut self) {
        let _ = self.close();
    }

    /// Ends the stream with its footer, which a reader that seeks needs, and makes it durable.
    pub(crate) fn finish(mut self) -> Result<u64, RecordError> {
        let closed = self.close();
        self.check().and(closed)?;
        Ok(self.bytes())
    }

    /// Footer and sync; where the footer does not fit, the stream ends without one, after its last whole message.
    fn close(&mut self) -> Result<(), RecordError> {
        let Some(mut encoder) = self.encoder.take() else { return Ok(()) };
        let data = self.bytes();
        let footer = encoder.finish().map_err(|error| describe(error, data));
        let mut storage = encoder.into_inner().map_err(|error| describe(error, data))?.storage;
        if footer.is_err() {
            // A footer is three writes: half of one is worse than none.
            let _ = storage.cut(data);
            self.bytes.store(data, Ordering::Relaxed);
        }
        footer.and(storage.sync().map_err(|source| RecordError::Write { bytes: data, source }))
    }
}

fn describe(error: EncodeError, bytes: u64) -> RecordError {
    match error {
        EncodeError::Write(source) => RecordError::Write { bytes, source },
        other => RecordError::Encode { bytes, reason: other.to_string() },
    }
}
