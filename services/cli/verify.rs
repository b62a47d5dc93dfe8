//! `armplane verify`: the same scenario under different conditions, compared byte by byte.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use chain::Tick;
use launcher::{End, Exit, Failure as Mishap, Plan};
use message_log::{Difference, LogError, LogReader, LogWriter, TopicHash, first_difference};
use model::Robot;
use runtime::{Disturbance, random, realtime};
use serde_json::json;
use shared_types::Message;
use shared_types::job::{Job, Mode};
use shared_types::scenario::Scenario;
use shared_types::summary::TopicSummary;
use shared_types::topics::{self, Build, ByTopic, COUNT, Each, Family, TOPICS, Topic};

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
    topics: [TopicSummary; COUNT],
    /// Why it did not come to its end; empty when it did.
    failure: String,
    /// The process that ended it before its time, and how.
    fallen: Option<(String, Exit)>,
}

/// What the runs are compared with.
struct Reference {
    ran: Ran,
    /// Where its messages are; nowhere yet while nobody needs them.
    messages: Option<PathBuf>,
    /// Whether it is the first of the runs, because of the scenario's faults: they happen to processes, which one thread does not have.
    is_run: bool,
}

impl Reference {
    /// Whether a run gave the same bytes and ended the same way.
    fn is_like(&self, ran: &Ran) -> bool {
        ran.topics == self.ran.topics && ran.fallen == self.ran.fallen && ran.failure.is_empty() == self.ran.failure.is_empty()
    }

    /// A planned fault may be the end of every run (the death of the plant is); nothing else may.
    fn is_sound(&self) -> bool {
        self.ran.failure.is_empty() || (self.is_run && self.ran.fallen.is_some())
    }
}

/// The first place where a run is not the reference.
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
    let has_faults = !scenario.fault.is_empty();
    if has_faults && args.runs < 2 {
        let sentence = "plans faults, which one thread cannot have: its runs are compared with each other, so take at least --runs 2";
        return Err(Failure::Input(format!("{} {sentence}", scenario.name)));
    }
    let folder = Folder::create(args.out.as_deref())?;
    let one_thread = || on_one_thread(&robot, &scenario, None).map(|ran| Reference { ran, messages: None, is_run: false });
    let mut reference = if has_faults { None } else { Some(one_thread()?) };
    let (mut runs, mut place) = (Vec::new(), None);
    for index in 0..args.runs as usize {
        let condition = CONDITIONS[index % CONDITIONS.len()];
        let out = folder.path().join(format!("run-{}", index + 1));
        std::fs::create_dir_all(&out).map_err(|error| Failure::Work(format!("cannot make {}: {error}", out.display())))?;
        let job = load::job(&robot, scenario.clone(), graph.clone(), Mode::Lockstep, out);
        let job = Job { record: condition.record, ..job };
        let ran = in_processes(&job, condition, random(scenario.seed, index as u64), args.unordered)?;
        let messages = job.out.join(recorder::MESSAGES);
        let Some(reference) = &mut reference else {
            reference = Some(Reference { ran, messages: Some(messages), is_run: true });
            continue;
        };
        if ran.topics != reference.ran.topics && place.is_none() {
            let expected = match &reference.messages {
                Some(messages) => messages,
                None => {
                    let messages = folder.path().join("one-thread");
                    on_one_thread(&robot, &scenario, Some(&messages))?;
                    reference.messages.insert(messages)
                }
            };
            place = first_place(expected, &messages, index)?;
        }
        if args.out.is_none() {
            // What is left of it goes with the whole folder.
            let _ = std::fs::remove_dir_all(&job.out);
        }
        runs.push(ran);
    }
    // There is at least one run.
    let Some(reference) = reference else { return Err(Failure::work("nothing was run")) };
    let is_identical = reference.is_sound() && runs.iter().all(|ran| reference.is_like(ran));
    if as_json {
        tell_machine(&scenario, &reference, &runs, place.as_ref(), is_identical);
    } else {
        tell(&scenario, &reference, &runs, place.as_ref(), is_identical);
    }
    Ok(if is_identical { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// The topics of one thread: their fingerprints, and their messages in a folder where they are wanted.
struct Topics(ByTopic<Taps>);

struct Taps;

impl Family for Taps {
    type Of<M: Topic> = Tap<M>;
}

struct Tap<M: Message> {
    hash: TopicHash,
    keep: Option<LogWriter<M>>,
}

impl Topics {
    fn create(folder: Option<&Path>) -> Result<Self, LogError> {
        struct Create<'a>(Option<&'a Path>);
        impl Build<Taps> for Create<'_> {
            type Error = LogError;
            fn build<M: Topic>(&mut self) -> Result<Tap<M>, LogError> {
                Ok(Tap { hash: TopicHash::default(), keep: self.0.map(LogWriter::create).transpose()? })
            }
        }
        ByTopic::try_build(&mut Create(folder)).map(Self)
    }

    fn add(&mut self, tick: &Tick) -> Result<(), LogError> {
        struct Add<'a>(&'a mut ByTopic<Taps>, &'a Tick);
        impl Each for Add<'_> {
            type Output = Result<(), LogError>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                let (tap, message) = (M::of_mut(self.0), M::of(self.1));
                tap.hash.add(message);
                tap.keep.as_mut().map_or(Ok(()), |keep| keep.add(message))
            }
        }
        topics::try_each(&mut Add(&mut self.0, tick))
    }

    /// In the order of [`TOPICS`].
    fn finish(mut self) -> Result<[TopicSummary; COUNT], LogError> {
        struct Finish<'a>(&'a mut ByTopic<Taps>);
        impl Each for Finish<'_> {
            type Output = Result<(), LogError>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                M::of_mut(self.0).keep.as_mut().map_or(Ok(()), LogWriter::flush)
            }
        }
        struct Account<'a>(&'a ByTopic<Taps>);
        impl Each for Account<'_> {
            type Output = TopicSummary;
            fn each<M: Topic>(&mut self) -> TopicSummary {
                let hash = &M::of(self.0).hash;
                TopicSummary { count: hash.count(), hash: format!("{:016x}", hash.digest()) }
            }
        }
        topics::try_each(&mut Finish(&mut self.0))?;
        Ok(topics::each(&mut Account(&self.0)))
    }
}

