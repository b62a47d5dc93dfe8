//! The controller process: the control law, from estimate and singularities to torque.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod cycle;

use model::{Refused, Robot};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{
    ControlState, ControllerCheckpoint, ServoState, SingularityReport, StateEstimate, Target,
    TorqueCommand,
};

pub use cycle::{Cycle, Step};

/// The step for an arm of as many joints as `robot` has.
///
/// # Errors
/// [`Refused`] if robot and scenario do not fit, or the arm has more joints than the program is built for.
pub fn cycle(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn Step>, Refused> {
    model::boxed!(robot, N => Cycle::<N>::new(robot, scenario), dyn Step)
}

/// Controls until the run stops.
///
/// # Errors
/// [`ProcessError`] if the step cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = cycle(robot, scenario).map_err(ProcessError::setup)?;
    let mut reports = shell.reader::<SingularityReport>()?;
    let mut estimates = shell.reader::<StateEstimate>()?;
    let mut states = shell.writer::<ControlState>()?;
    let mut torques = shell.writer::<TorqueCommand>()?;
    let mut checkpoint = shell.checkpoint::<ControllerCheckpoint>()?;
    checkpoint
        .previous()
        .into_iter()
        .for_each(|last| cycle.restore(last));
    let (mut targets, mut servos) = match scenario.servo {
        Some(_) => (
            Some(shell.reader::<Target>()?),
            Some(shell.writer::<ServoState>()?),
        ),
        None => (None, None),
    };
    while let Some(report) = reports.next()? {
        let Some(estimate) = estimates.at(report.header.tick)? else {
            continue;
        };
        let tick = estimate.header.tick;
        let target = match &mut targets {
            Some(targets) => targets.newest(tick)?,
            None => None,
        };
        let (mut state, mut torque) = (states.loan_as_is(tick)?, torques.loan_as_is(tick)?);
        let mut servo = servos
            .as_mut()
            .map(|servos| servos.loan_as_is(tick))
            .transpose()?;
        match &mut servo {
            Some(servo) => cycle.steer((estimate, report), target, servo, &mut state, &mut torque),
            None => cycle.step(estimate, report, &mut state, &mut torque),
        }
        cycle.save(checkpoint.slot());
        if let Some(servo) = servo {
            servo.send()?;
        }
        state.send()?;
        torque.send()?;
    }
    Ok(())
}
