//! Control laws compared: every law on the same plant, seed and task, on one scenario or on many lines.

mod law;
mod lines;
mod race;
mod text;
mod verdict;

pub use law::{Law, laws};
pub use lines::{Drawn, Lines};
pub use race::{Race, Racer, race};

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use control::Kind;
use model::{Refused, Robot};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value, json};
use session::{Failure, Observer, Progress, Results, load};
use shared_types::codes::singularity_name;
use shared_types::graph::Graph;
use shared_types::scenario::Scenario;
use shared_types::summary::{BOUNDARY, FAILED, MISSED, REACHED};

use crate::end::check;
use crate::row::Row;

/// The scenario that stands for many lines.
pub const SWEEP: &str = "sweep";

/// The scenarios and laws to compare.
pub struct Request<'a> {
    /// Built-in scenarios' names, or scenario files.
    pub scenarios: &'a [String],
    /// The laws.
    pub laws: &'a [Law],
    /// The results folder; the next free `runs/compare-NNN` where it is `None`.
    pub out: Option<&'a Path>,
    /// The lines of the scenario `sweep`; settings and seed of every scenario.
    pub lines: Lines<'a>,
    /// The plant in place of the simulated arm, as of a run.
    pub plant: Option<&'a str>,
}

/// The outcome of a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// By the goal of the scenario.
    Reached,
    /// Before the start, or on the way, and the arm brought to rest within its limits: the reason says why.
    Refused,
    /// The run was completed, and its reason names a cause: a hold, or the path's accuracy.
    Missed,
    /// The goal was not reached, and nothing says why.
    Silent,
}

/// A task and its run.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// The singularities that it passes, by name.
    pub singularities: String,
    /// The place on the line.
    pub place: &'static str,
    /// Its outcome.
    pub outcome: Outcome,
    /// Why, in words.
    pub reason: String,
    /// Time that the plan before the start took on this machine, where it is measured; ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub planning_ms: Option<f64>,
    /// The run; `None` where it was refused before the start.
    pub score: Option<Row>,
}

/// One scenario, or the lines that stand for the scenario `sweep`, under each law.
pub struct Compared {
    /// The scenario, without its planned faults.
    scenario: Scenario,
    robot: String,
    /// How many planned faults were left out.
    faults_left_out: usize,
    /// Peak speed of the lines, m/s; `None` of one task.
    speed: Option<f64>,
    /// Each line is exactly singular somewhere: each has a row, and its plan is measured.
    is_exact: bool,
    tasks: Vec<Drawn>,
    laws: Vec<(Law, Vec<Line>)>,
}

/// Runs each scenario under each law, hands each comparison to `each` when it is complete, and saves `compare.json`, and each line through an exact
/// singularity that did not reach its goal as a scenario. Returns the JSON and the folder.
///
/// # Errors
/// [`Failure`] where a scenario cannot be run, or a file cannot be written.
pub fn compare(
    request: &Request<'_>,
    observer: Observer<'_>,
    each: &mut dyn FnMut(&Compared),
) -> Result<(Value, PathBuf), Failure> {
    let names = request.scenarios.iter();
    let begun = names.map(|name| {
        let (robot, compared) = Compared::begin(name, &request.lines, observer)?;
        let task = &compared.tasks[0].scenario;
        let graph = |law: &Law| law.graph(request.plant, &robot, task);
        let graphs = request
            .laws
            .iter()
            .map(graph)
            .collect::<Result<Vec<_>, _>>()?;
        Ok((robot, graphs, compared))
    });
    let begun = begun.collect::<Result<Vec<_>, Failure>>()?;
    // From here on a folder is there; a signal ends the runs at hand, and with them all.
    let signals = Mutex::new(session::interrupts()?);
    let go_on = || check(&mut signals.lock().unwrap_or_else(PoisonError::into_inner));
    let results = Results::create(request.out, "compare")?;
    let mut comparisons = Vec::new();
    for (robot, graphs, mut compared) in begun {
        compared.run(&robot, &graphs, request, observer, &go_on)?;
        each(&compared);
        comparisons.push(compared.json());
        for (number, task) in compared.unreached() {
            lines::save(&results.folder, number, &task.scenario)?;
        }
    }
    let whole = json!({"version": env!("CARGO_PKG_VERSION"), "scenarios": comparisons});
    results.save("compare.json", &whole)?;
    Ok((whole, results.folder.clone()))
}

