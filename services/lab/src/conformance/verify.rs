//! The same scenario under different conditions, compared byte by byte.

use std::path::{Path, PathBuf};
use std::time::Instant;

use chain::{Sink, Tick};
use launcher::{End, Exit, Failure as Mishap};
use message_log::{
    Difference, LogError, LogReader, LogWriter, Logs, RowReader, Shape, TopicHash,
    first_difference, first_difference_in, tick_of,
};
use model::Robot;
use runtime::{ControlPage, RunDir, random};
use session::{Failure, Observer, load};
use shared_types::Message;
use shared_types::graph::Graph;
use shared_types::job::{Job, Mode};
use shared_types::layout::MessageLayout;
use shared_types::scenario::Scenario;
use shared_types::summary::TopicSummary;
use shared_types::topics::{self, Build, ByTopic, COUNT, Each, Family, STEERED, TOPICS, Topic};

use super::condition::{CONDITIONS, Condition};
use super::stops::Stops;
use crate::cpu_load::CpuLoad;
use crate::folder::Folder;

/// The result of one run.
pub struct Ran {
    /// Condition of the run.
    pub condition: String,
    /// Ticks run.
    pub ticks: u64,
    /// Ticks per second of wall-clock time.
    pub ticks_per_s: f64,
    /// Each topic by its name: those of [`TOPICS`] in their order, then those that only the graph knows.
    pub topics: Vec<(String, TopicSummary)>,
    /// Why it did not come to its end; empty when it did.
    pub failure: String,
    /// The process that ended it before its time, and how.
    pub ended_by: Option<(String, Exit)>,
}

/// The reference of the comparison.
pub struct Reference {
    /// Result of the run.
    pub ran: Ran,
    /// Where its messages are; nowhere before they are needed.
    pub messages: Option<PathBuf>,
    /// Whether it is the first of the runs: one thread cannot have the death of the plant, a fault of the recorder, or a program of the graph's own.
    pub is_run: bool,
}

impl Reference {
    /// Whether a run gave the same bytes and ended the same way.
    fn is_like(&self, ran: &Ran) -> bool {
        let is_same_end = !self.is_run || ran.ended_by == self.ran.ended_by;
        ran.topics == self.ran.topics
            && is_same_end
            && ran.failure.is_empty() == self.ran.failure.is_empty()
    }

    /// A planned fault may be the end of every run (the death of the plant is, and one death more than the budget); nothing else may.
    fn is_sound(&self) -> bool {
        self.ran.failure.is_empty() || !self.is_run || self.ran.ended_by.is_some()
    }
}

/// The first place where a run is not the reference.
pub struct Place {
    /// Number of the run.
    pub run: usize,
    /// Tick of the difference.
    pub tick: u64,
    /// Topic of the difference.
    pub topic: String,
    /// The difference.
    pub difference: Difference,
}

