//! A controller of one's own, to copy: it moves the hand along the straight line
//! `by_m` of the scenario's first segment.
//!
//! ```text
//! law.rs    the pure step: one estimate in, one torque out
//! main.rs   connects the step to topics
//! ```
//!
//! `docs/tutorial.md` builds and runs it. Its inverse is damped
//! everywhere, as one writes it in a first course; near a singularity the hand falls behind.

mod law;

use std::process::ExitCode;

use model::Robot;
use runtime::{ProcessError, Shell};
use shared_types::{ControlState, StateEstimate, TorqueCommand};

use law::Law;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), ProcessError> {
    let shell = Shell::from_environment()?;
    let job = shell.job()?;
    let robot = Robot::from_source(&job.robot).map_err(ProcessError::setup)?;
    let law = Law::new(&robot, &job.scenario).map_err(ProcessError::setup)?;
    let mut estimates = shell.reader::<StateEstimate>()?;
    let mut states = shell.writer::<ControlState>()?;
    let mut torques = shell.writer::<TorqueCommand>()?;
    // The law has no state but the tick: a replacement needs no checkpoint.
    while let Some(estimate) = estimates.next()? {
        let (mut state, mut torque) = (
            states.loan(estimate.header.tick)?,
            torques.loan(estimate.header.tick)?,
        );
        law.step(estimate, &mut state, &mut torque);
        state.send()?;
        torque.send()?;
    }
    Ok(())
}
