//! Starts the processes of a run, watches them, stops them, and leaves nothing behind.
//!
//! The launcher knows names and process ids, never the contents of a message. Its guarantees:
//!
//! * Nothing half-started: when a process cannot be started or does not get ready, the others are stopped and everything is removed.
//! * No child outlives it, whatever kills it (`PR_SET_PDEATHSIG`), nor what the programs of others have started ([`Guard`]); what is left in shared
//!   memory then, [`RunDir::remove_stale`] finds.
//! * Ctrl-C reaches it alone; it asks the children to stop, then tells them (SIGTERM), then makes them (SIGKILL), each with a limit. The
//!   recorder is stopped last. A second Ctrl-C skips the asking.
//! * A process that ends unasked ends the run, with one sentence that names it, unless its restart policy says otherwise.

mod child;
mod delay;
mod descendants;
pub mod doctor;
pub mod folders;
mod launch;
mod limits;
mod outcome;
mod plan;
mod signals;
mod spawn;
mod stop;
#[cfg(test)]
mod tests;
mod unfinished;
mod watch;

pub use delay::Delay;
pub use descendants::{Guard, end_descendants, guard};
pub use launch::Launcher;
pub use limits::{Shortage, check_limits, with_room};
pub use outcome::{End, Failure, LaunchError, Outcome, ProcessOutcome};
pub use plan::{Child, Event, Limits, Plan, Restart, reexec};
pub use runtime::Exit;
pub use signals::Interrupts;

use runtime::RunDir;

/// Removes what dead launchers of this user left in shared memory; living runs are not touched.
///
/// # Errors
/// When a file cannot be removed.
pub fn clean() -> Result<Vec<runtime::FoundRun>, runtime::RunDirError> {
    RunDir::remove_stale()
}
