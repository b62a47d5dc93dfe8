//! `armplane compare`: every control law on the same plant, seed and task, side by side.

mod picture;
mod score;
mod sweep;
mod tune;

use std::process::ExitCode;

use control::Kind;
use serde_json::{Value, json};
use shared_types::codes::singularity_name;
use shared_types::scenario::{Scenario, Strategy};

use super::failure::Failure;
use super::out::say;
use super::pool::on_all_cores;
use super::run::Results;
use super::table::{digits, number, table};
use super::{CompareArgs, load};
use score::{Score, score};

/// The scenario that stands for many lines.
const SWEEP: &str = "sweep";

/// The paper's law in both forms, and the baselines.
const LAWS: [Strategy; 7] = [
    Strategy::Blended,
    Strategy::ChangKhatib,
    Strategy::OperationalSpace,
    Strategy::DampedLeastSquares,
    Strategy::TruncatedSvd,
    Strategy::HoldAndBlend,
    Strategy::JointPd,
];

pub(crate) fn compare(args: &CompareArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let laws = laws(&args.law)?;
    if !(args.speed.is_finite() && args.speed > 0.0) {
        return Err(Failure::Input(format!("--speed is {}: it must be a positive number of m/s", args.speed)));
    }
    if args.tune {
        return tune::tune(args, &laws, as_json);
    }
    let mut loaded = args.scenarios.iter().map(|name| load::scenario(name, &args.set, args.seed)).collect::<Result<Vec<_>, _>>()?;
    let results = Results::create(args.out.as_deref(), "compare")?;
    let mut told = Vec::new();
    for loaded in &mut loaded {
        let path = results.folder.join(&loaded.scenario.name);
        let left_out = loaded.scenario.fault.len();
        loaded.scenario = chain::without_faults(&loaded.scenario);
        if left_out > 0 && !as_json {
            say!(
                "{}: without its planned faults ({left_out}): laws are compared on one thread, and faults happen to processes",
                loaded.scenario.name
            );
        }
        if loaded.scenario.name == SWEEP {
            let sweep = sweep::Sweep::run(loaded, &laws, args)?;
            picture::sweep(&sweep).save(&path).map_err(Failure::work)?;
            told.push(sweep.json());
            if !as_json {
                sweep.print();
            }
        } else {
            let scores = under_each(loaded, &laws)?;
            picture::scenario(&loaded.scenario, &scores).save(&path).map_err(Failure::work)?;
            told.push(json!({
                "scenario": loaded.scenario.name, "robot": loaded.robot.name, "seed": loaded.scenario.seed, "faults_left_out": left_out,
                "laws": scores,
            }));
            if !as_json {
                print(&loaded.scenario, &scores);
            }
        }
    }
    let whole = json!({"version": env!("CARGO_PKG_VERSION"), "scenarios": told});
    keep(&results, &whole)?;
    if as_json {
        say!("{whole}");
    } else {
        say!("{}\n  compare.json and a picture of each table, SVG and PNG", results.folder.display());
    }
    Ok(ExitCode::SUCCESS)
}

fn keep(results: &Results, whole: &Value) -> Result<(), Failure> {
    let path = results.folder.join("compare.json");
    let text = serde_json::to_vec_pretty(whole).map_err(Failure::work)?;
    std::fs::write(&path, text).map_err(|error| Failure::Work(format!("cannot write {}: {error}", path.display())))
}

fn laws(names: &[String]) -> Result<Vec<Strategy>, Failure> {
    if names.is_empty() {
        return Ok(LAWS.to_vec());
    }
    let law = |name: &String| {
        let known = || Strategy::ALL.iter().map(|law| law.name());
        Strategy::ALL
            .into_iter()
            .find(|law| law.name() == name)
            .ok_or_else(|| Failure::Input(load::unknown("control law", name, known(), "")))
    };
    names.iter().map(law).collect()
}

/// The same scenario under another law.
fn under(scenario: &Scenario, law: Strategy) -> Scenario {
    let mut scenario = scenario.clone();
    scenario.control.strategy = law;
    scenario
}

fn under_each(loaded: &load::Loaded, laws: &[Strategy]) -> Result<Vec<Score>, Failure> {
    let load::Loaded { scenario, robot } = loaded;
    on_all_cores(&scenario.name, laws, |law| score(robot, &under(scenario, *law)))
        .into_iter()
        .map(|score| score.map_err(|error| Failure::Input(format!("{}: {error}", scenario.name))))
        .collect()
}

/// What people call the singularity that a line goes through.
fn name_of(kind: Kind) -> String {
    singularity_name(kind.code(), 0)
}

fn percent(ratio: f64) -> String {
    format!("{:.0} %", ratio * 100.0)
}

fn print(scenario: &Scenario, scores: &[Score]) {
    say!("{}: {} (seed {})", scenario.name, scenario.title, scenario.seed);
    let headings = [
        "law",
        "along ζ, mm",
        "°",
        "across ζ, mm",
        "°",
        "end, mm",
        "°",
        "speed",
        "torque",
        "torque step",
        "chatter",
        "jumps, J",
        "time",
        "success",
    ];
    let mut rows = table(&headings);
    for score in scores {
        let error = |value: f64| number(if score.completed { digits(value) } else { "–".to_owned() });
        rows.add_row([
            score.law.clone().into(),
            error(score.along_max_mm),
            error(score.along_max_deg),
            error(score.across_max_mm),
            error(score.across_max_deg),
            error(score.final_mm),
            error(score.final_deg),
            number(percent(score.speed_max_ratio)),
            number(percent(score.torque_max_ratio)),
            number(percent(score.torque_step_max_ratio)),
            number(score.chatter),
            number(digits(score.jump_energy_j)),
            number(format!("× {:.2}", score.time_stretch)),
            success(score).into(),
        ]);
    }
    say!("{rows}");
}

/// S1, S2, or what was missed.
fn success(score: &Score) -> String {
    match (score.s1, score.s2) {
        (true, _) => "S1".to_owned(),
        (_, true) => "S2".to_owned(),
        _ => format!("no: {}", score.missed.join(", ")),
    }
}