/// A difference between runs, and all runs.
pub struct Verified {
    /// The reference of the comparison.
    pub reference: Reference,
    /// The runs, without the reference where that is one of them.
    pub runs: Vec<Ran>,
    /// Where they first differ.
    pub place: Option<Place>,
    /// Whether all runs gave the same bytes and ended the same way.
    pub is_identical: bool,
}

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
    /// Where the messages and recordings stay; `None` removes them.
    pub out: Option<&'a Path>,
    /// Lets the plant take the torque of the tick before where the right one is late.
    pub unordered: bool,
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
    } = request;
    chain::try_first_tick(robot, scenario)
        .map_err(|error| Failure::Input(format!("{name}: {error}")))?;
    let has_programs = graph
        .process
        .iter()
        .any(|process| process.program().is_none());
    let has_own_graph =
        || chain::graph(scenario).map_or(true, |built_in| built_in.process != graph.process);
    let needs_processes = has_programs
        || !scenario.fault.is_empty()
            && (has_own_graph() || chain::planned_faults(scenario).is_err());
    if needs_processes && request.runs < 2 {
        let reason = if has_programs {
            "runs in programs of its graph"
        } else {
            "plans faults of its plant, its recorder or its graph"
        };
        let sentence = format!(
            "{reason}, which one thread cannot have: its runs are compared with each other, so take at least --runs 2"
        );
        return Err(Failure::Input(format!("{} {sentence}", scenario.name)));
    }
    let folder = Folder::create(request.out)?;
    let one_thread = || {
        on_one_thread(robot, scenario, None).map(|ran| Reference {
            ran,
            messages: None,
            is_run: false,
        })
    };
    let mut reference = if needs_processes {
        None
    } else {
        Some(one_thread()?)
    };
    let (mut runs, mut place) = (Vec::new(), None);
    for index in 0..request.runs as usize {
        let condition = CONDITIONS[index % CONDITIONS.len()];
        let out = folder.path().join(format!("run-{}", index + 1));
        std::fs::create_dir_all(&out)
            .map_err(|error| Failure::Work(format!("cannot make {}: {error}", out.display())))?;
        let job = load::job(
            robot,
            (*scenario).clone(),
            (*graph).clone(),
            Mode::Lockstep,
            out,
        );
        let job = Job {
            record: condition.record,
            ..job
        };
        let ran = in_processes(
            &job,
            condition,
            random(scenario.seed, index as u64),
            request.unordered,
            observer,
        )?;
        let messages = job.out.join(recorder::MESSAGES);
        let Some(reference) = &mut reference else {
            reference = Some(Reference {
                ran,
                messages: Some(messages),
                is_run: true,
            });
            continue;
        };
        if ran.topics != reference.ran.topics && place.is_none() {
            let expected = match &reference.messages {
                Some(messages) => messages,
                None => {
                    let messages = folder.path().join("one-thread");
                    on_one_thread(robot, scenario, Some(&messages))?;
                    reference.messages.insert(messages)
                }
            };
            place = first_place(graph, expected, &messages, index)?;
        }
        if request.out.is_none() {
            // The rest is removed with the whole folder.
            let _ = std::fs::remove_dir_all(&job.out);
        }
        runs.push(ran);
    }
    // There is at least one run.
    let Some(reference) = reference else {
        return Err(Failure::work("nothing was run"));
    };
    let is_identical = reference.is_sound() && runs.iter().all(|ran| reference.is_like(ran));
    Ok(Verified {
        reference,
        runs,
        place,
        is_identical,
    })
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

impl<M: Message> Tap<M> {
    fn add(&mut self, message: &M) -> Result<(), LogError> {
        self.hash.add(message);
        self.keep.as_mut().map_or(Ok(()), |keep| keep.add(message))
    }
}

impl Topics {
    fn create(folder: Option<&Path>) -> Result<Self, LogError> {
        struct Create<'a>(Option<&'a Path>, Logs);
        impl Build<Taps> for Create<'_> {
            type Error = LogError;
            fn build<M: Topic>(&mut self) -> Result<Tap<M>, LogError> {
                Ok(Tap {
                    hash: TopicHash::default(),
                    keep: self
                        .0
                        .map(|folder| LogWriter::create(folder, &self.1))
                        .transpose()?,
                })
            }
        }
        ByTopic::try_build(&mut Create(folder, Logs::new(0, TOPICS))).map(Self)
    }

    fn add(&mut self, tick: &Tick) -> Result<(), LogError> {
        struct Add<'a>(&'a mut ByTopic<Taps>, &'a Tick);
        impl Each for Add<'_> {
            type Output = Result<(), LogError>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                M::of_mut(self.0).add(M::of(self.1))
            }
        }
        topics::try_each(&mut Add(&mut self.0, tick))
    }

    /// Adds what the chain sends in a scenario that plans faults; the sentence: why it ended before its task did.
    fn add_under_faults(
        &mut self,
        robot: &Robot,
        scenario: &Scenario,
    ) -> Result<Option<String>, Failure> {
        struct Add<'a>(&'a mut ByTopic<Taps>, Result<(), LogError>);
        impl Sink for Add<'_> {
            fn take<M: Topic>(&mut self, message: &M) {
                if self.1.is_ok() {
                    self.1 = M::of_mut(self.0).add(message);
                }
            }
        }
        let mut add = Add(&mut self.0, Ok(()));
        let ended = chain::run_under_faults(robot, scenario, &mut add).map_err(Failure::input)?;
        add.1.map_err(Failure::work).map(|()| ended)
    }

    /// In the order of [`TOPICS`].
    fn finish(mut self) -> Result<[TopicSummary; COUNT], LogError> {
        struct Finish<'a>(&'a mut ByTopic<Taps>);
        impl Each for Finish<'_> {
            type Output = Result<(), LogError>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                M::of_mut(self.0)
                    .keep
                    .as_mut()
                    .map_or(Ok(()), LogWriter::flush)
            }
        }
        struct Account<'a>(&'a ByTopic<Taps>);
        impl Each for Account<'_> {
            type Output = TopicSummary;
            fn each<M: Topic>(&mut self) -> TopicSummary {
                let hash = &M::of(self.0).hash;
                hash.summary()
            }
        }
        topics::try_each(&mut Finish(&mut self.0))?;
        Ok(topics::each(&mut Account(&self.0)))
    }
}

