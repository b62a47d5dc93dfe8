//! The controller process: the control law, from estimate and singularities to torque.
#![allow(non_snake_case)]

mod cycle;

use model::{Robot, with_dof};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{SingularityReport, StateEstimate, TorqueCommand};

pub use cycle::Cycle;

/// Controls until the run stops.
///
/// # Errors
/// [`ProcessError`] where the control law cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    with_dof!(robot.dof(), N => control::<N>(shell, robot, scenario)).unwrap_or_else(|| Err(ProcessError::setup("unsupported number of joints")))
}

fn control<const N: usize>(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = Cycle::<N>::new(robot, scenario).map_err(ProcessError::setup)?;
    let mut reports = shell.reader::<SingularityReport>()?;
    let mut estimates = shell.reader::<StateEstimate>()?;
    let mut torques = shell.writer::<TorqueCommand>()?;
    while let Some(report) = reports.next()? {
        let Some(estimate) = estimates.at(report.header.tick)? else { continue };
        torques.send(cycle.step(estimate, report))?;
    }
    Ok(())
}
