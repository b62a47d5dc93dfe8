//! Every law on the same plant, seed and task, side by side.

use serde_json::{Value, json};
use session::{Failure, Observer, Results, load};
use shared_types::scenario::{Scenario, Strategy};

use super::law::under;
use super::picture;
use super::score::{Score, score};
use super::sweep::{SWEEP, Sweep, SweepSize};
use crate::pool::on_all_cores;

/// The scenarios and laws to compare.
pub struct Request<'a> {
    /// Built-in scenarios' names, or scenario files.
    pub scenarios: &'a [String],
    /// The laws.
    pub laws: &'a [Strategy],
    /// Values that override those of every scenario.
    pub settings: &'a [String],
    /// Seed of every random number; the scenario's where it is `None`.
    pub seed: Option<u64>,
    /// The results folder; the next free `runs/compare-NNN` where it is `None`.
    pub out: Option<&'a std::path::Path>,
    /// Of the scenario `sweep`.
    pub size: SweepSize,
}

/// One scenario under each law.
pub enum Compared {
    /// A single scenario.
    Scenario {
        /// The scenario, without its planned faults.
        scenario: Box<Scenario>,
        /// Name of the robot.
        robot: String,
        /// How many planned faults were left out.
        faults_left_out: usize,
        /// One score per law.
        scores: Vec<Score>,
    },
    /// Many lines.
    Sweep {
        /// The sweep.
        sweep: Sweep,
        /// How many planned faults were left out.
        faults_left_out: usize,
    },
}

impl Compared {
    /// For machines.
    #[must_use]
    pub fn json(&self) -> Value {
        match self {
            Self::Sweep { sweep, .. } => sweep.json(),
            Self::Scenario {
                scenario,
                robot,
                faults_left_out,
                scores,
            } => json!({
                "scenario": scenario.name, "robot": robot, "seed": scenario.seed, "faults_left_out": faults_left_out, "laws": scores,
            }),
        }
    }
}

/// Runs each scenario under each law, hands each comparison to `each` when it is complete, and saves pictures and `compare.json`. Returns
/// the JSON and the folder.
///
/// # Errors
/// [`Failure`] where a scenario cannot be run, or a file cannot be written.
pub fn compare(
    request: &Request<'_>,
    observer: Observer<'_>,
    each: &mut dyn FnMut(&Compared),
) -> Result<(Value, std::path::PathBuf), Failure> {
    let load = |name: &String| load::scenario(name, request.settings, request.seed);
    let loaded = request
        .scenarios
        .iter()
        .map(load)
        .collect::<Result<Vec<_>, _>>()?;
    let results = Results::create(request.out, "compare")?;
    let mut comparisons = Vec::new();
    for mut loaded in loaded {
        let path = results.folder.join(&loaded.scenario.name);
        let faults_left_out = loaded.scenario.fault.len();
        loaded.scenario = chain::without_faults(&loaded.scenario);
        let compared = if loaded.scenario.name == SWEEP {
            let sweep = Sweep::run(&loaded, request.laws, request.size, observer)?;
            picture::sweep(&sweep).save(&path).map_err(Failure::work)?;
            Compared::Sweep {
                sweep,
                faults_left_out,
            }
        } else {
            let scores = under_each(&loaded, request.laws, observer)?;
            picture::scenario(&loaded.scenario, &scores)
                .save(&path)
                .map_err(Failure::work)?;
            Compared::Scenario {
                robot: loaded.robot.name.clone(),
                scenario: Box::new(loaded.scenario),
                faults_left_out,
                scores,
            }
        };
        each(&compared);
        comparisons.push(compared.json());
    }
    let whole = json!({"version": env!("CARGO_PKG_VERSION"), "scenarios": comparisons});
    results.save("compare.json", &whole)?;
    Ok((whole, results.folder.clone()))
}

fn under_each(
    loaded: &load::Loaded,
    laws: &[Strategy],
    observer: Observer<'_>,
) -> Result<Vec<Score>, Failure> {
    let load::Loaded {
        scenario, robot, ..
    } = loaded;
    on_all_cores(
        &scenario.name,
        laws,
        |law| score(robot, &under(scenario, *law)),
        observer,
    )
    .into_iter()
    .map(|score| score.map_err(|error| Failure::Input(format!("{}: {error}", scenario.name))))
    .collect()
}
