//! MuJoCo in place of the simulated arm: the program that holds it, in the package `armplane` of Python, and its words before a run.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use serde_json::json;
use shared_types::graph::Process;

use crate::failure::Failure;
use crate::load::{self, Loaded};
use crate::python::Python;

/// The module that takes part in a run, and without an exchange page checks a scenario.
const MODULE: &str = "armplane.mujoco";

/// The exit code of `env` for a program that is not there.
const NOT_FOUND: i32 = 127;

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
/// [`Failure::Input`] where there is no such scene.
pub(crate) fn take_over(world: &mut Process, scene: Option<&str>) -> Result<(), Failure> {
    let scene = scene.map(|scene| {
        let found = Path::new(scene).canonicalize();
        found.map_err(|error| Failure::Input(format!("--plant mujoco: {scene}: {error}")))
    });
    (world.command, world.exchange) = (command(scene.transpose()?), true);
    Ok(())
}

/// The program of the process.
fn command(scene: Option<PathBuf>) -> Vec<String> {
    let Python { program, path } = Python::find();
    let path = path.map(|path| ["env".to_owned(), format!("PYTHONPATH={}", path.display())]);
    path.into_iter()
        .flatten()
        .chain([program, "-m".to_owned(), MODULE.to_owned()])
        .chain(scene.map(|scene| scene.display().to_string()))
        .collect()
}

/// Asks MuJoCo, the process `name` of the graph, whether it can simulate the arm.
///
/// # Errors
/// [`Failure::Input`] where Python or MuJoCo is missing, or the scene does not fit the arm: the sentence says what to install or to mend.
pub(crate) fn check(loaded: &Loaded, name: &str) -> Result<(), Failure> {
    answer(loaded, name).map_err(|reason| Failure::Input(format!("--plant mujoco: {reason}")))
}

/// Lets the program load arm and scene, and end; the last line that it prints is the reason of a refusal.
fn answer(loaded: &Loaded, name: &str) -> Result<(), String> {
    let Loaded {
        scenario, robot, ..
    } = loaded;
    let start = robot.start_posture(&scenario.start);
    let arm = start.map(|start| robot.to_mjcf(scenario.frame(), &start));
    let arm = arm.map_err(|error| error.to_string())?;
    let question = json!({"scenario": scenario, "robot": robot.source, "arm": arm});
    let command = load::command(&loaded.graph, name);
    let mut command = command.ok_or("there is no program")?;
    let missing = |error: std::io::Error| format!("{} mujoco (python3: {error})", Python::MISSING);
    command.stdin(Stdio::piped()).stdout(Stdio::null());
    let mut child = command.stderr(Stdio::piped()).spawn().map_err(missing)?;
    if let Some(mut stdin) = child.stdin.take() {
        // A program that ends before it has read everything says why.
        let _ = stdin.write_all(question.to_string().as_bytes());
    }
    let said = child.wait_with_output().map_err(missing)?;
    let errors = String::from_utf8_lossy(&said.stderr);
    let last = errors.lines().rfind(|line| !line.trim().is_empty());
    match last.unwrap_or("the program ended without a word") {
        _ if said.status.success() => Ok(()),
        line if said.status.code() == Some(NOT_FOUND) => Err(format!("{} mujoco ({line})", Python::MISSING)),
        line if line.contains("No module named 'armplane'") => Err(
            "Python lacks the package armplane: pip install the wheel that `python/build` makes (docs/python.md)"
                .to_owned(),
        ),
        line => Err(line.to_owned()),
    }
}
