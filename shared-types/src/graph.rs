//! Which processes run, what each reads and writes, where, and what happens when one dies.
//!
//! A topic has one writer. Data flows one way; the one exception, the torque that closes the loop, is declared as `feedback`:
//! the plant consumes torque k to get from tick k to tick k + 1.

use serde::{Deserialize, Serialize};

use crate::file::{Complaint, InvalidFile};
use crate::topics::TOPICS;

/// A process graph.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Graph {
    /// The processes, in the order they are started.
    pub process: Vec<Process>,
}

/// One operating-system process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Process {
    /// Its name, which is also the subcommand of `armplane` that it runs.
    pub name: String,
    /// Topics it reads at the tick it works on.
    #[serde(default)]
    pub reads: Vec<String>,
    /// Topics it reads to get to the next tick.
    #[serde(default)]
    pub feedback: Vec<String>,
    /// Topics it alone writes.
    #[serde(default)]
    pub writes: Vec<String>,
    /// The core it is pinned to in real time; modulo the cores there are.
    #[serde(default)]
    pub core: usize,
    /// SCHED_FIFO priority in real time, 1 to 99; 0: ordinary scheduling.
    #[serde(default)]
    pub priority: u32,
    /// The launcher's response to its unrequested end.
    #[serde(default)]
    pub restart: Restart,
}

/// The launcher's response to the unrequested end of a process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Restart {
    /// Stop the whole graph.
    #[default]
    Never,
    /// Start it again, within the budget.
    Always,
}

/// A process that this version can run, with the topics it must have.
struct Known {
    name: &'static str,
    reads: &'static [&'static str],
    feedback: &'static [&'static str],
    writes: &'static [&'static str],
}

const KNOWN: [Known; 5] = [
    Known { name: "plant", reads: &[], feedback: &["torque"], writes: &["sensor", "plant_state"] },
    Known { name: "estimator", reads: &["sensor"], feedback: &[], writes: &["estimate"] },
    Known { name: "analyzer", reads: &["estimate"], feedback: &[], writes: &["singularity"] },
    Known { name: "controller", reads: &["estimate", "singularity"], feedback: &[], writes: &["control_state", "torque"] },
    Known { name: "recorder", reads: &TOPICS, feedback: &[], writes: &[] },
];

impl Graph {
    /// Reads and validates a graph.
    ///
    /// # Errors
    /// [`InvalidFile`]: unknown key, process or topic; two writers of one topic; a topic nobody writes; a cycle without `feedback`;
    /// a process without a topic it needs.
    pub fn parse(file: &str, text: &str) -> Result<Self, InvalidFile> {
        let graph: Self = crate::file::parse(file, text, &[])?;
        graph.check().map_err(|complaint| complaint.locate(file, text))?;
        Ok(graph)
    }

    /// The process of that name.
    #[must_use]
    pub fn process(&self, name: &str) -> Option<&Process> {
        self.process.iter().find(|process| process.name == name)
    }

    /// The writer of a topic.
    #[must_use]
    pub fn writer(&self, topic: &str) -> Option<&Process> {
        self.process.iter().find(|process| process.writes.iter().any(|name| name == topic))
    }

    /// The readers of a topic, feedback included.
    pub fn readers<'a>(&'a self, topic: &'a str) -> impl Iterator<Item = &'a Process> {
        self.process.iter().filter(move |process| process.reads.iter().chain(&process.feedback).any(|name| name == topic))
    }