/// The reference of a scenario: no process, no shared memory, no clock.
fn on_one_thread(
    robot: &Robot,
    scenario: &Scenario,
    messages: Option<&Path>,
) -> Result<Ran, Failure> {
    let began = Instant::now();
    let mut topics = Topics::create(messages).map_err(Failure::work)?;
    let mut kept = Ok(());
    let ended = if chain::plans_faults_of_processes(scenario) {
        topics.add_under_faults(robot, scenario)?
    } else {
        let add = |tick: &Tick| {
            kept = std::mem::replace(&mut kept, Ok(())).and_then(|()| topics.add(tick))
        };
        chain::run(robot, scenario, add).map_err(Failure::input)?;
        None
    };
    let topics = kept.and_then(|()| topics.finish()).map_err(Failure::work)?;
    let ticks = topics[0].count;
    let has = |topic: &str| scenario.servo.is_some() || !STEERED.contains(&topic);
    let topics = TOPICS
        .into_iter()
        .zip(topics)
        .filter(|(topic, _)| has(topic))
        .map(|(topic, summary)| (topic.to_owned(), summary))
        .collect();
    let ticks_per_s = ticks as f64 / began.elapsed().as_secs_f64().max(1e-9);
    let condition = "one thread, no shared memory".to_owned();
    Ok(Ran {
        condition,
        ticks,
        ticks_per_s,
        topics,
        failure: ended.unwrap_or_default(),
        ended_by: None,
    })
}

fn in_processes(
    job: &Job,
    condition: Condition,
    seed: u64,
    unordered: bool,
    observer: Observer<'_>,
) -> Result<Ran, Failure> {
    let mut plan = session::plan(job)?;
    condition.disturb(&mut plan, seed, unordered);
    let load = condition.cpu_load.then(CpuLoad::start);
    let (count, mut stops) = (plan.children.len(), None);
    let mut begin = |run: &RunDir| {
        let control_page = ControlPage::open(run).map_err(Failure::work)?;
        stops = condition
            .stops
            .then(|| Stops::start(control_page, count, seed));
        Ok(())
    };
    let (outcome, account) = session::launch_begun(job, plan, &mut begin, observer)?;
    drop((load, stops));
    let (failure, ended_by) = match outcome.end {
        End::Completed => (String::new(), None),
        End::Interrupted { signal } => return Err(Failure::Work(format!("stopped by {signal}"))),
        End::Failed(mishap) => (mishap.to_string(), ended_by(mishap)),
    };
    // Without an account there is no topic either, and that is a difference.
    let mut account = account.unwrap_or_default();
    let own = job.graph.own_messages().map(|layout| layout.topic);
    let names = TOPICS
        .into_iter()
        .filter(|topic| job.graph.writer(topic).is_some())
        .map(str::to_owned)
        .chain(own);
    let topics = names
        .map(|topic| (account.topics.remove(&topic).unwrap_or_default(), topic))
        .map(|(summary, topic)| (topic, summary))
        .collect();
    Ok(Ran {
        condition: condition.to_string(),
        ticks: outcome.ticks,
        ticks_per_s: account.ticks_per_s,
        topics,
        failure,
        ended_by,
    })
}

fn ended_by(mishap: Mishap) -> Option<(String, Exit)> {
    match mishap {
        Mishap::Died { process, exit, .. } => Some((process, exit)),
        Mishap::NoRoom { .. } | Mishap::Slow { .. } | Mishap::DidNotStop { .. } => None,
    }
}

