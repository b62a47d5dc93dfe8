//! The same scenario under different conditions, compared byte by byte.

use std::fmt;
use std::path::{Path, PathBuf};

use model::Robot;
use runtime::random;
use serde::Serialize;
use session::table::{Fitted, count, number, table};
use session::{Failure, Observer, Progress, Results, load};
use shared_types::graph::Graph;
use shared_types::job::{Job, Mode};
use shared_types::scenario::Scenario;

use super::compared::{
    Place, Ran, differing, in_processes, on_one_thread, places, record_of, record_on_one_thread,
};
use super::condition::{CONDITIONS, KILLS, Subject, UNDISTURBED};
use crate::folder::Folder;

/// Most runs of which each has a row; of more only those that differ have one.
const MOST_ROWS: usize = 12;

/// How to run a scenario several times.
pub struct Request<'a> {
    /// The scenario's name, for errors.
    pub name: &'a str,
    /// The scenario.
    pub scenario: &'a Scenario,
    /// Its arm.
    pub robot: &'a Robot,
    /// The process graph.
    pub graph: &'a Graph,
    /// How often.
    pub runs: u32,
    /// Kills processes at random moments, in place of all other conditions.
    pub kills: bool,
    /// Where the messages and recordings stay; `None` removes them.
    pub out: Option<&'a Path>,
    /// Lets the plant take the torque of the tick before where the right one is late.
    pub unordered: bool,
}

/// All runs, and the first difference between them.
#[derive(Serialize)]
pub struct Verified {
    /// Name of the scenario.
    pub scenario: String,
    /// Its seed.
    pub seed: u64,
    /// How many faults it plans.
    pub faults: usize,
    /// Whether all runs gave the same bytes and ended the same way.
    pub identical: bool,
    /// 1 where the first run is the reference: one thread cannot compute the death of the plant, a fault of the recorder, or a program of the graph's own.
    pub reference_run: Option<u32>,
    /// What the runs are compared with.
    pub reference: Ran,
    /// The runs.
    pub runs: Vec<Ran>,
    /// Where the first that differs does so.
    pub difference: Option<Place>,
    /// The folder of the runs that differ, and of the reference.
    pub folder: Option<PathBuf>,
}

/// Runs a scenario several times, each time under another condition, and compares every message of every topic.
///
/// # Errors
/// [`Failure`] where the scenario cannot be run, or a run is interrupted.
pub fn verify(request: &Request<'_>, observer: Observer<'_>) -> Result<Verified, Failure> {
    let Request {
        name,
        scenario,
        robot,
        graph,
        ..
    } = *request;
    chain::try_first_tick(robot, scenario, graph)
        .map_err(|error| Failure::Input(format!("{name}: {error}")))?;
    let needs_processes = needs_processes(scenario, graph);
    // Before anything is made: a signal ends it at once.
    let mut reference = match needs_processes {
        None => Some(on_one_thread(robot, scenario)?),
        Some(reason) if request.runs < 2 => {
            return Err(Failure::Input(format!(
                "{} {reason}, which one thread cannot compute: its runs are compared with each other, so use at least --runs 2",
                scenario.name
            )));
        }
        Some(_) => None,
    };
    let _signals = session::interrupts()?;
    let folder = Folder::create(request.out)?;
    let (mut runs, mut difference, mut first) = (Vec::<Ran>::new(), None, None);
    observer(Progress::Begin {
        title: &scenario.name,
        length: u64::from(request.runs),
        unit: "runs",
    });
    for index in 0..request.runs as usize {
        let results = Results::within(folder.path(), &format!("run-{}", index + 1))?;
        let (job, ran) = run(request, index, &results.folder)?;
        let reference = reference.get_or_insert_with(|| ran.clone());
        let first = first.get_or_insert_with(|| job.clone());
        let differs = ran.topics != reference.topics;
        if differs && difference.is_none() {
            let expected = match needs_processes {
                Some(_) => record_of(&first.out, first)?,
                None => record_on_one_thread(folder.path(), &job, robot)?,
            };
            let place = places(&expected, &record_of(&job.out, &job)?)?
                .into_iter()
                .next();
            let run = Some(index + 1);
            difference = place.map(|place| Place { run, ..place });
        }
        let is_reference = index == 0 && needs_processes.is_some();
        if request.out.is_none() && !is_reference && !differs {
            results.clear()?;
        }
        runs.push(ran);
        observer(Progress::Step);
    }
    observer(Progress::End);
    let none = || Failure::work("nothing was run");
    let (is_run, reference) = (needs_processes.is_some(), reference.ok_or_else(none)?);
    let verified = Verified::of(scenario, is_run, reference, runs, difference);
    Ok(Verified {
        folder: verified.difference.is_some().then(|| folder.keep()),
        ..verified
    })
}

impl Verified {
    fn of(
        scenario: &Scenario,
        is_run: bool,
        reference: Ran,
        runs: Vec<Ran>,
        difference: Option<Place>,
    ) -> Self {
        let is_like = |ran: &Ran| {
            ran.topics == reference.topics
                && ran.failure.is_empty() == reference.failure.is_empty()
                && (!is_run || ran.ended_by == reference.ended_by)
        };
        // A planned fault may be the end of every run (the death of the plant is, and one death more than the budget); nothing else may.
        let is_sound = reference.failure.is_empty() || !is_run || reference.ended_by.is_some();
        Self {
            scenario: scenario.name.clone(),
            seed: scenario.seed,
            faults: scenario.fault.len(),
            identical: is_sound && runs.iter().all(is_like),
            reference_run: is_run.then_some(1),
            reference,
            runs,
            difference,
            folder: None,
        }
    }
}

