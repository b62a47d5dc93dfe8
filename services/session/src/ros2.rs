//! The face of a run for ROS 2: a process in the Python package `armplane` that only looks on. Its commands go to the operator's socket.

use std::time::Duration;

use serde_json::Value;
use shared_types::process::{Process, Restart};

use crate::failure::Failure;
use crate::load::{self, Loaded};
use crate::python::Python;

/// The module that takes part in a run, and without a run checks its options and packages; the name of its process.
const MODULE: &str = "armplane.ros2";
const NAME: &str = "ros2";

/// The topics that it shows, where the graph has them.
const READS: [&str; 5] = [
    "sensor",
    "estimate",
    "singularity",
    "control_state",
    "servo_state",
];

/// Longest time in which its packages load.
const LONGEST: Duration = Duration::from_secs(60);

/// Adds the process to the graph of a run.
///
/// # Errors
/// [`Failure::Input`] if Python, a package or an option cannot be had, or the graph has a process of that name: the sentence says what to install or to mend.
pub(crate) fn add(loaded: &mut Loaded, options: &str) -> Result<(), Failure> {
    let refused = |reason: String| Failure::Input(format!("--ros2: {reason}"));
    let graph = &mut loaded.graph;
    if graph.process(NAME).is_some() {
        return Err(refused(format!(
            "the graph already has a process `{NAME}`; leave one of them out"
        )));
    }
    let reads = READS.iter().filter(|topic| graph.writer(topic).is_some());
    let process = Process {
        name: NAME.to_owned(),
        command: Python::command(MODULE, [options.to_owned()]),
        reads: reads.map(|topic| (*topic).to_owned()).collect(),
        core: 1,
        // Commands pass through it: other work on the machine is not to delay them. Below the recorder, in real time only.
        priority: 5,
        restart: Restart::Always,
        ..Process::default()
    };
    graph.process.push(process);
    let command = load::command(graph, NAME).ok_or_else(|| refused("no program".to_owned()))?;
    let answer = Python::ask(command, &Value::Null, "cyclonedds", LONGEST);
    answer.map(drop).map_err(refused)
}
