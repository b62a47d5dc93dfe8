//! The reference arm's own parts of a steered run: its analysis, and the drives of the arm that follows it (+).

use crate::analyzer::Analyzer;
use model::{Model, Robot};
use nalgebra::SVector;
use shared_types::scenario::Scenario;

/// Share of the torques and torque rates that the reference arm takes; the rest is for following it.
const SHARE: f64 = 0.9;

/// The drives of a steered arm, and the analysis of its reference arm, whose model has a share of their torques.
#[derive(Clone, Debug)]
pub(crate) struct Steered<const N: usize> {
    pub(crate) analyzer: Analyzer<N>,
    /// Joints of the arm.
    pub(crate) dof: usize,
    /// Torque limits, N·m.
    pub(crate) effort: SVector<f64, N>,
    /// Largest change of each torque in a tick, N·m.
    pub(crate) torque_step: SVector<f64, N>,
}

/// The model of the reference arm where the scenario is steered, and its parts; else the arm's own model.
pub(crate) fn of<const N: usize>(
    model: Model<N>,
    robot: &Robot,
    scenario: &Scenario,
) -> (Model<N>, Option<Steered<N>>) {
    if scenario.servo.is_none() {
        return (model, None);
    }
    let steered = Steered {
        analyzer: Analyzer::new(robot, &scenario.analysis),
        dof: robot.dof(),
        effort: *model.effort(),
        torque_step: model.torque_rate() * scenario.dt_s(),
    };
    (model.with_torque_share(SHARE), Some(steered))
}