/// One of the runs, under its condition.
fn run(request: &Request<'_>, index: usize, out: &Path) -> Result<(Job, Ran), Failure> {
    let Request {
        scenario,
        robot,
        graph,
        kills,
        ..
    } = *request;
    let condition = match (kills, index) {
        (false, _) => CONDITIONS[index % CONDITIONS.len()],
        // With this one the others may have to be compared.
        (true, 0) => UNDISTURBED,
        (true, _) => KILLS,
    };
    let seed = random(scenario.seed, index as u64);
    let (scenario, graph) = (scenario.clone(), graph.clone());
    let job = load::job(robot, scenario, graph, Mode::Lockstep, out.to_owned());
    let mut plan = session::plan(&job)?;
    condition.disturb(&mut plan, seed, request.unordered);
    let source = plan.children.iter().position(|child| child.ends_run);
    let subject = Subject {
        count: plan.children.len(),
        source: source.unwrap_or_default(),
        length: job.scenario.planned_ticks(),
    };
    let mut start = 0;
    let beside = |page| {
        start += 1;
        condition.beside(page, subject, start, seed)
    };
    let (ran, summary) = in_processes(&job, plan, condition.to_string(), beside)?;
    let lack = summary.recorder.error;
    let is_kept = request.out.is_none() || lack.is_empty();
    is_kept
        .then_some((job, ran))
        .ok_or_else(|| Failure::Work(format!("{} is not kept whole: {lack}", out.display())))
}

/// Why one thread cannot have a scenario.
fn needs_processes(scenario: &Scenario, graph: &Graph) -> Option<&'static str> {
    let has_own_graph =
        || chain::graph(scenario).map_or(true, |built_in| built_in.process != graph.process);
    if graph
        .process
        .iter()
        .any(|process| process.program().is_none())
    {
        return Some("runs in programs of its graph");
    }
    let is_possible =
        scenario.fault.is_empty() || !has_own_graph() && chain::planned_faults(scenario).is_ok();
    (!is_possible).then_some("plans faults of its plant, its recorder or its graph")
}

impl Verified {
    /// The topics in which a run is not the reference.
    fn others(&self, ran: &Ran) -> String {
        let others = differing([&self.reference.topics, &ran.topics]);
        match others.is_empty() {
            true => "all equal".to_owned(),
            false => format!("≠ {}", others.join(", ")),
        }
    }

    /// The contents of each topic in the reference.
    fn hashes(&self) -> Fitted {
        let mut hashes = table(&["topic", "messages", "hash of the contents in the reference"]);
        for (name, topic) in &self.reference.topics {
            hashes.add_row([name.into(), number(topic.count), topic.hash.as_str().into()]);
        }
        hashes
    }

    /// The reference and the runs: of many only those that differ.
    fn rows(&self) -> Fitted {
        let Self {
            reference, runs, ..
        } = self;
        let mut rows = table(&["run", "condition", "ticks/s", "topics"]);
        let is_shown = |ran: &Ran| runs.len() <= MOST_ROWS || ran.topics != reference.topics;
        let shown = (1..).zip(runs).filter(|(_, ran)| is_shown(ran));
        let named = shown.map(|(number, ran)| (number.to_string(), ran));
        for (name, ran) in std::iter::once(("reference".to_owned(), reference)).chain(named) {
            rows.add_row([
                name.into(),
                ran.condition.as_str().into(),
                number(format!("{:.0}", ran.ticks_per_s)),
                self.others(ran).into(),
            ]);
        }
        rows
    }
}

impl fmt::Display for Verified {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            scenario,
            seed,
            reference,
            runs,
            folder,
            ..
        } = self;
        writeln!(f, "{}\n{}", self.hashes(), self.rows())?;
        for (number, ran) in (1..)
            .zip(runs)
            .filter(|(_, ran)| ran.topics != reference.topics)
        {
            for death in &ran.deaths {
                writeln!(f, "run {number}: {death}")?;
            }
        }
        if let Some(folder) = folder {
            writeln!(f, "runs with other bytes are in {}", folder.display())?;
        }
        for (number, ran) in (1..).zip(runs).filter(|(_, ran)| !ran.failure.is_empty()) {
            writeln!(f, "run {number} did not finish: {}", ran.failure)?;
        }
        if let Some(place) = &self.difference {
            writeln!(f, "{place}")?;
        }
        if self.reference_run.is_some() {
            writeln!(
                f,
                "one thread cannot compute the death of the plant, a fault of the recorder, or a program of the graph's own: \
                 run 1 is the reference of the others"
            )?;
        }
        let verdict = if self.identical {
            "the same bytes everywhere"
        } else {
            "NOT the same bytes"
        };
        let deaths: usize = runs.iter().map(|ran| ran.deaths.len()).sum();
        let [runs, deaths] = [(runs.len(), "run"), (deaths, "death")]
            .map(|(number, what)| count(number as u64, what));
        writeln!(
            f,
            "{scenario}, seed {seed}, {}, {runs}, {deaths}: {verdict}",
            count(reference.ticks, "tick")
        )
    }
}