    pub(crate) fn check(&self) -> Result<(), Complaint> {
        for (i, process) in self.process.iter().enumerate() {
            let at = |key: &str| format!("process.{i}.{key}");
            let Some(known) = KNOWN.iter().find(|known| known.name == process.name) else {
                let names: Vec<_> = KNOWN.iter().map(|known| known.name).collect();
                return Err(Complaint::new(
                    at("name"),
                    format!("there is no process `{}`", process.name),
                    format!("known: {}", names.join(", ")),
                ));
            };
            if self.process[..i].iter().any(|earlier| earlier.name == process.name) {
                return Err(Complaint::new(at("name"), format!("`{}` is listed twice", process.name), "one process of each name"));
            }
            for (key, topics, needed) in [
                ("reads", &process.reads, known.reads),
                ("feedback", &process.feedback, known.feedback),
                ("writes", &process.writes, known.writes),
            ] {
                for (j, topic) in topics.iter().enumerate() {
                    let place = format!("process.{i}.{key}.{j}");
                    if !TOPICS.contains(&topic.as_str()) {
                        return Err(Complaint::new(place, format!("there is no topic `{topic}`"), format!("known: {}", TOPICS.join(", "))));
                    }
                    if key == "writes"
                        && let Some(other) = self.process[..i].iter().find(|other| other.writes.contains(topic))
                    {
                        return Err(Complaint::new(
                            place,
                            format!("`{topic}` is already written by `{}`", other.name),
                            "a topic has one writer",
                        ));
                    }
                    if key != "writes" && self.writer(topic).is_none() {
                        return Err(Complaint::new(place, format!("nobody writes `{topic}`"), "add it to one process's `writes`"));
                    }
                }
                if let Some(missing) = needed.iter().find(|topic| !topics.iter().any(|name| name == *topic)) {
                    return Err(Complaint::new(
                        at("name"),
                        format!("`{}` needs `{missing}` in its `{key}`", process.name),
                        format!("{key} = [{}]", needed.iter().map(|topic| format!("{topic:?}")).collect::<Vec<_>>().join(", ")),
                    ));
                }
            }
            if process.priority > 99 {
                return Err(Complaint::new(
                    at("priority"),
                    format!("priority {} is out of range", process.priority),
                    "1 to 99, or 0 for ordinary scheduling",
                ));
            }
        }
        if let Some(Known { name, .. }) = KNOWN.iter().find(|known| self.process(known.name).is_none()) {
            return Err(Complaint::new(
                "process",
                format!("the graph has no `{name}`"),
                "every graph needs plant, estimator, analyzer, controller and recorder",
            ));
        }
        self.check_order()
    }

    /// Without feedback the graph must be acyclic: walk it, taking away processes whose inputs are all written by ones already taken.
    fn check_order(&self) -> Result<(), Complaint> {
        let mut taken: Vec<&str> = Vec::new();
        loop {
            let ready = self.process.iter().find(|process| {
                !taken.contains(&process.name.as_str())
                    && process.reads.iter().all(|topic| self.writer(topic).is_some_and(|writer| taken.contains(&writer.name.as_str())))
            });
            match ready {
                Some(process) => taken.push(&process.name),
                None if taken.len() == self.process.len() => return Ok(()),
                None => {
                    let i = self.process.iter().position(|process| !taken.contains(&process.name.as_str())).unwrap_or(0);
                    return Err(Complaint::new(
                        format!("process.{i}.reads"),
                        format!("`{}` waits for itself: its inputs depend on its own output of the same tick", self.process[i].name),
                        "move the topic that closes the loop to `feedback`",
                    ));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRAPH: &str = include_str!("../../services/graph.toml");

    #[test]
    fn the_default_graph_is_valid() {
        let graph = Graph::parse("graph.toml", GRAPH).unwrap();
        assert_eq!(graph.process.len(), 5);
        assert_eq!(graph.writer("torque").unwrap().name, "controller");
        assert_eq!(graph.readers("sensor").count(), 2);
    }

    #[test]
    fn each_wrong_graph_is_refused_with_its_line() {
        let cases: [(&str, &str, &str); 6] = [
            ("writes = [\"estimate\"]", "writes = [\"estimte\"]", "there is no topic `estimte`"),
            ("writes = [\"estimate\"]", "writes = [\"estimate\", \"sensor\"]", "already written by `plant`"),
            ("feedback = [\"torque\"]", "reads = [\"torque\"]", "needs `torque` in its `feedback`"),
            ("name = \"analyzer\"", "name = \"analyser\"", "there is no process `analyser`"),
            ("priority = 80", "priority = 180", "out of range"),
            ("reads = [\"sensor\"]", "reads = [\"sensor\", \"torque\"]", "waits for itself"),
        ];
        for (right, wrong, expected) in cases {
            assert!(GRAPH.contains(right), "{right}");
            let error = Graph::parse("graph.toml", &GRAPH.replacen(right, wrong, 1)).unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
            assert!(error.line().is_some(), "{error}");
        }
    }
}
