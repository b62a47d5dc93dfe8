//! A process graph as data, with everything that follows from it: writers, readers, layouts, the
//! order of the data.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::fault::{Kind, Target, corrupted_topic};
use crate::layout::{DeclaredTopic, MessageLayout};
use crate::process::{Process, Role};
use crate::topics::OfTopic;
use crate::wire::{Field, MAX_HOPS};

/// A process graph.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Graph {
    /// `"armplane"` adds these processes to the built-in graph, `"servo"` to that of a steered run.
    /// A process with a built-in name replaces the built-in one. Empty: the graph stands alone.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub extends: String,
    /// Folder in which the commands run. Default: the folder of the graph's file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folder: Option<PathBuf>,
    /// Topics for messages of your own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub topic: Vec<DeclaredTopic>,
    /// The processes, in the order in which they start.
    #[serde(default)]
    pub process: Vec<Process>,
}

impl Graph {
    /// The process of that name.
    #[must_use]
    pub fn process(&self, name: &str) -> Option<&Process> {
        self.process.iter().find(|process| process.name == name)
    }

    /// The process that makes the ticks.
    #[must_use]
    pub fn world(&self) -> Option<&Process> {
        self.process
            .iter()
            .find(|process| process.role() == Role::World)
    }

    /// The process that writes a topic.
    #[must_use]
    pub fn writer(&self, topic: &str) -> Option<&Process> {
        self.process
            .iter()
            .find(|process| process.writes.iter().any(|name| name == topic))
    }

    /// The processes that read a topic, feedback included.
    pub fn readers<'a>(&'a self, topic: &'a str) -> impl Iterator<Item = &'a Process> {
        self.process.iter().filter(move |process| {
            process
                .reads
                .iter()
                .chain(&process.feedback)
                .any(|name| name == topic)
        })
    }

    /// The layout of a topic's message: of one that this program knows, or one that the graph declares.
    #[must_use]
    pub fn layout(&self, topic: &str) -> Option<MessageLayout> {
        let declared = || {
            self.topic
                .iter()
                .find(|declared| declared.name == topic)
                .and_then(|declared| declared.layout().ok())
        };
        MessageLayout::named(topic).or_else(declared)
    }

    /// The messages that only this graph knows.
    pub fn own_messages(&self) -> impl Iterator<Item = MessageLayout> + '_ {
        self.topic
            .iter()
            .filter_map(|declared| declared.layout().ok())
    }

    /// Whether a fault of this kind can happen to a process: its part takes it, and to be corrupted it sends a number.
    #[must_use]
    pub fn takes(&self, kind: Kind, process: &Process) -> bool {
        let sends_number = || {
            self.target(&process.name)
                .is_some_and(|target| target.fields.iter().any(Field::is_number))
        };
        kind.suits(process) && (kind != Kind::Corrupt || sends_number())
    }

    /// The process that a fault happens to.
    #[must_use]
    pub fn target(&self, process: &str) -> Option<Target> {
        let index = self.process.iter().position(|one| one.name == process)?;
        let process = &self.process[index];
        let fields = corrupted_topic(&process.writes)
            .and_then(|topic| self.layout(topic))
            .map(|layout| layout.fields);
        Some(Target {
            index: u32::try_from(index).ok()?,
            role: process.role(),
            is_foreign: process.is_of_others() || !process.robot.is_empty(),
            fields: fields.unwrap_or_default(),
            reads: process
                .reads
                .iter()
                .chain(&process.feedback)
                .cloned()
                .collect(),
        })
    }

    /// The processes that stamp their messages, each at its place in [`Stamps`](crate::wire::Stamps): first the one that makes the ticks, then the
    /// others in the order of the data. Observers have no place; a graph with more processes than places is refused.
    #[must_use]
    pub fn hops(&self) -> Vec<&Process> {
        let stamping = |process: &&Process| process.role() != Role::Observer;
        self.in_order()
            .0
            .into_iter()
            .filter(stamping)
            .take(MAX_HOPS)
            .collect()
    }

    /// The way of a tick around the loop: from the process that makes it along the longest way of its data to the one whose message closes it.
    /// Each process with its place among the [`hops`](Self::hops).
    #[must_use]
    pub fn chain(&self) -> Vec<(usize, &Process)> {
        let hops = self.hops();
        // The way to each hop, by the last of the processes that it waits for.
        let mut ways: Vec<Vec<usize>> = Vec::with_capacity(hops.len());
        for (place, process) in hops.iter().enumerate() {
            let writes = |before: &usize| {
                hops[*before]
                    .writes
                    .iter()
                    .any(|topic| process.reads.contains(topic))
            };
            let longest = (0..place)
                .filter(writes)
                .map(|before| &ways[before])
                .max_by_key(|way| way.len());
            let mut way = longest.cloned().unwrap_or_default();
            way.push(place);
            ways.push(way);
        }
        let closes = |process: &&Process| {
            self.world().is_some_and(|world| {
                process
                    .writes
                    .iter()
                    .any(|topic| world.feedback.contains(topic))
            })
        };
        let last = hops.iter().position(closes);
        last.map(|last| {
            ways[last]
                .iter()
                .map(|&place| (place, hops[place]))
                .collect()
        })
        .unwrap_or_default()
    }

    /// The processes so that each comes after those whose messages of the same tick it reads, and those that wait for themselves.
    pub(super) fn in_order(&self) -> (Vec<&Process>, Vec<&Process>) {
        let (mut taken, mut left): (Vec<&Process>, Vec<&Process>) = self
            .process
            .iter()
            .partition(|process| process.role() == Role::World);
        loop {
            let is_there =
                |topic: &String| taken.iter().any(|process| process.writes.contains(topic));
            let Some(place) = left
                .iter()
                .position(|process| process.reads.iter().all(is_there))
            else {
                return (taken, left);
            };
            taken.push(left.remove(place));
        }
    }
}
