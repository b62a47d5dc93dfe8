//! A fault in its fixed-size form, which all processes of a run share.

use bytemuck::{Pod, Zeroable};

use super::kind::{Kind, MOST_DELAY_TICKS, Way};

/// A fault as the processes of a run carry it out: fixed size, in shared memory.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ScheduledFault {
    /// Index of the process in the manifest.
    pub process: u32,
    /// Number of its [`Kind`].
    pub kind: u32,
    /// Number of its [`Way`].
    pub way: u32,
    /// The joint from 0; the place of the corrupted number in the message, in bytes; for `cut` the place of the topic among those that the process
    /// reads.
    pub target: u32,
    /// First tick.
    pub at: u64,
    /// First tick it no longer concerns; `u64::MAX`: never.
    pub until: u64,
    /// Share of messages.
    pub probability: f64,
    /// By how much, in the way's unit; for `delay` the ticks.
    pub amount: f64,
    /// Most additional delay; ticks.
    pub jitter: u64,
    /// Seed of its random numbers.
    pub seed: u64,
}

impl ScheduledFault {
    /// The kind; `None` for a number that no kind has.
    #[must_use]
    pub fn kind(&self) -> Option<Kind> {
        Kind::ALL.get(self.kind as usize).copied()
    }

    /// In which way.
    #[must_use]
    pub fn way(&self) -> Option<Way> {
        Way::ALL.get(self.way as usize).copied()
    }

    /// Whether a run cannot go on from the messages and states at the beginning of a tick alone: the fault holds messages back there, or keeps a process
    /// away from them, or repeats one of a tick shortly before.
    #[must_use]
    pub fn unsettles(&self, tick: u64) -> bool {
        let is_past = self.until.saturating_add(2 * MOST_DELAY_TICKS) < tick;
        self.has_unsettled(tick) && !is_past
    }

    /// Whether it has come between messages and their readers by a tick, or takes a process down: the record does not say who was given what.
    #[must_use]
    pub fn has_unsettled(&self, tick: u64) -> bool {
        let is_of_edges =
            |kind: Kind| kind.takes_down() || kind.shapes_messages() || kind == Kind::Cut;
        self.kind().is_some_and(is_of_edges) && self.at <= tick.saturating_add(2)
    }

    /// Whether a tick is concerned.
    #[must_use]
    pub fn concerns(&self, tick: u64) -> bool {
        (self.at..self.until).contains(&tick)
    }
}
