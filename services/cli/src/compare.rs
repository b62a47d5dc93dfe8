//! `armplane compare`: every control law on the same plant, seed and task, side by side.

use std::path::PathBuf;

use clap::Args;
use lab::studies::compare::{self, Compared, Law, Lines, Request, SWEEP};
use session::{Failure, load};
use shared_types::scenario::Strategy;

use crate::out::{say, say_json, show, whole};
use crate::progress::observe;
use session::table::count as plural;

#[derive(Args)]
pub(crate) struct CompareArgs {
    /// Built-in scenarios, or scenario files.
    #[arg(value_name = "SCENARIO|FILE.toml", default_value = load::DEFAULT_SCENARIO)]
    scenarios: Vec<String>,
    /// Only these laws, separated by commas [default: the paper's law in both forms, and the baselines]. NAME=FILE.py is a controller of others, a class
    /// of `armplane.arena` (docs/arena.md); NAME=GRAPH.toml one of a graph.
    #[arg(long, value_name = "LAW|NAME=FILE", value_delimiter = ',')]
    law: Vec<String>,
    /// Folder for the results [default: the next free runs/compare-NNN].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Seed of the runs and of the sweep's lines [default: the scenario's].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Override a value of every scenario, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Number of lines in the sweep; with --robot, per singularity.
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    count: u32,
    /// Peak speed along the lines; m/s.
    #[arg(long, value_name = "M/S", default_value_t = 0.28)]
    speed: f64,
    /// Sweep lines through exactly singular postures of this arm, and print every line. Uses the first law of --law.
    #[arg(long, value_name = "ROBOT|FILE.urdf|FILE.xml")]
    robot: Option<String>,
    /// In place of the simulated arm: MuJoCo (docs/python.md). Each run then starts its own processes.
    #[arg(long, value_name = "mujoco|mujoco:SCENE.xml", conflicts_with = "race")]
    plant: Option<String>,
    /// Seconds that a controller of others may take to load and join a run.
    #[arg(long, value_name = "SECONDS", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..=3600))]
    join_limit: u32,
    /// With --robot: lines through two singularities at once, --count per pair.
    #[arg(long, requires = "robot")]
    pairs: bool,
    /// Record one scenario under two laws: its own (solid) and --law's (translucent) (default: damped-least-squares).
    #[arg(long, conflicts_with = "robot")]
    race: bool,
}

pub(crate) fn compare(args: &CompareArgs, as_json: bool) -> Result<bool, Failure> {
    let laws = compare::laws(&args.law, args.join_limit)?;
    if !(args.speed.is_finite() && args.speed > 0.0) {
        return Err(Failure::Input(format!(
            "--speed is {}: it must be a positive number of m/s",
            args.speed
        )));
    }
    if args.race {
        return race(args, &laws, as_json);
    }
    if args.robot.is_some() && args.scenarios != [SWEEP] {
        return Err(Failure::input(
            "--robot ROBOT needs the sweep: armplane compare sweep --robot ROBOT",
        ));
    }
    let lines = Lines {
        robot: args.robot.as_deref(),
        settings: &args.set,
        seed: args.seed,
        count: args.count,
        pairs: args.pairs,
        speed: args.speed,
    };
    // Of an arm's lines each has a row.
    let laws = &laws[..if args.robot.is_some() { 1 } else { laws.len() }];
    let request = Request {
        scenarios: &args.scenarios,
        laws,
        out: args.out.as_deref(),
        lines,
        plant: args.plant.as_deref(),
    };
    show_compared(&request, as_json)
}

/// Runs what is to be compared, and shows each table as soon as it is there.
fn show_compared(request: &Request<'_>, as_json: bool) -> Result<bool, Failure> {
    let (mut unreached, mut failed) = (0, 0);
    let mut each = |compared: &Compared| {
        failed += compared.failed() as u64;
        unreached += compared.unreached().count() as u64;
        if !as_json {
            show(compared);
        }
    };
    let (results, folder) = compare::compare(request, &observe, &mut each)?;
    if as_json {
        say!("{results}");
    } else {
        say!("{}\n  compare.json", folder.display());
        if unreached > 0 {
            let lines = plural(unreached, "line");
            say!("  {lines} that did not reach the goal, as scenarios");
        }
    }
    let runs = plural(failed, "run");
    whole((failed > 0).then(|| format!("{runs} failed: compare.json has the reasons")))
}

/// Two laws in one recording.
fn race(args: &CompareArgs, laws: &[Law], as_json: bool) -> Result<bool, Failure> {
    let ([scenario], [] | [_]) = (&args.scenarios[..], &args.law[..]) else {
        return Err(Failure::input(
            "--race takes one scenario and at most one --law",
        ));
    };
    if scenario == SWEEP {
        return Err(Failure::input(
            "--race takes a scenario with one path, not the sweep",
        ));
    }
    let rival = match laws {
        [rival] if !args.law.is_empty() => rival.own("--race")?,
        _ => Strategy::DampedLeastSquares,
    };
    let race = compare::race(
        scenario,
        &args.set,
        args.seed,
        rival,
        args.out.as_deref(),
        &observe,
    )?;
    if as_json {
        say_json(&race)?;
        return Ok(true);
    }
    show(&race);
    say!(
        "{}\n  run.rrd  both arms; open it with `armplane view {}`",
        race.folder.display(),
        race.folder.display()
    );
    Ok(true)
}
