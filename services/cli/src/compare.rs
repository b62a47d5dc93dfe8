//! `armplane compare`: every control law on the same plant, seed and task, side by side.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use control::Kind;
use lab::studies::compare::{
    self, ArmSweep, Compared, KINDS, Ranked, Request, SWEEP, Score, Sweep, SweepSize, failures, margin, missed, quantile, verdicts, worth,
};
use serde_json::json;
use session::{Failure, load};
use shared_types::scenario::{Scenario, Strategy};

use crate::compare_arm;
use crate::out::say;
use crate::progress::Terminal;
use crate::table::{digits, fitted, number, table};

/// How many of the best settings are shown.
const SHOWN: usize = 5;

/// Seed of an arm's lines where none is given.
const SEED: u64 = 1;

#[derive(Args)]
pub(crate) struct CompareArgs {
    /// Built-in scenarios' names, or scenario files.
    #[arg(value_name = "SCENARIO|FILE.toml", default_value = load::DEFAULT_SCENARIO)]
    scenarios: Vec<String>,
    /// Only these laws, separated by commas [default: ours in both forms, and the baselines].
    #[arg(long, value_name = "LAW", value_delimiter = ',')]
    law: Vec<String>,
    /// Folder for the results [default: the next free runs/compare-NNN].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Seed of every random number of the runs, and of the sweep's lines [default: the scenario's].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Lay a value over every scenario's, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Lines of the sweep.
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    count: u32,
    /// Peak speed of the sweep's lines; m/s.
    #[arg(long, value_name = "M/S", default_value_t = 0.28)]
    speed: f64,
    /// The sweep's lines through exactly singular postures of this arm instead of a PUMA's: a built-in robot, or a URDF. COUNT is then the number of
    /// lines for each singularity, the law is the first one named (default: ours), and every line is printed.
    #[arg(long, value_name = "ROBOT|FILE.urdf")]
    robot: Option<String>,
    /// With --robot: lines through two singularities at once, COUNT for each pair.
    #[arg(long, requires = "robot")]
    pairs: bool,
    /// Record one scenario under two laws, its own solid and another one translucent (--law; damped-least-squares by default).
    #[arg(long, conflicts_with_all = ["tune", "robot"])]
    race: bool,
    /// Search the baselines' parameters for the most lines of the sweep, on a seed of its own.
    #[arg(long)]
    tune: bool,
}

pub(crate) fn compare(args: &CompareArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let laws = compare::laws(&args.law)?;
    if !(args.speed.is_finite() && args.speed > 0.0) {
        return Err(Failure::Input(format!("--speed is {}: it must be a positive number of m/s", args.speed)));
    }
    if args.race {
        return race(args, as_json);
    }
    if let Some(robot) = &args.robot {
        if args.scenarios != [SWEEP] {
            return Err(Failure::Input("--robot draws the lines of the sweep: armplane compare sweep --robot ROBOT".to_owned()));
        }
        let sweep = ArmSweep {
            robot,
            law: laws[0],
            settings: &args.set,
            seed: args.seed.unwrap_or(SEED),
            count: args.count,
            pairs: args.pairs,
            speed: args.speed,
        };
        return compare_arm::compare_arm(&sweep, args.out.as_deref(), as_json);
    }
    if args.tune {
        return tune(args, &laws, as_json);
    }
    let request = Request {
        scenarios: &args.scenarios,
        laws: &laws,
        settings: &args.set,
        seed: args.seed,
        out: args.out.as_deref(),
        size: SweepSize { count: args.count, speed: args.speed },
    };
    let terminal = Terminal::default();
    let mut each = |compared: &Compared| {
        if !as_json {
            print_compared(compared);
        }
    };
    let (whole, folder) = compare::compare(&request, &|progress| terminal.show(progress), &mut each)?;
    if as_json {
        say!("{whole}");
    } else {
        say!("{}\n  compare.json and a picture of each table, SVG and PNG", folder.display());
    }
    Ok(ExitCode::SUCCESS)
}

fn print_compared(compared: &Compared) {
    let say_left_out = |name: &str, left_out: usize| {
        if left_out > 0 {
            say!("{name}: without its planned faults ({left_out}): laws are compared on one thread, and faults happen to processes");
        }
    };
    match compared {
        Compared::Scenario { scenario, faults_left_out, scores, .. } => {
            say_left_out(&scenario.name, *faults_left_out);
            print(scenario, scores);
        }
        Compared::Sweep { sweep, faults_left_out } => {
            say_left_out(SWEEP, *faults_left_out);
            print_sweep(sweep);
        }
    }
}

