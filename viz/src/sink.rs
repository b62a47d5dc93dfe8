//! Rerun's stream into a file that stands in its place when it is whole, or into a viewer.
//!
//! Rerun's own file sink writes from a thread that ends with the first error, after which flushing waits for ever: a full disk would hang the program.
//! Here the stream's messages are taken chunk by chunk and encoded by the thread that draws.

use std::cell::RefCell;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use files::Draft;
use rerun::external::re_log_encoding::{CrateVersion, EncodeError, Encoder, EncodingOptions};
use rerun::external::re_log_types::{BlueprintActivationCommand, StoreSource};
use rerun::log::{ChunkBatcherConfig, LogMsg, TimeColumn};
use rerun::sink::MemorySinkStorage;
use rerun::{
    AsComponents, EntityPath, RecordingStream, RecordingStreamBuilder, SerializedComponentColumn,
    StoreId, TimeCell, TimePoint,
};

use crate::facts::Facts;

/// Why a recording could not be made; nothing of it is left.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The arm cannot be drawn: its model does not fit.
    #[error("cannot draw the robot {robot}: {reason}")]
    Arm {
        /// The robot's name.
        robot: String,
        /// The model's error.
        reason: String,
    },
    /// The volume refused a write.
    #[error("cannot write {}: {source}; free space there", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A chunk could not be built, encoded or sent: a defect of ours, or a viewer's address.
    #[error("the recording cannot be made: {0}")]
    Rerun(String),
    /// Whoever asked for it wants it no more.
    #[error("the recording was stopped")]
    Stopped,
}

/// How long the end of a live run waits for its viewer.
const PATIENCE: Duration = Duration::from_secs(5);

/// An `.rrd` or `.rbl` in the making.
pub(crate) struct RrdFile {
    path: PathBuf,
    draft: Draft,
    encoder: Encoder<BufWriter<File>>,
}

impl RrdFile {
    pub(crate) fn create(path: &Path) -> Result<Self, RecordError> {
        let create = || {
            let (draft, file) = Draft::create(path)?;
            let options = EncodingOptions::PROTOBUF_COMPRESSED;
            let file = BufWriter::new(file);
            let encoder = Encoder::new_eager(CrateVersion::LOCAL, options, file)?;
            let path = path.to_owned();
            Ok(Self {
                path,
                draft,
                encoder,
            })
        };
        create().map_err(failed(path))
    }

    pub(crate) fn append(&mut self, messages: &[LogMsg]) -> Result<(), RecordError> {
        for one in messages {
            self.encoder.append(one).map_err(failed(&self.path))?;
        }
        Ok(())
    }

    /// Ends it with its table of contents, and puts it into its place.
    pub(crate) fn finish(mut self) -> Result<(), RecordError> {
        let end = || {
            self.encoder.finish()?;
            self.encoder.into_inner()?.flush()?;
            Ok(self.draft.place()?)
        };
        end().map_err(failed(&self.path))
    }
}

fn failed(path: &Path) -> impl FnOnce(EncodeError) -> RecordError {
    |error| match error {
        EncodeError::Write(source) => RecordError::Write {
            path: path.to_owned(),
            source,
        },
        error => defect(error),
    }
}

/// A recording's stream. What is logged into it goes out at the next [`flush`](Self::flush), a chunk for each entity.
pub(crate) struct Sink {
    stream: RecordingStream,
    /// Messages on their way into a file; none of a stream that goes to a viewer.
    file: Option<(MemorySinkStorage, RrdFile)>,
    rate_hz: u32,
    /// The first thing that could not be logged.
    defect: RefCell<Option<RecordError>>,
}

impl Sink {
    /// Into a file.
    pub(crate) fn file(path: &Path, facts: &Facts) -> Result<Self, RecordError> {
        let file = RrdFile::create(path)?;
        let (stream, storage) = builder(facts).memory().map_err(defect)?;
        Ok(Self::of(stream, Some((storage, file)), facts))
    }

