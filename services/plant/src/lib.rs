//! The plant process: the simulated arm, its sensors and its drives. It makes the ticks.
#![allow(non_snake_case)]

mod cycle;
mod hardware_faults;

use model::{Refused, Robot, with_dof};
use runtime::{MOST_FAULTS, ProcessError, Shell};
use shared_types::fault::ScheduledFault;
use shared_types::scenario::Scenario;
use shared_types::{PlantState, SensorSample, TorqueCommand};

pub use cycle::Cycle;

/// The pure step, whatever the number of joints; compiled once per number, here.
pub trait Step {
    /// The sensors' readings at `tick`, and the truth.
    fn sample(&self, tick: u64, sample: &mut SensorSample, truth: &mut PlantState);
    /// Moves the arm to the next tick under `command` (`None`: none came).
    fn step(&mut self, command: Option<&TorqueCommand>);
    /// Takes up the faults that concern `tick`, before its sample.
    fn apply_faults(&mut self, tick: u64, scheduled_faults: &[ScheduledFault]);
    /// Whether the task is over.
    fn is_over(&self) -> bool;
}

impl<const N: usize> Step for Cycle<N> {
    fn sample(&self, tick: u64, sample: &mut SensorSample, truth: &mut PlantState) {
        self.sample(tick, sample, truth);
    }
    fn step(&mut self, command: Option<&TorqueCommand>) {
        self.step(command);
    }
    fn apply_faults(&mut self, tick: u64, scheduled_faults: &[ScheduledFault]) {
        self.apply_faults(tick, scheduled_faults);
    }
    fn is_over(&self) -> bool {
        self.is_over()
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

/// Simulates `robot` until the task is over or the run stops.
///
/// # Errors
/// [`ProcessError`] where the step cannot be built or the graph breaks.
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
