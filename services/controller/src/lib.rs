//! The controller process: the control law, from estimate and singularities to torque.
#![allow(non_snake_case)]

mod cycle;

use model::{Refused, Robot, with_dof};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{ControlState, ControllerCheckpoint, ServoState, SingularityReport, StateEstimate, Target, TorqueCommand};

pub use cycle::Cycle;

/// The pure step, whatever the number of joints; compiled once per number, here.
pub trait Step {
    /// The torque for an estimate and the report of the same tick, and what the law did to arrive at it.
    fn step(&mut self, estimate: &StateEstimate, report: &SingularityReport, state: &mut ControlState, torque: &mut TorqueCommand);
    /// The same towards the target of this tick, in a scenario that is steered.
    fn steer(
        &mut self,
        inputs: (&StateEstimate, &SingularityReport),
        target: Option<&Target>,
        servo: &mut ServoState,
        state: &mut ControlState,
        torque: &mut TorqueCommand,
    );
    /// Writes what must survive a restart.
    fn save(&self, out: &mut ControllerCheckpoint);
    /// Takes up what [`save`](Self::save) has written.
    fn restore(&mut self, from: &ControllerCheckpoint);
    /// Why the path cannot be followed, found before the first tick, in words.
    fn obstacle(&self) -> Option<&str>;
    /// A goal beyond reach, found before the first tick, in words.
    fn warning(&self) -> Option<String>;
}

impl<const N: usize> Step for Cycle<N> {
    fn step(&mut self, estimate: &StateEstimate, report: &SingularityReport, state: &mut ControlState, torque: &mut TorqueCommand) {
        self.step(estimate, report, state, torque);
    }
    fn steer(
        &mut self,
        inputs: (&StateEstimate, &SingularityReport),
        target: Option<&Target>,
        servo: &mut ServoState,
        state: &mut ControlState,
        torque: &mut TorqueCommand,
    ) {
        self.steer(inputs, target, servo, state, torque);
    }
    fn save(&self, out: &mut ControllerCheckpoint) {
        self.save(out);
    }
    fn restore(&mut self, from: &ControllerCheckpoint) {
        self.restore(from);
    }
    fn obstacle(&self) -> Option<&str> {
        self.obstacle()
    }
    fn warning(&self) -> Option<String> {
        self.warning()
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
    let mut states = shell.writer::<ControlState>()?;
    let mut torques = shell.writer::<TorqueCommand>()?;
    let mut checkpoint = shell.checkpoint::<ControllerCheckpoint>()?;
    checkpoint.previous().into_iter().for_each(|last| cycle.restore(last));
    let (mut targets, mut servos) = match scenario.servo {
        Some(_) => (Some(shell.reader::<Target>()?), Some(shell.writer::<ServoState>()?)),
        None => (None, None),
    };
    while let Some(report) = reports.next()? {
        let Some(estimate) = estimates.at(report.header.tick)? else { continue };
        let tick = estimate.header.tick;
        let target = match &mut targets {
            Some(targets) => targets.newest(tick)?,
            None => None,
        };
        let (mut state, mut torque) = (states.loan_as_is(tick)?, torques.loan_as_is(tick)?);
        let mut servo = servos.as_mut().map(|servos| servos.loan_as_is(tick)).transpose()?;
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
