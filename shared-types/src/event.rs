//! Words on a run: what its log says.

/// How much an event matters; the numbers are those of ROS.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Level {
    /// As it should be.
    #[default]
    Info = 20,
    /// Noticed.
    Warning = 30,
    /// Something broke.
    Error = 40,
}

impl Level {
    /// As viewers and tables write it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Info => "INFO",
            Self::Warning => "WARN",
            Self::Error => "ERROR",
        }
    }
}

/// The author of a sentence about a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Source {
    /// The judge: it says the same again when it judges the record again.
    #[default]
    Judge,
    /// The fault table.
    Faults,
}

/// A sentence about a tick.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Event {
    /// The tick.
    pub tick: u64,
    /// How much it matters.
    pub level: Level,
    /// Its author.
    pub source: Source,
    /// The sentence.
    pub text: String,
}
