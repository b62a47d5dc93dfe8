//! The shell of a process: ports on topics, the clock, the waits, real-time settings, the run's place in shared memory.
//!
//! ```text
//! RunDir    /dev/shm/armplane-…: where a run lives; found again and removed when its launcher died
//! Manifest  who is in the run and talks to whom          Board   heartbeats, doorbells, counts, the stop flag
//! Hub       the launcher's side of all topics            Shell   one process's side of everything
//! Reader, Writer, Drain   typed ends of a topic          Pace    the rhythm of the process that makes the ticks
//! ```
//!
//! Data travels on iceoryx2 publish-subscribe services that any iceoryx2 tool can open; wake-ups travel over a futex per process on the
//! board, which costs a system call only when somebody sleeps. Every wait has a limit. This is the only crate that knows iceoryx2.

mod board;
mod clock;
mod difference;
mod edge;
mod fate;
pub mod floor;
mod gauge;
mod hash;
mod kept;
mod ledger;
mod manifest;
mod memory;
mod pace;
mod ports;
pub mod realtime;
mod run_dir;
mod shell;
pub mod stock;
mod topics;

#[cfg(test)]
mod tests;

pub use board::{Board, BoardError, Count, Counts, Line, MAX_PROCESSES, Phase, State, Stop};
pub use clock::{now_ns, sleep_until};
pub use difference::{Difference, Differences, FieldDifference, first_difference};
pub use edge::{leaves_as, random};
pub use gauge::{Glimpse, SingularityGlimpse, Spread};
pub use hash::TopicHash;
pub use kept::{Keep, KeepError, Kept};
pub use ledger::{Account, Ledger, MOST_FAULTS, Origin};
pub use manifest::{Disturbance, Manifest, ManifestError, Mode, Process};
pub use pace::Pace;
pub use ports::{Drain, Reader, SendError, Writer};
pub use run_dir::{FoundRun, RunDir, RunDirError, SHM};
pub use shell::{Interrupted, OpenError, ProcessError, Shell};
pub use topics::{CHAIN_DEPTH, Hub, RECORDER_DEPTH, TopicError};
