//! Lines through exactly singular postures of any arm, under one law: which reach their goal, which are refused in words, which fail in silence.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

use model::{Refused, Robot};
use serde::Serialize;
use serde_json::{Value, json};
use session::{Failure, Observer, Results, load};
use shared_types::graph::Graph;
use shared_types::scenario::Scenario;
use shared_types::summary::{BOUNDARY, MISSED, REACHED};

use super::text::with_errors;
use super::{Law, SWEEP, unless_stopped};
use crate::pool::on_all_cores;
use crate::row::Row;
use crate::studies::singular_lines::{SingularLine, Through, singular_lines};
use crate::text::{Columns, optional, percent, quantile};
use crate::trial::bare;

/// The lines to draw, and their speed.
#[derive(Clone, Debug)]
pub struct ArmSweep<'a> {
    /// A built-in robot's name, or a URDF.
    pub robot: &'a str,
    /// The law.
    pub law: &'a Law,
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
    /// The plant in place of the simulated arm, as of a run.
    pub plant: Option<&'a str>,
}

/// The outcome of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// By the goal of the scenario.
    Reached,
    /// Before the start, or on the way, and the arm brought to rest within its limits: the reason says why.
    Refused,
    /// The run was completed, and its reason names a cause: a hold, or the path's accuracy.
    Missed,
    /// The goal was not reached, and nothing says why.
    Silent,
}

/// A line to run.
#[derive(Clone, Debug, Serialize)]
pub struct Drawn {
    /// The singularities that it passes, by name, joined by `+`.
    pub singularities: String,
    /// Where on the line: `start`, `middle`, `end`; `near` where it passes close by.
    pub place: &'static str,
    /// The run: start posture and one segment.
    pub scenario: Scenario,
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
    pub score: Option<Row>,
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

impl ArmLines {
    /// The lines that did not reach their goal, with their numbers from 1 on.
    fn short(&self) -> impl Iterator<Item = (usize, &Line)> {
        let numbered = (1..).zip(&self.lines);
        numbered.filter(|(_, line)| line.outcome != Outcome::Reached)
    }

    /// How many did not reach their goal, refused ones too.
    pub fn unreached(&self) -> usize {
        self.short().count()
    }

    /// As one JSON object.
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
        for (i, line) in self.short() {
            save_scenario(&results.folder, i, &line.scenario)?;
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
        let lines = self.some(&robot, observer)?;
        let title = format!("lines of {}", robot.name);
        let graph = self.law.graph(self.plant, &robot, &lines[0].scenario)?;
        let run = |line: &SingularLine| run(&robot, self.law, graph.as_ref(), line);
        Ok(ArmLines {
            robot: robot.name.clone(),
            law: self.law.name().to_owned(),
            seed: self.seed,
            speed_m_s: self.speed,
            lines: unless_stopped(graph.as_ref(), || {
                on_all_cores(&title, &lines, run, observer)
            })?,
        })
    }

    /// Draws the lines and saves each as a scenario file in a folder; their number.
    ///
    /// # Errors
    /// As [`run`](Self::run), and where the folder exists or a file cannot be written.
    pub fn save_lines(&self, folder: &Path, observer: Observer<'_>) -> Result<usize, Failure> {
        let robot = load::robot(self.robot, None, None)?;
        let lines = self.some(&robot, observer)?;
        save_scenarios(folder, lines.iter().map(|line| &line.scenario))
    }

    /// Draws the lines; none where the arm has no such line within its limits.
    ///
    /// # Errors
    /// [`Failure`] for a robot or a setting that does not exist.
    pub fn drawn(&self, observer: Observer<'_>) -> Result<Vec<Drawn>, Failure> {
        let robot = load::robot(self.robot, None, None)?;
        let lines = self.draw(&robot, observer)?.into_iter();
        let drawn = lines.map(|line| Drawn {
            singularities: line.names(),
            place: line.place.name(),
            scenario: line.scenario,
        });
        Ok(drawn.collect())
    }

    fn draw(&self, robot: &Robot, observer: Observer<'_>) -> Result<Vec<SingularLine>, Failure> {
        let mut template = bare(SWEEP, self.robot, self.settings)?;
        if let Ok(path) = Path::new(self.robot).canonicalize() {
            // The lines' scenarios lie elsewhere.
            template.robot = path.display().to_string();
        }
        template.seed = self.seed;
        template.plant.floor_m = None;
        let through = match self.pairs {
            true => Through::Two,
            false => Through::One,
        };
        let size = (self.seed, self.count, self.speed);
        singular_lines(robot, &template, through, size, observer).map_err(Failure::input)
    }

    /// At least one line.
    fn some(&self, robot: &Robot, observer: Observer<'_>) -> Result<Vec<SingularLine>, Failure> {
        let lines = self.draw(robot, observer)?;
        if lines.is_empty() {
            let what = match self.pairs {
                true => "two singularities at once",
                false => "a singularity",
            };
            return Err(Failure::Input(format!(
                "{} has no line through {what} within its limits",
                robot.name
            )));
        }
        Ok(lines)
    }
}

fn save_scenario(folder: &Path, number: usize, scenario: &Scenario) -> Result<(), Failure> {
    let text = toml::to_string(scenario).map_err(Failure::work)?;
    let path = folder.join(format!("line-{number}.toml"));
    files::write(&path, text).map_err(Failure::work)
}

/// Saves lines as scenario files in a new folder; their number.
pub(super) fn save_scenarios<'a>(
    folder: &Path,
    lines: impl Iterator<Item = &'a Scenario>,
) -> Result<usize, Failure> {
    let results = Results::create(Some(folder), "lines")?;
    let mut count = 0;
    for line in lines {
        count += 1;
        save_scenario(&results.folder, count, line)?;
    }
    Ok(count)
}

