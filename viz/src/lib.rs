//! From the messages of a run to a Rerun recording one wants to look at: the only code that knows Rerun.
//!
//! * [`Recording`] takes one complete tick at a time and writes an `.rrd` that ends cleanly: on a full disk, and when its process is killed.
//! * What is recorded: [`Signal`] names the numbers (1 kHz); the picture (50 Hz) is the arm, its target and path, the singular frame with
//!   the lost direction ζ, ghosts of null-space motion; modes, states and words come as they change.
//! * How it is shown: a blueprint in the file, one layout per purpose, also as `.rbl` ([`Recording::save_blueprint`]).
//!
//! PURE inside: `signals`, `scene`, `arm`, `solid` and `story` map messages to data; `sink`, `blueprint` and `recording` write them.

#![allow(non_snake_case)]

mod arm;
mod blueprint;
mod entity;
mod recording;
mod scene;
mod signals;
mod sink;
mod solid;
mod story;
#[cfg(test)]
mod synthetic;

pub use recording::{Level, Options, Recording, RunInfo};
pub use signals::{HOP_NAMES, Signal, TickRow};
pub use sink::{FileInfo, RecordError, Storage};
