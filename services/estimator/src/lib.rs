//! The estimator process: encoder samples in; positions, velocities and unexplained torque out.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod cycle;
mod disturbance;

use model::{Refused, Robot};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{EstimatorCheckpoint, SensorSample, StateEstimate};

pub use cycle::{Cycle, Step};

/// The step for an arm of as many joints as `robot` has.
///
/// # Errors
/// [`Refused`] if robot and scenario do not fit, or the arm has more joints than the program is built for.
pub fn cycle(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn Step>, Refused> {
    model::boxed!(robot, N => Cycle::<N>::new(robot, scenario), dyn Step)
}

/// Estimates until the run stops.
///
/// # Errors
/// [`ProcessError`] if the step cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = cycle(robot, scenario).map_err(ProcessError::setup)?;
    let mut sensors = shell.reader::<SensorSample>()?;
    let mut estimates = shell.writer::<StateEstimate>()?;
    let mut checkpoint = shell.checkpoint::<EstimatorCheckpoint>()?;
    checkpoint
        .previous()
        .into_iter()
        .for_each(|last| cycle.restore(last));
    while let Some(sample) = sensors.next()? {
        let mut estimate = estimates.loan_as_is(sample.header.tick)?;
        cycle.step(sample, &mut estimate);
        if cycle.rejects() {
            shell.mark_message_fault_detected();
        }
        cycle.save(checkpoint.slot());
        estimate.send()?;
    }
    Ok(())
}
