//! Runs of the protocol without processes: every schedule of small graphs, and random histories with a recorder.

#[cfg(test)]
mod exploration;
mod history;
mod recorder;
mod world;

pub use history::{Outcome, history};
#[cfg(test)]
pub(crate) use world::Graph;
