//! The controller's pure step: torque from the estimated state and its singularity report.

use control::{Controller, Refusal, SetupError, start_posture, wire};
use model::{Model, Robot};
use shared_types::scenario::Scenario;
use shared_types::{SingularityReport, StateEstimate, TorqueCommand};

/// One arm's control law, tick by tick.
#[derive(Clone, Debug)]
pub struct Cycle<const N: usize> {
    controller: Controller<N>,
}

impl<const N: usize> Cycle<N> {
    /// A controller at the start of the scenario's task.
    ///
    /// # Errors
    /// [`SetupError`] where the scenario does not fit the robot.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, SetupError> {
        let frame = (!scenario.frame.is_empty()).then_some(scenario.frame.as_str());
        let q_start = start_posture(robot, scenario)?;
        Ok(Self { controller: Controller::new(Model::new(robot, frame)?, robot, scenario, q_start)? })
    }

    /// Takes up the state that `last` carries: what a restarted controller does.
    pub fn resume(&mut self, last: &TorqueCommand) {
        self.controller.restore(&last.resume);
    }

    /// The torque for an estimate and the report of the same tick, at that tick. No allocation; a report that cannot be read is refused.
    pub fn step(&mut self, estimate: &StateEstimate, report: &SingularityReport) -> TorqueCommand {
        let (q, qdot) = (wire::joints(&estimate.q), wire::joints(&estimate.qdot));
        let command = match wire::report(report) {
            Ok(report) => self.controller.step(&q, &qdot, &wire::joints(&estimate.tau_disturbance), &report),
            Err(_) => self.controller.refuse(&q, &qdot, Refusal::Report),
        };
        wire::command_message(estimate.header.tick, &command, &self.controller)
    }
}
