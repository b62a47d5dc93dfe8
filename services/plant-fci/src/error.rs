//! Failures of the robot, each with its remedy.

use crate::address::Address;

/// Why the robot cannot be used, or is lost.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RobotFailure {
    /// This program does not contain the client.
    #[error(
        "this armplane is built without Franka's control interface: build it with `cargo build --release --features fci`"
    )]
    NotBuilt,
    /// Nothing answers there.
    #[error(
        "no robot answers at {address} ({reason}): see that it is switched on, unlocked, in FCI mode and reachable, or start the simulator (docs/franka.md)"
    )]
    Unreachable {
        /// The address.
        address: Address,
        /// The client's own words.
        reason: String,
    },
    /// The two speak different versions.
    #[error(
        "the robot at {address} has version {theirs} of the interface; this program has 5 and 10: use a robot system that matches one of them"
    )]
    Version {
        /// The address.
        address: Address,
        /// The robot's version.
        theirs: u16,
    },
    /// It is not in a mode in which a motion can begin.
    #[error("the robot at {address} is in the mode \"{mode}\"{errors}: {remedy}")]
    NotReady {
        /// The address.
        address: Address,
        /// Its mode.
        mode: String,
        /// Its errors.
        errors: String,
        /// The remedy.
        remedy: &'static str,
    },
    /// It stopped the motion by itself.
    #[error(
        "the robot stopped the arm by a reflex at tick {tick}: {errors}; acknowledge it in Desk, or start the simulator again, before the next run"
    )]
    Reflex {
        /// Tick of the run; 0 before the first.
        tick: u64,
        /// The names of its errors.
        errors: String,
    },
    /// The connection broke.
    #[error(
        "the robot at {address} is lost at tick {tick} ({reason}): it stops the arm by itself when commands cease; see to the network, or start the simulator again"
    )]
    Lost {
        /// The address.
        address: Address,
        /// Tick of the run.
        tick: u64,
        /// The client's own words.
        reason: String,
    },
    /// It refused a request.
    #[error("the robot at {address} refuses to {action}: {reason}")]
    Refused {
        /// The address.
        address: Address,
        /// The request.
        action: &'static str,
        /// Its words.
        reason: String,
    },
    /// Its URDF cannot be used.
    #[error("the robot's own description cannot be used: {0}")]
    Description(String),
    /// The arm did not get to the start.
    #[error(
        "the arm did not come to rest at the start posture: joint {joint} is {off_mrad:.1} mrad off after {seconds:.1} s; free its way, or choose another start"
    )]
    NotAtStart {
        /// Which, from 1.
        joint: usize,
        /// How far off.
        off_mrad: f64,
        /// The time that it had.
        seconds: f64,
    },
}

impl From<RobotFailure> for runtime::ProcessError {
    fn from(failure: RobotFailure) -> Self {
        Self::setup(failure)
    }
}
