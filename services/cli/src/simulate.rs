//! `armplane simulate`: random histories of the lockstep protocol in one process.

use std::process::ExitCode;
use std::time::Instant;

use clap::Args;
use lab::conformance::simulate::Simulated;
use serde_json::json;
use session::Failure;

use crate::out::{passed, say};
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct SimulateArgs {
    /// Seed of all histories.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// How many histories.
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    histories: u64,
    /// Put a defect into the protocol: shows that `simulate` can fail.
    #[arg(long, value_name = "N", default_value_t = 0, hide = true)]
    defect: usize,
}

pub(crate) fn simulate(args: &SimulateArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let began = Instant::now();
    let simulated =
        lab::conformance::simulate::simulate(args.seed, args.histories, args.defect, &observe)?;
    let (
        Simulated {
            histories,
            deaths,
            steps,
            failures,
        },
        wall_s,
    ) = (&simulated, began.elapsed().as_secs_f64());
    let per_minute = *histories as f64 / wall_s.max(1e-9) * 60.0;
    if as_json {
        say!(
            "{}",
            json!({"seed": args.seed, "histories": histories, "deaths": deaths, "steps": steps, "wall_s": wall_s, "failures": failures})
        );
    } else {
        failures
            .iter()
            .take(5)
            .for_each(|failure| say!("{failure}"));
        let verdict = match failures.len() {
            0 => "each ends, and its plan repeats it".to_owned(),
            count => format!(
                "{count} of {} batches hold one that does not keep its guarantees",
                args.histories.div_ceil(250)
            ),
        };
        say!(
            "seed {}: {histories} histories, {deaths} deaths, {steps} steps, {per_minute:.0} a minute: {verdict}",
            args.seed
        );
    }
    passed(failures.is_empty())
}
