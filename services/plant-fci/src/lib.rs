//! A Franka arm as the plant: torques over Franka's control interface (FCI), its states as sensor samples.
//!
//! The robot's clock paces the run: each state of its 1 kHz stream is a tick, answered by the
//! torque computed from it. The interface compensates gravity and friction itself, so the torque
//! sent is the commanded one minus g(q). It changes by less than 1 N·m per tick. The drives of the
//! simulated plant ([`sim::Drive`]) stand in front of the robot, and hold, stop and refuse as they
//! do there.
//!
//! ```text
//! address.rs      fci://HOST[:PORT]              cycle.rs      from state and command to the torque sent
//! approach.rs     to the start posture           description.rs  the robot's own URDF as a robot of armplane
//! client.rs       the robot (feature `fci`)      error.rs      failures in words, with a remedy
//! interface.rs    its constants
//! ```
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]
// Without the client the pure parts have no caller but their tests.
#![cfg_attr(not(feature = "fci"), allow(dead_code))]

mod address;
mod approach;
#[cfg(feature = "fci")]
mod client;
mod cycle;
mod description;
mod error;
mod interface;
#[cfg(feature = "fci")]
mod process;

use model::{Robot, RobotText};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;

pub use address::{Address, SCHEME};
pub use error::RobotFailure;
pub use interface::{JOINTS, RATE_HZ};

/// The robot at an address by its own description: its URDF, and properties that a URDF cannot
/// express. `None`: it has no URDF (FCI version 5).
///
/// # Errors
/// [`RobotFailure`] if there is no robot, it is not ready for a motion, or its URDF is no arm of seven joints.
#[cfg(feature = "fci")]
pub fn describe(address: &Address, name: &str) -> Result<Option<RobotText>, RobotFailure> {
    let client = client::Client::connect(address)?;
    client.check_ready()?;
    client
        .urdf()?
        .map(|urdf| description::source(name, urdf))
        .transpose()
}

/// Takes part in the run as its plant until the task is over or the run stops.
///
/// # Errors
/// [`ProcessError`] if the robot is lost, stops by a reflex, or the graph breaks.
#[cfg(feature = "fci")]
pub fn run(
    shell: &Shell,
    robot: &Robot,
    scenario: &Scenario,
    address: &Address,
) -> Result<(), ProcessError> {
    process::run(shell, robot, scenario, address)
}

/// Without the feature `fci` there is no robot.
///
/// # Errors
/// Always.
#[cfg(not(feature = "fci"))]
pub fn describe(_address: &Address, _name: &str) -> Result<Option<RobotText>, RobotFailure> {
    Err(RobotFailure::NotBuilt)
}

/// Without the feature `fci` there is no robot.
///
/// # Errors
/// Always.
#[cfg(not(feature = "fci"))]
pub fn run(
    _shell: &Shell,
    _robot: &Robot,
    _scenario: &Scenario,
    _address: &Address,
) -> Result<(), ProcessError> {
    Err(ProcessError::setup(RobotFailure::NotBuilt))
}
