//! Runs of the protocol without processes: every schedule of small graphs, and random histories with a recorder.

mod exploration;
mod history;
mod recorder;
mod world;

pub(crate) use world::Graph;
