//! The analyzer process: finds the singularities near the arm's posture, with their directions and
//! types.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod cycle;

use model::{Refused, Robot};
use runtime::{ProcessError, Shell};
use shared_types::scenario::Scenario;
use shared_types::{AnalyzerCheckpoint, SingularityReport, StateEstimate};

pub use cycle::{Cycle, Step};

/// The step for an arm of as many joints as `robot` has.
///
/// # Errors
/// [`Refused`] if robot and scenario do not fit, or the arm has more joints than the program is built for.
pub fn cycle(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn Step>, Refused> {
    model::boxed!(robot, N => Cycle::<N>::new(robot, scenario), dyn Step)
}

/// Analyses until the run stops.
///
/// # Errors
/// [`ProcessError`] if the step cannot be built or the graph breaks.
pub fn run(shell: &Shell, robot: &Robot, scenario: &Scenario) -> Result<(), ProcessError> {
    let mut cycle = cycle(robot, scenario).map_err(ProcessError::setup)?;
    let mut estimates = shell.reader::<StateEstimate>()?;
    let mut reports = shell.writer::<SingularityReport>()?;
    let mut checkpoint = shell.checkpoint::<AnalyzerCheckpoint>()?;
    checkpoint
        .previous()
        .into_iter()
        .for_each(|last| cycle.restore(last));
    while let Some(estimate) = estimates.next()? {
        let mut report = reports.loan_as_is(estimate.header.tick)?;
        cycle.step(estimate, &mut report);
        cycle.save(checkpoint.slot());
        report.send()?;
    }
    Ok(())
}
