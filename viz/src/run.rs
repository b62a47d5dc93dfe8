//! A run as everything here reads it: its ticks, and what happened besides.

use model::Robot;
use shared_types::MAX_DOF;
use shared_types::event::Event;
use shared_types::job::Job;
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

/// Called with the number of ticks so far; `false` ends the work.
pub type Progress<'a> = &'a mut dyn FnMut(u64) -> bool;

/// A run that is read.
pub struct Source<'a> {
    /// Its job.
    pub job: &'a Job,
    /// Its arm.
    pub robot: &'a Robot,
    /// Facts besides its messages.
    pub happened: Happened<'a>,
    /// Its ticks, in order.
    pub ticks: &'a mut dyn Iterator<Item = Tick>,
    /// Called from time to time.
    pub progress: Progress<'a>,
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
