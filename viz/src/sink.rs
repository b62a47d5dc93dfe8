//! An `.rrd` stream that ends cleanly when its volume does.
//!
//! Rerun's own file sink writes from a thread that returns on the first error, after which flushing waits for an answer that never
//! comes. This one writes where it is called: the first error is kept, the stream is cut back to its last whole message, and every
//! later call returns at once.

use re_chunk::{Chunk, ChunkResult};
use re_log_types::external::re_tuid::Tuid;
use re_log_types::{
    BlueprintActivationCommand, LogMsg, SetStoreInfo, StoreId, StoreInfo, StoreSource,
};

use crate::storage::{RecordError, Storage};
use crate::stream::Stream;

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

/// A stream of stores' messages.
pub(crate) struct Sink {
    /// `None` once closed.
    stream: Option<Stream>,
    /// Bytes of whole messages.
    bytes: u64,
    chunks: u64,
    /// The error that closed it, until it is answered.
    error: Option<RecordError>,
}

impl Sink {
    /// Starts a stream.
    pub(crate) fn new(storage: Box<dyn Storage>) -> Result<Self, RecordError> {
        let stream = Stream::begin(storage)?;
        Ok(Self {
            bytes: stream.bytes(),
            stream: Some(stream),
            chunks: 0,
            error: None,
        })
    }

    /// Announces a store, before its first chunk.
    pub(crate) fn announce(&mut self, store: &StoreId) {
        let source = StoreSource::Other(concat!("armplane ", env!("CARGO_PKG_VERSION")).into());
        let message = LogMsg::SetStoreInfo(SetStoreInfo {
            row_id: Tuid::new(),
            info: StoreInfo::new(store.clone(), source),
        });
        self.write(|stream| stream.message(&message));
    }

    /// Appends a chunk of a store.
    pub(crate) fn chunk(&mut self, store: &StoreId, chunk: ChunkResult<Chunk>) {
        match chunk {
            Ok(chunk) => {
                self.chunks += 1;
                self.write(|stream| stream.chunk(store, chunk));
            }
            Err(error) => self.fail(RecordError::Encode {
                bytes: self.bytes,
                reason: error.to_string(),
            }),
        }
    }

    /// Says that a blueprint is complete and shall be shown.
    pub(crate) fn activate(&mut self, blueprint: &StoreId) {
        let message = LogMsg::BlueprintActivationCommand(BlueprintActivationCommand {
            blueprint_id: blueprint.clone(),
            make_active: true,
            make_default: true,
        });
        self.write(|stream| stream.message(&message));
    }

    /// Writes what waits: from then on it outlives the process.
    pub(crate) fn flush(&mut self) {
        self.write(Stream::flush);
    }

    fn write(&mut self, write: impl FnOnce(&mut Stream) -> Result<(), RecordError>) {
        let Some(stream) = &mut self.stream else {
            return;
        };
        let written = write(stream);
        self.bytes = stream.bytes();
        if let Err(error) = written {
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
        self.bytes
    }

    /// Chunks so far.
    pub(crate) fn chunks(&self) -> u64 {
        self.chunks
    }

    /// Whether the stream has ended.
    pub(crate) fn is_closed(&self) -> bool {
        self.stream.is_none()
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
        Ok(self.bytes)
    }

    fn close(&mut self) -> Result<(), RecordError> {
        let Some(stream) = self.stream.take() else {
            return Ok(());
        };
        let (bytes, ended) = stream.end();
        self.bytes = bytes;
        ended
    }
}
