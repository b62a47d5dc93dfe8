//! The built-in scenarios and robots.

use std::fmt;

use model::Robot;
use serde_json::{Value, json};
use shared_types::scenario::Scenario;

use crate::table::{number, table};
use crate::{Failure, load};

/// All built-in scenarios and robots.
pub struct Catalogue {
    scenarios: Vec<Scenario>,
    robots: Vec<Robot>,
}

impl Catalogue {
    /// Reads them.
    ///
    /// # Errors
    /// [`Failure`] if one of them cannot be read.
    pub fn load() -> Result<Self, Failure> {
        let scenarios = sim::scenarios::names()
            .map(|name| Scenario::parse(name, sim::scenarios::text(name).unwrap_or_default(), &[]))
            .collect::<Result<Vec<_>, _>>()?;
        let robots = Robot::builtin_names()
            .iter()
            .map(|name| Robot::builtin(name))
            .collect::<Result<Vec<_>, _>>()
            .map_err(Failure::input)?;
        Ok(Self { scenarios, robots })
    }

    /// As one JSON object.
    pub fn json(&self) -> Value {
        let scenarios: Vec<_> = self.scenarios
            .iter()
            .map(|s| json!({"name": s.name, "title": s.title, "about": s.about, "robot": s.robot, "duration_s": s.duration_s(), "rate_hz": s.rate_hz}))
            .collect();
        let robots: Vec<_> = self.robots
            .iter()
            .map(|r| json!({"name": r.name, "joints": r.dof(), "frames": r.frames.iter().map(|f| &f.name).collect::<Vec<_>>(), "postures": r.postures}))
            .collect();
        json!({"scenarios": scenarios, "robots": robots})
    }
}

impl fmt::Display for Catalogue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rows = table(&["scenario", "robot", "s", "what it shows"]);
        for scenario in &self.scenarios {
            rows.add_row([
                scenario.name.clone().into(),
                scenario.robot.clone().into(),
                number(format!("{:.1}", scenario.duration_s())),
                scenario.title.clone().into(),
            ]);
        }
        writeln!(f, "{rows}")?;
        let mut rows = table(&["robot", "joints", "postures", "frames"]);
        for robot in &self.robots {
            let postures: Vec<_> = robot.postures.keys().map(String::as_str).collect();
            let frames: Vec<_> = robot
                .frames
                .iter()
                .map(|frame| frame.name.as_str())
                .collect();
            rows.add_row([
                robot.name.clone().into(),
                number(robot.dof()),
                postures.join(" ").into(),
                frames.join(" ").into(),
            ]);
        }
        writeln!(f, "{rows}")?;
        writeln!(f, "Run one: armplane run {}", load::DEFAULT_SCENARIO)
    }
}
