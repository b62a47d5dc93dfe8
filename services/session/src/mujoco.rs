//! MuJoCo in place of the simulated arm: the program that holds it, in the package `armplane` of Python, and its words before a run.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use serde_json::json;
use shared_types::graph::Process;

use crate::failure::Failure;
use crate::load::{self, Loaded};

/// The module that takes part in a run, and without an exchange page checks a scenario.
const MODULE: &str = "armplane.mujoco";

/// The exit code of `env` for a program that is not there.
const NOT_FOUND: i32 = 127;

const MISSING: &str = "there is no Python: install Python 3.9 or newer, then pip install mujoco";

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

/// The Python of this program's own folder, where it has been installed together with the package; else that of PATH, which finds the package in
/// the source tree of this program.
fn command(scene: Option<PathBuf>) -> Vec<String> {
    let program = std::env::current_exe().unwrap_or_default();
    let text = |path: PathBuf| path.display().to_string();
    let beside = program.with_file_name("python3");
    let python = match beside.is_file() {
        true => text(beside),
        false => "python3".to_owned(),
    };
    let mut packages = program.ancestors().map(|folder| folder.join("python"));
    let package = packages.find(|folder| folder.join("armplane/mujoco.py").is_file());
    let path = package.map(|package| {
        let others = std::env::var_os("PYTHONPATH").unwrap_or_default();
        let others = std::env::split_paths(&others).filter(|folder| !folder.as_os_str().is_empty());
        let all = std::iter::once(package).chain(others);
        let all = std::env::join_paths(all).unwrap_or_default();
        format!("PYTHONPATH={}", all.display())
    });
    let environment = path.map(|path| ["env".to_owned(), path]);
    environment
        .into_iter()
        .flatten()
        .chain([python, "-m".to_owned(), MODULE.to_owned()])
        .chain(scene.map(text))
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
    let missing = |error: std::io::Error| format!("{MISSING} (python3: {error})");
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
        line if said.status.code() == Some(NOT_FOUND) => Err(format!("{MISSING} ({line})")),
        line if line.contains("No module named 'armplane'") => Err(
            "Python lacks the package armplane: pip install the wheel that `python/build` makes (docs/python.md)"
                .to_owned(),
        ),
        line => Err(line.to_owned()),
    }
}
