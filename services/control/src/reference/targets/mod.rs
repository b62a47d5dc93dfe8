//! The reference of a steered run (+): from the target that a person or a program gives at this moment to a smooth motion for the law.
//!
//! There is no path to look along. The [`TargetState`] follows the target within the session's speed and acceleration; the law, the clock and the
//! limits are those of a path, and see it as a leg of constant twist, [`HORIZON_S`](super::path::HORIZON_S) long, that begins anew at every tick.
//!
//! The law acts on the *reference arm*: an ideal arm of the same model, without noise or friction, with nine tenths of the torques. Its accelerations
//! keep the [stops](crate::limits::range::stopped) of its joints, and the real arm follows it joint by joint: Γ = A(q)(q̈_r + k_v(q̇_r − q̇) +
//! k_p(q_r − q)) + bias. So reference and arm never part: whatever limit ends a motion ends it on the reference arm. Reach ends the motion by the bounded
//! [`lead`] of the reference over the reference arm, so that nothing winds up and a way back is free at once. Where nothing is left to reach, the
//! reference arm comes to [`rest`], its null motion included.
//!
//! Reduces to the paper's law: where the arm is its model and no stop is near, q̈ = q̈_r is the acceleration that the law demands.

pub mod intake;
pub mod lead;
pub mod rest;
mod state;
mod steer;

pub use state::{TargetState, without_text};

use crate::limits::torque::Drives;
use crate::singularity::analyzer::Analyzer;
use crate::types::Refusal;
use model::{Model, Robot};
use shared_types::scenario::Scenario;

/// Share of the torques and torque rates that the reference arm takes; the rest is for following it.
pub(crate) const SHARE: f64 = 0.9;

/// Of a steered run: the drives of the arm, and the analysis of its reference arm, whose model has a share of their torques.
#[derive(Clone, Debug)]
pub(crate) struct Targets<const N: usize> {
    pub(crate) analyzer: Analyzer<N>,
    /// Joints of the arm.
    dof: usize,
    /// Of the arm itself.
    drives: Drives<N>,
}

impl<const N: usize> Targets<N> {
    /// Those of an arm, `model` the arm's own.
    pub(crate) fn new(model: &Model<N>, robot: &Robot, scenario: &Scenario) -> Self {
        Self {
            analyzer: Analyzer::new(robot, &scenario.analysis),
            dof: robot.dof(),
            drives: Drives::of(model, robot.gravity, scenario.dt_s()),
        }
    }
}

/// Whether a steered arm goes on after this refusal, once at rest.
pub(crate) fn goes_on(refusal: Refusal) -> bool {
    matches!(
        refusal,
        Refusal::Limit
            | Refusal::Singular
            | Refusal::Speed
            | Refusal::Room
            | Refusal::Unlisted
            | Refusal::Parted
    ) || gives_up(refusal)
}

/// Whether this refusal ends the force that a target asks for.
pub(crate) fn gives_up(refusal: Refusal) -> bool {
    matches!(
        refusal,
        Refusal::Contact | Refusal::Bounce | Refusal::Pressing
    )
}
