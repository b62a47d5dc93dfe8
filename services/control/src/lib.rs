//! The paper: control of an arm at its kinematic singularities, dynamically consistent.
//!
//! K.-S. Chang and O. Khatib, *Manipulator Control at Kinematic Singularities: A Dynamically Consistent Strategy*, IROS 1995; cited as CK95 at the
//! function that computes an equation (`[CK95 Eq. 4]`) and at the test that checks it (`// covers: CK95 Eq. 4 (operational_space::Operational::new)`).
//!
//! PURE: no clock, thread, file, environment or randomness; nothing is allocated per tick; no data makes it panic.
//!
//! # Modules
//! | module | content |
//! |---|---|
//! | [`paper`] | s_i and D_si (Eq. 1, 2), operational space and its null space (Eq. 3 to 5), Type 1, Type 2, the switching table |
//! | [`continuous`] | ours (+): one continuous solve, auxiliary loops, governor, foresight, saturation; each reduces to the paper's law |
//! | [`servo`] | ours (+): a target given at this moment as the reference, in place of a path |
//! | [`arm_family`] | one place per family of arms: measures and references together |
//! | [`baselines`] | the laws of others |
//!
//! # One tick
//! [`Analyzer::step`] finds the singularities of the posture: s_i, D_si, ζ_i and their types. [`Controller::step`] takes five steps from there:
//!
//! | step | in `Controller::tick` | what | where |
//! |---|---|---|---|
//! | 1 | `desired_motion` | desired motion of E and C, pose error, a* | [`trajectory`] |
//! | 2 | `coordinates().step` | per singularity: type → target, table → mode, loop → demand | [`paper::type_1`], [`paper::type_2`], [`paper::switching`], [`continuous::auxiliary`] |
//! | 3 | `torques` | Γ = JᵀF + N_T Γ₀, or as one solve | [`paper::chang_khatib`], [`continuous::blended`] |
//! | 4 | `limits` | joint speeds kept; null-space torque is given up first; no torque changes faster than its drive accepts | [`continuous::speed_limit`], [`continuous::saturation`], [`continuous::torque_rate`] |
//! | 5 | `clock` | the speed of the path's clock at the next tick | [`continuous::governor`], [`continuous::foresight`] |
//!
//! [`wire`] turns the values into messages and back.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod analyzer;
pub mod arm_family;
mod auxiliary_coordinates;
pub mod baselines;
mod beyond_reach;
pub mod centre;
mod command;
pub mod continuous;
mod controller;
mod demand_ahead;
mod desired_motion;
mod ground_truth;
pub mod law;
pub mod linear;
pub mod paper;
mod plausibility;
mod posture;
mod route_ahead;
mod served;
pub mod servo;
mod setup;
mod state;
mod steer;
mod steered;
mod telemetry;
mod tick;
pub mod trajectory;
mod types;
pub mod wire;

#[cfg(test)]
extern crate self as control;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

pub use analyzer::{Analyzer, RANK_TOLERANCE};
pub use controller::Controller;
pub use ground_truth::{GroundTruth, ground_truth};
pub use setup::{SetupError, start_posture};
pub use trajectory::Progress;
pub use types::{Class, Command, Kind, Mode, Phase, Plan, Refusal, Report, Singularity};
