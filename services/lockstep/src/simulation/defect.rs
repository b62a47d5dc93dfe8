//! The defects of the protocol that a simulation can have, to prove that it finds them, and the number that stands for bytes.

use std::hash::{DefaultHasher, Hash, Hasher};

pub(crate) fn digest(of: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    of.hash(&mut hasher);
    hasher.finish()
}

/// A defect of the machine, put in to show that the exploration finds it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Defect {
    /// The machine as it is.
    None,
    /// A reader does not look into the retainer after a death.
    NoRetainer,
    /// A death is placed by the ticks that the process has closed.
    PlacedByClosings,
    /// A death between two outputs is planned at the beginning of its tick.
    NoDeathWithinTick,
    /// The source does not wait for the others at the end.
    NoFinish,
    /// The source does not wait at the beginning of a tick.
    NoHoldBack,
    /// The source does not wait for a process that the loop does not wait for.
    NoLag,
    /// The source does not wait for the recorder.
    NoRecorderLag,
    /// A replacement of the recorder does not take what the retainers hold.
    NoRecall,
    /// The recorder's checkpoints are as rare without message logs as with them.
    RareCheckpoints,
}

impl Defect {
    /// Those of the chain.
    pub const OF_THE_CHAIN: [Self; 6] = [
        Self::NoRetainer,
        Self::PlacedByClosings,
        Self::NoDeathWithinTick,
        Self::NoFinish,
        Self::NoHoldBack,
        Self::NoLag,
    ];
    /// Those of the recorder.
    pub const OF_THE_RECORDER: [Self; 3] =
        [Self::NoRecorderLag, Self::NoRecall, Self::RareCheckpoints];

    /// All defects.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::OF_THE_CHAIN.into_iter().chain(Self::OF_THE_RECORDER)
    }
}
