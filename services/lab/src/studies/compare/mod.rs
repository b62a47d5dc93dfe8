//! Control laws compared: every law on the same plant, seed and task, on one scenario or on many lines.

mod arm_lines;
mod law;
mod race;
mod text;
mod verdict;

pub use arm_lines::{ArmLines, ArmSweep, Drawn, Line, Outcome};
pub use law::{Law, laws};
pub use race::{Race, Racer, race};

use control::Kind;
use lines::KINDS;
use model::{Refused, Robot};
use serde_json::{Map, Value, json};
use session::{Failure, Observer, Results, load};
use shared_types::codes::singularity_name;
use shared_types::graph::Graph;
use shared_types::scenario::Scenario;

use crate::folder::check;
use crate::pool::on_all_cores;
use crate::row::Row;
use crate::trial::Trial;

/// The scenario that stands for many lines.
pub const SWEEP: &str = "sweep";

/// The scenarios and laws to compare.
pub struct Request<'a> {
    /// Built-in scenarios' names, or scenario files.
    pub scenarios: &'a [String],
    /// The laws.
    pub laws: &'a [Law],
    /// Values that override those of every scenario.
    pub settings: &'a [String],
    /// Seed of every random number; the scenario's where it is `None`.
    pub seed: Option<u64>,
    /// The results folder; the next free `runs/compare-NNN` where it is `None`.
    pub out: Option<&'a std::path::Path>,
    /// Of the scenario `sweep`.
    pub size: SweepSize,
    /// The plant in place of the simulated arm, as of a run.
    pub plant: Option<&'a str>,
}

/// How many lines, and how fast.
#[derive(Clone, Copy, Debug)]
pub struct SweepSize {
    /// Lines.
    pub count: u32,
    /// Peak speed; m/s.
    pub speed: f64,
}

/// One scenario, or the lines that stand for the scenario `sweep`, under each law.
pub struct Compared {
    /// The scenario, without its planned faults.
    scenario: Scenario,
    robot: String,
    /// How many planned faults were left out.
    faults_left_out: usize,
    /// Peak speed of the lines; m/s.
    speed: f64,
    /// The singularity that each line passes; none of a scenario with a path of its own.
    near: Vec<Kind>,
    /// Of each law a row for each line, or one.
    laws: Vec<(Law, Vec<Row>)>,
}

/// Runs each scenario under each law, hands each comparison to `each` when it is complete, and saves `compare.json`. Returns
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
    let loaded = request.scenarios.iter().map(load);
    let loaded = loaded.collect::<Result<Vec<_>, _>>()?;
    let results = Results::create(request.out, "compare")?;
    let mut comparisons = Vec::new();
    for loaded in &loaded {
        let compared = Compared::run(loaded, request, observer)?;
        each(&compared);
        comparisons.push(compared.json());
    }
    let whole = json!({"version": env!("CARGO_PKG_VERSION"), "scenarios": comparisons});
    results.save("compare.json", &whole)?;
    Ok((whole, results.folder.clone()))
}

/// Saves the lines that stand for the scenario `sweep` as scenario files in a folder; their number.
///
/// # Errors
/// [`Failure`] where there is no such robot or setting, the folder exists, or a file cannot be written.
pub fn save_lines(
    folder: &std::path::Path,
    settings: &[String],
    seed: Option<u64>,
    size: SweepSize,
) -> Result<usize, Failure> {
    let loaded = load::scenario(SWEEP, settings, seed)?;
    let lines = draw(&loaded, size)?;
    arm_lines::save_scenarios(folder, lines.iter().map(|line| &line.scenario))
}

/// Lines through and near each singularity of a PUMA: those of the scenario `sweep`.
///
/// # Errors
/// [`Failure`] where there is no such robot or setting.
pub fn near_lines(
    settings: &[String],
    seed: Option<u64>,
    size: SweepSize,
) -> Result<Vec<Drawn>, Failure> {
    let loaded = load::scenario(SWEEP, settings, seed)?;
    let lines = draw(&loaded, size)?.into_iter();
    let drawn = lines.map(|line| Drawn {
        singularities: name_of(line.near),
        place: "near",
        scenario: line.scenario,
    });
    Ok(drawn.collect())
}

/// Seeded lines of the scenario `sweep`.
///
/// # Errors
/// [`Failure::Input`] for an arm without a PUMA's factors.
fn draw(loaded: &load::Loaded, size: SweepSize) -> Result<Vec<lines::Line>, Failure> {
    let (robot, count) = (&loaded.robot, size.count as usize);
    let mut template = loaded.scenario.clone();
    // The lines fill the arm's whole reach: where a floor would be, too.
    template.plant.floor_m = None;
    let lines = lines::lines(robot, &template, template.seed, count, size.speed);
    if lines.is_empty() {
        return Err(Failure::Input(format!(
            "the sweep's lines are drawn for a PUMA, and '{}' has no such factors: compare scenarios of your own instead",
            robot.name
        )));
    }
    Ok(lines)
}