/// The reference of a scenario in which nothing goes wrong: no process, no shared memory, no clock.
fn on_one_thread(robot: &Robot, scenario: &Scenario, messages: Option<&Path>) -> Result<Ran, Failure> {
    let began = Instant::now();
    let mut topics = Topics::create(messages).map_err(Failure::work)?;
    let mut kept = Ok(());
    chain::run(robot, scenario, |tick| {
        if kept.is_ok() {
            kept = topics.add(tick);
        }
    })
    .map_err(Failure::input)?;
    let topics = kept.and_then(|()| topics.finish()).map_err(Failure::work)?;
    let ticks = topics[0].count;
    let ticks_per_s = ticks as f64 / began.elapsed().as_secs_f64().max(1e-9);
    let condition = "one thread, no shared memory".to_owned();
    Ok(Ran { condition, ticks, ticks_per_s, topics, failure: String::new(), fallen: None })
}

fn in_processes(job: &Job, condition: Condition, seed: u64, unordered: bool) -> Result<Ran, Failure> {
    let mut plan = run::plan(job)?;
    condition.disturb(&mut plan, seed, unordered);
    let hogs = condition.hogs.then(Hogs::start);
    let (outcome, account) = run::launch(job, plan)?;
    drop(hogs);
    let (failure, fallen) = match outcome.end {
        End::Completed => (String::new(), None),
        End::Interrupted { signal } => return Err(Failure::Work(format!("stopped by {signal}"))),
        End::Failed(mishap) => (mishap.to_string(), fallen(mishap)),
    };
    // Without an account there is no topic either, and that is a difference.
    let mut account = account.unwrap_or_default();
    let topics = TOPICS.map(|topic| account.topics.remove(topic).unwrap_or_default());
    Ok(Ran { condition: condition.to_string(), ticks: outcome.ticks, ticks_per_s: account.ticks_per_s, topics, failure, fallen })
}

fn fallen(mishap: Mishap) -> Option<(String, Exit)> {
    match mishap {
        Mishap::Died { process, exit, .. } => Some((process, exit)),
        Mishap::Slow { .. } | Mishap::DidNotStop { .. } => None,
    }
}

/// Reads what two runs kept, side by side, up to the first difference.
fn first_place(reference: &Path, messages: &Path, run: usize) -> Result<Option<Place>, Failure> {
    struct First<'a>(&'a Path, &'a Path);
    impl Each for First<'_> {
        type Output = Result<Option<(u64, Difference)>, Failure>;
        fn each<M: Topic>(&mut self) -> Self::Output {
            first_in::<M>(self.0, self.1)
        }
    }
    let differences = topics::each(&mut First(reference, messages)).into_iter().collect::<Result<Vec<_>, _>>()?;
    // The earliest; of one tick the first in the order of the data: it is the cause, the others follow from it.
    let found = TOPICS.into_iter().zip(differences).filter_map(|(topic, difference)| Some((topic, difference?)));
    let first = found.min_by_key(|(_, (tick, _))| *tick);
    Ok(first.map(|(topic, (tick, difference))| Place { run, tick, topic, difference }))
}

