//! Lines through exactly singular postures of any arm, under one law: which reach their goal, which are refused in words, which fail in silence.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;
use serde_json::{Value, json};
use session::{Failure, Observer, Results, load};
use shared_types::codes::singularity_name;
use shared_types::scenario::{Scenario, Strategy};
use shared_types::summary::{BOUNDARY, MISSED, REACHED};

use super::law::under;
use super::score::{Score, score};
use crate::pool::on_all_cores;
use crate::studies::singular_lines::{SingularLine, Through, Where, singular_lines};

/// The lines to draw, and their speed.
#[derive(Clone, Debug)]
pub struct ArmSweep<'a> {
    /// A built-in robot's name, or a URDF.
    pub robot: &'a str,
    /// The law.
    pub law: Strategy,
    /// Values that override those of the scenario.
    pub settings: &'a [String],
    /// Seed of the lines, and of every random number of their runs.
    pub seed: u64,
    /// Lines of each singularity, or of each pair.
    pub count: u32,
    /// Whether each line goes through two singularities at once.
    pub pairs: bool,
    /// Peak speed; m/s.
    pub speed: f64,
}

/// The outcome of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// By the goal of the scenario.
    Reached,
    /// Before the start, or on the way, and the arm brought to rest within its limits: the reason says why.
    Refused,
    /// The run was completed, and its reason names a hold, a clipped goal or the path's accuracy.
    Missed,
    /// The goal was not reached, and nothing says why.
    Silent,
}

/// One line and its run.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// The singularities that hold exactly, by name.
    pub singularities: String,
    /// Where on the line: `start`, `middle`, `end`.
    pub place: &'static str,
    /// Its outcome.
    pub outcome: Outcome,
    /// Why, in words.
    pub reason: String,
    /// Time that the plan before the start took on this machine; ms.
    pub planning_ms: f64,
    /// The run; `None` where it was refused before the start.
    pub score: Option<Score>,
    /// The run's scenario, to repeat it.
    #[serde(skip)]
    pub scenario: Scenario,
}

/// The lines of an arm.
#[derive(Clone, Debug, Serialize)]
pub struct ArmLines {
    /// The robot's name.
    pub robot: String,
    /// The law.
    pub law: String,
    /// Seed.
    pub seed: u64,
    /// Peak speed; m/s.
    pub speed_m_s: f64,
    /// In the order in which they were drawn.
    pub lines: Vec<Line>,
}

impl Line {
    /// The scenario file that repeats the run.
    ///
    /// # Errors
    /// [`Failure::Work`] where it cannot be written as TOML.
    pub fn scenario_text(&self) -> Result<String, Failure> {
        toml::to_string(&self.scenario).map_err(Failure::work)
    }
}

impl ArmLines {
    /// How many lines became so.
    #[must_use]
    pub fn count(&self, outcome: Outcome) -> usize {
        self.lines
            .iter()
            .filter(|line| line.outcome == outcome)
            .count()
    }

    /// As one JSON object.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({"version": env!("CARGO_PKG_VERSION"), "sweep": self})
    }

    /// Saves the lines as compare.json, and a scenario for each that did not reach its goal; returns the folder.
    ///
    /// # Errors
    /// [`Failure`] where the folder exists or a file cannot be written.
    pub fn save(&self, out: Option<&Path>) -> Result<PathBuf, Failure> {
        let results = Results::create(out, "compare")?;
        results.save("compare.json", &self.json())?;
        for (i, line) in self
            .lines
            .iter()
            .enumerate()
            .filter(|(_, line)| line.outcome != Outcome::Reached)
        {
            std::fs::write(
                results.folder.join(format!("line-{}.toml", i + 1)),
                line.scenario_text()?,
            )
            .map_err(Failure::work)?;
        }
        Ok(results.folder.clone())
    }
}

impl ArmSweep<'_> {
    /// Draws the lines and runs them on all cores.
    ///
    /// # Errors
    /// [`Failure`] for a robot or a setting that does not exist, or an arm for which no line is found.
    pub fn run(&self, observer: Observer<'_>) -> Result<ArmLines, Failure> {
        let robot = load::robot(self.robot, None, None)?;
        let text = format!(
            "name = \"sweep\"\nrobot = \"{}\"\n[start]\nposture = \"none\"\n[[segment]]\nduration_s = 2.0\n",
            self.robot
        );
        let mut template = Scenario::parse("sweep.toml", &text, self.settings)?;
        if let Ok(path) = Path::new(self.robot).canonicalize() {
            // The lines' scenarios lie elsewhere.
            template.robot = path.display().to_string();
        }
        template.seed = self.seed;
        template.plant.floor_m = None;
        let through = if self.pairs {
            Through::Two
        } else {
            Through::One
        };
        let lines = singular_lines(
            &robot,
            &template,
            through,
            (self.seed, self.count, self.speed),
            observer,
        )
        .map_err(Failure::input)?;
        if lines.is_empty() {
            let what = if self.pairs {
                "two singularities at once"
            } else {
                "a singularity"
            };
            return Err(Failure::Input(format!(
                "{} has no posture with {what} within its limits from which a line leads on",
                robot.name
            )));
        }
        let title = format!("lines of {}", robot.name);
        let run = |line: &SingularLine| run(&robot, self.law, line);
        Ok(ArmLines {
            robot: robot.name.clone(),
            law: self.law.name().to_owned(),
            seed: self.seed,
            speed_m_s: self.speed,
            lines: on_all_cores(&title, &lines, run, observer),
        })
    }
}

fn run(robot: &model::Robot, law: Strategy, line: &SingularLine) -> Line {
    let scenario = under(&line.scenario, law);
    let names = line
        .kinds
        .iter()
        .map(|kind| singularity_name(kind.code(), 0))
        .collect::<Vec<_>>();
    let place = match line.place {
        Where::Start => "start",
        Where::Middle => "middle",
        Where::End => "end",
    };
    let began = Instant::now();
    let obstacle = chain::Chain::new(robot, &scenario).and_then(|chain| {
        chain
            .obstacle()
            .map_or(Ok(()), |why| Err(model::Refused::because(why)))
    });
    let planning_ms = began.elapsed().as_secs_f64() * 1e3;
    let result = obstacle.and_then(|()| score(robot, &scenario));
    let out = |outcome, reason: String, score| Line {
        singularities: names.join("+"),
        place,
        outcome,
        reason,
        planning_ms,
        score,
        scenario,
    };
    match result {
        Err(refused) => out(Outcome::Refused, refused.to_string(), None),
        Ok(score) => {
            let within = score.speed_max_ratio <= 1.0 && !score.stopped_by_plant;
            let says = ["held", "clipped", "orthogonal", "off along", "beyond reach"]
                .iter()
                .any(|word| score.reason.contains(word));
            let outcome = match score.outcome.as_str() {
                REACHED => Outcome::Reached,
                BOUNDARY => Outcome::Missed,
                "stopped" if within => Outcome::Refused,
                MISSED if within && says => Outcome::Missed,
                _ => Outcome::Silent,
            };
            out(outcome, score.reason.clone(), Some(score))
        }
    }
}
