//! A run's recording for other tools.

use std::path::{Path, PathBuf};

use recorder::{MESSAGES, Row, Ticks};
use shared_types::scenario::Layout;
use shared_types::summary::{RecorderSummary, Summary};
use viz::{Exported, Messages, ReadNews, Reading, TickRow};

use crate::failure::Failure;
use crate::layout::save_blueprint;
use crate::progress::{Observer, Progress};
use crate::runs::Run;

/// Name of a recording whose parts have been merged.
pub const WHOLE: &str = "whole.rrd";

/// A form of [`export`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// Tables, or channels.
    Numbers(viz::ExportFormat),
    /// The recording in one file.
    Whole,
    /// A layout for the viewer, by default the scenario's.
    Layout(Option<Layout>),
}

/// The result of [`export`].
#[derive(Clone, Debug)]
pub struct Export {
    /// The files.
    pub files: Vec<PathBuf>,
    /// One sentence, where the recording or the message logs hold less than the run: how much of it, why, and the remedy.
    pub shortfall: Option<String>,
}

/// Writes a run in another form into a folder, as far as its recording can be read.
///
/// # Errors
/// [`Failure::Input`] if the run has no recording, or no row of it can be read: nothing is written then; [`Failure::Work`] if a file cannot be
/// written.
pub fn export(
    run: &Run,
    format: ExportFormat,
    out: &Path,
    observer: Observer<'_>,
) -> Result<Export, Failure> {
    if !matches!(format, ExportFormat::Layout(_)) {
        run.check_readable()?;
    }
    files::make_folder(out)
        .map_err(|error| Failure::Input(format!("cannot write to {}: {error}", out.display())))?;
    let (mut reading, mut damage) = (Reading::default(), Vec::new());
    let files = match format {
        ExportFormat::Layout(layout) => {
            let layout =
                layout.map_or_else(|| run.job().map(|job| job.scenario.view.layout), Ok)?;
            let path = out.join(format!("{}.rbl", layout.name()));
            save_blueprint(run, layout, &path)?;
            return Ok(Export {
                files: vec![path],
                shortfall: None,
            });
        }
        ExportFormat::Whole => {
            let path = out.join(WHOLE);
            viz::merge(run.recording()?, &path, |news| reading.add(news)).map_err(Failure::work)?;
            vec![path]
        }
        ExportFormat::Numbers(format) => {
            let (files, found) = numbers(run, format, out, &mut reading, observer)?;
            damage = found;
            files
        }
    };
    let shortfall = reading
        .shortfall(&run.parts, run.summary().ok().as_ref())
        .map(|shortfall| shortfall.to_string());
    let lacks: Vec<String> = shortfall.into_iter().chain(damage).collect();
    Ok(Export {
        files,
        shortfall: (!lacks.is_empty()).then(|| run.with_remedy(&lacks.join("; "))),
    })
}

/// Writes the numbers of the recording and of the kept messages. Returns the files, and the defects
/// of the message log.
fn numbers(
    run: &Run,
    format: viz::ExportFormat,
    out: &Path,
    reading: &mut Reading,
    observer: Observer<'_>,
) -> Result<(Vec<PathBuf>, Vec<String>), Failure> {
    let parts = run.recording()?;
    let mut messages = StoredMessages::open(run).inspect_err(|reason| {
        observer(Progress::Line(&format!(
            "armplane: columns from the run's messages are missing: {reason}"
        )));
    });
    let steered = messages.as_ref().is_ok_and(|stored| stored.steered);
    let lent = messages
        .as_mut()
        .ok()
        .map(|stored| stored as &mut dyn Messages);
    let ticks = run.summary().map_or(0, |summary| summary.recorder.rows);
    observer(Progress::Begin {
        title: "export",
        length: ticks,
        unit: "rows",
    });
    let written = viz::export(
        Exported {
            parts,
            messages: lent,
            steered,
        },
        format,
        out,
        &mut |news| {
            reading.add(news);
            if let ReadNews::Rows(_) = news {
                observer(Progress::Position(reading.rows()));
            }
        },
    );
    observer(Progress::End);
    let (summary, defect) = match run.summary_if_any() {
        Ok(summary) => (summary, None),
        Err(defect) => (None, Some(defect)),
    };
    let mut damage = match messages {
        Ok(stored) => stored.ticks.damage(summary.as_ref()),
        Err(Unread::Defect(reason)) => vec![reason],
        Err(Unread::NotKept(_)) => Vec::new(),
    };
    damage.extend(defect);
    Ok((written.map_err(Failure::work)?, damage))
}

