//! The plant process: the simulated arm, its sensors and its drives. It makes the ticks.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod cycle;
mod hardware_faults;

use model::{Refused, Robot};
use runtime::{MOST_FAULTS, ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{PlantState, SensorSample, TorqueCommand};

pub use cycle::{Cycle, Step};

/// The step for an arm of as many joints as `robot` has.
///
/// # Errors
/// [`Refused`] if robot and scenario do not fit, or the arm has more joints than the program is built for.
pub fn cycle(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn Step>, Refused> {
    model::boxed!(robot, N => Cycle::<N>::new(robot, scenario), dyn Step)
}

/// Simulates `robot` until the task is over or the run stops.
///
/// # Errors
/// [`ProcessError`] if the step cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = cycle(robot, scenario).map_err(ProcessError::setup)?;
    let mut sensors = shell.writer::<SensorSample>()?;
    let mut truths = shell.writer::<PlantState>()?;
    let mut torques = shell.reader::<TorqueCommand>()?;
    let mut tick_source = shell.tick_source(0);
    let mut scheduled_faults = Vec::with_capacity(MOST_FAULTS);
    while let Some(tick) = tick_source.next()? {
        let had_faults = !scheduled_faults.is_empty();
        scheduled_faults.clear();
        shell.faults_at(tick, |place, scheduled, kind| {
            if kind.concerns_joint() {
                shell.mark_injected(place);
                scheduled_faults.push(*scheduled);
            }
        });
        if had_faults || !scheduled_faults.is_empty() {
            cycle.apply_faults(tick, &scheduled_faults);
            if cycle.is_contradicted() {
                shell.mark_detected();
            }
        }
        let (mut sample, mut truth) = (sensors.loan_as_is(tick)?, truths.loan_as_is(tick)?);
        cycle.sample(tick, &mut sample, &mut truth);
        sample.send()?;
        truth.send()?;
        cycle.step(torques.arriving(tick, tick_source.deadline_ns())?);
        if cycle.is_over() {
            tick_source.finish()?;
            break;
        }
    }
    Ok(())
}
