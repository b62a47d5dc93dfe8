//! The lockstep protocol without processes: pure decisions and their data.
//!
//! ```text
//! protocol          which ticks are closed, which process waits for which, and what a death changes
//! recall            the messages that no living reader has received
//! engine            the processes of a graph on one thread, step by step: the chain's runs under faults, and the simulation's
//! simulation        random histories and every schedule of small graphs: no lost tick, no double tick, no deadlock
//! ```
//!
//! `runtime` carries the decisions out on shared memory; nothing here knows a clock, a thread or a file.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod checkpoint_rule;
pub mod engine;
mod protocol;
mod recall;
#[cfg(test)]
mod simulation;

pub use checkpoint_rule::most_ticks_unsaved;
pub use protocol::{
    CHAIN_LAG, Outage, Progress, Protocol, RECORDER_LAG, Report, Role, View, unplanned_death,
};
pub use recall::{Recall, Ring, oldest_missed};