/// Where two series of kept messages of one topic first differ: the tick, and in what. Either may lack what the other has.
fn first_in<M: Message>(reference: &Path, messages: &Path) -> Result<Option<(u64, Difference)>, Failure> {
    let (mut expected, mut found) =
        (LogReader::<M>::open(reference).map_err(Failure::work)?, LogReader::<M>::open(messages).map_err(Failure::work)?);
    let whole =
        |expected: &str, found: &str| Difference { field: "the message".to_owned(), expected: expected.into(), found: found.into() };
    loop {
        let pair = (expected.next_message().map_err(Failure::work)?, found.next_message().map_err(Failure::work)?);
        let tick = |message: &M| message.header().tick;
        return Ok(match pair {
            (None, None) => None,
            (Some(expected), None) => Some((tick(&expected), whole("one", "none"))),
            (None, Some(found)) => Some((tick(&found), whole("none", "one"))),
            (Some(expected), Some(found)) if tick(&expected) < tick(&found) => Some((tick(&expected), whole("one", "none"))),
            (Some(expected), Some(found)) if tick(&expected) > tick(&found) => Some((tick(&found), whole("none", "one"))),
            (Some(expected), Some(found)) => match first_difference(&expected, &found) {
                Some(difference) => Some((tick(&expected), difference)),
                None => continue,
            },
        });
    }
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

/// Why the first run is the reference, where it is.
const WHY: &str =
    "the scenario plans faults, and one thread has no processes that they could happen to: run 1 is the reference of the others";

fn tell(scenario: &Scenario, reference: &Reference, runs: &[Ran], place: Option<&Place>, is_identical: bool) {
    let headings = [&["", "condition", "ticks/s"], &TOPICS[..]].concat();
    let mut rows = table(&headings);
    let row = |name: String, ran: &Ran, marks: [String; COUNT]| {
        let head = [name.into(), ran.condition.clone().into(), number(format!("{:.0}", ran.ticks_per_s))];
        head.into_iter().chain(marks.map(Into::into)).collect::<Vec<comfy_table::Cell>>()
    };
    let (name, first) = if reference.is_run { ("run 1, reference", 2) } else { ("reference", 1) };
    rows.add_row(row(name.to_owned(), &reference.ran, reference.ran.topics.clone().map(|topic| topic.hash)));
    for (number, ran) in (first..).zip(runs) {
        let mut wanted = reference.ran.topics.iter();
        let marks =
            ran.topics.clone().map(|topic| if wanted.next() == Some(&topic) { "equal".to_owned() } else { format!("≠ {}", topic.hash) });
        rows.add_row(row(format!("run {number}"), ran, marks));
    }
    say!("{rows}");
    let all = reference.is_run.then_some(&reference.ran).into_iter().chain(runs);
    for (number, ran) in (1..).zip(all).filter(|(_, ran)| !ran.failure.is_empty()) {
        say!("run {number} did not come to its end: {}", ran.failure);
    }
    if let Some(Place { run, tick, topic, difference: Difference { field, expected, found } }) = place {
        say!("run {} first differs at tick {tick}, topic {topic}, field {field}: {found} instead of {expected}", run + 1);
    }
    if reference.is_run {
        say!("{WHY}");
    }
    let verdict = if is_identical { "the same bytes everywhere" } else { "NOT the same bytes" };
    let count = runs.len() + usize::from(reference.is_run);
    say!("{}, seed {}, {} ticks, {count} runs: {verdict}", scenario.name, scenario.seed, reference.ran.ticks);
}

fn tell_machine(scenario: &Scenario, reference: &Reference, runs: &[Ran], place: Option<&Place>, is_identical: bool) {
    let of = |ran: &Ran| {
        let topic = |(index, name): (usize, &str)| {
            let topic = &ran.topics[index];
            (name.to_owned(), json!({"count": topic.count, "hash": topic.hash, "equal": *topic == reference.ran.topics[index]}))
        };
        let topics: serde_json::Map<_, _> = TOPICS.into_iter().enumerate().map(topic).collect();
        json!({"condition": ran.condition, "ticks": ran.ticks, "ticks_per_s": ran.ticks_per_s, "failure": ran.failure, "topics": topics})
    };
    let difference = place.map(|place| {
        let Difference { field, expected, found } = &place.difference;
        json!({"run": place.run + 1, "tick": place.tick, "topic": place.topic, "field": field, "expected": expected, "found": found})
    });
    let all = reference.is_run.then_some(&reference.ran).into_iter().chain(runs);
    let whole = json!({
        "scenario": scenario.name, "seed": scenario.seed, "identical": is_identical, "faults": scenario.fault.len(),
        "reference_run": reference.is_run.then_some(1), "reference": of(&reference.ran), "runs": all.map(of).collect::<Vec<_>>(),
        "difference": difference,
    });
    say!("{whole}");
}
