//! The analyzer process: where the arm is singular, or nearly; in which directions; of which type.
#![allow(non_snake_case)]

mod cycle;

use model::{Robot, with_dof};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{SingularityReport, StateEstimate};

pub use cycle::Cycle;

/// Analyses until the run stops.
///
/// # Errors
/// [`ProcessError`] where the analyzer cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    with_dof!(robot.dof(), N => analyse::<N>(shell, robot, scenario)).unwrap_or_else(|| Err(ProcessError::setup("unsupported number of joints")))
}

fn analyse<const N: usize>(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = Cycle::<N>::new(robot, scenario).map_err(ProcessError::setup)?;
    let mut estimates = shell.reader::<StateEstimate>()?;
    let mut reports = shell.writer::<SingularityReport>()?;
    while let Some(estimate) = estimates.next()? {
        reports.send(cycle.step(estimate))?;
    }
    Ok(())
}
