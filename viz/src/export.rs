//! A run's numbers and events for other tools.

mod columns;
mod table;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use model::Robot;
use rerun::external::arrow::array::{
    Array, ArrayRef, Float64Array, Int64Array, RecordBatch, StringArray,
};
use rerun::external::arrow::datatypes::{Field, Schema, SchemaRef};
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
    let facts = Facts::new(source.job, source.robot, None, false)?;
    let mut story = Story::new(source.job, &source.happened);
    let (mut events, mut signals) = (Vec::new(), None::<Table>);
    let tell = |tick: u64, news: News| {
        events.push(match news {
            News::Line(event) => (
                tick,
                "log",
                event.level.name().to_owned(),
                event.text.clone(),
            ),
            News::State { name, state, .. } => (tick, "state", name.to_owned(), state.to_owned()),
        });
    };
    let write = |schema: &SchemaRef, columns, count| {
        let table = match &mut signals {
            Some(table) => table,
            none => none.insert(Table::create(format, out, "signals", Arc::clone(schema))?),
        };
        table.write(columns)?;
        (source.progress)(count)
            .then_some(())
            .ok_or(ExportError::Stopped)
    };
    in_batches(&facts, &mut story, source.ticks, tell, write)?;
    // A state is told when it is over, with the tick at which it began.
    events.sort_by_key(|event| event.0);
    let events = write_events(&events, f64::from(facts.rate_hz), format, out)?;
    let signals = signals.map(|table| table.finish()).transpose()?;
    let events = events.finish()?;
    Ok(signals.into_iter().chain([events]).collect())
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
    let facts = Facts::new(job, robot, None, false)?;
    let mut story = Story::new(job, &Happened::default());
    let mut writer = None::<StreamWriter<Vec<u8>>>;
    let write = |schema: &SchemaRef, columns, _| -> Result<(), ExportError> {
        let writer = match &mut writer {
            Some(writer) => writer,
            none => none.insert(StreamWriter::try_new(Vec::new(), schema)?),
        };
        Ok(writer.write(&RecordBatch::try_new(Arc::clone(schema), columns)?)?)
    };
    in_batches(&facts, &mut story, ticks, |_, _| (), write)?;
    Ok(writer.map_or(Ok(Vec::new()), StreamWriter::into_inner)?)
}

/// Hands the columns of successive ticks to `write`, with the number of ticks so far, and the news of each tick to `tell`.
fn in_batches(
    facts: &Facts,
    story: &mut Story,
    ticks: impl Iterator<Item = Tick>,
    mut tell: impl FnMut(u64, News),
    mut write: impl FnMut(&SchemaRef, Vec<ArrayRef>, u64) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let (mut begun, mut gathered, mut count) = (None, Vec::new(), 0);
    let mut ticks = ticks.peekable();
    while let Some(tick) = ticks.next() {
        story.push(&tick.row(), &mut tell);
        gathered.push(tick);
        count += 1;
        // The first report names the columns; a run without one is not kept for it.
        let is_known = begun.is_some() || !story.names.is_empty() || gathered.len() > MOST;
        if (gathered.len() < ROWS || !is_known) && ticks.peek().is_some() {
            continue;
        }
        let (columns, schema) = begun.get_or_insert_with(|| {
            let (columns, schema) = Columns::new(facts, &story.names);
            (columns, Arc::new(schema))
        });
        write(schema, columns.of(facts, &gathered), count)?;
        gathered.clear();
    }
    Ok(())
}

fn write_events(
    events: &[Happening],
    rate_hz: f64,
    format: ExportFormat,
    out: &Path,
) -> Result<Table, ExportError> {
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
    let field =
        |(name, column): &(&str, ArrayRef)| Field::new(*name, column.data_type().clone(), false);
    let schema = Schema::new(columns.iter().map(field).collect::<Vec<_>>());
    let mut table = Table::create(format, out, "events", Arc::new(schema))?;
    table.write(columns.map(|(_, column)| column).into())?;
    Ok(table)
}
