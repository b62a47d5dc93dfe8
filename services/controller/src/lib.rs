//! The controller process: the control law, from estimate and singularities to torque.
#![allow(non_snake_case)]

mod cycle;

use model::{Refused, Robot, with_dof};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{SingularityReport, StateEstimate, TorqueCommand};

pub use cycle::Cycle;

/// The pure step, whatever the number of joints; compiled once per number, here.
pub trait Step {
    /// The torque for an estimate and the report of the same tick.
    fn step(&mut self, estimate: &StateEstimate, report: &SingularityReport) -> TorqueCommand;
    /// Takes up the state that `last` carries.
    fn resume(&mut self, last: &TorqueCommand);
}

impl<const N: usize> Step for Cycle<N> {
    fn step(&mut self, estimate: &StateEstimate, report: &SingularityReport) -> TorqueCommand {
        self.step(estimate, report)
    }
    fn resume(&mut self, last: &TorqueCommand) {
        self.resume(last);
    }
}

/// The step for an arm of as many joints as `robot` has.
///
/// # Errors
/// [`Refused`] where robot and scenario do not fit, or the program is not built for that number of joints.
pub fn cycle(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn Step>, Refused> {
    with_dof!(robot.dof(), N => Cycle::<N>::new(robot, scenario).map(|cycle| Box::new(cycle) as Box<dyn Step>).map_err(Refused::because))
        .unwrap_or_else(|| Err(Refused::size(robot)))
}

/// Controls until the run stops.
///
/// # Errors
/// [`ProcessError`] where the step cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = cycle(robot, scenario).map_err(ProcessError::setup)?;
    let mut reports = shell.reader::<SingularityReport>()?;
    let mut estimates = shell.reader::<StateEstimate>()?;
    let mut torques = shell.writer::<TorqueCommand>()?;
    if let Some(last) = torques.legacy() {
        cycle.resume(last);
    }
    while let Some(report) = reports.next()? {
        let Some(estimate) = estimates.at(report.header.tick)? else { continue };
        torques.send(cycle.step(estimate, report))?;
    }
    Ok(())
}
