//! The shell of a process: ports on topics, the clock, the waits, real-time settings, the run's place in shared memory.
//!
//! ```text
//! RunDir        /dev/shm/armplane-…: a run's files; found again and removed when its launcher has died
//! Manifest      the processes of the run and their topics   ControlPage   heartbeats, doorbells, counts, the stop flag
//! Hub           the launcher's side of all topics           Shell         one process's side of everything
//! Reader, Writer, Collector   typed ends of a topic         TickSource    the rhythm of the process that makes the ticks
//! ```
//!
//! Data travels on iceoryx2 publish-subscribe services, which any iceoryx2 tool can open. Wake-ups
//! travel over a futex per process on the control page, which costs a system call only if its owner
//! sleeps. Every wait has a limit. Apart from `lab`'s baseline transports, this is the only crate
//! that uses iceoryx2.

mod bus;
mod checkpoint;
mod clock;
mod complain;
mod context;
mod control_page;
mod disturbance;
mod doorbell;
mod drive;
mod environment;
mod fault;
mod joined;
mod look_out;
mod manifest;
mod mapped;
pub mod realtime;
mod reserved;
mod rounds;
mod run_dir;
mod saving;
mod shell;
mod signal;
mod stamping;
mod stand_in;
mod tick_source;
mod turns;
mod unfinished;
mod wait;
mod watcher;

#[cfg(test)]
mod tests;

/// The page on a graph of one's own, whose program is compiled as a test.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/graph.md")]
struct GraphPage;

/// The page on programs of others, whose one in Rust is compiled as a test.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/wire.md")]
struct WirePage;

pub use bus::collector::Collector;
pub use bus::error::TopicError;
pub use bus::hub::Hub;
pub use bus::reader::Reader;
pub use bus::writer::{SendError, Writer};
pub use clock::now_ns;
pub use complain::complain;
pub use control_page::live_statistics::Distribution;
pub use control_page::{
    ControlPage, ControlPageError, Count, Counts, Phase, ProcessEntry, State, Stop,
};
pub use doorbell::DoorbellPort;
pub use drive::{Outside, drive};
pub use environment::{PROCESS_VARIABLE, RUN_VARIABLE, join};
pub use fault::exit::Exit;
pub use fault::table::{FaultRecord, FaultTable, MOST_FAULTS, MOST_WHEN_REQUESTED, Origin};
pub use joined::{Input, Joined, JoinedError, Output, past_of};
pub use manifest::{Disturbance, Manifest, ManifestError, Process};
pub use process::{CUT_TICKS, NamedSaved, Saved};
pub use reserved::{release_reserve, reserve, write_reserved};
pub use run_dir::{FoundRun, RunDir, RunDirError, SHM};
pub use saving::leave;
pub use shared_types::job::Mode;
pub use shared_types::process::MAX_PROCESSES;
pub use shared_types::random::at as random;
pub use shell::{ProcessError, Shell};
pub use stand_in::stand_in;
pub use tick_source::TickSource;
pub use wait::Interrupted;
pub use watcher::Watcher;
