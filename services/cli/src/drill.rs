//! `armplane drill`: every fault on every process of a real graph, judged by the physics.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use lab::faults::drill::{Cell, Request, Without};
use session::{Failure, load};

use crate::out::say;
use crate::progress::Terminal;
use session::table::{number, table};
use viz::plot::digits;

#[derive(Args)]
pub(crate) struct DrillArgs {
    /// Built-in scenarios' names, or scenario files; their own faults are left out.
    #[arg(value_name = "SCENARIO|FILE.toml", default_value = load::DEFAULT_SCENARIO)]
    scenario: Vec<String>,
    /// One cell.
    #[arg(long, value_name = "PROCESS:KIND[:WAY]")]
    only: Option<String>,
    /// How many pairs of faults to try besides.
    #[arg(long, value_name = "N", default_value_t = 12)]
    pairs: u32,
    /// Seed of every random number of the runs, and of the ticks of the faults [default: the scenario's].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Override a value of the scenario, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Leave a protection out: shows that the drill can fail.
    #[arg(long, hide = true, value_name = "PROTECTION")]
    without: Option<Protection>,
    /// Keep the results here: drill.json and a heat map (SVG and PNG).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Protection {
    Hold,
    TorqueCheck,
    Fencing,
}

pub(crate) fn drill(args: &DrillArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let _signals = session::interrupts()?;
    let request = Request {
        scenarios: &args.scenario,
        only: args.only.as_deref(),
        pairs: args.pairs,
        seed: args.seed,
        settings: &args.set,
        without: args.without.map(|protection| match protection {
            Protection::Hold => Without::Hold,
            Protection::TorqueCheck => Without::TorqueCheck,
            Protection::Fencing => Without::Fencing,
        }),
        out: args.out.as_deref(),
    };
    let terminal = Terminal::default();
    let drilled = lab::faults::drill::drill(&request, &|progress| terminal.show(progress))?;
    if as_json {
        say!("{}", serde_json::to_string_pretty(&drilled.json).map_err(Failure::work)?);
    } else {
        print(&drilled.cells, drilled.passed, args.out.as_deref());
    }
    Ok(if drilled.passed { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn print(cells: &[Cell], passed: bool, out: Option<&Path>) {
    let headings = [
        "process",
        "fault",
        "detected, ms",
        "stale",
        "torque",
        "speed",
        "step",
        "off path, mrad",
        "mm",
        "recovered after, ms",
        "end",
        "restarts",
        "lost",
        "repeated",
        "",
    ];
    let mut rows = table(&headings);
    for cell in cells {
        let name = if cell.way.trim_matches([' ', '+']).is_empty() { cell.kind.clone() } else { format!("{} ({})", cell.kind, cell.way) };
        let end = match (cell.goal_reached, cell.safe_stop) {
            (true, _) => "goal",
            (false, true) => "rest",
            (false, false) => "ended",
        };
        let optional = |value: Option<f64>| value.map_or(String::from("–"), digits);
        rows.add_row([
            cell.process.clone().into(),
            name.into(),
            number(optional(cell.detected_ms)),
            number(cell.stale_ticks),
            number(format!("{:.0} %", cell.torque_max_ratio * 100.0)),
            number(format!("{:.0} %", cell.speed_max_ratio * 100.0)),
            number(format!("{:.1} %", cell.torque_step_max_ratio * 100.0)),
            number(digits(cell.excursion_max_rad * 1e3)),
            number(digits(cell.excursion_max_mm)),
            number(optional(cell.settled_ms)),
            end.into(),
            number(cell.restarts),
            number(cell.messages_lost),
            if cell.replayed_identically { "same" } else { "OTHER" }.into(),
            cell.invariants_broken.join("; ").into(),
        ]);
    }
    say!("{rows}");
    let broken = cells.iter().filter(|cell| !cell.invariants_broken.is_empty()).count();
    let goals = cells.iter().filter(|cell| cell.goal_reached).count();
    say!(
        "{} cells: {goals} reached the goal, {} came to rest or ended cleanly, {broken} broke an invariant",
        cells.len(),
        cells.len() - goals
    );
    if let Some(out) = out {
        say!("{}/drill.json, drill.svg, drill.png", out.display());
    }
    if !passed {
        say!("a guarantee does not hold: see the last column");
    }
}
