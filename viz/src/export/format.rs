//! A file format of an export, and the table that all formats share.

use std::path::{Path, PathBuf};

use crate::read::{About, ReadError, Rows};
use crate::signals::Signal;

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

impl ExportError {
    pub(super) fn write(path: &Path) -> impl Fn(&dyn std::fmt::Display) -> Self + use<> {
        let path = path.to_owned();
        move |reason| Self::Write { path: path.clone(), reason: reason.to_string() }
    }
}

/// A format: what it does with each piece of a recording, which comes in the order of time, kind by kind.
pub(super) trait Format {
    /// Once, before the first numbers.
    fn begin(&mut self, columns: &Columns) -> Result<(), ExportError>;
    fn rows(&mut self, columns: &Columns, rows: &Rows) -> Result<(), ExportError>;
    fn event(&mut self, event: &Event) -> Result<(), ExportError>;
    /// Ends the files; their paths.
    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, ExportError>;
}

/// A line of the log, or a change of a lane of the state timeline.
pub(super) struct Event {
    pub(super) tick: u64,
    pub(super) t_s: f64,
    /// `log` or `state`.
    pub(super) kind: &'static str,
    /// The level, or the lane.
    pub(super) subject: String,
    pub(super) text: String,
}

/// The columns of the wide table: each signal with its elements.
pub(super) struct Columns {
    pub(super) signals: Vec<(Signal, Vec<String>)>,
    pub(super) rate_hz: f64,
}

impl Columns {
    pub(super) fn new(about: &About) -> Self {
        let elements = |signal: Signal| (signal, signal.elements(about.joints, &about.singularities));
        Self { signals: Signal::ALL.iter().map(|signal| elements(*signal)).collect(), rate_hz: about.rate_hz() }
    }

    /// `tick`, `t_s`, then `group.quantity.element`: `joint.q.1`, `singularity.s.wrist`.
    pub(super) fn names(&self) -> Vec<String> {
        let of = |(signal, elements): &(Signal, Vec<String>)| -> Vec<String> {
            let base = signal.name().replace(':', ".");
            elements.iter().map(|element| if element.is_empty() { base.clone() } else { format!("{base}.{element}") }).collect()
        };
        ["tick", "t_s"].map(str::to_owned).into_iter().chain(self.signals.iter().flat_map(of)).collect()
    }

    pub(super) fn t_s(&self, tick: u64) -> f64 {
        tick as f64 / self.rate_hz
    }

    /// A row's values after tick and time, `None` where a message was missing; `values` is scratch.
    pub(super) fn each_value(&self, rows: &Rows, row: usize, values: &mut Vec<f64>, mut put: impl FnMut(usize, Signal, Option<f64>)) {
        let mut column = 0;
        for (signal, elements) in &self.signals {
            values.clear();
            rows.values(*signal, row, values);
            for i in 0..elements.len() {
                put(column, *signal, values.get(i).copied());
                column += 1;
            }
        }
    }
}
