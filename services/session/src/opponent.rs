//! A third-party controller instead of armplane's: a class in Python, or a process of a graph.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use model::Robot;
use serde_json::json;
use shared_types::graph::{Graph, Role};
use shared_types::process::Restart;
use shared_types::scenario::Scenario;

use crate::failure::Failure;
use crate::load;
use crate::python::Python;
use crate::robot;

/// The module that runs a class of `armplane.arena`, and without a run checks its file.
const MODULE: &str = "armplane.arena.host";
/// Compilers and large packages at work before the first answer; s.
const LONGEST_S: u32 = 120;

/// A controller of others: its file ends in `.py` or `.toml`.
#[derive(Clone, Debug)]
pub struct Controller {
    file: PathBuf,
    /// Not a class in Python.
    is_graph: bool,
    join_limit_s: u32,
}

impl Controller {
    /// A controller that may take so long to join, s.
    ///
    /// # Errors
    /// [`Failure::Input`] if there is no such file, or it is neither Python nor a graph.
    pub fn new(file: &Path, join_limit_s: u32) -> Result<Self, Failure> {
        let refused = |reason: &str| Failure::Input(format!("{}: {reason}", file.display()));
        let is_graph = match file.extension().and_then(OsStr::to_str) {
            Some("py") => false,
            Some("toml") => true,
            _ => {
                return Err(refused(
                    "give a Python file with a class of armplane.arena (.py), or a graph (.toml)",
                ));
            }
        };
        let file = file.canonicalize();
        Ok(Self {
            file: file.map_err(|error| refused(&error.to_string()))?,
            is_graph,
            join_limit_s,
        })
    }

    /// Whether a Python file has a controller and all that it imports.
    fn check(&self, graph: &Graph) -> Result<(), Failure> {
        let process = graph
            .process
            .iter()
            .find(|process| process.command.iter().any(|part| part == MODULE));
        let Some(command) = process.and_then(|process| load::command(graph, &process.name)) else {
            return Ok(());
        };
        let limit = Duration::from_secs(self.join_limit_s.into());
        Python::ask(command, &json!({}), "'armplane[arena]'", limit)
            .map(drop)
            .map_err(|reason| Failure::Input(format!("{}: {reason}", self.file.display())))
    }
}

/// The graph of a run in lockstep under a controller of others, with `plant` in place of the simulated arm.
///
/// # Errors
/// [`Failure`] if the controller or the plant cannot be had.
pub fn opposed(
    controller: &Controller,
    plant: Option<&str>,
    robot: &Robot,
    scenario: &Scenario,
) -> Result<Graph, Failure> {
    let (file, is_graph) = (&controller.file, controller.is_graph);
    let mut graph = load::graph_of(scenario, is_graph.then_some(file.as_path()))?;
    let mut processes = graph.process.iter_mut();
    let own = processes.find(|process| process.writes.iter().any(|topic| topic == "torque"));
    if let Some(own) = own.filter(|own| own.role() != Role::World) {
        if !is_graph {
            own.command = Python::command(MODULE, [file.display().to_string()]);
            own.answer_limit_s = LONGEST_S;
        }
        // A second one would begin in the middle.
        own.restart = Restart::Never;
        if own.is_of_others() {
            own.join_limit_s = controller.join_limit_s;
        }
    }
    controller.check(&graph)?;
    match plant {
        Some(plant) => robot::with_plant(graph, plant, robot, scenario),
        None => Ok(graph),
    }
}