/// The results of runs; in processes, a signal ends each of them.
///
/// # Errors
/// [`Failure::Work`] where one has come.
fn unless_stopped<T>(graph: Option<&Graph>, runs: impl FnOnce() -> T) -> Result<T, Failure> {
    if graph.is_none() {
        return Ok(runs());
    }
    let mut signals = session::interrupts()?;
    let done = runs();
    check(&mut signals)?;
    Ok(done)
}

/// Runs trials on all cores.
fn rows(title: &str, trials: &[Trial<'_>], observer: Observer<'_>) -> Result<Vec<Row>, Refused> {
    on_all_cores(title, trials, Trial::run, observer)
        .into_iter()
        .collect()
}

impl Compared {
    fn run(
        loaded: &load::Loaded,
        request: &Request<'_>,
        observer: Observer<'_>,
    ) -> Result<Self, Failure> {
        let scenario = chain::without_faults(&loaded.scenario);
        let name = scenario.name.as_str();
        let robot: &Robot = &loaded.robot;
        let (near, tasks) = if name == SWEEP {
            let lines = draw(loaded, request.size)?;
            let parts = |line: lines::Line| (line.near, chain::without_faults(&line.scenario));
            lines.into_iter().map(parts).unzip()
        } else {
            (Vec::new(), vec![scenario.clone()])
        };
        let graphs = request
            .laws
            .iter()
            .map(|law| law.graph(request.plant, robot, &tasks[0]));
        let graphs = graphs.collect::<Result<Vec<_>, _>>()?;
        let under = |(law, graph)| {
            let graph: &Option<Graph> = graph;
            let trial = move |task| Law::trial(law, robot, task, graph.as_ref());
            tasks.iter().map(trial)
        };
        let trials: Vec<_> = request.laws.iter().zip(&graphs).flat_map(under).collect();
        let in_processes = graphs.iter().flatten().next();
        let rows = unless_stopped(in_processes, || rows(name, &trials, observer))?
            .map_err(|error| Failure::Input(format!("{name}: {error}")))?;
        let of_law = |(law, rows): (&Law, &[Row])| {
            let rows = rows.iter().map(|row| law.named(row));
            (law.clone(), rows.collect())
        };
        Ok(Self {
            faults_left_out: loaded.scenario.fault.len(),
            robot: robot.name.clone(),
            speed: request.size.speed,
            laws: request
                .laws
                .iter()
                .zip(rows.chunks(tasks.len()))
                .map(of_law)
                .collect(),
            near,
            scenario,
        })
    }

    /// How many of a law's lines near a singularity (near any: `None`) are so, and of how many.
    fn count(&self, rows: &[Row], near: Option<Kind>, so: fn(&Row) -> bool) -> (usize, usize) {
        let lines = self.near.iter().zip(rows);
        let of: Vec<_> = lines
            .filter(|(kind, _)| near.is_none_or(|near| near == **kind))
            .map(|(_, row)| so(row))
            .collect();
        (of.iter().filter(|so| **so).count(), of.len())
    }

    /// For machines.
    pub fn json(&self) -> Value {
        let Scenario { name, seed, .. } = &self.scenario;
        if self.near.is_empty() {
            let laws: Vec<_> = self.laws.iter().flat_map(|(_, rows)| rows).collect();
            return json!({
                "scenario": name, "robot": self.robot, "seed": seed, "faults_left_out": self.faults_left_out, "laws": laws,
            });
        }
        let of_law = |(law, rows): &(Law, Vec<Row>)| {
            let counts = |near: Option<Kind>| {
                let count = |so| self.count(rows, near, so).0;
                let lines = self.count(rows, near, |_| true).1;
                json!({"lines": lines, "s1": count(|row| row.task.s1), "s2": count(|row| row.task.s2), "ends": count(Row::ended)})
            };
            let near: Map<_, _> = KINDS
                .iter()
                .map(|kind| (name_of(*kind), counts(Some(*kind))))
                .collect();
            let line = |(kind, row): (&Kind, &Row)| json!({"near": name_of(*kind), "score": row});
            let lines: Vec<_> = self.near.iter().zip(rows).map(line).collect();
            json!({"law": law.name(), "all": counts(None), "near": near, "lines": lines})
        };
        let laws: Vec<_> = self.laws.iter().map(of_law).collect();
        json!({"scenario": name, "seed": seed, "speed_m_s": self.speed, "laws": laws})
    }
}

/// The name of the singularity that a line passes.
pub(crate) fn name_of(kind: Kind) -> String {
    singularity_name(kind.code(), 0).to_owned()
}