fn run(robot: &Robot, law: &Law, graph: Option<&Graph>, line: &SingularLine) -> Line {
    let trial = law.trial(robot, &line.scenario, graph);
    let began = Instant::now();
    let planned = match law {
        Law::Own(_) => planned(robot, &trial.scenario),
        Law::Other(..) => Ok(()),
    };
    let planning_ms = began.elapsed().as_secs_f64() * 1e3;
    let result = planned.and_then(|()| trial.run());
    let result = result.map(|row| law.named(&row));
    let (outcome, reason) = match &result {
        Err(refused) => (Outcome::Refused, refused.to_string()),
        Ok(row) => (outcome(row), row.reason.clone()),
    };
    Line {
        singularities: line.names(),
        place: line.place.name(),
        outcome,
        reason,
        planning_ms,
        score: result.ok(),
        scenario: trial.scenario,
    }
}

/// Plans as a run does, and leaves it at that.
fn planned(robot: &Robot, scenario: &Scenario) -> Result<(), Refused> {
    let chain = chain::Chain::new(robot, scenario)?;
    let obstacle = chain.obstacle().map(Refused::because);
    obstacle.map_or(Ok(()), Err)
}

fn outcome(row: &Row) -> Outcome {
    let within = row.joints.speed_max_ratio <= 1.0 && row.joints.stopped_ticks == 0;
    let says = !row.task.causes.is_empty();
    match row.outcome.as_str() {
        REACHED => Outcome::Reached,
        BOUNDARY => Outcome::Missed,
        "stopped" if within => Outcome::Refused,
        MISSED if within && says => Outcome::Missed,
        _ => Outcome::Silent,
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Reached => "reached",
            Self::Refused => "refused",
            Self::Missed => "missed",
            Self::Silent => "SILENT",
        })
    }
}

/// A row a line, the reasons of those that did not reach their goal, and a row a singularity.
impl fmt::Display for ArmLines {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (robot, law, count) = (&self.robot, &self.law, self.lines.len());
        writeln!(
            f,
            "{robot}: {count} lines through exactly singular postures, {} m/s, {law} (seed {})",
            self.speed_m_s, self.seed
        )?;
        self.by_line(f)?;
        for (i, line) in self.short() {
            writeln!(f, "line {i}, {}: {}", line.outcome, line.reason)?;
        }
        self.by_singularity(f)
    }
}

type Numbered<'a> = (usize, &'a Line);

impl ArmLines {
    fn by_line(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let load = |of: fn(&Row) -> String| {
            move |(_, line): &Numbered<'_>| optional(line.score.as_ref(), of)
        };
        let columns = Columns::<Numbered<'_>>::new()
            .number("line", |(i, _)| *i)
            .text("singular", |(_, line)| line.singularities.clone())
            .text("at its", |(_, line)| line.place)
            .text("goal", |(_, line)| line.outcome);
        let columns = with_errors(columns, |(_, line)| line.score.as_ref())
            .number("speed", load(|row| percent(row.joints.speed_max_ratio)))
            .number(
                "torque step",
                load(|row| format!("{:.1} %", row.joints.torque_step_max_ratio * 100.0)),
            )
            .number(
                "time",
                load(|row| format!("× {:.2}", row.task.time_stretch)),
            )
            .number("plan, ms", |(_, line)| format!("{:.0}", line.planning_ms))
            .text("S2", |(_, line)| {
                line.score.as_ref().map_or_else(String::new, Row::success)
            });
        writeln!(f, "{}", columns.print((1..).zip(&self.lines)))
    }

    fn by_singularity(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut names: Vec<&str> = self.lines.iter().map(|line| &*line.singularities).collect();
        names.sort_unstable();
        names.dedup();
        let group = |name: Option<&str>| {
            let lines = self.lines.iter();
            let of = lines.filter(|line| name.is_none_or(|name| line.singularities == name));
            (name.unwrap_or("all").to_owned(), of.collect::<Vec<_>>())
        };
        type Group<'a> = (String, Vec<&'a Line>);
        let count = |outcome| {
            move |(_, lines): &Group<'_>| {
                lines.iter().filter(|line| line.outcome == outcome).count()
            }
        };
        let rows = |lines: &Vec<&Line>| -> Vec<Row> {
            lines.iter().filter_map(|line| line.score.clone()).collect()
        };
        let columns = Columns::<Group<'_>>::new()
            .text("singular", |(name, _)| name.clone())
            .number("lines", |(_, lines)| lines.len())
            .number("reached", count(Outcome::Reached))
            .number("refused", count(Outcome::Refused))
            .number("missed", count(Outcome::Missed))
            .number("silent", count(Outcome::Silent))
            .number("S2 %", |(_, lines)| {
                let s2 = rows(lines).iter().filter(|row| row.task.s2).count();
                format!("{:.0}", 100.0 * s2 as f64 / lines.len() as f64)
            })
            .number("torque step, largest", |(_, lines)| {
                let steps = rows(lines);
                let steps = steps.iter().map(|row| row.joints.torque_step_max_ratio);
                format!("{:.1} %", 100.0 * steps.fold(0.0, f64::max))
            })
            .number("plan, median and largest, ms", |(_, lines)| {
                let of = |share| quantile(lines.iter().map(|line| line.planning_ms), share);
                format!("{:.0} {:.0}", of(0.5), of(1.0))
            });
        let groups = names.into_iter().map(Some).chain([None]).map(group);
        writeln!(f, "{}", columns.print(groups))
    }
}