/// The messages in a run's folder.
struct StoredMessages {
    ticks: Ticks,
    /// The row read last.
    row: Option<Box<Row>>,
    steered: bool,
}

/// The reason why the messages of a run cannot be read.
#[derive(Debug, thiserror::Error)]
enum Unread {
    /// There are none beside the recording, as was asked for.
    #[error("{0}")]
    NotKept(&'static str),
    /// They are damaged, or gone.
    #[error("{0}")]
    Defect(String),
}

impl Unread {
    fn defect(error: impl std::fmt::Display) -> Self {
        Self::Defect(error.to_string())
    }
}

impl StoredMessages {
    fn open(run: &Run) -> Result<Self, Unread> {
        if !run.is_own() {
            return Err(Unread::NotKept(
                "the recording was renamed; export its run's folder",
            ));
        }
        let job = run.read_job().map_err(Unread::Defect)?;
        if !job.messages {
            return Err(Unread::NotKept("the run had --no-messages"));
        }
        let ticks = Ticks::open(&run.folder.join(MESSAGES), &job).map_err(Unread::defect)?;
        Ok(Self {
            ticks,
            row: None,
            steered: job.scenario.servo.is_some(),
        })
    }
}

impl Messages for StoredMessages {
    fn at(&mut self, tick: u64, take: &mut dyn FnMut(&TickRow<'_>)) {
        while self.row.as_ref().is_none_or(|row| row.tick < tick) {
            match self.ticks.next() {
                Some(row) => self.row = Some(row),
                None => return,
            }
        }
        if let Some(row) = self.row.as_ref().filter(|row| row.tick == tick) {
            take(&TickRow::new(tick, row.messages().lent()));
        }
    }
}

/// Gives the summary the checksums of the recording's files, which nobody writes any more.
pub(crate) fn seal(folder: &Path, recorder: &mut RecorderSummary) {
    match viz::checksums(&viz::parts_in(folder)) {
        Ok(checksums) => recorder.checksums = checksums,
        Err(error) => {
            recorder.error = joined([
                &recorder.error,
                &format!("its files cannot be read again: {error}"),
            ])
        }
    }
}

/// Clauses in one sentence, but for those that are empty.
pub(crate) fn joined(clauses: [&str; 2]) -> String {
    clauses
        .into_iter()
        .filter(|clause| !clause.is_empty())
        .collect::<Vec<_>>()
        .join("; ")
}

/// Gives the parts whose recorder was killed their footers, and the summary their new sizes. A part that cannot be completed stays as it was, and
/// `observer` gets the reason.
pub(crate) fn complete(folder: &Path, summary: &mut Summary, observer: Observer<'_>) {
    let parts = viz::parts_in(folder);
    for part in &parts {
        if let Err(error) = viz::complete(part) {
            observer(Progress::Line(&format!(
                "armplane: {} stays without a table of contents: {error}",
                part.display()
            )));
        }
    }
    if !summary.recorder.file.is_empty() {
        summary.recorder.bytes = viz::bytes_in(&parts);
        let Summary { recorder, .. } = summary;
        if !recorder.error.is_empty() && recorder.bytes > 0 {
            // Nothing is written into them any more.
            recorder.error = format!(
                "{}; the recording has {} bytes",
                recorder.error, recorder.bytes
            );
        }
    }
}
