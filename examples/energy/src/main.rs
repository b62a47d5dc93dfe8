//! A process of one's own, to copy: it reads `estimate` and writes `energy`, a topic that armplane does not know.
//!
//! ```text
//! message.rs   the message and the checkpoint; `graph.toml` declares the same fields
//! cycle.rs     the pure step: one estimate in, one message out
//! main.rs      connects the step to topics
//! ```
//!
//! `cargo build --release -p energy`, then `armplane run examples/energy/energy.toml`. In lockstep the run repeats itself byte for byte, faults on
//! this process included (`armplane fault energy kill`); `summary.json` has the hash of its topic, `messages.mcap` its messages.

mod cycle;
mod message;

use std::process::ExitCode;

use model::Robot;
use runtime::{ProcessError, Shell};
use shared_types::StateEstimate;

use cycle::Cycle;
use message::{Energy, EnergyCheckpoint};

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
    let mut cycle = Cycle::new(&robot, job.scenario.frame()).map_err(ProcessError::setup)?;
    let mut estimates = shell.reader::<StateEstimate>()?;
    let mut energies = shell.writer::<Energy>()?;
    // The state of the last tick before a death: a replacement goes on from it.
    let mut checkpoint = shell.checkpoint::<EnergyCheckpoint>()?;
    if let Some(last) = checkpoint.previous() {
        cycle.restore(last);
    }
    while let Some(estimate) = estimates.next()? {
        let mut energy = energies.loan(estimate.header.tick)?;
        cycle.step(estimate, &mut energy);
        cycle.save(checkpoint.slot());
        energy.send()?;
    }
    Ok(())
}
