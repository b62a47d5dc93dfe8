#![doc = include_str!("../README.md")]
//!
//! # In this crate
//! The paper is cited as CK95 at the function that computes an equation (`[CK95 Eq. 4]`) and at the test that checks it
//! (`// covers: CK95 Eq. 4 (operational_space::Operational::Jbar)`).
//!
//! PURE: no clock, thread, file, environment or randomness; nothing is allocated per tick; no data makes it panic.
//!
//! # Modules
//! | module | content |
//! |---|---|
//! | [`tick`] | one tick: state in, state out, in seven calls |
//! | [`reference`] | step 1: a path, targets given at this moment (+), a commanded turn of ζ |
//! | [`law`] | steps 2 and 3: the problem on one page, the singular rows, one solve for every strategy |
//! | [`paper`] | Eq. 1 to 5, Type 1, Type 2, the switching table |
//! | [`limits`] | steps 4 and 5 (+): filters in the order in which they act, and the clock |
//! | [`singularity`] | where an arm is singular: measures, directions, types, and the references of their coordinates |
//! | [`plan`] | one search for a route along the whole path, before the first tick (+) |
//! | [`baselines`] | the laws of others |
//!
//! Before the tick, [`Analyzer::step`] finds the singularities of the posture: s_i, D_si, ζ_i and their types. What is marked (+) goes beyond the paper,
//! and reduces to its law where a path is feasible.
//!
//! [`wire`] turns the values into messages and back.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

pub mod baselines;
pub mod centre;
mod command;
mod controller;
mod ground_truth;
pub mod law;
pub mod limits;
pub mod linear;
pub mod paper;
pub mod plan;
pub mod reference;
mod setup;
pub mod singularity;
mod state;
pub mod tick;
mod types;
pub mod wire;

#[cfg(test)]
extern crate self as control;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

pub use controller::Controller;
pub use ground_truth::{Asked, Contact, GroundTruth, ground_truth};
pub use paper::type_1::SIDE_CHANGE;
pub use plan::scenario::advice;
pub use reference::free_axis::free_axis;
pub use reference::path::{Progress, quintic};
pub use setup::{SetupError, start_posture};
pub use singularity::analyzer::{Analyzer, RANK_TOLERANCE};
pub use tick::Inputs;
pub use types::{Class, Command, Kind, Mode, Phase, Plan, Refusal, Report, Singularity};
