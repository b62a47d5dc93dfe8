//! `armplane verify`: the same scenario under different conditions, compared byte by byte.

use std::path::PathBuf;

use clap::Args;
use lab::conformance::Request;
use session::{Failure, load};

use crate::out::answer;
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct VerifyArgs {
    /// A built-in scenario, or a scenario file.
    #[arg(value_name = "SCENARIO|FILE.toml", default_value = load::DEFAULT_SCENARIO)]
    scenario: String,
    /// Number of runs, each under other conditions.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    runs: u32,
    /// Kill processes at random moments of N runs instead.
    #[arg(long, value_name = "N", conflicts_with_all = ["runs", "unordered"], value_parser = clap::value_parser!(u32).range(1..=10_000))]
    kills: Option<u32>,
    /// Seed of every random number of the run [default: the scenario's].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Override a value of the scenario, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Your own process graph.
    #[arg(long, value_name = "FILE.toml")]
    graph: Option<PathBuf>,
    /// Keep the messages and recordings of all runs here [default: removed].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Let the plant take the torque of the tick before where the right one is late: shows that `verify` can fail.
    #[arg(long, hide = true)]
    unordered: bool,
}

pub(crate) fn verify(args: &VerifyArgs, as_json: bool) -> Result<bool, Failure> {
    let load::Loaded {
        scenario,
        robot,
        graph,
    } = load::scenario_in(args.graph.as_deref(), &args.scenario, &args.set, args.seed)?;
    let request = Request {
        name: &args.scenario,
        scenario: &scenario,
        robot: &robot,
        graph: &graph,
        // One more, which nobody disturbs.
        runs: args.kills.map_or(args.runs, |kills| kills + 1),
        kills: args.kills.is_some(),
        out: args.out.as_deref(),
        unordered: args.unordered,
    };
    let verified = lab::conformance::verify(&request, &observe)?;
    answer(as_json, &verified, &verified);
    Ok(verified.identical)
}