impl Compared {
    /// The tasks of a scenario by its name, before they are run.
    fn begin(
        name: &str,
        lines: &Lines<'_>,
        observer: Observer<'_>,
    ) -> Result<(Robot, Self), Failure> {
        let is_sweep = name == SWEEP;
        let (robot, scenario, tasks) = if is_sweep {
            lines.some(observer)?
        } else {
            let load::Loaded {
                robot, scenario, ..
            } = load::scenario(name, lines.settings, lines.seed)?;
            let task = Drawn {
                singularities: String::new(),
                place: "",
                scenario: chain::without_faults(&scenario),
            };
            (robot, scenario, vec![task])
        };
        let compared = Self {
            faults_left_out: scenario.fault.len(),
            scenario: chain::without_faults(&scenario),
            robot: robot.name.clone(),
            speed: is_sweep.then_some(lines.speed),
            is_exact: is_sweep && lines.robot.is_some(),
            tasks,
            laws: Vec::new(),
        };
        Ok((robot, compared))
    }

    fn run(
        &mut self,
        robot: &Robot,
        graphs: &[Option<Graph>],
        request: &Request<'_>,
        observer: Observer<'_>,
        go_on: &(dyn Fn() -> Result<(), Failure> + Sync),
    ) -> Result<(), Failure> {
        let (name, tasks) = (&self.scenario.name, &self.tasks);
        let under = |(law, graph)| tasks.iter().map(move |task| (law, graph, task));
        let all: Vec<_> = request.laws.iter().zip(graphs).flat_map(under).collect();
        let plans = self.is_exact;
        let run = |(law, graph, task): &(&Law, &Option<Graph>, &Drawn)| {
            let line = run(robot, law, graph.as_ref(), task, plans);
            observer(Progress::Step);
            go_on().map(|()| line)
        };
        observer(Progress::Begin {
            title: name,
            length: all.len() as u64,
            unit: "runs",
        });
        // A core that is done takes the next task, however long the others are.
        let lines = all.par_iter().with_max_len(1).map(run);
        let lines = lines.collect::<Result<Vec<_>, Failure>>();
        observer(Progress::End);
        let lines = lines?;
        let is_nothing = self.speed.is_none() && lines.iter().all(|line| line.score.is_none());
        if let Some(line) = lines.first().filter(|_| is_nothing) {
            return Err(Failure::Input(format!("{name}: {}", line.reason)));
        }
        let of_law = lines.chunks(tasks.len()).map(<[_]>::to_vec);
        self.laws = request.laws.iter().cloned().zip(of_law).collect();
        Ok(())
    }

    /// The lines through exact singularities that did not reach their goal under the first law, with their numbers from 1 on.
    pub fn unreached(&self) -> impl Iterator<Item = (usize, &Drawn)> {
        let first = self.laws.first().filter(|_| self.is_exact);
        let lines = first.into_iter().flat_map(|(_, lines)| lines);
        let numbered = (1..).zip(lines.zip(&self.tasks));
        numbered
            .filter(|(_, (line, _))| line.outcome != Outcome::Reached)
            .map(|(number, (_, task))| (number, task))
    }

    /// Number of runs of which a process could not go on, one of others for instance.
    pub fn failed(&self) -> usize {
        let lines = self.laws.iter().flat_map(|(_, lines)| lines);
        let rows = lines.filter_map(|line| line.score.as_ref());
        rows.filter(|row| row.outcome == FAILED).count()
    }

