//! The processes of a run: the topics of each, its core, and the response to its end.
//!
//! A topic has one writer. Data flows one way, except for the torque, which closes the loop and is
//! declared as `feedback`: the process that makes the ticks uses torque k to get from tick k to
//! tick k + 1.
//!
//! ```toml
//! extends = "armplane"          # all processes of the built-in graph; one with the name of another takes its place
//!                               # "servo": the same with an operator that publishes targets; "force": with a sensor at the wrist
//!
//! [[topic]]                     # a message that only this graph knows
//! name = "energy"
//! type = "armplane.Energy.v1"
//! fields = ["header: Header", "kinetic_j: f64"]
//!
//! [[process]]
//! name = "energy"
//! command = ["./energy"]
//! reads = ["estimate"]
//! writes = ["energy"]
//! restart = "always"
//! ```

mod built_in;
mod check;
mod topology;

use crate::file::{Complaint, InvalidFile};
use crate::scenario::Scenario;
use crate::topics::TOPICS;

pub use crate::process::{MAX_PROCESSES, Process, Program, Restart, Role};
pub use built_in::{BUILT_IN, PRESSING, STEERED, STEERED_PRESSING};
pub use topology::Graph;

use built_in::{EVERYTHING, NAMED};

impl Graph {
    /// The built-in graph, of a steered run with an operator.
    ///
    /// # Errors
    /// See [`Graph::parse`].
    pub fn built_in(is_steered: bool) -> Result<Self, InvalidFile> {
        Self::parse("graph.toml", if is_steered { STEERED } else { BUILT_IN })
    }

    /// The built-in graph for a scenario: with an operator where it is steered, with a sensor at the wrist where it controls a force by one.
    ///
    /// # Errors
    /// See [`Graph::parse`].
    pub fn of(scenario: &Scenario) -> Result<Self, InvalidFile> {
        let is_steered = scenario.servo.is_some();
        match (scenario.has_wrist_sensor(), is_steered) {
            (true, true) => Self::parse("graph.toml", STEERED_PRESSING),
            (true, false) => Self::parse("graph.toml", PRESSING),
            _ => Self::built_in(is_steered),
        }
    }

    /// Reads and validates a graph.
    ///
    /// # Errors
    /// [`InvalidFile`]: unknown key, process or topic; two writers of one topic; a topic that no process writes; a cycle without `feedback`;
    /// no process that makes the ticks; a process of ours without a topic it needs; a message with padding.
    pub fn parse(file: &str, text: &str) -> Result<Self, InvalidFile> {
        let mut graph: Self = crate::file::parse(file, text, &[])?;
        let mut before = 0;
        while !graph.extends.is_empty() {
            let known = NAMED.iter().find(|(name, _)| *name == graph.extends);
            let (_, base) = known.ok_or_else(|| {
                let message = format!("there is no graph `{}` to extend", graph.extends);
                let [a, b, c, d] = NAMED.map(|(name, _)| name);
                let remedy = format!("extends = \"{a}\", \"{b}\", \"{c}\" or \"{d}\"");
                Complaint::new("extends", message, remedy).locate(file, text)
            })?;
            before += graph.extend(base)?;
        }
        graph.read_everything();
        let located = |complaint: Complaint| {
            Complaint {
                path: place_in_file(&complaint.path, before),
                ..complaint
            }
            .locate(file, text)
        };
        graph.check().map_err(located)?;
        Ok(graph)
    }

    /// Inserts the processes of a built-in graph before its own, except those with a name of its
    /// own. Returns their number.
    fn extend(&mut self, text: &str) -> Result<usize, InvalidFile> {
        let mut base: Self = crate::file::parse("graph.toml", text, &[])?;
        base.process
            .retain(|process| self.process(&process.name).is_none());
        let before = base.process.len();
        base.process.append(&mut self.process);
        self.process = base.process;
        self.extends = base.extends;
        Ok(before)
    }

    /// Replaces `*` among the topics read.
    fn read_everything(&mut self) {
        let declared = self.topic.iter().map(|topic| &*topic.name);
        let all = TOPICS.into_iter().chain(declared);
        let written: Vec<String> = all
            .filter(|topic| self.writer(topic).is_some())
            .map(str::to_owned)
            .collect();
        for process in &mut self.process {
            if process.reads.iter().any(|topic| topic == EVERYTHING) {
                let of_others = |topic: &&String| !process.writes.contains(topic);
                process.reads = written.iter().filter(of_others).cloned().collect();
            }
        }
    }
}

