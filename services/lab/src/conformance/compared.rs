//! Runs in processes and on one thread, and the first place where the messages of two of them differ.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use chain::Sink;
use launcher::{End, Exit, Failure as Mishap, Plan};
use model::Robot;
use recorder::{Contents, RecordError, RecordReader, tick_of};
use runtime::{ControlPage, RunDir};
use serde::Serialize;
use session::{Failure, Observer};
use shared_types::job::Job;
use shared_types::layout::MessageLayout;
use shared_types::scenario::Scenario;
use shared_types::summary::{Summary, TopicSummary};
use shared_types::topics::{STEERED, TOPICS, Topic};

use super::difference::{Difference, first_difference_in};
use crate::signals::Background;
use crate::trial::Hashes;

/// The result of one run.
#[derive(Clone, Serialize)]
pub struct Ran {
    /// Condition of the run.
    pub condition: String,
    /// Ticks run.
    pub ticks: u64,
    /// Ticks per second of wall-clock time.
    pub ticks_per_s: f64,
    /// Why it did not come to its end; empty when it did.
    pub failure: String,
    /// Each topic by its name.
    pub topics: BTreeMap<String, TopicSummary>,
    /// The process that ended it before its time, and how.
    #[serde(skip)]
    pub(super) ended_by: Option<(String, Exit)>,
}

/// A run in processes, with all that its launcher knows.
pub(super) struct InProcesses {
    pub(super) ran: Ran,
    pub(super) summary: Summary,
    /// The process that makes the ticks.
    pub(super) source: String,
}

/// Runs a job; `beside` starts what goes on beside it, each time that all processes start.
pub(super) fn in_processes(
    job: &Job,
    plan: Plan,
    condition: String,
    beside: impl Fn(ControlPage) -> Vec<Background>,
    observer: Observer<'_>,
) -> Result<InProcesses, Failure> {
    let mut work = Vec::new();
    let source = plan.children.iter().find(|child| child.ends_run);
    let source = source.map_or_else(String::new, |child| child.process.name.clone());
    let mut begin = |run: &RunDir| {
        work.clear();
        work.extend(beside(ControlPage::open(run).map_err(Failure::work)?));
        Ok(())
    };
    let (outcome, account) = session::launch_begun(job, plan, &mut begin, observer)?;
    drop(work);
    let summary = session::summarise(job, &outcome, account);
    let (failure, ended_by) = match outcome.end {
        End::Completed => (String::new(), None),
        End::Interrupted { signal } => return Err(Failure::Work(format!("stopped by {signal}"))),
        End::Failed(mishap) => {
            let text = mishap.to_string();
            let by = if let Mishap::Died { process, exit, .. } = mishap {
                Some((process, exit))
            } else {
                None
            };
            (text, by)
        }
    };
    // Without an account there is no topic either, and that is a difference.
    let of = |layout: &MessageLayout| {
        let summary = summary.topics.get(&layout.topic).cloned();
        (layout.topic.clone(), summary.unwrap_or_default())
    };
    let ran = Ran {
        condition,
        ticks: outcome.ticks,
        ticks_per_s: summary.pace.ticks_per_s,
        failure,
        topics: Contents::of(job).layouts().iter().map(of).collect(),
        ended_by,
    };
    Ok(InProcesses {
        ran,
        summary,
        source,
    })
}

/// The record of a run.
pub(super) struct Kept {
    path: PathBuf,
    pub(super) contents: Contents,
}

/// The record that a run has left in its folder.
pub(super) fn record_of(folder: &Path, job: &Job) -> Result<Kept, Failure> {
    let kept = Kept {
        path: folder.join(recorder::MESSAGES),
        contents: Contents::of(job),
    };
    kept.read().map_err(Failure::work)?;
    Ok(kept)
}

impl Kept {
    /// Its messages from the beginning.
    pub(super) fn read(&self) -> Result<RecordReader, RecordError> {
        RecordReader::open(&self.path, &self.contents)
    }
}

/// What a scenario gives without processes, shared memory and a clock.
pub(super) fn on_one_thread(robot: &Robot, scenario: &Scenario) -> Result<Ran, Failure> {
    let (began, mut hashes) = (Instant::now(), Hashes::default());
    let ended = chain::run_under_faults(robot, scenario, &mut hashes).map_err(Failure::input)?;
    let ticks = hashes.0[0].count();
    let has = |topic: &str| scenario.servo.is_some() || !STEERED.contains(&topic);
    let topics = TOPICS.iter().zip(&hashes.0).filter(|(topic, _)| has(topic));
    Ok(Ran {
        condition: "one thread, no shared memory".to_owned(),
        ticks,
        ticks_per_s: ticks as f64 / began.elapsed().as_secs_f64().max(1e-9),
        failure: ended.unwrap_or_default(),
        topics: topics
            .map(|(topic, hash)| ((*topic).to_owned(), hash.summary()))
            .collect(),
        ended_by: None,
    })
}

