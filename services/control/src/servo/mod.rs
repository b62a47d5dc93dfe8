//! The reference of a steered run (+): from the target that a person or a program gives at this moment to a smooth motion for the law.
//!
//! There is no path to look along. The [`Reference`] follows the target within the session's speed and acceleration; the law, the governor and the
//! torque rate are those of a path, and see it as a leg of constant twist, [`HORIZON_S`](crate::trajectory::HORIZON_S) long, that begins anew at
//! every tick. The governor's clock slows the reference; [`limits`] adds the joint limits to it.
//!
//! The law acts on the *reference arm*: an ideal arm of the same model, without noise or friction, with nine tenths of the torques. Its accelerations
//! keep the [`stops`] of its joints, and the real arm follows it joint by joint: Γ = A(q)(q̈_r + k_v(q̇_r − q̇) + k_p(q_r − q)) + bias. So reference and arm
//! never part: whatever limit ends a motion ends it on the reference arm. Reach ends the motion by [anti-windup](anti_windup) between reference and
//! reference arm, so that nothing winds up and a way back is free at once. Where nothing is left to reach, the reference arm comes to [rest], its
//! null motion included.
//!
//! Reduces to the paper's law: where the arm is its model and no stop is near, q̈ = q̈_r is the acceleration that the law demands.

pub mod anti_windup;
pub mod intake;
pub mod limits;
pub mod reference;
pub mod rest;
pub mod stops;

pub use reference::Reference;
