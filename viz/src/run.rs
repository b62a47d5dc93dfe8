//! A run as everything here reads it: its ticks, and what happened besides.

use model::Robot;
use shared_types::event::Event;
use shared_types::job::Job;
use shared_types::messages::SingularityState;
use shared_types::summary::FaultSummary;
use shared_types::topics::{ByTopic, CHAIN, Received};
use shared_types::wire::Header;
use shared_types::{MAX_DOF, Message, SingularityReport};

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

impl std::ops::Deref for Tick {
    type Target = ByTopic<Received>;

    fn deref(&self) -> &ByTopic<Received> {
        &self.messages
    }
}

impl Tick {
    /// Joint positions, rad: the simulator's, else the estimator's.
    pub(crate) fn q(&self) -> Option<&[f64; MAX_DOF]> {
        let estimated = self.estimate.as_ref().map(|estimate| &estimate.q);
        self.plant_state.as_ref().map(|m| &m.q).or(estimated)
    }

    /// Joint velocities, rad/s: the simulator's, else the estimator's.
    pub(crate) fn qdot(&self) -> Option<&[f64; MAX_DOF]> {
        let estimated = self.estimate.as_ref().map(|estimate| &estimate.qdot);
        self.plant_state.as_ref().map(|m| &m.qdot).or(estimated)
    }

    /// The singularities reported.
    pub(crate) fn singularities(&self) -> &[SingularityState] {
        self.singularity
            .as_ref()
            .map_or(&[], SingularityReport::listed)
    }

    /// The headers of the messages of [`CHAIN`]'s topics.
    pub(crate) fn headers(&self) -> [Option<&Header>; CHAIN.len()] {
        [
            self.sensor.as_ref().map(Message::header),
            self.estimate.as_ref().map(Message::header),
            self.singularity.as_ref().map(Message::header),
            self.torque.as_ref().map(Message::header),
        ]
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
