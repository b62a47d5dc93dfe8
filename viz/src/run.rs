//! A run as everything here reads it: its ticks, and what happened besides.

use shared_types::MAX_DOF;
use shared_types::summary::FaultSummary;
use shared_types::topics::{ByTopic, Received};

use crate::signals::TickRow;

/// The messages of one tick, and what was noted since the one before; in real time some may be missing.
#[derive(Clone, Debug, Default)]
pub struct Tick {
    /// Its number.
    pub tick: u64,
    /// Those that have come.
    pub messages: ByTopic<Received>,
    /// Lines of the log.
    pub events: Vec<Event>,
}

impl Tick {
    pub(crate) fn row(&self) -> TickRow<'_> {
        TickRow {
            tick: self.tick,
            messages: self.messages.lent(),
            events: &self.events,
        }
    }
}

/// How serious an event is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// As planned.
    Info,
    /// A fault that is being dealt with.
    Warning,
    /// Something failed.
    Error,
}

impl Level {
    /// As the viewer and tables write it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Info => "INFO",
            Self::Warning => "WARN",
            Self::Error => "ERROR",
        }
    }
}

/// A line of the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// When.
    pub tick: u64,
    /// How serious.
    pub level: Level,
    /// One sentence.
    pub text: String,
}

/// Another law's arm beside the run's own.
#[derive(Clone, Debug)]
pub struct Rival {
    /// Ticks from one posture to the next.
    pub every: u64,
    /// Joint positions, rad; the last one stays.
    pub postures: Vec<[f64; MAX_DOF]>,
    /// Markdown that compares both, with each posture.
    pub words: Vec<String>,
}

/// Facts about a run besides its messages.
#[derive(Clone, Copy, Debug, Default)]
pub struct Happened<'a> {
    /// The faults of the summary.
    pub faults: &'a [FaultSummary],
    /// In a race.
    pub rival: Option<&'a Rival>,
}
