//! A fault in its fixed-size form, which all processes of a run share.

use bytemuck::{Pod, Zeroable};

use super::kind::{Kind, Way};

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
        Kind::of(self.kind)
    }

    /// In which way.
    #[must_use]
    pub fn way(&self) -> Option<Way> {
        Way::of(self.way)
    }

    /// Whether a tick is concerned.
    #[must_use]
    pub fn concerns(&self, tick: u64) -> bool {
        (self.at..self.until).contains(&tick)
    }
}
