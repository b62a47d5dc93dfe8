//! `armplane verify`: the same scenario under different conditions, compared byte by byte.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use chain::{Chain, Tick};
use launcher::{End, Plan};
use model::Robot;
use runtime::{Difference, Disturbance, Kept, TopicHash, first_difference, random, realtime};
use serde_json::json;
use shared_types::graph::TOPICS;
use shared_types::job::{Job, Mode};
use shared_types::scenario::Scenario;
use shared_types::summary::TopicSummary;
use shared_types::{Message, PlantState, SensorSample, SingularityReport, StateEstimate, TorqueCommand};

use super::failure::Failure;
use super::hogs::Hogs;
use super::out::say;
use super::table::{number, table};
use super::{VerifyArgs, load, run};

/// Longest delay of a process at its start.
const LONGEST_DELAY_MS: u64 = 300;

/// Where the processes run.
#[derive(Clone, Copy)]
enum Placement {
    /// As the graph says.
    Graph,
    /// All on one core.
    Together(usize),
    /// One after the other on the next core.
    Split,
    /// Wherever the kernel likes.
    Free,
}

/// The circumstances of one run.
#[derive(Clone, Copy)]
struct Condition {
    placement: Placement,
    nice: bool,
    delays: bool,
    pauses: bool,
    hogs: bool,
    record: bool,
}

/// What the runs go through, one after the other and from the beginning again, each time with other random numbers.
const CONDITIONS: [Condition; 6] = [
    Condition { placement: Placement::Graph, nice: false, delays: false, pauses: false, hogs: false, record: true },
    Condition { placement: Placement::Free, nice: true, delays: true, pauses: true, hogs: false, record: false },
    Condition { placement: Placement::Split, nice: false, delays: true, pauses: false, hogs: true, record: true },
    Condition { placement: Placement::Together(0), nice: true, delays: false, pauses: true, hogs: true, record: false },
    Condition { placement: Placement::Together(1), nice: false, delays: true, pauses: true, hogs: false, record: true },
    Condition { placement: Placement::Free, nice: false, delays: false, pauses: false, hogs: true, record: false },
];

impl std::fmt::Display for Condition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.placement {
            Placement::Graph => write!(f, "cores of the graph")?,
            Placement::Together(core) => write!(f, "all on core {core}")?,
            Placement::Split => write!(f, "alternating cores")?,
            Placement::Free => write!(f, "not pinned")?,
        }
        for (is_so, words) in [(self.nice, "nice"), (self.delays, "late starts"), (self.pauses, "pauses"), (self.hogs, "busy cores")] {
            if is_so {
                write!(f, ", {words}")?;
            }
        }
        write!(f, ", {}", if self.record { "recording" } else { "no recording" })
    }
}

impl Condition {
    /// Lays the condition over a plan.
    fn disturb(&self, plan: &mut Plan, seed: u64, unordered: bool) {
        let cores = realtime::allowed_cores();
        let core = |index: usize| (!cores.is_empty()).then(|| cores[index % cores.len()]);
        for (index, child) in plan.children.iter_mut().enumerate() {
            let process = &mut child.process;
            process.core = match self.placement {
                Placement::Graph => process.core,
                Placement::Together(which) => core(which),
                Placement::Split => core(index),
                Placement::Free => None,
            };
            let draw = |what: u64| random(seed, 8 * index as u64 + what);
            process.disturbance = Disturbance {
                start_delay: if self.delays { Duration::from_millis(draw(0) % LONGEST_DELAY_MS) } else { Duration::ZERO },
                nice: if self.nice { (draw(1) % 16) as i32 } else { 0 },
                pauses: self.pauses.then(|| draw(2)),
                unordered: unordered && child.ends_run,
            };
        }
    }
}

/// What one run gave.
struct Ran {
    condition: String,
    ticks: u64,
    ticks_per_s: f64,
    /// In the order of [`TOPICS`].
    topics: [TopicSummary; 5],
    /// Why it did not come to its end; empty when it did.
    failure: String,
}

/// The first place where a run is not what one thread computes.
struct Place {
    run: usize,
    tick: u64,
    topic: &'static str,
    difference: Difference,
}