/// Two laws in one recording.
fn race(args: &CompareArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let ([scenario], [] | [_]) = (&args.scenarios[..], &args.law[..]) else {
        return Err(Failure::Input("--race takes one scenario and at most one --law".to_owned()));
    };
    if scenario == SWEEP {
        return Err(Failure::Input("--race takes a scenario with one path, not the sweep".to_owned()));
    }
    let rival = match compare::laws(&args.law)?[..] {
        [rival] => rival,
        _ => Strategy::DampedLeastSquares,
    };
    let terminal = Terminal::default();
    let race = compare::race(scenario, &args.set, args.seed, rival, args.out.as_deref(), &|progress| terminal.show(progress))?;
    if as_json {
        say!("{}", serde_json::to_string_pretty(&race).map_err(Failure::work)?);
        return Ok(ExitCode::SUCCESS);
    }
    say!("{}: the same plant, seed {} and task under two laws", race.scenario, race.seed);
    let mut rows = table(&["law", "hand off its reference, mm", "°", "joint speed"]);
    for (law, racer) in [&race.law, &race.rival] {
        rows.add_row([
            law.clone().into(),
            number(digits(racer.position_max_mm)),
            number(digits(racer.orientation_max_deg)),
            number(percent(racer.speed_max_ratio)),
        ]);
    }
    say!("{rows}\n{}\n  run.rrd  both arms; open it with: armplane view {}", race.folder.display(), race.folder.display());
    Ok(ExitCode::SUCCESS)
}

/// Searches each law's parameters and prints the best.
fn tune(args: &CompareArgs, laws: &[Strategy], as_json: bool) -> Result<ExitCode, Failure> {
    if args.scenarios != [SWEEP] {
        return Err(Failure::Input("--tune searches on the lines of the sweep: armplane compare sweep --tune".to_owned()));
    }
    let size = SweepSize { count: args.count, speed: args.speed };
    let mut searched = Vec::new();
    let mut each = |law: Strategy, seed: u64, ranked: &Ranked<'_>| {
        searched.push(json!({"law": law.name(), "points": ranked.iter().map(|(point, scores)| {
            let [s2, s1, ends] = worth(scores);
            json!({"settings": point.settings, "s2": s2, "s1": s1, "ends": ends})
        }).collect::<Vec<_>>()}));
        if as_json {
            return;
        }
        let lines = ranked.first().map_or(0, |(_, scores)| scores.len());
        say!("{}: {} settings on {lines} lines at {} m/s (seed {seed})", law.name(), ranked.len(), args.speed);
        let mut rows = table(&["S2", "S1", "ends", "settings", "S2 missed by"]);
        for (point, scores) in ranked.iter().take(SHOWN) {
            let mut row = worth(scores).map(number).to_vec();
            row.extend([point.settings.clone().into(), missed(scores).into()]);
            rows.add_row(row);
        }
        say!("{rows}");
    };
    let terminal = Terminal::default();
    let (seed, lines) = compare::tune(&args.set, args.seed, size, laws, &|progress| terminal.show(progress), &mut each)?;
    if as_json {
        say!("{}", json!({"lines": lines, "seed": seed, "speed_m_s": args.speed, "laws": searched}));
    }
    Ok(ExitCode::SUCCESS)
}

fn percent(ratio: f64) -> String {
    format!("{:.0} %", ratio * 100.0)
}

fn print(scenario: &Scenario, scores: &[Score]) {
    say!("{}: {} (seed {})", scenario.name, scenario.title, scenario.seed);
    let mut rows = fitted(&["law", "⊥ ζ, mm", "°", "∥ ζ, mm", "°", "speed", "torque", "time", "verdict"]);
    for (score, verdict) in scores.iter().zip(verdicts(scores)) {
        let error = |value: f64| number(if score.completed { digits(value) } else { "–".to_owned() });
        rows.add_row([
            score.law.clone().into(),
            error(score.orthogonal_max_mm),
            error(score.orthogonal_max_deg),
            error(score.along_max_mm),
            error(score.along_max_deg),
            number(percent(score.speed_max_ratio)),
            number(percent(score.torque_max_ratio)),
            number(format!("× {:.2}", score.time_stretch)),
            verdict.into(),
        ]);
    }
    say!("{rows}");
    failures(scores).iter().chain(&margin(scores)).for_each(|line| say!("{line}"));
    say!("⊥ ζ: largest error orthogonal to the singular directions, ∥ ζ: along them; speed, torque: of the joints' limits.");
    say!("S1 asks for less than 1 mm and 0.5° orthogonal to ζ, S2 for 1 mm and 3°, and 10 mm and 5° along ζ.");
}

fn print_sweep(sweep: &Sweep) {
    say!("sweep: {} lines at {} m/s (seed {})", sweep.near.len(), sweep.speed, sweep.seed);
    let mut rows =
        fitted(&["law", "S1 %", "S2 %", "elbow", "wrist", "overhead", "ends %", "orthogonal p95, mm", "time p90", "S2 missed by"]);
    for (law, scores) in &sweep.laws {
        let share = |near: Option<Kind>, so: &dyn Fn(&Score) -> bool| {
            let (yes, all) = sweep.count(scores, near, so);
            format!("{:.1}", 100.0 * yes as f64 / all.max(1) as f64)
        };
        let mut row = vec![law.name().into(), number(share(None, &|score| score.s1)), number(share(None, &|score| score.s2))];
        row.extend(KINDS.map(|kind| number(share(Some(kind), &|score| score.s2))));
        row.extend([
            number(share(None, &Score::ended)),
            number(digits(quantile(scores, 0.95, |score| score.orthogonal_max_mm))),
            number(format!("× {:.2}", quantile(scores, 0.9, |score| score.time_stretch))),
            missed(scores).into(),
        ]);
        rows.add_row(row);
    }
    say!("{rows}\nelbow, wrist, overhead: S2 % of the lines near that lock");
}
