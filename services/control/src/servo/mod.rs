//! The reference of a steered run (+): from the target that a person or a program gives at this moment to a smooth motion for the law.
//!
//! There is no path to look along. The [`Reference`] follows the target within the session's speed and acceleration; the law, the governor and the
//! torque rate are those of a path, and see it as a leg of constant twist, [`HORIZON_S`](crate::trajectory::HORIZON_S) long, that begins anew at every tick. The governor's clock
//! slows the reference; [`limits`] adds the joint limits to it. Reach ends the motion by a [`leash`]: the reference is never further from the arm
//! than it, so that nothing winds up and a way back is free at once.
//!
//! Reduces to the paper's law: with a target within reach and limits the reference is a feasible motion, and the law is that of a path.

pub mod intake;
pub mod leash;
pub mod limits;
pub mod reference;

pub use reference::Reference;
