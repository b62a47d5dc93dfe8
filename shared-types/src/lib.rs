#![doc = include_str!("../README.md")]
//!
//! # In this crate
//! The agreements between processes of armplane, and between armplane and people.
//!
//! * [`wire`]: messages and checkpoints (fixed size, `repr(C)`, no padding, versioned name), and
//!   their layout as data.
//! * [`messages`]: the messages, field by field with units and frames.
//! * [`checkpoints`]: the state from which a restarted process continues, field by field.
//! * [`topics`]: the list of topics, and everything derived from it.
//! * [`bounds`]: comparisons that decide an outcome; NaN fails them.
//! * [`codes`]: named integers in messages.
//! * [`scenario`]: robot, start, task, gains, noise, seed and goal of a run.
//! * [`pose_table`]: a path as rows of poses with times.
//! * [`event`]: a sentence about a tick, for the log.
//! * [`fault`]: faults to inject, by process and tick.
//! * [`graph`]: the processes of a run, their topics and commands; [`process`]: one process;
//!   [`layout`]: messages declared by a graph.
//! * [`file`]: reads such files; errors name the place and the remedy.
//! * [`job`]: all of it together, for a starting process.
//! * [`summary`]: the results of a run, `summary.json`.
//!
//! This crate imports no other crate of the workspace, knows no algebra and does no input or output.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod bounds;
pub mod checkpoints;
pub mod codes;
pub mod event;
pub mod fault;
pub mod file;
pub mod graph;
pub mod job;
pub mod layout;
pub mod messages;
pub mod pose_table;
pub mod process;
pub mod random;
pub mod scenario;
pub mod summary;
pub mod target_file;
pub mod task_end;
pub mod topics;
pub mod wire;
mod words;

pub use checkpoints::{AnalyzerCheckpoint, ControllerCheckpoint, EstimatorCheckpoint};
pub use messages::{
    ControlState, PlantState, SensorSample, ServoState, SingularityReport, SingularityState,
    StateEstimate, Target, TargetContent, TorqueCommand, WristForce,
};
pub use topics::{ByTopic, Topic};
pub use wire::{Header, Layout, Message, Stamps};

/// Most joints an arm may have on the wire; arrays of joints have this length and are zero beyond the arm's own.
pub const MAX_DOF: usize = 8;

/// Most singularities reported at once.
pub const MAX_SINGULARITIES: usize = 4;

/// Whether a value is the one that a file may leave out.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}
