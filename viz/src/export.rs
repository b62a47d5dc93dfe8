//! A recording's numbers and events for other tools.

mod columns;
mod table;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use re_chunk::external::arrow::array::{ArrayRef, Float64Array, Int64Array, StringArray};
use re_chunk::external::arrow::datatypes::{Field, Schema};

use crate::read::{Piece, ReadError, ReadNews, read};
use crate::signals::TickRow;
use columns::Columns;
use table::Table;
pub use table::parquet_properties;

/// A format of [`export`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// `signals.csv` and `events.csv`.
    Csv,
    /// `signals.parquet` and `events.parquet`.
    Parquet,
}

/// Why an export failed: reading, writing, or the format's own crate.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A file cannot be written.
    #[error("cannot write {path}: {reason}; free space there, or choose another folder with --out")]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the file system or of the format's crate.
        reason: String,
    },
}

/// The messages of a run as they were on the wire, by tick.
pub trait Messages {
    /// Hands on those of a tick; an empty row where there are none. Ticks are asked for in ascending order.
    fn at(&mut self, tick: u64, take: &mut dyn FnMut(&TickRow<'_>));
}

/// The data of an export.
pub struct Exported<'a> {
    /// The recording's files, in order.
    pub parts: &'a [PathBuf],
    /// The run's messages, where they are kept: columns of their own.
    pub messages: Option<&'a mut dyn Messages>,
    /// Whether the run was steered: columns of its own.
    pub steered: bool,
}

/// A line of the log, or a change of a lane of the state timeline: tick, `log` or `state`, level or lane, text.
type Event = (u64, &'static str, String, String);

/// Reads a recording once and writes it into files of a format in the folder `out`; returns their paths.
///
/// # Errors
/// [`ExportError`] where the recording cannot be read, or a file not be written.
pub fn export(
    what: Exported<'_>,
    format: ExportFormat,
    out: &Path,
    news: &mut dyn FnMut(ReadNews<'_>),
) -> Result<Vec<PathBuf>, ExportError> {
    let Exported {
        parts,
        mut messages,
        steered,
    } = what;
    let mut signals: Option<(Columns, Table)> = None;
    let (mut events, mut rate_hz) = (Vec::<Event>::new(), 1000.0);
    read(parts, |piece| {
        match (piece, &mut signals) {
            (Piece::About(about), None) => {
                rate_hz = about.rate_hz();
                let has_messages = messages.as_ref().map(|_| steered);
                let (columns, schema) = Columns::new(about, has_messages);
                let table = Table::create(format, out, "signals", schema)?;
                signals = Some((columns, table));
            }
            (Piece::Rows(rows), Some((columns, table))) => {
                news(ReadNews::Rows(rows.ticks.len() as u64));
                table.write(columns.of(rows, |tick, take| {
                    if let Some(messages) = &mut messages {
                        messages.at(tick, take);
                    }
                }))?;
            }
            (Piece::Event { tick, level, text }, _) => events.push((tick, "log", level, text)),
            (Piece::State { tick, lane, state }, _) => events.push((tick, "state", lane, state)),
            (Piece::Damaged(damage), _) => news(ReadNews::Damaged(&damage)),
            _ => {}
        }
        Ok::<(), ExportError>(())
    })?;
    let signals = signals.map(|(_, table)| table.finish()).transpose()?;
    let events = write_events(&events, rate_hz, format, out)?;
    Ok(signals.into_iter().chain([events]).collect())
}

fn write_events(
    events: &[Event],
    rate_hz: f64,
    format: ExportFormat,
    out: &Path,
) -> Result<PathBuf, ExportError> {
    let times = events.iter().map(|event| event.0 as f64 / rate_hz);
    let texts = |text: fn(&Event) -> &str| -> ArrayRef {
        Arc::new(StringArray::from_iter_values(events.iter().map(text)))
    };
    let columns: [(&str, ArrayRef); 5] = [
        (
            "tick",
            Arc::new(Int64Array::from_iter_values(
                events.iter().map(|event| event.0 as i64),
            )),
        ),
        ("t_s", Arc::new(Float64Array::from_iter_values(times))),
        ("kind", texts(|event| event.1)),
        ("subject", texts(|event| &event.2)),
        ("text", texts(|event| &event.3)),
    ];
    let field =
        |(name, column): &(&str, ArrayRef)| Field::new(*name, column.data_type().clone(), false);
    let schema = Schema::new(columns.iter().map(field).collect::<Vec<_>>());
    let mut table = Table::create(format, out, "events", schema)?;
    table.write(columns.map(|(_, column)| column).into())?;
    table.finish()
}
