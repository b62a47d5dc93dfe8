#![doc = include_str!("../README.md")]
//!
//! # In this crate
//! PURE: no clock, thread, file, environment or randomness, and nothing allocates after a robot is loaded.
//!
//! - [`Robot`] is the arm as data: a serial chain read from a URDF, and the properties that a URDF has no element for (armature, friction,
//!   encoders, gravity, postures) from a [`description`] in TOML.
//! - [`Model`] is the same arm with its number of joints in the type, ready to compute:
//!   [`Model::evaluate`] gives everything a controller needs in one pass.
//!
//! Conventions. SI units. Frames in Drake's monogram notation: `X_BE` is the pose of E in B; B is the base, E the
//! end-effector frame, L a link, P its parent. Jacobians and twists are `[v; ω]`, in base axes, at the frame's origin.
//! Link frames are the URDF's. A link's joint turns about, or slides along, a unit axis fixed in that link.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod advance;
mod arm;
mod arrays;
mod body;
mod builtin;
pub mod description;
mod dispatch;
mod dynamics;
mod error;
mod factors;
mod foreign;
mod geometry;
mod joint;
mod kinematics;
mod lanes;
mod load;
mod mjcf;
mod mount;
mod pose;
mod robot;
mod rotation;
mod shape;
mod sines;
mod spatial;
mod task;
mod terms;
#[cfg(test)]
mod tests;
mod urdf;

pub use arm::{Model, ModelError};
pub use arrays::{joints, padded};
pub use dispatch::{Refused, SIZES, embedded};
pub use dynamics::ArmMotion;
pub use error::{Defect, PostureError, RobotError};
pub use factors::Factors;
pub use joint::{Frame, Joint, JointKind};
pub use kinematics::stack;
pub use pose::Pose;
pub use robot::Robot;
pub use rotation::{rotation_exp, rotation_log, rotation_twist};
pub use shape::{Geometry, Shape};
pub use shared_types::job::RobotText;
pub use sines::sincos;
pub use task::{TaskAxes, TaskAxis, unit_scaled};
pub use terms::{LastTerms, Terms};