/// The first place where two runs differ.
#[derive(Clone, Debug, Serialize)]
pub struct Place {
    /// Number of the run, from 1, where there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<usize>,
    /// Tick of the difference.
    pub tick: u64,
    /// Topic of the difference.
    pub topic: String,
    /// The field, or `the message` where one has it and the other has not; with the values of the reference and of the run.
    #[serde(flatten)]
    pub difference: Difference,
}

impl Place {
    pub(super) fn new(tick: u64, topic: &str, difference: Difference) -> Self {
        Self {
            run: None,
            tick,
            topic: topic.to_owned(),
            difference,
        }
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            run,
            tick,
            topic,
            difference:
                Difference {
                    field,
                    expected,
                    found,
                },
        } = self;
        if let Some(run) = run {
            write!(f, "run {run} ")?;
        }
        write!(
            f,
            "first differs at tick {tick}, topic {topic}, field {field}:\n{found} instead of {expected}"
        )
    }
}

/// What a run is compared with.
pub(super) enum Reference<'a> {
    OneThread(&'a Robot, &'a Scenario),
    /// The record of another run.
    Run(Kept),
}

/// Reads the messages of a run beside those of the reference up to the first difference: the earliest, and of one tick the first in the order of the
/// data, for it is the cause and the others follow from it.
pub(super) fn first_place(
    reference: &Reference<'_>,
    record: &Kept,
    run: usize,
) -> Result<Option<Place>, Failure> {
    let layouts = record.contents.layouts().iter().enumerate();
    let mut followed = layouts
        .map(|(channel, layout)| Followed::open(record, channel, layout.clone()))
        .collect::<Result<Vec<_>, _>>()
        .map_err(Failure::work)?;
    match reference {
        Reference::OneThread(robot, scenario) => {
            struct Follow<'a>(&'a mut [Followed]);
            impl Sink for Follow<'_> {
                fn take<M: Topic>(&mut self, message: &M) {
                    let one = self.0.iter_mut().find(|one| one.layout.topic == M::TOPIC);
                    if let Some(one) = one {
                        one.expect(bytemuck::bytes_of(message), message.header().tick);
                    }
                }
            }
            chain::run_under_faults(robot, scenario, &mut Follow(&mut followed))
                .map_err(Failure::input)?;
        }
        Reference::Run(expected) => {
            for one in &mut followed {
                let mut messages = expected.read().map_err(Failure::work)?;
                while let Some(message) = messages.next_of(one.channel) {
                    one.expect(message, tick_of(message));
                }
            }
        }
    }
    let first = followed
        .into_iter()
        .filter_map(Followed::end)
        .min_by_key(|place| place.tick);
    Ok(first.map(|place| Place {
        run: Some(run),
        ..place
    }))
}

/// A topic of a run, read beside the messages that are expected of it.
struct Followed {
    channel: usize,
    layout: MessageLayout,
    messages: RecordReader,
    next: Option<Vec<u8>>,
    first: Option<Place>,
}

impl Followed {
    fn open(record: &Kept, channel: usize, layout: MessageLayout) -> Result<Self, RecordError> {
        let mut messages = record.read()?;
        Ok(Self {
            next: messages.next_of(channel).map(<[u8]>::to_vec),
            channel,
            layout,
            messages,
            first: None,
        })
    }

    /// Takes the next message of the reference; either may lack what the other has.
    fn expect(&mut self, expected: &[u8], tick: u64) {
        if self.first.is_some() {
            return;
        }
        match &self.next {
            Some(message) if tick_of(message) < tick => {
                self.lacks(tick_of(message), ["none", "one"]);
            }
            Some(message) if tick_of(message) == tick => {
                let found = first_difference_in(&self.layout.fields, expected, message);
                self.first =
                    found.map(|difference| Place::new(tick, &self.layout.topic, difference));
                self.next = self.messages.next_of(self.channel).map(<[u8]>::to_vec);
            }
            _ => self.lacks(tick, ["one", "none"]),
        }
    }

    /// The first difference, when the reference has no more messages.
    fn end(mut self) -> Option<Place> {
        if let Some(row) = self.next.take().filter(|_| self.first.is_none()) {
            self.lacks(tick_of(&row), ["none", "one"]);
        }
        self.first
    }

    fn lacks(&mut self, tick: u64, [expected, found]: [&str; 2]) {
        let difference = Difference {
            field: "the message".to_owned(),
            expected: expected.to_owned(),
            found: found.to_owned(),
        };
        self.first = Some(Place::new(tick, &self.layout.topic, difference));
    }
}
