//! The end of a task, for the process that makes the ticks: reported by the controller, or by a
//! time limit. PURE.

use crate::codes::{PHASE_DONE, PHASE_REFUSED, PHASE_RUNNING};
use crate::scenario::Scenario;

/// Time for the arm to come to rest after the controller has refused to continue; s.
const REFUSED_S: u64 = 2;

/// Done; refused, and the arm has had 2 s to come to rest; or 20 times as long as planned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TaskEnd {
    phase: u32,
    refused_ticks: u64,
    refused_limit: u64,
    limit: u64,
}

impl TaskEnd {
    /// The governor may stretch a task to this many times its planned length, and no run is longer.
    pub const LONGEST: u32 = 20;

    /// Before the first command of a scenario: its run has at most the ticks of the interrupted session that it repeats, or [`LONGEST`](Self::LONGEST)
    /// times the planned ones.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        let planned_s = f64::from(Self::LONGEST) * scenario.duration_s();
        let longest = (planned_s * f64::from(scenario.rate_hz)).round() as u64;
        Self::new(scenario.rate_hz, scenario.at_most(longest))
    }

    /// Before the first command of a run of `rate_hz` ticks per second and at most `limit` ticks.
    #[must_use]
    pub fn new(rate_hz: u32, limit: u64) -> Self {
        Self {
            phase: PHASE_RUNNING,
            refused_ticks: 0,
            refused_limit: REFUSED_S * u64::from(rate_hz),
            limit,
        }
    }

    /// The phase in force, and for how many ticks a refusal has been: all that a tick changes.
    #[must_use]
    pub fn saved(&self) -> (u32, u64) {
        (self.phase, self.refused_ticks)
    }

    /// Goes on from what [`saved`](Self::saved) has given.
    pub fn resume(&mut self, phase: u32, refused_ticks: u64) {
        self.phase = phase;
        self.refused_ticks = refused_ticks;
    }

    /// Takes in the phase of a tick's command, one of `codes::PHASES`; `None`: none came, and the
    /// previous one stays in force.
    pub fn take(&mut self, phase: Option<u32>) {
        self.phase = phase.unwrap_or(self.phase);
        self.refused_ticks = if self.phase == PHASE_REFUSED {
            self.refused_ticks + 1
        } else {
            0
        };
    }

    /// Whether the run is over after so many ticks.
    #[must_use]
    pub fn is_over(&self, ticks: u64) -> bool {
        self.phase == PHASE_DONE || self.refused_ticks > self.refused_limit || ticks >= self.limit
    }
}