/// Reads what two runs kept, side by side, up to the first difference.
pub(super) fn first_place(
    graph: &Graph,
    reference: &Path,
    messages: &Path,
    run: usize,
) -> Result<Option<Place>, Failure> {
    struct First<'a>(&'a Graph, &'a Path, &'a Path);
    impl Each for First<'_> {
        type Output = Result<Option<(u64, Difference)>, Failure>;
        fn each<M: Topic>(&mut self) -> Self::Output {
            if self.0.writer(M::TOPIC).is_some() {
                first_in::<M>(self.1, self.2)
            } else {
                Ok(None)
            }
        }
    }
    let differences = topics::each(&mut First(graph, reference, messages))
        .into_iter()
        .collect::<Result<Vec<_>, _>>()?;
    // The earliest; of one tick the first in the order of the data: it is the cause, the others follow from it.
    let listed = TOPICS.into_iter().map(str::to_owned).zip(differences);
    let own = graph.own_messages().map(|layout| {
        Ok((
            layout.topic.clone(),
            first_in_own(&layout, reference, messages)?,
        ))
    });
    let own = own.collect::<Result<Vec<_>, Failure>>()?;
    let found = listed
        .chain(own)
        .filter_map(|(topic, difference)| Some((topic, difference?)));
    let first = found.min_by_key(|(_, (tick, _))| *tick);
    Ok(first.map(|(topic, (tick, difference))| Place {
        run,
        tick,
        topic,
        difference,
    }))
}

/// Where two series of kept messages of one topic first differ: the tick, and in what. Either may lack what the other has.
fn first_in<M: Message>(
    reference: &Path,
    messages: &Path,
) -> Result<Option<(u64, Difference)>, Failure> {
    let (mut expected, mut found) = (
        LogReader::<M>::open(reference).map_err(Failure::work)?,
        LogReader::<M>::open(messages).map_err(Failure::work)?,
    );
    first_of(
        || expected.next_message(),
        || found.next_message(),
        |message: &M| message.header().tick,
        first_difference,
    )
}

/// The same for a topic that only the graph knows.
fn first_in_own(
    layout: &MessageLayout,
    reference: &Path,
    messages: &Path,
) -> Result<Option<(u64, Difference)>, Failure> {
    let shape = Shape::from(layout);
    let open = |folder: &Path| RowReader::open(folder, &shape).map_err(Failure::work);
    let (mut expected, mut found) = (open(reference)?, open(messages)?);
    let tick = |row: &Vec<u64>| tick_of(row);
    let differ = |expected: &Vec<u64>, found: &Vec<u64>| {
        first_difference_in(
            &layout.fields,
            bytemuck::cast_slice(expected),
            bytemuck::cast_slice(found),
        )
    };
    first_of(|| expected.next_row(), || found.next_row(), tick, differ)
}

fn first_of<T>(
    mut expected: impl FnMut() -> Result<Option<T>, LogError>,
    mut found: impl FnMut() -> Result<Option<T>, LogError>,
    tick: impl Fn(&T) -> u64,
    differ: impl Fn(&T, &T) -> Option<Difference>,
) -> Result<Option<(u64, Difference)>, Failure> {
    let whole = |expected: &str, found: &str| Difference {
        field: "the message".to_owned(),
        expected: expected.into(),
        found: found.into(),
    };
    loop {
        let pair = (
            expected().map_err(Failure::work)?,
            found().map_err(Failure::work)?,
        );
        return Ok(match pair {
            (None, None) => None,
            (Some(expected), None) => Some((tick(&expected), whole("one", "none"))),
            (None, Some(found)) => Some((tick(&found), whole("none", "one"))),
            (Some(expected), Some(found)) if tick(&expected) < tick(&found) => {
                Some((tick(&expected), whole("one", "none")))
            }
            (Some(expected), Some(found)) if tick(&expected) > tick(&found) => {
                Some((tick(&found), whole("none", "one")))
            }
            (Some(expected), Some(found)) => match differ(&expected, &found) {
                Some(difference) => Some((tick(&expected), difference)),
                None => continue,
            },
        });
    }
}
