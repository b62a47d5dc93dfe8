//! `armplane bench`: what a hand-over, a cycle and a step cost here, beside baseline transports of the machine.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use lab::benchmarks::{self, Only, Rows};
use serde_json::json;
use session::{Failure, Results};

use crate::out::{say, show};
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct BenchArgs {
    /// Benchmarks to run [default: all but lockstep].
    #[arg(value_enum, value_name = "BENCH")]
    what: Vec<Bench>,
    /// Samples per hop and cycle.
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u64).range(1000..=10_000_000))]
    samples: u64,
    /// Only the rows of `hop` and `cycle` that match every word or number of bytes, with their baseline: --only topic --only "same core".
    #[arg(long, value_name = "WORD")]
    only: Vec<String>,
    /// Another build of armplane for `lockstep` to alternate with.
    #[arg(long, value_name = "PROGRAM")]
    against: Option<PathBuf>,
    /// Runs of `lockstep` per program.
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    runs: u32,
    /// Save bench.json here.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Args)]
pub(crate) struct BenchPeerArgs {
    /// Which.
    name: String,
    /// The run's directory in shared memory.
    #[arg(long, value_name = "DIR")]
    run: PathBuf,
}

/// The benchmarks.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Bench {
    /// Half a round trip between two processes.
    Hop,
    /// Once around four processes: sensor, estimate, singularities, torque.
    Cycle,
    /// One step of each process, on one thread.
    Steps,
    /// Ticks per second of the whole graph in lockstep, recording on (only on request).
    Lockstep,
}

pub(crate) fn bench(args: &BenchArgs, as_json: bool) -> Result<bool, Failure> {
    if args.only.iter().any(|word| word.trim().is_empty()) {
        return Err(Failure::input(
            "--only needs a word or a number of bytes, as in --only \"same core\" --only topic",
        ));
    }
    let out = args.out.as_deref();
    let out = out
        .map(|out| Results::create(Some(out), "bench"))
        .transpose()?;
    let (samples, only, against) = (args.samples, Only(&args.only), args.against.as_deref());
    let (mut rows, mut lockstep) = (Vec::new(), None);
    for bench in Bench::value_variants() {
        let is_usual = match bench {
            Bench::Lockstep => against.is_some(),
            _ => args.what.is_empty(),
        };
        match bench {
            _ if !is_usual && !args.what.contains(bench) => {}
            Bench::Hop => rows.extend(benchmarks::hop(samples, &only, &observe)?),
            Bench::Cycle => rows.extend(benchmarks::cycle(samples, &only, &observe)?),
            Bench::Steps => rows.extend(benchmarks::steps()?),
            Bench::Lockstep => {
                lockstep = Some(benchmarks::lockstep(args.runs, against, &observe)?);
            }
        }
        if *bench == Bench::Cycle && rows.is_empty() && !args.only.is_empty() {
            return Err(Failure::Input(format!(
                "no row of `hop` or `cycle` matches --only {}: run without it to see all rows",
                args.only.join(" --only ")
            )));
        }
    }
    let machine = benchmarks::machine();
    let line = benchmarks::machine_line(&machine);
    let whole = json!({"machine": machine, "rows": rows, "lockstep": lockstep});
    if let Some(out) = &out {
        out.save("bench.json", &whole)?;
    }
    if as_json {
        say!("{whole}");
        return Ok(true);
    }
    if !rows.is_empty() {
        show(&Rows(&rows));
    }
    lockstep.iter().for_each(show);
    say!("{line}");
    if let Some(out) = &out {
        say!("{}", out.folder.join("bench.json").display());
    }
    Ok(true)
}

/// Takes part in a ring.
pub(crate) fn peer(args: &BenchPeerArgs) -> Result<bool, Failure> {
    benchmarks::peer(&args.name, &args.run).map_err(Failure::work)?;
    Ok(true)
}
