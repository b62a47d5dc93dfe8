//! `armplane drill`: every fault on every process of a real graph, judged by the physics.

use std::path::PathBuf;

use clap::Args;
use lab::faults::{self, Request, Without};
use session::{Failure, load};
use shared_types::job::Mode;

use crate::out::{say, say_json, show};
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct DrillArgs {
    /// Built-in scenarios, or scenario files; their planned faults are left out.
    #[arg(value_name = "SCENARIO|FILE.toml", default_value = load::DEFAULT_SCENARIO)]
    scenario: Vec<String>,
    /// Only this fault.
    #[arg(long, value_name = "PROCESS:KIND[:VARIANT]")]
    only: Option<String>,
    /// Number of fault pairs to try as well.
    #[arg(long, value_name = "N", default_value_t = 12)]
    pairs: u32,
    /// Seed of the runs and of the faults' ticks [default: the scenario's].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Your own process graph.
    #[arg(long, value_name = "FILE.toml")]
    graph: Option<PathBuf>,
    /// Override a value of the scenario, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Run in real time instead, and judge each run by itself.
    #[arg(long)]
    realtime: bool,
    /// Switch a protection off, to show that the drill then fails.
    #[arg(long, value_name = "PROTECTION")]
    without: Option<Protection>,
    /// Save drill.json here.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Protection {
    Hold,
    TorqueCheck,
    Fencing,
}

pub(crate) fn drill(args: &DrillArgs, as_json: bool) -> Result<bool, Failure> {
    let _signals = session::interrupts()?;
    let drilled = faults::drill(&args.request(), &observe)?;
    if as_json {
        say_json(&drilled)?;
    } else {
        show(&drilled);
        args.out
            .iter()
            .for_each(|out| say!("{}/drill.json", out.display()));
    }
    Ok(drilled.passed)
}

impl DrillArgs {
    fn request(&self) -> Request<'_> {
        Request {
            scenarios: &self.scenario,
            only: self.only.as_deref(),
            pairs: self.pairs,
            seed: self.seed,
            settings: &self.set,
            graph: self.graph.as_deref(),
            mode: match self.realtime {
                true => Mode::Realtime,
                false => Mode::Lockstep,
            },
            without: self.without.map(|protection| match protection {
                Protection::Hold => Without::Hold,
                Protection::TorqueCheck => Without::TorqueCheck,
                Protection::Fencing => Without::Fencing,
            }),
            out: self.out.as_deref(),
        }
    }
}
