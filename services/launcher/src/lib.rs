//! Starts the processes of a run, watches them, stops them, and leaves nothing behind.
//!
//! The launcher knows names and process ids, never the contents of a message. Its guarantees:
//!
//! * Nothing stays half-started: if a process does not start or get ready, the others are stopped
//!   and everything is removed.
//! * No child outlives it, even if it is killed (`PR_SET_PDEATHSIG`), nor does any descendant
//!   ([`Guard`]). [`runtime::RunDir::remove_stale`] removes leftovers in shared memory.
//! * Ctrl-C reaches only the launcher. It asks the children to stop, then sends SIGTERM, then
//!   SIGKILL, each after a time limit. The recorder is stopped last. A second Ctrl-C skips the
//!   asking.
//! * If a process ends unasked in lockstep, all processes start again from the newest cut of the
//!   record, at most five times from the same one, and the bytes are those of a run without that death. In real time it alone is replaced, as its restart
//!   policy says.

mod begin;
mod child;
mod delay;
mod descendants;
pub mod doctor;
pub mod folders;
mod launch;
mod limits;
mod outcome;
mod plan;
mod restart;
mod signals;
mod spawn;
mod stop;
mod unfinished;
mod watch;

pub use delay::Delay;
pub use descendants::{Guard, end_descendants, guard};
pub use launch::{Launcher, Ran};
pub use limits::with_room;
pub use outcome::{Death, End, Failure, LaunchError, Outcome, ProcessOutcome};
pub use plan::{Begin, Child, Event, Limits, Plan, reexec, start_beside};
pub use runtime::Exit;
pub use signals::Interrupts;