    /// To a viewer that listens at a URL, by Rerun's own sink; nobody waits for it.
    pub(crate) fn viewer(url: &str, facts: &Facts) -> Result<Self, RecordError> {
        let stream = builder(facts).connect_grpc_opts(url).map_err(defect)?;
        Ok(Self::of(stream, None, facts))
    }

    fn of(
        stream: RecordingStream,
        file: Option<(MemorySinkStorage, RrdFile)>,
        facts: &Facts,
    ) -> Self {
        stream.set_log_tick_enabled(false);
        stream.set_log_time_enabled(false);
        Self {
            stream,
            file,
            rate_hz: facts.rate_hz,
            defect: RefCell::default(),
        }
    }

    /// The time of a tick.
    pub(crate) fn nanoseconds(&self, tick: u64) -> i64 {
        (u128::from(tick) * 1_000_000_000 / u128::from(self.rate_hz)) as i64
    }

    /// Adds a row that is written with the next chunks.
    pub(crate) fn log(&self, tick: u64, path: impl AsRef<str>, archetype: &dyn AsComponents) {
        self.stream.set_timepoint(TimePoint::from([
            ("tick", TimeCell::from_sequence(tick as i64)),
            ("t", TimeCell::from_duration_nanos(self.nanoseconds(tick))),
        ]));
        self.done(self.stream.log(path.as_ref(), archetype));
    }

    pub(crate) fn log_static(&self, path: impl Into<EntityPath>, archetype: &dyn AsComponents) {
        self.done(self.stream.log_static(path, archetype));
    }

    /// Rows of one place, gathered as columns; nothing where there are none.
    pub(crate) fn send_columns(
        &self,
        path: &str,
        ticks: &[u64],
        columns: Vec<SerializedComponentColumn>,
    ) {
        let times = ticks.iter().map(|tick| self.nanoseconds(*tick));
        let times = [
            TimeColumn::new_sequence("tick", ticks.iter().map(|tick| *tick as i64)),
            TimeColumn::new_duration_nanos("t", times),
        ];
        if !ticks.is_empty() {
            self.done(self.stream.send_columns(path, times, columns));
        }
    }

    /// Adds a blueprint, which shall be shown. All that has been logged before comes before it.
    pub(crate) fn send_blueprint(&self, messages: Vec<LogMsg>, store: &StoreId) {
        if self.file.is_some() {
            self.done(self.stream.flush_blocking());
        }
        self.stream.send_blueprint(messages, activation(store));
    }

    /// Keeps the first thing that could not be logged, for the next [`flush`](Self::flush).
    fn done<E: std::fmt::Display>(&self, done: Result<(), E>) {
        if let Err(error) = done {
            self.defect.borrow_mut().get_or_insert(defect(error));
        }
    }

    /// Writes what has been logged.
    pub(crate) fn flush(&mut self) -> Result<(), RecordError> {
        self.done(self.stream.flush_async());
        if let Some((storage, file)) = &mut self.file {
            file.append(&storage.take())?;
        }
        self.defect.take().map_or(Ok(()), Err)
    }

    /// The end of the file.
    pub(crate) fn finish(mut self) -> Result<(), RecordError> {
        self.flush()?;
        match self.file {
            Some((_, file)) => file.finish(),
            None => self.stream.flush_with_timeout(PATIENCE).map_err(defect),
        }
    }
}

/// A failure of Rerun's.
pub(crate) fn defect(error: impl std::fmt::Display) -> RecordError {
    RecordError::Rerun(error.to_string())
}

fn builder(facts: &Facts) -> RecordingStreamBuilder {
    RecordingStreamBuilder::from_store_id(&facts.store())
        .enabled(true)
        .send_properties(false)
        // For the viewer.
        .store_source(StoreSource::Other(
            concat!("armplane ", env!("CARGO_PKG_VERSION")).into(),
        ))
        .batcher_config(ChunkBatcherConfig::NEVER)
}

/// Shows a blueprint that is whole.
pub(crate) fn activation(store: &StoreId) -> BlueprintActivationCommand {
    BlueprintActivationCommand {
        blueprint_id: store.clone(),
        make_active: true,
        make_default: true,
    }
}
