//! A controller of one's own, to copy: it moves the hand along the straight line
//! `by_m` of the scenario's first segment.
//!
//! ```text
//! law.rs    the pure step: one estimate in, one torque out
//! main.rs   takes part in a run
//! ```
//!
//! `docs/tutorial.md` builds and runs it. Its inverse is damped
//! everywhere, as one writes it in a first course; near a singularity the hand falls behind.

mod law;

use std::process::ExitCode;

use model::Robot;
use process::{Running, Stateless};

use law::Law;

fn main() -> ExitCode {
    // The law has no state but the tick.
    runtime::join(|job| {
        let robot = Robot::from_source(&job.robot).map_err(|error| error.to_string())?;
        Law::new(&robot, &job.scenario).map(|law| Running::new(law, Stateless))
    })
}
