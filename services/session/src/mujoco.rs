//! MuJoCo instead of the simulated arm: starts the program for it in the Python package `armplane`,
//! and lets it check the arm before the run.

use std::path::Path;

use serde_json::json;
use shared_types::graph::Process;

use crate::failure::Failure;
use crate::load::{self, Loaded};
use crate::python::Python;

/// The module that takes part in a run, and without a run checks a scenario.
const MODULE: &str = "armplane.mujoco";

/// The scene of a plant: none of `mujoco`, a file of `mujoco:FILE`; `None` for another plant.
pub(crate) fn scene(plant: &str) -> Option<Option<&str>> {
    match plant.strip_prefix("mujoco")? {
        "" => Some(None),
        scene => scene.strip_prefix(':').map(Some),
    }
}

/// Makes a process of the graph MuJoCo.
///
/// # Errors
/// [`Failure::Input`] if there is no such scene.
pub(crate) fn take_over(world: &mut Process, scene: Option<&str>) -> Result<(), Failure> {
    let scene = scene.map(|scene| {
        let found = Path::new(scene).canonicalize();
        found.map_err(|error| Failure::Input(format!("--plant mujoco: {scene}: {error}")))
    });
    let scene = scene.transpose()?.map(|scene| scene.display().to_string());
    world.command = Python::command(MODULE, scene);
    Ok(())
}

/// The texts of an arm in MJCF, as MuJoCo compiles it: a URDF and a description, without the one that may lie beside the file.
///
/// # Errors
/// The reason why MuJoCo is missing, or refuses the file.
pub(crate) fn compile(file: &Path) -> Result<(String, String), String> {
    #[derive(serde::Deserialize)]
    struct Texts {
        urdf: String,
        description: String,
    }
    let arguments = ["--json".to_owned(), file.display().to_string()];
    let words = Python::command("armplane.mjcf", arguments);
    let mut command = std::process::Command::new(&words[0]);
    command.args(&words[1..]);
    let answer = Python::ask(command, &json!({}), "mujoco", LONGEST)?;
    let texts: Texts =
        serde_json::from_slice(&answer).map_err(|error| format!("MuJoCo's answer: {error}"))?;
    Ok((texts.urdf, texts.description))
}

/// Asks MuJoCo, the process `name` of the graph, whether it can simulate the arm.
///
/// # Errors
/// [`Failure::Input`] if Python or MuJoCo is missing, or the scene does not fit the arm: the sentence says what to install or to mend.
pub(crate) fn check(loaded: &Loaded, name: &str) -> Result<(), Failure> {
    answer(loaded, name).map_err(|reason| Failure::Input(format!("--plant mujoco: {reason}")))
}

/// Longest time in which MuJoCo is loaded and has compiled a scene.
const LONGEST: std::time::Duration = std::time::Duration::from_secs(120);

fn answer(loaded: &Loaded, name: &str) -> Result<(), String> {
    let Loaded {
        scenario, robot, ..
    } = loaded;
    let start = robot.start_posture(&scenario.start);
    let arm = start.map(|start| robot.to_mjcf(scenario.frame(), &start));
    let arm = arm.map_err(|error| error.to_string())?;
    let question = json!({"scenario": scenario, "robot": robot.source, "arm": arm});
    let command = load::command(&loaded.graph, name);
    let command = command.ok_or("there is no program")?;
    Python::ask(command, &question, "mujoco", LONGEST).map(drop)
}
