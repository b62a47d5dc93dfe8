//! The message logs of one run, as a whole.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use shared_types::job::Job;
use shared_types::topics::TOPICS;

/// The logs of a run: which run, which topics, and how many messages each log holds. Every block of a log states these numbers of all of them, so that a
/// log that lacks its end is told by the others.
#[derive(Clone, Debug)]
pub struct Logs(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    run: u64,
    topics: Vec<String>,
    written: Vec<AtomicU64>,
}

impl Logs {
    /// Of the run with an identity, with a log for each topic.
    #[must_use]
    pub fn new(run: u64, topics: impl IntoIterator<Item = impl Into<String>>) -> Self {
        let topics: Vec<String> = topics.into_iter().map(Into::into).collect();
        let written = topics.iter().map(|_| AtomicU64::new(0)).collect();
        Self(Arc::new(Inner {
            run,
            topics,
            written,
        }))
    }

    /// Of a job's run: the topics that its graph writes, those that only the graph knows behind the others.
    #[must_use]
    pub fn of(job: &Job) -> Self {
        let known = TOPICS
            .into_iter()
            .filter(|topic| job.graph.writer(topic).is_some())
            .map(str::to_owned);
        Self::new(
            job.id,
            known.chain(job.graph.own_messages().map(|layout| layout.topic)),
        )
    }

    /// The identity of the run.
    #[must_use]
    pub fn run(&self) -> u64 {
        self.0.run
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.topics.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.topics.is_empty()
    }

    /// The place of a topic's log among them.
    #[must_use]
    pub fn place(&self, topic: &str) -> Option<usize> {
        self.0.topics.iter().position(|one| one == topic)
    }

    /// How many messages each log holds, in their order.
    pub(crate) fn written(&self) -> impl Iterator<Item = u64> + '_ {
        self.0.written.iter().map(|one| one.load(Ordering::Relaxed))
    }

    pub(crate) fn set_written(&self, place: usize, messages: u64) {
        self.0
            .written
            .iter()
            .skip(place)
            .take(1)
            .for_each(|one| one.store(messages, Ordering::Relaxed));
    }
}
