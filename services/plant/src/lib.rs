//! The plant process: the simulated arm, its sensors and its drives. It makes the ticks.
#![allow(non_snake_case)]

mod cycle;

use model::{Robot, with_dof};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{PlantState, SensorSample, TorqueCommand};

pub use cycle::Cycle;

/// Simulates `robot` until the task is over or the run stops.
///
/// # Errors
/// [`ProcessError`] where the plant cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    with_dof!(robot.dof(), N => simulate::<N>(shell, robot, scenario)).unwrap_or_else(|| Err(ProcessError::setup("unsupported number of joints")))
}

fn simulate<const N: usize>(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = Cycle::<N>::new(robot, scenario).map_err(ProcessError::setup)?;
    let mut sensors = shell.writer::<SensorSample>()?;
    let mut truths = shell.writer::<PlantState>()?;
    let mut torques = shell.reader::<TorqueCommand>()?;
    let mut pace = shell.pace(0);
    while let Some(tick) = pace.next()? {
        let (sample, truth) = cycle.sample(tick);
        sensors.send(sample)?;
        truths.send(truth)?;
        cycle.step(torques.at_until(tick, pace.deadline_ns())?);
        if cycle.is_over() {
            break;
        }
    }
    Ok(())
}