    /// The names of the singularities, in the order in which they were drawn.
    fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for task in &self.tasks {
            if !names.contains(&task.singularities.as_str()) {
                names.push(&task.singularities);
            }
        }
        names
    }

    /// The laws that refused the path, and why.
    fn refused(&self) -> impl Iterator<Item = (&str, &str)> {
        self.laws.iter().filter_map(|(law, lines)| {
            let line = lines.iter().find(|line| line.score.is_none())?;
            Some((law.name(), line.reason.as_str()))
        })
    }

    /// For machines.
    pub fn json(&self) -> Value {
        let Scenario { name, seed, .. } = &self.scenario;
        let Some(speed) = self.speed else {
            let lines = self.laws.iter().flat_map(|(_, lines)| lines);
            let laws: Vec<_> = lines.filter_map(|line| line.score.as_ref()).collect();
            let refused: Map<_, _> = (self.refused())
                .map(|(law, why)| (law.to_owned(), why.into()))
                .collect();
            return json!({
                "scenario": name, "robot": self.robot, "seed": seed, "faults_left_out": self.faults_left_out, "laws": laws, "refused": refused,
            });
        };
        let of_law = |(law, lines): &(Law, Vec<Line>)| {
            let near = self.names().into_iter();
            let near: Map<_, _> = near
                .map(|name| (name.to_owned(), Counts::of(lines, Some(name)).json()))
                .collect();
            let all = Counts::of(lines, None).json();
            json!({"law": law.name(), "all": all, "near": near, "lines": lines})
        };
        let laws: Vec<_> = self.laws.iter().map(of_law).collect();
        json!({"scenario": name, "robot": self.robot, "seed": seed, "speed_m_s": speed, "laws": laws})
    }
}

/// Lines of a law near a singularity, or near any.
struct Counts<'a>(Vec<&'a Line>);

impl<'a> Counts<'a> {
    fn of(lines: &'a [Line], near: Option<&str>) -> Self {
        let is_near = |line: &&Line| near.is_none_or(|near| line.singularities == near);
        Self(lines.iter().filter(is_near).collect())
    }

    fn rows(&self) -> impl Iterator<Item = &'a Row> {
        self.0.iter().filter_map(|line| line.score.as_ref())
    }

    fn so(&self, so: fn(&Row) -> bool) -> usize {
        self.rows().filter(|row| so(row)).count()
    }

    fn ended(&self, outcome: Outcome) -> usize {
        let ended = self.0.iter().filter(|line| line.outcome == outcome);
        ended.count()
    }

    fn json(&self) -> Value {
        json!({
            "lines": self.0.len(), "s1": self.so(|row| row.task.s1), "s2": self.so(|row| row.task.s2), "ends": self.so(Row::ended),
            "reached": self.ended(Outcome::Reached), "refused": self.ended(Outcome::Refused), "missed": self.ended(Outcome::Missed),
            "silent": self.ended(Outcome::Silent),
        })
    }
}

fn run(robot: &Robot, law: &Law, graph: Option<&Graph>, task: &Drawn, plans: bool) -> Line {
    let trial = law.trial(robot, &task.scenario, graph);
    let began = Instant::now();
    let planned = match law {
        Law::Own(_) if plans => planned(robot, &trial.scenario),
        _ => Ok(()),
    };
    let planning_ms = plans.then(|| began.elapsed().as_secs_f64() * 1e3);
    let result = planned.and_then(|()| trial.run());
    let (outcome, reason) = match &result {
        Err(refused) => (Outcome::Refused, refused.to_string()),
        Ok(row) => (outcome(row), row.reason.clone()),
    };
    Line {
        singularities: task.singularities.clone(),
        place: task.place,
        outcome,
        reason,
        planning_ms,
        score: result.ok().map(|row| Row {
            law: law.name().to_owned(),
            ..row
        }),
    }
}

/// Plans as a run does, and leaves it at that.
fn planned(robot: &Robot, scenario: &Scenario) -> Result<(), Refused> {
    chain::Chain::new(robot, scenario)?.possible()
}

fn outcome(row: &Row) -> Outcome {
    let within = row.joints.speed_max_ratio <= 1.0 && row.joints.stopped_ticks == 0;
    let says = !row.task.causes.is_empty();
    match row.outcome.as_str() {
        REACHED => Outcome::Reached,
        BOUNDARY => Outcome::Missed,
        "stopped" if within => Outcome::Refused,
        MISSED if within && says => Outcome::Missed,
        _ => Outcome::Silent,
    }
}

/// The name of the singularity that a line passes.
pub(crate) fn name_of(kind: Kind) -> String {
    singularity_name(kind.code(), 0).to_owned()
}
