//! The estimator process: encoder samples in; positions, velocities and unexplained torque out.
#![allow(non_snake_case)]

mod cycle;

use model::{Robot, with_dof};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{SensorSample, StateEstimate};

pub use cycle::Cycle;

/// Estimates until the run stops.
///
/// # Errors
/// [`ProcessError`] where the estimator cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    with_dof!(robot.dof(), N => estimate::<N>(shell, robot, scenario)).unwrap_or_else(|| Err(ProcessError::setup("unsupported number of joints")))
}

fn estimate<const N: usize>(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = Cycle::<N>::new(robot, scenario).map_err(ProcessError::setup)?;
    let mut sensors = shell.reader::<SensorSample>()?;
    let mut estimates = shell.writer::<StateEstimate>()?;
    while let Some(sample) = sensors.next()? {
        estimates.send(cycle.step(sample))?;
    }
    Ok(())
}
