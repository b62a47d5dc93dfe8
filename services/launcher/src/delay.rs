//! Why a run waits for a process.

/// The reason for which a run waits for a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delay {
    /// It is stopped (SIGSTOP).
    Stopped,
    /// A debugger holds it.
    Traced,
    /// It is not ready for the first tick.
    NotReady,
    /// It has not closed the tick in hand.
    Behind,
    /// It has been asked to stop, and has not stopped.
    NotStopped,
}

impl std::fmt::Display for Delay {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Stopped => "is stopped (SIGSTOP): waiting",
            Self::Traced => "is held by a debugger: waiting",
            Self::NotReady => "is still starting, and the first tick waits for it (Ctrl-C ends the run, `--silence-limit SECONDS` limits the wait)",
            Self::Behind => "has not finished the current tick: waiting",
            Self::NotStopped => "was asked to stop and still runs: waiting (Ctrl-C kills it)",
        })
    }
}
