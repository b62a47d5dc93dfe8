//! How much of its run a recording holds.

use std::fmt;
use std::path::PathBuf;

use shared_types::summary::Summary;

use crate::parts::{bytes_in, checksums, is_complete, parts_in};
use crate::read::{Piece, ReadError, ReadNews, read};

/// The rows and damages found while a recording is read.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    rows: u64,
    damages: Vec<String>,
}

impl Reading {
    /// Takes a piece of news in.
    pub fn add(&mut self, news: ReadNews<'_>) {
        match news {
            ReadNews::Rows(more) => self.rows += more,
            ReadNews::Damaged(damage) => self.damages.push(damage.to_string()),
        }
    }

    /// Rows read so far.
    #[must_use]
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// The shortfall of the files, after all of them have been read: by themselves, and by the summary of their run. A file with a name of its own may be a
    /// part of a run, or of another run than the summary beside it: it is judged by itself only.
    #[must_use]
    pub fn shortfall(self, parts: &[PathBuf], summary: Option<&Summary>) -> Option<Shortfall> {
        let is_own = parts.first().is_none_or(|part| {
            part.parent()
                .is_some_and(|folder| parts_in(folder) == parts)
        });
        let run = summary.filter(|summary| is_own && !summary.recorder.file.is_empty());
        let mut causes = self.damages;
        // Any other defect tells more.
        if causes.is_empty()
            && let Some(run) = run
        {
            causes.extend(altered(parts, &run.recorder.checksums));
        }
        for part in parts
            .iter()
            .filter(|part| !is_complete(part).unwrap_or(false))
        {
            causes.push(format!("{} has no end", part.display()));
        }
        if let Some(run) = run {
            let bytes = bytes_in(parts);
            let is_short = self.rows < run.recorder.rows;
            if bytes < run.recorder.bytes {
                causes.push(format!(
                    "there are {bytes} of the {} bytes that the recorder wrote",
                    run.recorder.bytes
                ));
            }
            if !run.recorder.error.is_empty() {
                causes.push(run.recorder.error.clone());
            } else if is_short && run.recorder.lost > 0 {
                causes.push(format!(
                    "the recorder lost {} messages while the run lasted",
                    run.recorder.lost
                ));
            } else if is_short && run.completed && run.of.mode == "lockstep" && causes.is_empty() {
                causes.push("a part of its bytes is passed over".to_owned());
            }
        }
        (!causes.is_empty()).then(|| Shortfall {
            rows: self.rows,
            of: run.map(|run| run.recorder.rows).filter(|rows| *rows > 0),
            causes,
        })
    }
}

/// The first of a recording's files that its run's summary does not know, or has another checksum of, in a clause; none where it has no checksums.
#[must_use]
pub fn altered(parts: &[PathBuf], of_run: &[String]) -> Option<String> {
    if of_run.is_empty() {
        return None;
    }
    if let Some(part) = parts.get(of_run.len()) {
        return Some(format!(
            "{} is no file of this run, whose summary.json has {} of them",
            part.display(),
            of_run.len()
        ));
    }
    match checksums(parts) {
        Ok(found) => {
            let (part, _) = parts
                .iter()
                .zip(found.iter().zip(of_run))
                .find(|(_, (found, written))| found != written)?;
            Some(format!(
                "{} is not as it was written, or of another run: its checksum is not the one in summary.json",
                part.display()
            ))
        }
        Err(error) => Some(format!("its files cannot be read: {error}")),
    }
}

/// A recording that holds less than its run: a sentence without its end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shortfall {
    rows: u64,
    of: Option<u64>,
    causes: Vec<String>,
}

impl fmt::Display for Shortfall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rows, of, causes } = self;
        let of = of.map_or(String::new(), |of| format!(" of {of}"));
        write!(
            f,
            "{rows}{of} rows of the recording can be read: {}",
            causes.join("; ")
        )
    }
}

/// How many rows of a recording can be read; those before the first thing that cannot.
#[must_use]
pub fn rows_in(parts: &[PathBuf]) -> u64 {
    let mut rows = 0;
    // Rows that have been read before an error count.
    let _ = read(parts, |piece| {
        if let Piece::Rows(more) = piece {
            rows += more.ticks.len() as u64;
        }
        Ok::<(), ReadError>(())
    });
    rows
}

/// Whether a recording has a row that can be read.
///
/// # Errors
/// [`ReadError`] where a file before it cannot be opened or holds no recording.
pub fn has_rows(parts: &[PathBuf]) -> Result<bool, ReadError> {
    // The first row ends the reading without an error.
    let read = read(parts, |piece| match piece {
        Piece::Rows(_) => Err(None),
        _ => Ok(()),
    });
    match read {
        Ok(()) => Ok(false),
        Err(None) => Ok(true),
        Err(Some(error)) => Err(error),
    }
}
