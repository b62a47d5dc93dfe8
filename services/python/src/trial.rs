//! Runs on this thread, without processes: the module `armplane.trials` in Python names the arguments and the results.

use std::path::PathBuf;

use lab::studies::compare::Lines;
use lab::studies::steered::twists;
use lab::trial::Trial;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde_json::json;
use session::load::{Loaded, Source};
use session::{Failure, Progress, Steering, Targets};
use shared_types::scenario::{Goal, Strategy};

use crate::arm::Arm;
use crate::controller::Controller;
use crate::floats::Mode;
use crate::refused;

/// A scenario by its name, its path, or its text, which has more than one line.
fn source(scenario: &str) -> Result<Source, Failure> {
    match scenario.contains('\n') {
        true => Ok(Source {
            file: "scenario.toml".to_owned(),
            text: scenario.to_owned(),
            folder: PathBuf::new(),
        }),
        false => Source::read(scenario),
    }
}

fn load(scenario: &str, settings: &[String], seed: Option<u64>) -> Result<Loaded, Failure> {
    source(scenario)?.scenario(None, settings, seed)
}

/// Checks that a scenario takes these settings, whatever its arm says.
#[pyfunction]
pub(crate) fn check_scenario(
    py: Python<'_>,
    scenario: &str,
    settings: Vec<String>,
) -> PyResult<()> {
    py.detach(|| source(scenario)?.parse(&settings).map(drop))
        .map_err(refused)
}

/// The arm of a scenario, at its frame.
#[pyfunction]
pub(crate) fn scenario_arm(py: Python<'_>, scenario: &str, settings: Vec<String>) -> PyResult<Arm> {
    let loaded = py
        .detach(|| load(scenario, &settings, None))
        .map_err(refused)?;
    Arm::new(py, arm::Arm::new(loaded.robot, loaded.scenario.frame()))
}

/// The row of a run as JSON; where a step refuses the scenario, only `outcome` and `reason`. `controller`: a class in Python whose object controls
/// it.
#[pyfunction]
#[pyo3(signature = (scenario, settings, seed, controller=None))]
pub(crate) fn run_trial(
    py: Python<'_>,
    scenario: &str,
    settings: Vec<String>,
    seed: Option<u64>,
    controller: Option<Bound<'_, PyAny>>,
) -> PyResult<String> {
    let loaded = py
        .detach(|| load(scenario, &settings, seed))
        .map_err(refused)?;
    let trial = trial(&loaded);
    let row = match controller {
        None => alone(py, || trial.run()),
        Some(class) => under(&class, &loaded, |controller| trial.run_under(controller))?,
    };
    let mut row = match row {
        Ok(row) => serde_json::to_value(&row).map_err(refused)?,
        Err(error) => json!({"outcome": "refused", "reason": error.to_string()}),
    };
    row["robot"] = loaded.robot.name.into();
    Ok(row.to_string())
}

/// The signals of a run, a stream of Arrow's IPC format.
#[pyfunction]
#[pyo3(signature = (scenario, settings, seed, controller=None))]
pub(crate) fn trace_trial<'py>(
    py: Python<'py>,
    scenario: &str,
    settings: Vec<String>,
    seed: Option<u64>,
    controller: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyBytes>> {
    let loaded = py
        .detach(|| load(scenario, &settings, seed))
        .map_err(refused)?;
    let trial = trial(&loaded);
    let table = match controller {
        None => alone(py, || trial.trace(None)),
        Some(class) => under(&class, &loaded, |controller| trial.trace(Some(controller)))?,
    };
    Ok(PyBytes::new(py, &table.map_err(refused)?))
}

/// A run without Python's lock, in the processor's standard mode.
fn alone<T: Send>(py: Python<'_>, run: impl FnOnce() -> T + Send) -> T {
    py.detach(|| Mode::STANDARD.during(run))
}

/// The same under a controller in Python, which takes the lock at each tick. What it raises ends the run.
fn under<T: Send>(
    class: &Bound<'_, PyAny>,
    loaded: &Loaded,
    run: impl FnOnce(lab::trial::Controller) -> T + Send,
) -> PyResult<T> {
    let (controller, handle) = Controller::new(class, loaded)?;
    let done = alone(class.py(), || run(Box::new(controller)));
    handle.end(class.py()).map(|()| done)
}

fn trial(loaded: &Loaded) -> Trial<'_> {
    Trial {
        robot: &loaded.robot,
        scenario: loaded.scenario.clone(),
        graph: None,
    }
}

/// Scenarios of straight lines through singularities, as JSON.
#[pyfunction]
pub(crate) fn draw_lines(
    py: Python<'_>,
    robot: &str,
    kind: &str,
    count: u32,
    seed: u64,
    speed: f64,
    settings: Vec<String>,
) -> PyResult<String> {
    let quiet = |_: Progress<'_>| ();
    let is_near = kind == "near";
    let settings = match is_near {
        true => [&settings[..], &[format!("robot={robot}")]].concat(),
        false => settings,
    };
    let lines = Lines {
        robot: (!is_near).then_some(robot),
        settings: &settings,
        seed: Some(seed),
        count,
        pairs: kind == "two",
        speed,
    };
    let (.., lines) = py.detach(|| lines.drawn(&quiet)).map_err(refused)?;
    let line = |line: lab::studies::compare::Drawn| {
        let scenario = toml::to_string(&line.scenario).map_err(refused)?;
        Ok(json!({"singularities": line.singularities, "place": line.place, "scenario": scenario}))
    };
    let lines: PyResult<Vec<_>> = lines.into_iter().map(line).collect();
    Ok(json!(lines?).to_string())
}

/// The scenario of a steered run: seeded random twists, without a floor.
#[pyfunction]
pub(crate) fn random_twists(robot: &str, seed: u64, seconds: f64) -> PyResult<String> {
    let steering = Steering {
        subject: robot.to_owned(),
        targets: Targets::Text(twists(seed, seconds)),
        start: None,
        duration_s: None,
        settings: Vec::new(),
        seed: None,
        graph: None,
    };
    let mut scenario = steering.load().map_err(refused)?.scenario;
    scenario.plant.floor_m = None;
    toml::to_string(&scenario).map_err(refused)
}

/// The largest error orthogonal to ζ of a success by the strict bar, S1; degrees.
#[pyfunction]
pub(crate) fn orthogonal_bar_deg() -> f64 {
    Goal::default().orthogonal_deg
}

/// The control laws: each with whether it follows paths, as comparisons need.
#[pyfunction]
pub(crate) fn law_names() -> Vec<(&'static str, bool)> {
    let laws = Strategy::ALL.into_iter();
    laws.map(|law| (law.name(), law.follows_paths())).collect()
}
