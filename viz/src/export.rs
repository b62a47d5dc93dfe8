//! A recording's numbers and events for other tools.

mod csv;
mod format;
mod parquet;

use std::path::{Path, PathBuf};

use crate::read::{Piece, ReadNews, read};
use crate::signals::TickRow;
use csv::Csv;
use format::{Columns, Event, Format};

pub use format::ExportError;

/// A format of [`export`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// `signals.csv` and `events.csv`.
    Csv,
    /// `signals.parquet` and `events.parquet`.
    Parquet,
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
    /// Which joints slide: their units are metres and newtons. Joints beyond it turn.
    pub slides: &'a [bool],
    /// Whether the run was steered: columns of its own.
    pub steered: bool,
}

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
        slides,
        steered,
    } = what;
    let mut format = opened(format, out)?;
    let (mut columns, mut rate_hz) = (None::<Columns>, 1000.0);
    read(parts, |piece| {
        let mut event = |tick: u64, kind, subject, text| {
            format.event(Event {
                tick,
                t_s: tick as f64 / rate_hz,
                kind,
                subject,
                text,
            })
        };
        match (piece, &mut columns) {
            (Piece::About(about), None) => {
                rate_hz = about.rate_hz();
                format.begin(columns.insert(Columns::new(
                    about,
                    messages.as_ref().map(|_| steered),
                    slides,
                )))
            }
            (Piece::Rows(rows), Some(columns)) => {
                news(ReadNews::Rows(rows.ticks.len() as u64));
                let block = columns.block(rows, |tick, take| {
                    if let Some(messages) = &mut messages {
                        messages.at(tick, take);
                    }
                });
                format.rows(columns, &block)
            }
            (Piece::Event { tick, level, text }, _) => event(tick, "log", level, text),
            (Piece::State { tick, lane, state }, _) => event(tick, "state", lane, state),
            (Piece::Damaged(damage), _) => {
                news(ReadNews::Damaged(&damage));
                Ok(())
            }
            _ => Ok(()),
        }
    })?;
    format.finish()
}

fn opened(format: ExportFormat, out: &Path) -> Result<Box<dyn Format>, ExportError> {
    match format {
        ExportFormat::Csv => Ok(Box::new(Csv::create(out)?)),
        ExportFormat::Parquet => Ok(Box::new(parquet::Parquet::create(out)?)),
    }
}
