//! The scenario of a steered run: an arm or a scenario, and the source of its targets.

use std::path::PathBuf;

use model::Robot;
use shared_types::process::{Process, Program};
use shared_types::scenario::{self, Start};
use shared_types::target_file;
use sim::scenarios;

use crate::failure::Failure;
use crate::load::{self, Loaded, Source};

/// Where the targets of a session come from.
#[derive(Clone, Debug)]
pub enum Targets {
    /// From the scenario itself.
    Scenario,
    /// From a file.
    File(PathBuf),
    /// From a text in the same format.
    Text(String),
    /// From lines sent to the operator's socket while the run lasts.
    Live,
    /// From a process of the graph.
    Process,
}

/// A session as it is asked for.
#[derive(Clone, Debug)]
pub struct Steering {
    /// A built-in robot, a URDF file, a built-in scenario, or a scenario file.
    pub subject: String,
    /// Its targets.
    pub targets: Targets,
    /// The posture in which a robot starts: one that its description names, or joint positions in degrees.
    pub start: Option<String>,
    /// Longest duration, s.
    pub duration_s: Option<f64>,
    /// Values that override those of the scenario.
    pub settings: Vec<String>,
    /// Seed of every random number of the run.
    pub seed: Option<u64>,
    /// A process graph.
    pub graph: Option<PathBuf>,
}

/// Default start postures of a session; the first one that the robot's description has is used.
const STARTS: [&str; 4] = ["home", "nominal", "bent", "ready"];

/// Duration of a session without a stated end, s.
const OPEN_S: f64 = 3600.0;

impl Steering {
    /// The scenario of the session, its robot and its graph.
    ///
    /// # Errors
    /// [`Failure::Input`] or [`Failure::File`] if one of them cannot be used.
    pub fn load(&self) -> Result<Loaded, Failure> {
        let subject = &self.subject;
        let is_scenario = scenarios::text(subject).is_some() || subject.ends_with(".toml");
        let source = if is_scenario {
            Source::read(subject)?
        } else {
            self.source()?
        };
        let mut scenario = source.parse(&self.settings)?;
        scenario.seed = self.seed.unwrap_or(scenario.seed);
        let was_steered = scenario.servo.is_some() && is_scenario;
        if is_scenario && !was_steered {
            // Its words are those of its path.
            scenario.name = format!("servo-{}", scenario.name);
            scenario.title = format!("{subject}, steered");
            scenario.about.clear();
        }
        let session = scenario.servo.get_or_insert_default();
        scenario.segment.clear();
        let targets = match &self.targets {
            Targets::Scenario if was_steered => None,
            Targets::Scenario => {
                return Err(Failure::Input(format!(
                    "{subject} is not steered: it has no [servo]; give targets with --from FILE, or --random SEED"
                )));
            }
            Targets::File(file) => Some(load::targets(file, scenario.rate_hz)?),
            Targets::Text(text) => Some(text.clone()),
            Targets::Live | Targets::Process => Some(String::new()),
        };
        let is_live = matches!(self.targets, Targets::Live);
        let is_others = matches!(self.targets, Targets::Process);
        if let Some(targets) = targets {
            (session.targets, session.live) = (targets, is_live);
            session.input.clear();
        }
        let is_open = is_live || is_others && session.duration_s <= 0.0;
        let usual_s = if is_open { OPEN_S } else { session.duration_s };
        session.duration_s = self.duration_s.unwrap_or(usual_s);
        let loaded = source.load(scenario, self.graph.as_deref())?;
        let Loaded {
            scenario,
            robot,
            graph,
        } = &loaded;
        let writer = graph.writer("target").and_then(Process::program);
        if is_others && writer == Some(Program::Operator) {
            return Err(Failure::Input(
                "no process of the graph gives targets but armplane's operator, which has none: name a graph with a process of yours that writes `target`, \
                 as in --graph examples/steer/graph.toml"
                    .to_owned(),
            ));
        }
        if let (Targets::File(file), Some(session)) = (&self.targets, &scenario.servo) {
            target_file::check(&session.targets, scenario.rate_hz, robot.dof())
                .map_err(|error| load::in_file(error, file, &session.targets))?;
        }
        Ok(loaded)
    }

    /// A scenario for a robot.
    fn source(&self) -> Result<Source, Failure> {
        let robot = load::robot(&self.subject, None, None)?;
        let start = match &self.start {
            Some(text) if text.starts_with(|c: char| c.is_ascii_digit() || "-+.".contains(c)) => {
                let number = |part: &str| {
                    part.trim()
                        .parse::<f64>()
                        .map_err(|_| Failure::Input(format!("--start: `{part}` is not a number")))
                };
                let q = text.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
                Start {
                    q_deg: Some(q),
                    ..Start::default()
                }
            }
            name => Start {
                posture: Some(name.clone().map_or_else(|| default_start(&robot), Ok)?),
                ..Start::default()
            },
        };
        robot
            .start_posture(&start)
            .map_err(|error| Failure::Input(format!("--start: {error}")))?;
        let start = toml::Table::try_from(&start).map_err(Failure::work)?;
        let mut table = toml::Table::new();
        let name = scenario::as_name(&format!("servo-{}", robot.name));
        table.insert("name".to_owned(), name.into());
        table.insert("robot".to_owned(), self.subject.clone().into());
        table.insert("start".to_owned(), start.into());
        // The name of a file that is not read: the targets come from elsewhere.
        let session = toml::Table::from_iter([("input".to_owned(), toml::Value::from("-"))]);
        table.insert("servo".to_owned(), session.into());
        Ok(Source {
            file: format!("servo {}", self.subject),
            text: table.to_string(),
            folder: PathBuf::new(),
        })
    }
}

fn default_start(robot: &Robot) -> Result<String, Failure> {
    let found = STARTS
        .iter()
        .find(|name| robot.postures.contains_key(**name))
        .map(|name| (*name).to_owned());
    found
        .or_else(|| robot.postures.keys().next().cloned())
        .ok_or_else(|| {
            Failure::Input(format!(
                "{} has no named posture: give joint positions, --start=0,30,-60,…",
                robot.name
            ))
        })
}
