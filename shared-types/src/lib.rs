#![doc = include_str!("../README.md")]
//!
//! # In this crate
//! Everything two processes of armplane, or a process and a person, agree on.
//!
//! * [`wire`]: what a message and a checkpoint are (fixed size, `repr(C)`, no padding, explicit versioned name), and their layout as data.
//! * [`messages`]: the messages, field by field with units and frames.
//! * [`checkpoints`]: what a restarted process needs of its own past, field by field.
//! * [`topics`]: THE list of topics, and what is derived from it.
//! * [`bounds`]: comparisons that decide an outcome; NaN fails them.
//! * [`codes`]: the named integers that travel in them.
//! * [`scenario`]: what a run does: robot, start, task, gains, noise, seed, judgement.
//! * [`fault`]: what can be made to go wrong, in which process, when.
//! * [`graph`]: the processes of a run, their topics and commands; [`process`]: one of them; [`layout`]: messages that only a graph knows.
//! * [`exchange`]: the page through which a program in another language takes part.
//! * [`file`]: how such files are read, and how their errors name the place and the remedy.
//! * [`job`]: all of it together, as a starting process reads it.
//! * [`summary`]: what a run left: the schema of `summary.json`.
//!
//! This crate imports no other crate of the workspace, knows no algebra and does no input or output.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod bounds;
pub mod checkpoints;
pub mod codes;
pub mod exchange;
pub mod fault;
pub mod file;
pub mod graph;
pub mod job;
pub mod layout;
pub mod messages;
pub mod process;
pub mod random;
pub mod scenario;
pub mod summary;
pub mod target_file;
pub mod task_end;
pub mod topics;
pub mod wire;

pub use checkpoints::{AnalyzerCheckpoint, ControllerCheckpoint, EstimatorCheckpoint};
pub use messages::{
    ControlState, PlantState, SensorSample, ServoState, SingularityReport, SingularityState,
    StateEstimate, Target, TargetContent, TorqueCommand,
};
pub use topics::{ByTopic, Topic};
pub use wire::{Checkpoint, Header, Layout, Message, Stamps};

/// Most joints an arm may have on the wire; arrays of joints have this length and are zero beyond the arm's own.
pub const MAX_DOF: usize = 8;

/// Most singularities reported at once.
pub const MAX_SINGULARITIES: usize = 4;
