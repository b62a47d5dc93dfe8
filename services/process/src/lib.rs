//! A process is a step: what it reads and writes, the state that survives a tick, and the faults of
//! its messages. PURE.
//!
//! ```text
//! step            Process, the trait of plant, estimator, analyzer, controller and operator, and of everything that others write
//! port            topics as a step sees them: Port, Inputs, Outputs        scratch   what steps on one thread need not compute twice
//! snapshot        the state as bytes, with layout and checksum        saved     the same with its tick and the message that closes the loop
//! message_faults  what a fault makes of a message as it leaves             fence     which messages count
//! member          a process of a graph with its step
//! thread          a list of steps on one thread                            edges     the same under faults
//! absence         when a fault takes a process down
//! ```
//!
//! Three loops run a step: `runtime::drive` as a process, [`Thread`] beside others on one thread, and a replay on the recorded inputs.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod absence;
mod edges;
mod fence;
mod member;
mod message_faults;
mod packed;
mod port;
mod saved;
mod scratch;
mod snapshot;
mod step;
mod thread;

pub use absence::absence;
pub use edges::Ended;
pub use fence::{Fence, not_finite};
pub use member::Member;
pub use message_faults::{Shaper, apply_to_outgoing, happens, is_cut};
pub use packed::Packed;
pub use port::{Inputs, MOST_PORTS, Outputs, Port};
pub use saved::{CUT_TICKS, NamedSaved, Saved};
pub use scratch::Scratch;
pub use snapshot::{Damaged, Snapshot, Stateless};
pub use step::{Flow, Process, Running, Step};
pub use thread::Thread;
