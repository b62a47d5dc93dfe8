//! Lines to compare laws on: through and near the singularities of a PUMA, or through exactly singular postures of any arm.

use std::path::Path;

use model::Robot;
use session::{Failure, Observer, load};
use shared_types::scenario::Scenario;

use super::{SWEEP, name_of};
use crate::studies::singular_lines::singular_lines;
use crate::trial::bare;

/// Seed of an arm's lines where none is given.
const SEED: u64 = 1;

/// The lines to draw.
#[derive(Clone, Debug)]
pub struct Lines<'a> {
    /// A built-in robot's name, or a URDF: each line is exactly singular somewhere. Without one, those of the scenario `sweep`, through and near each
    /// singularity of a PUMA.
    pub robot: Option<&'a str>,
    /// Values that override those of the scenario.
    pub settings: &'a [String],
    /// Seed of the lines, and of every random number of their runs; that of the scenario, or 1, where it is `None`.
    pub seed: Option<u64>,
    /// Lines in all; of a robot, lines of each singularity or of each pair.
    pub count: u32,
    /// Whether each line of a robot goes through two singularities at once.
    pub pairs: bool,
    /// Peak speed; m/s.
    pub speed: f64,
}

/// A line to run.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawn {
    /// The singularities that it passes, by name, joined by `+`.
    pub singularities: String,
    /// The place on the line: `start`, `middle`, `end`; `near` where it passes close by.
    pub place: &'static str,
    /// The run: start posture and one segment.
    pub scenario: Scenario,
}

impl Lines<'_> {
    /// Draws the lines of an arm; none where it has no such line within its limits. Each is a variant of the scenario.
    ///
    /// # Errors
    /// [`Failure::Input`] for a robot or a setting that does not exist.
    pub fn drawn(&self, observer: Observer<'_>) -> Result<(Robot, Scenario, Vec<Drawn>), Failure> {
        let Some(robot) = self.robot else {
            return self.near();
        };
        let arm = load::robot(robot, None, None)?;
        arm.complete().map_err(Failure::input)?;
        let mut template = bare(SWEEP, robot, self.settings)?;
        // A folder may have the name of a built-in arm.
        let file = Path::new(robot);
        if let Some(path) = file.canonicalize().ok().filter(|path| path.is_file()) {
            // The lines' scenarios lie elsewhere.
            template.robot = path.display().to_string();
        }
        template.seed = self.seed.unwrap_or(SEED);
        template.plant.floor_m = None;
        let drawn = singular_lines(&arm, &template, self, observer).map_err(Failure::input)?;
        Ok((arm, template, drawn))
    }

    fn near(&self) -> Result<(Robot, Scenario, Vec<Drawn>), Failure> {
        let load::Loaded {
            robot, scenario, ..
        } = load::scenario(SWEEP, self.settings, self.seed)?;
        let mut template = chain::without_faults(&scenario);
        // The lines fill the arm's whole reach: where a floor would be, too.
        template.plant.floor_m = None;
        let count = self.count as usize;
        let lines = lines::lines(&robot, &template, template.seed, count, self.speed);
        if lines.is_empty() {
            return Err(Failure::Input(format!(
                "the sweep's lines are drawn for a PUMA, and '{}' has no such factors: compare scenarios of your own instead",
                robot.name
            )));
        }
        let drawn = lines.into_iter().map(|line| Drawn {
            singularities: name_of(line.near),
            place: "near",
            scenario: line.scenario,
        });
        Ok((robot, scenario, drawn.collect()))
    }

    /// Draws at least one line.
    pub(super) fn some(
        &self,
        observer: Observer<'_>,
    ) -> Result<(Robot, Scenario, Vec<Drawn>), Failure> {
        let found = self.drawn(observer)?;
        if !found.2.is_empty() {
            return Ok(found);
        }
        let what = match self.pairs {
            true => "two singularities at once",
            false => "a singularity",
        };
        let robot = &found.0.name;
        Err(Failure::Input(format!(
            "{robot} has no line through {what} within its limits"
        )))
    }
}

pub(super) fn save(folder: &Path, number: usize, scenario: &Scenario) -> Result<(), Failure> {
    let text = toml::to_string(scenario).map_err(Failure::work)?;
    let path = folder.join(format!("line-{number}.toml"));
    files::write(&path, text).map_err(Failure::work)
}
