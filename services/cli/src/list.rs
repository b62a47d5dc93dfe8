//! `armplane list`.

use std::process::ExitCode;

use model::Robot;
use serde_json::json;
use shared_types::scenario::Scenario;

use crate::out::say;
use session::Failure;
use session::table::{fitted, number};

pub(crate) fn list(as_json: bool) -> Result<ExitCode, Failure> {
    let scenarios = sim::scenarios::names()
        .map(|name| Scenario::parse(name, sim::scenarios::text(name).unwrap_or_default(), &[]))
        .collect::<Result<Vec<_>, _>>()?;
    let robots = Robot::builtin_names().iter().map(|name| Robot::builtin(name)).collect::<Result<Vec<_>, _>>().map_err(Failure::input)?;
    if as_json {
        let scenarios: Vec<_> = scenarios
            .iter()
            .map(|s| json!({"name": s.name, "title": s.title, "about": s.about, "robot": s.robot, "duration_s": s.duration_s(), "rate_hz": s.rate_hz}))
            .collect();
        let robots: Vec<_> = robots
            .iter()
            .map(|r| json!({"name": r.name, "joints": r.dof(), "frames": r.frames.iter().map(|f| &f.name).collect::<Vec<_>>(), "postures": r.postures}))
            .collect();
        say!("{}", json!({"scenarios": scenarios, "robots": robots}));
        return Ok(ExitCode::SUCCESS);
    }
    let mut rows = fitted(&["scenario", "robot", "s", "what it shows"]);
    for scenario in &scenarios {
        rows.add_row([
            scenario.name.clone().into(),
            scenario.robot.clone().into(),
            number(format!("{:.1}", scenario.duration_s())),
            scenario.title.clone().into(),
        ]);
    }
    say!("{rows}");
    let mut rows = fitted(&["robot", "joints", "postures", "frames"]);
    for robot in &robots {
        let postures: Vec<_> = robot.postures.keys().map(String::as_str).collect();
        let frames: Vec<_> = robot.frames.iter().map(|frame| frame.name.as_str()).collect();
        rows.add_row([robot.name.clone().into(), number(robot.dof()), postures.join(" ").into(), frames.join(" ").into()]);
    }
    say!("{rows}");
    say!("Run one: armplane run {}", session::load::DEFAULT_SCENARIO);
    Ok(ExitCode::SUCCESS)
}
