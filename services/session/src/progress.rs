//! Progress of a long operation.

use std::fmt::Display;

/// One piece of news.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress<'a> {
    /// A stage begins: its title, its length, and the unit of both length and positions.
    Begin {
        /// The work done.
        title: &'a str,
        /// Work in this stage; `unit`s.
        length: u64,
        /// Of length and positions, in the plural: "ticks", "runs".
        unit: &'static str,
    },
    /// The stage's title changes.
    Title(&'a str),
    /// Work done in this stage; units.
    Position(u64),
    /// One more unit of work is done.
    Step,
    /// A sentence that stays readable after the stage has ended.
    Line(&'a str),
    /// The stage has ended.
    End,
}

/// Receives the news, from any thread. Returning is all it must do.
pub type Observer<'a> = &'a (dyn Fn(Progress<'_>) + Sync);

/// Tells a sentence of this program's own, beside those of a run's processes.
pub(crate) fn say(observer: Observer<'_>, sentence: impl Display) {
    observer(Progress::Line(&format!("armplane: {sentence}")));
}