/// A path in a graph that `before` processes were put before, as a path in its file.
fn place_in_file(path: &str, before: usize) -> String {
    let mut keys = path.splitn(3, '.');
    let (Some("process"), Some(Ok(index))) = (keys.next(), keys.next().map(str::parse::<usize>))
    else {
        return path.to_owned();
    };
    // A process that the file does not have: the file is wrong in that it extends the graph.
    index.checked_sub(before).map_or_else(
        || "extends".to_owned(),
        |index| format!("process.{index}.{}", keys.next().unwrap_or_default()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topics::{PRESSING as PRESSED, STEERED as TARGETS};

    fn names<'a>(processes: impl IntoIterator<Item = &'a Process>) -> Vec<&'a str> {
        processes
            .into_iter()
            .map(|process| process.name.as_str())
            .collect()
    }

    const ENERGY: &str = "extends = \"armplane\"\n[[topic]]\nname = \"energy\"\ntype = \"armplane.Energy.v1\"\nfields = [\"header: Header\", \
                          \"kinetic_j: f64\"]\n[[process]]\nname = \"energy\"\ncommand = [\"./energy\"]\nreads = [\"estimate\"]\nwrites = [\"energy\"]\n";

    fn parse(text: &str) -> Graph {
        Graph::parse("graph.toml", text).unwrap()
    }

    #[test]
    fn the_built_in_graphs_have_every_program_and_every_topic() {
        let graph = parse(BUILT_IN);
        assert_eq!(names(&graph.process), Program::ALL.map(Program::name));
        assert!(
            graph
                .process
                .iter()
                .all(|process| process.program().is_some())
        );
        // `*` is every topic that is written.
        let all = || TOPICS.into_iter().filter(|topic| *topic != PRESSED);
        let always = all().filter(|topic| !TARGETS.contains(topic));
        assert!(always.eq(&graph.process("recorder").unwrap().reads));
        let [world, torque] = [graph.world(), graph.writer("torque")].map(Option::unwrap);
        assert_eq!(names([world, torque]), ["plant", "controller"]);
        let hops = ["plant", "estimator", "analyzer", "controller"];
        assert_eq!(
            (names(graph.hops()), names(in_chain(&graph))),
            (hops.to_vec(), hops.to_vec())
        );
        // A steered run has an operator before its controller.
        let steered = parse(STEERED);
        let hops = ["plant", "estimator", "analyzer", "operator", "controller"];
        assert_eq!(names(steered.hops()), hops);
        assert!(all().eq(&steered.process("recorder").unwrap().reads));
        // One that controls a force has a sensor at the wrist, and no target.
        let pressing = parse(PRESSING);
        let plain = ["plant", "estimator", "analyzer", "controller"];
        assert_eq!(names(pressing.hops()), plain);
        assert!(pressing.writer(PRESSED).is_some() && pressing.writer("target").is_none());
        // A steered one that may press has both.
        let both = parse(STEERED_PRESSING);
        assert_eq!(names(both.hops()), hops);
        assert_eq!(both.process("recorder").unwrap().reads, TOPICS);
    }

    fn in_chain(graph: &Graph) -> Vec<&Process> {
        graph
            .chain()
            .into_iter()
            .map(|(_, process)| process)
            .collect()
    }

    #[test]
    fn a_graph_that_extends_adds_and_replaces() {
        let graph = parse(ENERGY);
        let all = [
            "plant",
            "estimator",
            "analyzer",
            "controller",
            "recorder",
            "energy",
        ];
        assert_eq!(names(&graph.process), all);
        // The recorder reads what is added, and the loop does not wait for it.
        assert_eq!(
            graph.process("recorder").unwrap().reads.last().unwrap(),
            "energy"
        );
        assert_eq!((graph.hops().len(), graph.chain().len()), (5, 4));
        let bytes = |topic| graph.layout(topic).unwrap().bytes;
        assert_eq!(bytes("energy"), bytes("torque") - 64);
        // A graph that has been read is whole.
        assert_eq!(parse(&toml::to_string(&graph).unwrap()), graph);
        let mine = parse(
            "extends = \"armplane\"\n[[process]]\nname = \"plant\"\ncommand = [\"mine\"]\nfeedback = [\"torque\"]\nwrites = [\"sensor\", \"plant_state\"]\n",
        );
        assert_eq!(
            (mine.process.len(), mine.process("plant").unwrap().program()),
            (5, None)
        );
    }

    #[test]
    fn a_longer_way_is_the_chain() {
        let late = ENERGY.replace("reads = [\"estimate\"]", "reads = [\"singularity\"]");
        let graph = parse(&format!(
            "{late}[[process]]\nname = \"controller\"\ncommand = [\"mine\"]\nreads = [\"energy\", \"estimate\"]\nwrites = [\"control_state\", \"torque\"]\n"
        ));
        let way = ["plant", "estimator", "analyzer", "energy", "controller"];
        assert_eq!(names(in_chain(&graph)), way);
    }
}
