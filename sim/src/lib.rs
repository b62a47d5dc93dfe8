//! The simulated arm: its physics, its encoders, its drives.
//!
//! PURE: no clock, thread, file, environment or unseeded randomness. Same inputs, same bits.
//!
//! - [`Plant`] integrates the arm. `"reference"`: Runge–Kutta of the smooth dynamics, nothing else. `"rapier"` (the default): the same integrator
//!   carries the state, and rapier3d computes the effect of contact and joint stops on it. Dry friction of an arm that touches nothing is solved
//!   here.
//! - [`Encoders`] read the joints: quantised, with noise that is a function of (seed, tick, joint).
//! - [`Drive`] turns commanded torque into applied torque: it checks, limits and reports, and stops the arm by itself when
//!   commands cease.
//! - [`scenarios`]: the built-in ones.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod drive;
mod dry_friction;
mod encoder;
mod error;
mod hybrid;
mod noise;
mod plant;
pub mod scenarios;
mod smooth;
mod solids;
mod surface;
#[cfg(test)]
mod tests;
mod world;

pub use drive::{Drive, STOP_GAIN};
pub use encoder::Encoders;
pub use error::PlantError;
pub use hybrid::Touch;
pub use noise::gaussians;
pub use plant::{Diverged, Plant};
pub use smooth::State;
