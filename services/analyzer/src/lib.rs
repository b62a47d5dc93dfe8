//! The analyzer process: where the arm is singular, or nearly; in which directions; of which type.
#![allow(non_snake_case)]

mod cycle;

use model::{Refused, Robot, with_dof};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{AnalyzerCheckpoint, SingularityReport, StateEstimate};

pub use cycle::Cycle;

/// The pure step, whatever the number of joints; compiled once per number, here.
pub trait Step {
    /// The report for an estimate, at its tick.
    fn step(&mut self, estimate: &StateEstimate, out: &mut SingularityReport);
    /// Leaves out singular values and whatever follows from them alone.
    fn leave_out_conditioning(&mut self);
    /// Writes what must survive a restart.
    fn save(&self, out: &mut AnalyzerCheckpoint);
    /// Takes up what [`save`](Self::save) has written.
    fn restore(&mut self, from: &AnalyzerCheckpoint);
}

impl<const N: usize> Step for Cycle<N> {
    fn step(&mut self, estimate: &StateEstimate, out: &mut SingularityReport) {
        self.step(estimate, out);
    }
    fn leave_out_conditioning(&mut self) {
        self.leave_out_conditioning();
    }
    fn save(&self, out: &mut AnalyzerCheckpoint) {
        self.save(out);
    }
    fn restore(&mut self, from: &AnalyzerCheckpoint) {
        self.restore(from);
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

/// Analyses until the run stops.
///
/// # Errors
/// [`ProcessError`] where the step cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = cycle(robot, scenario).map_err(ProcessError::setup)?;
    let mut estimates = shell.reader::<StateEstimate>()?;
    let mut reports = shell.writer::<SingularityReport>()?;
    let mut checkpoint = shell.checkpoint::<AnalyzerCheckpoint>()?;
    checkpoint.previous().into_iter().for_each(|last| cycle.restore(last));
    while let Some(estimate) = estimates.next()? {
        let mut report = reports.loan_as_is(estimate.header.tick)?;
        cycle.step(estimate, &mut report);
        cycle.save(checkpoint.slot());
        report.send()?;
    }
    Ok(())
}