pub(crate) fn verify(args: &VerifyArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let load::Loaded { scenario, robot } = load::scenario(&args.scenario, &args.set, args.seed)?;
    let graph = load::graph(args.graph.as_deref())?;
    chain::try_first_tick(&robot, &scenario).map_err(|error| Failure::Input(format!("{}: {error}", args.scenario)))?;
    let folder = Folder::create(args.out.as_deref())?;
    let reference = on_one_thread(&robot, &scenario)?;
    let (mut runs, mut place) = (Vec::new(), None);
    for index in 0..args.runs as usize {
        let condition = CONDITIONS[index % CONDITIONS.len()];
        let out = folder.path().join(format!("run-{}", index + 1));
        std::fs::create_dir_all(&out).map_err(|error| Failure::Work(format!("cannot make {}: {error}", out.display())))?;
        let job = Job {
            run: String::new(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            mode: Mode::Lockstep,
            out,
            record: condition.record,
            messages: true,
            robot: load::robot_text(&robot),
            scenario: scenario.clone(),
            graph: graph.clone(),
        };
        let ran = in_processes(&job, condition, random(scenario.seed, index as u64), args.unordered, reference.ticks)?;
        let messages = job.out.join(recorder::MESSAGES);
        if ran.topics != reference.topics && place.is_none() {
            place = first_place(&robot, &scenario, &messages, index)?;
        }
        if args.out.is_none() {
            // What is left of it goes with the whole folder.
            let _ = std::fs::remove_dir_all(&job.out);
        }
        runs.push(ran);
    }
    let is_identical = runs.iter().all(|ran| ran.topics == reference.topics && ran.failure.is_empty());
    if as_json {
        tell_machine(&scenario, &reference, &runs, place.as_ref(), is_identical);
    } else {
        tell(&scenario, &reference, &runs, place.as_ref(), is_identical);
    }
    Ok(if is_identical { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// The reference: no process, no shared memory, no clock.
fn on_one_thread(robot: &Robot, scenario: &Scenario) -> Result<Ran, Failure> {
    let began = Instant::now();
    let (mut sensor, mut truth, mut estimate) = <(TopicHash, TopicHash, TopicHash)>::default();
    let (mut report, mut command) = <(TopicHash, TopicHash)>::default();
    let each = |tick: &Tick| {
        sensor.add(&tick.sensor);
        truth.add(&tick.truth);
        estimate.add(&tick.estimate);
        report.add(&tick.report);
        command.add(&tick.command);
    };
    chain::run(robot, scenario, each).map_err(Failure::input)?;
    let topics = [sensor, truth, estimate, report, command]
        .map(|hash| TopicSummary { count: hash.count(), hash: format!("{:016x}", hash.digest()) });
    let ticks = topics[0].count;
    let ticks_per_s = ticks as f64 / began.elapsed().as_secs_f64().max(1e-9);
    Ok(Ran { condition: "one thread, no shared memory".to_owned(), ticks, ticks_per_s, topics, failure: String::new() })
}

fn in_processes(job: &Job, condition: Condition, seed: u64, unordered: bool, ticks: u64) -> Result<Ran, Failure> {
    let mut plan = run::plan(job)?;
    condition.disturb(&mut plan, seed, unordered);
    let hogs = condition.hogs.then(Hogs::start);
    let (outcome, account) = run::launch(job, plan, ticks)?;
    drop(hogs);
    let failure = match &outcome.end {
        End::Completed => String::new(),
        End::Interrupted { signal } => return Err(Failure::Work(format!("stopped by {signal}"))),
        End::Failed(failure) => failure.to_string(),
    };
    // Without an account there is no topic either, and that is a difference.
    let mut account = account.unwrap_or_default();
    let topics = TOPICS.map(|topic| account.topics.remove(topic).unwrap_or_default());
    Ok(Ran { condition: condition.to_string(), ticks: outcome.ticks, ticks_per_s: account.ticks_per_s, topics, failure })
}

/// Computes the reference again, beside the messages that a run kept, up to the first difference.
fn first_place(robot: &Robot, scenario: &Scenario, messages: &Path, run: usize) -> Result<Option<Place>, Failure> {
    let mut sensor = Kept::<SensorSample>::open(messages).map_err(Failure::work)?;
    let mut truth = Kept::<PlantState>::open(messages).map_err(Failure::work)?;
    let mut estimate = Kept::<StateEstimate>::open(messages).map_err(Failure::work)?;
    let mut report = Kept::<SingularityReport>::open(messages).map_err(Failure::work)?;
    let mut command = Kept::<TorqueCommand>::open(messages).map_err(Failure::work)?;
    let mut chain = Chain::new(robot, scenario).map_err(Failure::input)?;
    while !chain.is_over() {
        let expected = chain.step();
        // In the order of the data: the first one is the cause, the others follow from it.
        let differences = [
            compare(&expected.sensor, &mut sensor)?,
            compare(&expected.truth, &mut truth)?,
            compare(&expected.estimate, &mut estimate)?,
            compare(&expected.report, &mut report)?,
            compare(&expected.command, &mut command)?,
        ];
        let found = TOPICS.into_iter().zip(differences).find_map(|(topic, difference)| Some((topic, difference?)));
        if let Some((topic, difference)) = found {
            return Ok(Some(Place { run, tick: expected.sensor.header.tick, topic, difference }));
        }
    }
    Ok(None)
}

fn compare<M: Message>(expected: &M, kept: &mut Kept<M>) -> Result<Option<Difference>, Failure> {
    let absent = || Difference { field: "the message".to_owned(), expected: "one".to_owned(), found: "none".to_owned() };
    Ok(match kept.next_message().map_err(Failure::work)? {
        Some(found) => first_difference(expected, &found),
        None => Some(absent()),
    })
}

/// Where the runs leave their messages: the user's folder, or one that is gone at the end.
pub(crate) enum Folder {
    Kept(PathBuf),
    Passing(tempfile::TempDir),
}

impl Folder {
    pub(crate) fn create(wanted: Option<&Path>) -> Result<Self, Failure> {
        match wanted {
            None => tempfile::Builder::new()
                .prefix("armplane-")
                .tempdir()
                .map(Self::Passing)
                .map_err(|error| Failure::Work(format!("cannot make a temporary folder: {error}; name one with --out"))),
            Some(folder) => std::fs::create_dir_all(folder).and_then(|()| folder.canonicalize()).map(Self::Kept).map_err(|error| {
                Failure::Input(format!("cannot write to {}: {error}; choose another folder with --out", folder.display()))
            }),
        }
    }

    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::Kept(path) => path,
            Self::Passing(folder) => folder.path(),
        }
    }

    /// It stays, for somebody to look into.
    pub(crate) fn keep(self) -> PathBuf {
        match self {
            Self::Kept(path) => path,
            Self::Passing(folder) => folder.keep(),
        }
    }
}

fn tell(scenario: &Scenario, reference: &Ran, runs: &[Ran], place: Option<&Place>, is_identical: bool) {
    let headings = [&["", "condition", "ticks/s"], &TOPICS[..]].concat();
    let mut rows = table(&headings);
    let row = |name: String, ran: &Ran, marks: [String; 5]| {
        let head = [name.into(), ran.condition.clone().into(), number(format!("{:.0}", ran.ticks_per_s))];
        head.into_iter().chain(marks.map(Into::into)).collect::<Vec<comfy_table::Cell>>()
    };
    rows.add_row(row("reference".to_owned(), reference, reference.topics.clone().map(|topic| topic.hash)));
    for (index, ran) in runs.iter().enumerate() {
        let mut wanted = reference.topics.iter();
        let marks =
            ran.topics.clone().map(|topic| if wanted.next() == Some(&topic) { "equal".to_owned() } else { format!("≠ {}", topic.hash) });
        rows.add_row(row(format!("run {}", index + 1), ran, marks));
    }
    say!("{rows}");
    for (index, ran) in runs.iter().enumerate().filter(|(_, ran)| !ran.failure.is_empty()) {
        say!("run {} did not come to its end: {}", index + 1, ran.failure);
    }
    if let Some(Place { run, tick, topic, difference: Difference { field, expected, found } }) = place {
        say!("run {} first differs at tick {tick}, topic {topic}, field {field}: {found} instead of {expected}", run + 1);
    }
    let verdict = if is_identical { "the same bytes everywhere" } else { "NOT the same bytes" };
    say!("{}, seed {}, {} ticks, {} runs: {verdict}", scenario.name, scenario.seed, reference.ticks, runs.len());
}

fn tell_machine(scenario: &Scenario, reference: &Ran, runs: &[Ran], place: Option<&Place>, is_identical: bool) {
    let of = |ran: &Ran| {
        let topic = |(index, name): (usize, &str)| {
            let topic = &ran.topics[index];
            (name.to_owned(), json!({"count": topic.count, "hash": topic.hash, "equal": *topic == reference.topics[index]}))
        };
        let topics: serde_json::Map<_, _> = TOPICS.into_iter().enumerate().map(topic).collect();
        json!({"condition": ran.condition, "ticks": ran.ticks, "ticks_per_s": ran.ticks_per_s, "failure": ran.failure, "topics": topics})
    };
    let difference = place.map(|place| {
        let Difference { field, expected, found } = &place.difference;
        json!({"run": place.run + 1, "tick": place.tick, "topic": place.topic, "field": field, "expected": expected, "found": found})
    });
    let whole = json!({
        "scenario": scenario.name, "seed": scenario.seed, "identical": is_identical,
        "reference": of(reference), "runs": runs.iter().map(of).collect::<Vec<_>>(), "difference": difference,
    });
    say!("{whole}");
}
