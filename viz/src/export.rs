//! A run's numbers and events for other tools.

mod columns;
mod table;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use model::Robot;
use rerun::external::arrow::array::{ArrayRef, Float64Array, Int64Array, RecordBatch, StringArray};
use rerun::external::arrow::error::ArrowError;
use rerun::external::arrow::ipc::writer::StreamWriter;
use shared_types::job::Job;

use crate::facts::Facts;
use crate::run::{Happened, Source, Tick};
use crate::sink::RecordError;
use crate::story::{News, Story};
use columns::Columns;
use table::Table;

/// A format of [`export`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// `signals.csv` and `events.csv`.
    Csv,
    /// `signals.parquet` and `events.parquet`.
    Parquet,
}

/// Why an export failed; no file is left then that is not whole.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The arm does not fit.
    #[error(transparent)]
    Arm(#[from] RecordError),
    /// A file cannot be written.
    #[error("cannot write {path}: {reason}; free space there, or choose another folder with --out")]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the file system or of the format's crate.
        reason: String,
    },
    /// The tables cannot be encoded.
    #[error("cannot encode the signals: {0}")]
    Arrow(#[from] ArrowError),
    /// Whoever asked for it wants it no more.
    #[error("the export was stopped")]
    Stopped,
}

/// A line of the log, or a change of a lane of the state timeline: tick, `log` or `state`, level or lane, text.
type Happening = (u64, &'static str, String, String);

/// Rows that are written at once.
const ROWS: usize = 1000;
/// Rows that wait for the first report at most.
const MOST: usize = 10_000;

/// Writes a run into files of a format in the folder `out`, each of which takes its place when it is whole; returns their paths.
///
/// # Errors
/// [`ExportError`] where a file cannot be written, or the source's `progress` has ended it.
pub fn export(
    format: ExportFormat,
    out: &Path,
    source: Source,
) -> Result<Vec<PathBuf>, ExportError> {
    let facts = Facts::new(source.job, source.robot, source.happened, false)?;
    let (mut events, mut signals) = (Vec::<Happening>::new(), None::<Table>);
    let tell = |tick: u64, news: News| {
        let (kind, subject, text) = match news {
            News::Line(event) => ("log", event.level.name(), event.text.as_str()),
            News::State { name, state, .. } => ("state", name, state),
        };
        events.push((tick, kind, subject.to_owned(), text.to_owned()));
    };
    let write = |batch: &RecordBatch, count| {
        let table = match &mut signals {
            Some(table) => table,
            none => none.insert(Table::create(format, out, "signals", batch.schema())?),
        };
        table.write(batch)?;
        let goes_on = (source.progress)(count);
        goes_on.then_some(()).ok_or(ExportError::Stopped)
    };
    in_batches(&facts, source.ticks, tell, write)?;
    // A line of the log comes when it is known, with the tick that it is about.
    events.sort_by_key(|event| event.0);
    let batch = happenings(&events, f64::from(facts.rate_hz))?;
    let mut events = Table::create(format, out, "events", batch.schema())?;
    events.write(&batch)?;
    let tables = signals.into_iter().chain([events]);
    tables.map(Table::finish).collect()
}

/// The signals of a run as a stream of Arrow's IPC format: the columns of [`export`].
///
/// # Errors
/// [`ExportError::Arm`] if the arm does not fit, [`ExportError::Arrow`] if the stream cannot be encoded.
pub fn signals(
    job: &Job,
    robot: &Robot,
    ticks: impl Iterator<Item = Tick>,
) -> Result<Vec<u8>, ExportError> {
    let facts = Facts::new(job, robot, Happened::default(), false)?;
    let mut writer = None::<StreamWriter<Vec<u8>>>;
    let write = |batch: &RecordBatch, _| -> Result<(), ExportError> {
        let writer = match &mut writer {
            Some(writer) => writer,
            none => none.insert(StreamWriter::try_new(Vec::new(), &batch.schema())?),
        };
        Ok(writer.write(batch)?)
    };
    in_batches(&facts, ticks, |_, _| (), write)?;
    Ok(writer.map_or(Ok(Vec::new()), StreamWriter::into_inner)?)
}

/// Hands the columns of successive ticks to `write`, with the number of ticks so far, and the news of each tick to `tell`.
fn in_batches(
    facts: &Facts,
    ticks: impl Iterator<Item = Tick>,
    mut tell: impl FnMut(u64, News),
    mut write: impl FnMut(&RecordBatch, u64) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let mut story = Story::new(facts);
    let (mut begun, mut gathered, mut count) = (None, Vec::new(), 0);
    let mut ticks = ticks.peekable();
    while let Some(tick) = ticks.next() {
        story.push(&tick, &mut tell);
        gathered.push(tick);
        count += 1;
        // The first report names the columns; a run without one is not kept for it.
        let is_known = begun.is_some() || !story.named.is_empty() || gathered.len() > MOST;
        if (gathered.len() < ROWS || !is_known) && ticks.peek().is_some() {
            continue;
        }
        let columns = begun.get_or_insert_with(|| Columns::new(facts, &story.named));
        write(&columns.of(facts, &gathered)?, count)?;
        gathered.clear();
    }
    Ok(())
}

fn happenings(events: &[Happening], rate_hz: f64) -> Result<RecordBatch, ArrowError> {
    let times = events.iter().map(|event| event.0 as f64 / rate_hz);
    let ticks = events.iter().map(|event| event.0 as i64);
    let texts = |text: fn(&Happening) -> &str| -> ArrayRef {
        Arc::new(StringArray::from_iter_values(events.iter().map(text)))
    };
    let columns: [(&str, ArrayRef); 5] = [
        ("tick", Arc::new(Int64Array::from_iter_values(ticks))),
        ("t_s", Arc::new(Float64Array::from_iter_values(times))),
        ("kind", texts(|event| event.1)),
        ("subject", texts(|event| &event.2)),
        ("text", texts(|event| &event.3)),
    ];
    RecordBatch::try_from_iter(columns)
}
