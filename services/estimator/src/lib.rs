//! The estimator process: encoder samples in; positions, velocities and unexplained torque out.
#![allow(non_snake_case)]

mod cycle;
mod disturbance;

use model::{Refused, Robot, with_dof};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{EstimatorCheckpoint, SensorSample, StateEstimate};

pub use cycle::Cycle;

/// The pure step, whatever the number of joints; compiled once per number, here.
pub trait Step {
    /// The estimate at the sample's tick.
    fn step(&mut self, sample: &SensorSample, out: &mut StateEstimate);
    /// Writes what must survive a restart.
    fn save(&self, out: &mut EstimatorCheckpoint);
    /// Takes up what [`save`](Self::save) has written.
    fn restore(&mut self, from: &EstimatorCheckpoint);
    /// Whether a reading of the last sample was set aside.
    fn rejects(&self) -> bool;
}

impl<const N: usize> Step for Cycle<N> {
    fn step(&mut self, sample: &SensorSample, out: &mut StateEstimate) {
        self.step(sample, out);
    }
    fn save(&self, out: &mut EstimatorCheckpoint) {
        self.save(out);
    }
    fn restore(&mut self, from: &EstimatorCheckpoint) {
        self.restore(from);
    }
    fn rejects(&self) -> bool {
        self.rejects()
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

/// Estimates until the run stops.
///
/// # Errors
/// [`ProcessError`] where the step cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = cycle(robot, scenario).map_err(ProcessError::setup)?;
    let mut sensors = shell.reader::<SensorSample>()?;
    let mut estimates = shell.writer::<StateEstimate>()?;
    let mut checkpoint = shell.checkpoint::<EstimatorCheckpoint>()?;
    checkpoint.previous().into_iter().for_each(|last| cycle.restore(last));
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
