//! A process of one's own, to copy: it reads `estimate` and writes `energy`, a topic that armplane does not know.
//!
//! ```text
//! energy.rs    the message, the state, and the step; `graph.toml` declares the message's fields
//! main.rs      takes part in a run
//! ```
//!
//! `cargo build --release -p energy`, then `armplane run examples/energy/energy.toml`. In lockstep the run repeats itself byte for byte, faults on
//! this process included (`armplane fault energy kill`); `summary.json` has the hash of its topic, `messages.mcap` its messages.

mod energy;

use std::process::ExitCode;

use energy::Meter;

fn main() -> ExitCode {
    runtime::join(|job| Meter::begin(&job.robot, job.scenario.frame()))
}
