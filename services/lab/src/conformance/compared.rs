//! Runs in processes and on one thread, and the first place where the messages of two of them differ.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Instant;

use launcher::{Exit, Failure as Mishap, Plan};
use model::Robot;
use recorder::{Contents, RecordError, RecordReader, RecordWriter, TopicHash, tick_of};
use runtime::{ControlPage, RunDir};
use serde::Serialize;
use session::Failure;
use shared_types::job::Job;
use shared_types::layout::MessageLayout;
use shared_types::scenario::Scenario;
use shared_types::summary::{Summary, TopicSummary};
use shared_types::topics::{COUNT, TOPICS};

use super::difference::{Difference, Differences};
use crate::end::mishap;
use crate::signals::Background;

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
    /// Its deaths that no plan had, in words.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub deaths: Vec<String>,
    /// Each topic by its name.
    pub topics: BTreeMap<String, TopicSummary>,
    /// The process that ended it before its time, and how.
    #[serde(skip)]
    pub(super) ended_by: Option<(String, Exit)>,
}

/// Runs a job; `beside` starts what goes on beside it, each time that all processes start.
pub(super) fn in_processes(
    job: &Job,
    plan: Plan,
    condition: String,
    mut beside: impl FnMut(ControlPage) -> Vec<Background>,
) -> Result<(Ran, Summary), Failure> {
    let mut work = Vec::new();
    let mut begin = |run: &RunDir| {
        work.clear();
        work.extend(beside(ControlPage::open(run).map_err(Failure::work)?));
        Ok(())
    };
    let (outcome, account) = session::launch_watched(job, plan, &mut begin, &mut |_| ())?;
    drop(work);
    let summary = session::summarise(job, &outcome, account);
    let mishap = mishap(&outcome.end)?;
    let ended_by = match mishap {
        Some(Mishap::Died { process, exit, .. }) => Some((process.clone(), *exit)),
        _ => None,
    };
    // Without an account there is no topic either, and that is a difference.
    let of = |layout: &MessageLayout| {
        let summary = summary.topics.get(&layout.topic).cloned();
        (layout.topic.clone(), summary.unwrap_or_default())
    };
    let deaths = summary.faults.iter();
    let deaths = deaths.filter(|fault| fault.origin == "detected");
    let ran = Ran {
        condition,
        ticks: outcome.ticks,
        ticks_per_s: summary.pace.ticks_per_s,
        failure: mishap.map(ToString::to_string).unwrap_or_default(),
        deaths: deaths.map(|fault| fault.detail.clone()).collect(),
        topics: Contents::of(job).layouts().iter().map(of).collect(),
        ended_by,
    };
    Ok((ran, summary))
}

/// The result of a scenario without processes, shared memory and a clock.
pub(super) fn on_one_thread(robot: &Robot, scenario: &Scenario) -> Result<Ran, Failure> {
    let (began, mut hashes) = (Instant::now(), [TopicHash::default(); COUNT]);
    let mut add = |topic: usize, message: &[u8]| hashes[topic].add(message);
    let ended = chain::run_under_faults(robot, scenario, None, &mut add).map_err(Failure::input)?;
    let ticks = hashes[0].count();
    let topics = TOPICS.iter().zip(&hashes);
    let topics = topics.filter(|(topic, _)| scenario.sends(topic));
    Ok(Ran {
        condition: "one thread, no shared memory".to_owned(),
        ticks,
        ticks_per_s: ticks as f64 / began.elapsed().as_secs_f64().max(1e-9),
        failure: ended.unwrap_or_default(),
        topics: topics
            .map(|(topic, hash)| ((*topic).to_owned(), hash.summary()))
            .collect(),
        deaths: Vec::new(),
        ended_by: None,
    })
}

/// The topics of which two runs have other messages.
pub(super) fn differing([a, b]: [&BTreeMap<String, TopicSummary>; 2]) -> Vec<String> {
    let topics: BTreeSet<_> = a.keys().chain(b.keys()).collect();
    let topics = topics
        .into_iter()
        .filter(|topic| a.get(*topic) != b.get(*topic));
    topics.cloned().collect()
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

/// The record that a job's run on one thread would leave, as a file in a folder.
pub(super) fn record_on_one_thread(
    folder: &Path,
    job: &Job,
    robot: &Robot,
) -> Result<Kept, Failure> {
    let kept = Kept {
        path: folder.join("one-thread.mcap"),
        contents: Contents::of(job),
    };
    let mut writer = RecordWriter::create(&kept.path, &kept.contents).map_err(Failure::work)?;
    let mut written = Ok(());
    let mut keep = |topic: usize, message: &[u8]| {
        let channel = kept.contents.channel(TOPICS[topic]);
        if let (Some(channel), Ok(())) = (channel, &written) {
            written = writer.append(channel, message);
        }
    };
    chain::run_under_faults(robot, &job.scenario, None, &mut keep).map_err(Failure::input)?;
    let finished = written.and_then(|()| writer.finish());
    finished.map_err(Failure::work)?;
    Ok(kept)
}

impl Kept {
    /// Its messages from the beginning.
    fn read(&self) -> Result<RecordReader, RecordError> {
        RecordReader::open(&self.path, &self.contents)
    }
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

/// The topics that differ between two runs, each with its first place. The first of all is the earliest, and of one tick the first in the order of the data,
/// for it is the cause and the others follow from it.
pub(super) fn places(expected: &Kept, found: &Kept) -> Result<Vec<Place>, Failure> {
    let mut places = Vec::new();
    for (channel, layout) in found.contents.layouts().iter().enumerate() {
        let [expected, found] = [expected, found].map(|kept| kept.read().map_err(Failure::work));
        places.extend(first_of(layout, channel, expected?, found?));
    }
    places.sort_by_key(|place| place.tick);
    Ok(places)
}

/// The first difference of a topic; either run may lack what the other has.
fn first_of(
    layout: &MessageLayout,
    channel: usize,
    mut expected: RecordReader,
    mut found: RecordReader,
) -> Option<Place> {
    let lacks = |tick: u64, values: [&str; 2]| {
        let [expected, found] = values.map(str::to_owned);
        let difference = Difference {
            field: "the message".to_owned(),
            expected,
            found,
        };
        Some(Place::new(tick, &layout.topic, difference))
    };
    let mut differences = Differences::new(&layout.fields);
    loop {
        let (one, other) = (expected.next_of(channel), found.next_of(channel));
        let ticks = [one, other].map(|message| message.map_or(u64::MAX, tick_of));
        match (one, other) {
            (None, None) => return None,
            (Some(one), Some(other)) if ticks[0] == ticks[1] => {
                differences.add(ticks[0], one, other);
                if let Some((tick, difference)) = differences.first.take() {
                    return Some(Place::new(tick, &layout.topic, difference));
                }
            }
            _ if ticks[0] < ticks[1] => return lacks(ticks[0], ["one", "none"]),
            _ => return lacks(ticks[1], ["none", "one"]),
        }
    }
}
