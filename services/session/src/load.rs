//! Reads names and files into validated values. Nothing starts before all of them are valid.

use std::hash::{BuildHasher, RandomState};
use std::path::{Path, PathBuf};
use std::process::Command;

use model::{Robot, RobotError, RobotText, description};
use shared_types::file::{self, Complaint};
use shared_types::graph::Graph;
use shared_types::job::{Job, Mode};
use shared_types::process::Program;
use shared_types::scenario::{Mount, Scenario, Start};
use shared_types::target_file::{self, InvalidRow};
use shared_types::topics::PRESSING;
use sim::scenarios;

use crate::arm_faults;
use crate::failure::Failure;
use crate::mujoco;
use crate::results::SCENARIO;
use crate::seal;
use crate::units;

/// The scenario of `armplane` without arguments.
pub const DEFAULT_SCENARIO: &str = "fig5-wrist-rotation";

/// Endings of the files that an arm is read from.
const URDF: &str = ".urdf";
const MJCF: &str = ".xml";

/// A scenario with its robot, its start posture and its process graph, all checked against each other.
pub struct Loaded {
    /// With the settings applied.
    pub scenario: Scenario,
    /// The arm it names.
    pub robot: Robot,
    /// The processes it runs in.
    pub graph: Graph,
}

/// A scenario by built-in name or path, with settings applied.
///
/// # Errors
/// [`Failure::Input`] or [`Failure::File`] if there is no such scenario, or it, its robot or its faults are invalid.
pub fn scenario(name: &str, settings: &[String], seed: Option<u64>) -> Result<Loaded, Failure> {
    scenario_in(None, name, settings, seed)
}

/// A scenario with another graph's processes, if a file is given.
///
/// # Errors
/// As [`scenario`], and as [`graph`].
pub fn scenario_in(
    graph_file: Option<&Path>,
    name: &str,
    settings: &[String],
    seed: Option<u64>,
) -> Result<Loaded, Failure> {
    Source::read(name)?.scenario(graph_file, settings, seed)
}

/// The text of a scenario, and its source.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file as the user gave it; of a built-in scenario `NAME.toml`.
    pub file: String,
    /// The file's text.
    pub text: String,
    /// The folder from which the paths in it count; empty is the working directory, as for a built-in scenario.
    pub folder: PathBuf,
}

impl Source {
    /// The text of a scenario by built-in name or path.
    ///
    /// # Errors
    /// [`Failure::Input`] if there is no such scenario.
    pub fn read(name: &str) -> Result<Self, Failure> {
        if let Some(text) = scenarios::text(name) {
            return Ok(Self {
                file: format!("{name}.toml"),
                text: text.to_owned(),
                folder: PathBuf::new(),
            });
        }
        let path = Path::new(name);
        if let Some(remedy) = instead(path) {
            return Err(Failure::Input(format!(
                "{name} is not a scenario: {remedy}"
            )));
        }
        let is_path = name.contains('/') || path.extension().is_some();
        let file = format!("{name}.toml");
        let mut known: Vec<&str> = scenarios::names().collect();
        known.extend(Some(&*file).filter(|file| Path::new(file).is_file()));
        let built_in = name
            .strip_suffix(".toml")
            .filter(|name| scenarios::text(name).is_some());
        if !path.exists() && (!is_path || built_in.is_some()) {
            return Err(Failure::Input(unknown(
                "scenario",
                name,
                known.into_iter(),
                "or give the path of a scenario file (.toml), see `armplane list`",
            )));
        }
        let (text, folder) = (read(path)?, path.parent().unwrap_or(Path::new("")));
        is_for(name, &text, "a scenario")?;
        Ok(Self {
            file: name.to_owned(),
            text: seal::open(name, text, folder)?,
            folder: folder.to_owned(),
        })
    }

    /// The scenario with settings and seed applied, its robot and graph, all checked.
    ///
    /// # Errors
    /// See [`scenario_in`].
    pub fn scenario(
        &self,
        graph_file: Option<&Path>,
        settings: &[String],
        seed: Option<u64>,
    ) -> Result<Loaded, Failure> {
        let mut scenario = self.parse(settings)?;
        scenario.seed = seed.unwrap_or(scenario.seed);
        self.load(scenario, graph_file)
    }

    /// The scenario with settings applied, not yet checked against robot and graph.
    ///
    /// # Errors
    /// [`Failure::File`] if text or settings are invalid.
    pub fn parse(&self, settings: &[String]) -> Result<Scenario, Failure> {
        Scenario::parse(&self.file, &self.text, settings).map_err(|error| {
            let lost = settings.iter().find_map(|setting| misplaced(setting));
            lost.unwrap_or_else(|| error.into())
        })
    }

    /// Robot, targets and graph of a scenario from here, all checked.
    ///
    /// # Errors
    /// See [`scenario_in`].
    pub(crate) fn load(
        &self,
        mut scenario: Scenario,
        graph_file: Option<&Path>,
    ) -> Result<Loaded, Failure> {
        let robot = self.robot(&scenario)?;
        let own_graph = Some(&scenario.graph)
            .filter(|file| !file.is_empty())
            .map(|file| self.beside(file));
        self.read_targets(&mut scenario)?;
        self.read_tables(&mut scenario)?;
        let graph = graph_of(&scenario, graph_file.or(own_graph.as_deref()))?;
        check(&scenario, &robot, &graph).map_err(|complaint| self.located(complaint))?;
        Ok(Loaded {
            scenario,
            robot,
            graph,
        })
    }

    /// Reads the file of a steered run's targets, where the scenario names one that has not been read.
    ///
    /// # Errors
    /// [`Failure::Input`] if it cannot be read, [`Failure::File`] if it is no list of targets.
    fn read_targets(&self, scenario: &mut Scenario) -> Result<(), Failure> {
        let rate_hz = scenario.rate_hz;
        if let Some(session) = &mut scenario.servo
            && !session.input.is_empty()
            && session.targets.is_empty()
        {
            session.targets = targets(&self.beside(&session.input), rate_hz)?;
        }
        Ok(())
    }

    /// Reads the files of the segments' tables that have not been read, and gives the segments the times of their tables.
    ///
    /// # Errors
    /// [`Failure::Input`] if one cannot be read, [`Failure::File`] if it is no table of poses.
    fn read_tables(&self, scenario: &mut Scenario) -> Result<(), Failure> {
        for (i, segment) in scenario.segment.iter_mut().enumerate() {
            if let Some(table) = segment.table.as_mut().filter(|table| table.rows.is_empty()) {
                let path = self.beside(&table.file);
                table.rows = rows(&path)?;
                table
                    .poses()
                    .map_err(|error| in_file(error, &path, &table.rows))?;
            }
            segment
                .take_times()
                .map_err(|complaint| self.located(complaint.within(&format!("segment.{i}"))))?;
        }
        // The times of a table may be too many, or its ramp too long for it.
        scenario
            .check()
            .map_err(|complaint| self.located(complaint))
    }

    /// The robot that a scenario from here names.
    ///
    /// # Errors
    /// [`Failure::File`] if there is no such robot, or its description is invalid.
    pub fn robot(&self, scenario: &Scenario) -> Result<Robot, Failure> {
        let located = |key: &'static str| {
            move |failure| match failure {
                Failure::Input(sentence) => self.located(Complaint::new(key, sentence, "")),
                other => other,
            }
        };
        let robot = robot_in(&self.folder, &scenario.robot, scenario.frame(), None);
        let robot = robot.map_err(located("robot"))?;
        match &scenario.mount {
            Some(mount) => mounted(&robot, mount).map_err(located("mount")),
            None => Ok(robot),
        }
    }

    /// The path of a file that a scenario from here names.
    pub fn beside(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    fn located(&self, complaint: Complaint) -> Failure {
        Failure::from(complaint.locate(&self.file, &self.text))
    }
}

/// Checks a scenario against its robot and graph.
///
/// # Errors
/// [`Complaint`] if its frame, its faults or its start posture do not fit.
fn check(scenario: &Scenario, robot: &Robot, graph: &Graph) -> Result<(), Complaint> {
    if let Some(name) = scenario.frame() {
        let frame = robot.frames.iter().find(|frame| frame.name == name);
        // Frames before the last joint leave joints out.
        let last = robot.joints.len().checked_sub(1);
        let ends = robot.frames.iter().filter(|frame| frame.joint == last);
        let names = ends.map(|frame| frame.name.as_str());
        let wrong = match frame {
            None => Some(unknown("frame", name, names, "")),
            Some(frame) if frame.joint.is_none() => {
                Some(format!("the frame `{name}` stands still with the base"))
            }
            Some(_) => None,
        };
        if let Some(wrong) = wrong {
            let remedy = format!("left out, it is the arm's own, `{}`", robot.default_frame);
            return Err(Complaint::new("frame", wrong, remedy));
        }
    }
    if scenario.servo.is_some()
        && !graph
            .process("controller")
            .is_some_and(|one| one.reads.iter().any(|topic| topic == "target"))
    {
        return Err(Complaint::new(
            "servo",
            "the graph's controller does not read `target`",
            "extends = \"servo\" in the graph",
        ));
    }
    scenario.scheduled_faults(graph)?;
    for (i, fault) in scenario.fault.iter().enumerate() {
        arm_faults::check(fault, robot)
            .map_err(|complaint| complaint.within(&format!("fault.{i}")))?;
    }
    units::check(scenario, robot)?;
    robot
        .complete()
        .map_err(|error| Complaint::new("robot", error.to_string(), ""))?;
    let (key, remedy) = match &scenario.start {
        Start { q: Some(_), .. } => ("start.q", "q is in rad and m, q_deg in degrees"),
        Start { q_deg: Some(_), .. } => ("start.q_deg", ""),
        _ => ("start.posture", ""),
    };
    robot
        .start_posture(&scenario.start)
        .map_err(|error| Complaint::new(key, error.to_string(), remedy))?;
    Ok(())
}

/// TOML files by their purpose: keys of which each has one, and a command for it.
const PURPOSES: [(&str, &str, &str); 4] = [
    ("a scenario", "segment servo robot", "run FILE"),
    ("a graph", "extends process topic", "graph FILE"),
    ("a sweep", "key sample", "sweep FILE"),
    (
        "the description of an arm",
        "default_frame base_frame length_m task joints tool payload postures",
        "inspect --robot ARM.urdf",
    ),
];

/// Refuses a file that is meant for something else; an unreadable one says so itself, later.
fn is_for(file: &str, text: &str, wanted: &str) -> Result<(), Failure> {
    let table: toml::Table = toml::from_str(text).unwrap_or_default();
    let has = |keys: &str| keys.split(' ').any(|key| table.contains_key(key));
    let all = PURPOSES.iter().filter(|(_, keys, _)| has(keys));
    let found: Vec<_> = all.collect();
    match found[..] {
        [(purpose, _, command)] if *purpose != wanted => {
            let command = command.replace("FILE", file);
            let use_it = format!("it is {purpose}, for `armplane {command}`");
            Err(Failure::Input(format!("{file} is not {wanted}: {use_it}")))
        }
        _ => Ok(()),
    }
}

/// A setting whose key has lost its section: `k_p` for `control.k_p`.
fn misplaced(setting: &str) -> Option<Failure> {
    let key = setting.split('=').next().filter(|key| !key.contains('.'))?;
    let schema: serde_json::Value = serde_json::from_str(crate::schema::SCENARIO).ok()?;
    let sections = schema["properties"].as_object()?;
    let has = |section: &serde_json::Value| {
        let of = section["$ref"]
            .as_str()
            .or(section["items"]["$ref"].as_str());
        of.and_then(|of| schema.pointer(of.trim_start_matches('#')))
            .is_some_and(|of| of["properties"].get(key).is_some())
    };
    let within = |(name, section): (&String, &serde_json::Value)| {
        let element = if section["type"] == "array" { ".0" } else { "" };
        has(section).then(|| format!("{name}{element}.{key}"))
    };
    let places: Vec<_> = sections.iter().filter_map(within).collect();
    let is_lost = !sections.contains_key(key) && !places.is_empty();
    is_lost.then(|| {
        let places = places.join("` or `");
        Failure::Input(format!("setting {setting}: did you mean `{places}`?"))
    })
}

/// The remedy for a file or folder that is no scenario.
fn instead(path: &Path) -> Option<String> {
    let name = path.display();
    let folder = files::folder_of(path).display();
    if path.is_dir() {
        return Some(match path.join(SCENARIO).exists() {
            true => format!(
                "it is the folder of a run, which `armplane run {name}/{SCENARIO}` makes again"
            ),
            false => "it is a folder; give the path of a scenario file (.toml)".to_owned(),
        });
    }
    match path.extension().filter(|_| path.exists())?.to_str()? {
        "urdf" | "xml" => Some(format!(
            "it is an arm; `armplane new NAME --robot {name}` writes a scenario for it"
        )),
        "rrd" => Some(format!(
            "it is a recording; `armplane view {name}` shows it"
        )),
        "csv" => Some(format!(
            "it is a table; a segment of a scenario follows one of poses: table = {{ file = \"{name}\" }}, and `armplane servo ARM --from {name}` one of targets"
        )),
        "mcap" => Some(format!(
            "it has the messages of a run, which `armplane replay {folder}` takes"
        )),
        _ => None,
    }
}

/// Whether the arm of this name is read from a file.
pub(crate) fn is_arm_file(name: &str) -> bool {
    [URDF, MJCF].iter().any(|ending| name.ends_with(ending))
}

/// A robot by built-in name, or a URDF or MJCF with an optional description beside it (`arm.urdf`, `arm.toml`). Of a URDF with several arms, whose description
/// names none, it is the one that ends in `frame`; with `base` the arm from this link on.
///
/// # Errors
/// [`Failure::Input`] if there is no such robot, or its description is invalid.
pub fn robot(name: &str, frame: Option<&str>, base: Option<&str>) -> Result<Robot, Failure> {
    robot_in(Path::new(""), name, frame, base)
}

/// The same, where a path counts from a folder.
fn robot_in(
    folder: &Path,
    name: &str,
    frame: Option<&str>,
    base: Option<&str>,
) -> Result<Robot, Failure> {
    if let Some(stem) = name.strip_suffix(".xacro") {
        let stem = stem.trim_end_matches(URDF);
        return Err(Failure::Input(format!(
            "{name} is not an arm yet: expand it, `xacro {name} > {stem}{URDF}`, and name that file"
        )));
    }
    let path = folder.join(name);
    if !is_arm_file(name) {
        if path.is_file() {
            return Err(Failure::Input(format!(
                "{name} is not an arm: give a file that ends in {URDF}, or {MJCF} for MuJoCo's format"
            )));
        }
        let names = Robot::builtin_names();
        if !names.contains(&name) {
            let more = format!("or give the path of a URDF or MJCF file ({URDF}, {MJCF})");
            return Err(Failure::Input(unknown(
                "robot",
                name,
                names.iter().copied(),
                &more,
            )));
        }
        let robot = Robot::builtin(name).map_err(Failure::input)?;
        return match base {
            Some(base) => from_base(robot.source, base).map_err(Failure::input),
            None => Ok(robot),
        };
    }
    let refused = |error: String| Failure::Input(format!("{}: {error}", path.display()));
    let mut source = files::robot(&path, None).map_err(Failure::Input)?;
    if name.ends_with(MJCF) {
        let (urdf, own) = mujoco::compile(&path).map_err(refused)?;
        source.urdf = urdf;
        let all = description::merged(&own, &source.description);
        source.description = all.map_err(|error| refused(error.to_string()))?;
    }
    let made = match base {
        Some(base) => from_base(source, base),
        None => Robot::from_source_at(&source, frame),
    };
    made.map_err(|error| refused(error.to_string()))
}

/// The arm as it is mounted: its description has the scenario's keys, so that every process knows them.
fn mounted(robot: &Robot, mount: &Mount) -> Result<Robot, Failure> {
    let mut description: toml::Table = robot.source.description.parse().map_err(Failure::input)?;
    let mut mount = toml::Table::try_from(mount).map_err(Failure::input)?;
    // It is for curves in the frame `world`, which the arm does not know.
    mount.remove("base_m");
    description.extend(mount);
    Robot::from_source(&RobotText {
        description: description.to_string(),
        ..robot.source.clone()
    })
    .map_err(Failure::input)
}

/// The arm from a link of its URDF on: the joints before `base` are no part of it, and what the description says of the whole chain (factors, length, task
/// axes, postures) does not hold for the rest.
fn from_base(mut source: RobotText, base: &str) -> Result<Robot, RobotError> {
    let Ok(mut description) = source.description.parse::<toml::Table>() else {
        // It names the line.
        return Robot::from_source(&source);
    };
    for whole in ["factors", "length_m", "task", "postures"] {
        description.remove(whole);
    }
    description.insert("base_frame".to_owned(), base.into());
    source.description = description.to_string();
    Robot::from_source(&source)
}

/// The process graph of a scenario: the user's, or the built-in one, which fits the scenario.
///
/// # Errors
/// See [`graph`].
pub fn graph_of(scenario: &Scenario, file: Option<&Path>) -> Result<Graph, Failure> {
    let graph = match file {
        None => Graph::of(scenario)?,
        Some(_) => graph(file)?,
    };
    if scenario.has_wrist_sensor() && graph.writer(PRESSING).is_none() {
        return Err(Failure::Input(format!(
            "{} controls a force by a sensor at the wrist, and no process of the graph writes `{PRESSING}`: extend the graph \"force\" (\"servo-force\" where it is steered), or set plant.wrist_sensor = false",
            scenario.name
        )));
    }
    Ok(graph)
}

/// The process graph: the user's, or the built-in one.
///
/// # Errors
/// [`Failure::Input`] or [`Failure::File`] if the file cannot be read or is invalid.
pub fn graph(file: Option<&Path>) -> Result<Graph, Failure> {
    let Some(path) = file else {
        return Ok(Graph::built_in(false)?);
    };
    let (name, text) = (path.display().to_string(), read(path)?);
    is_for(&name, &text, "a graph")?;
    let mut graph = Graph::parse(&name, &text)?;
    if !graph
        .process
        .iter()
        .any(|process| process.program() == Some(Program::Recorder))
    {
        return Err(Failure::Input(format!(
            "{name}: no process records the run, and its account comes from the recorder: extends = \"armplane\", or a process with \
             program = \"recorder\" (`--no-record` leaves out the recording, not the account)"
        )));
    }
    let folder = path
        .parent()
        .unwrap_or(Path::new(""))
        .join(graph.folder.unwrap_or_default());
    let folder = if folder.as_os_str().is_empty() {
        PathBuf::from(".")
    } else {
        folder
    };
    let canonical = folder.canonicalize().map_err(|error| {
        Failure::Input(format!("{name}: folder: {}: {error}", folder.display()))
    })?;
    for process in &graph.process {
        if let Some(command) = process.command.first() {
            check_program(command, &canonical).map_err(|reason| {
                Failure::Input(format!(
                    "{name}: the command of `{}`: {reason}",
                    process.name
                ))
            })?;
        }
    }
    graph.folder = Some(canonical);
    Ok(graph)
}

/// The program of a command: a name is looked for in PATH, a path counts from the graph's folder.
pub fn program(command: &str, folder: Option<&Path>) -> PathBuf {
    match folder.filter(|_| command.contains('/')) {
        Some(folder) => folder.join(command),
        None => PathBuf::from(command),
    }
}

/// The command that the graph gives a process, in the folder of the graph's file; `None` if it gives none.
pub fn command(graph: &Graph, process: &str) -> Option<Command> {
    let (first, arguments) = graph.process(process)?.command.split_first()?;
    let folder = graph.folder.as_deref();
    let mut command = Command::new(program(first, folder));
    command
        .args(arguments)
        .current_dir(folder.unwrap_or(Path::new(".")));
    Some(command)
}

/// Whether there is a program that can be started.
fn check_program(command: &str, folder: &Path) -> Result<(), String> {
    use std::os::unix::fs::PermissionsExt;
    let is_program = |path: &Path| {
        path.metadata()
            .is_ok_and(|file| file.is_file() && file.permissions().mode() & 0o111 != 0)
    };
    if command.contains('/') {
        let path = program(command, Some(folder));
        return match (path.exists(), is_program(&path)) {
            (_, true) => Ok(()),
            (true, false) => Err(format!(
                "{0} is not an executable file: `chmod +x {0}`, or name its interpreter first, as in [\"python3\", \"{command}\"]",
                path.display()
            )),
            (false, _) => Err(format!(
                "there is no program {}: build it, or correct the path (relative to the graph's folder)",
                path.display()
            )),
        };
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    match std::env::split_paths(&folders).any(|folder| is_program(&folder.join(command))) {
        true => Ok(()),
        false => Err(format!(
            "there is no program `{command}` in PATH; for a file beside the graph, write `./{command}`"
        )),
    }
}

/// A run of a scenario in the processes of a graph, everything recorded.
pub fn job(robot: &Robot, scenario: Scenario, graph: Graph, mode: Mode, out: PathBuf) -> Job {
    Job {
        // The launcher knows it.
        run: String::new(),
        // The keys of the hash are random.
        id: RandomState::new().hash_one(std::process::id()),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        mode,
        out,
        record: true,
        robot: robot.source.clone(),
        dof: robot.dof() as u32,
        scenario,
        graph,
        from: None,
        deaths: Vec::new(),
    }
}

/// "there is no X `name`", with the nearest known name.
pub fn unknown<'a>(
    what: &str,
    name: &str,
    known: impl Iterator<Item = &'a str>,
    more: &str,
) -> String {
    let known: Vec<&str> = known.collect();
    let hint = match file::nearest(name, known.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("there are {}", known.join(", ")),
    };
    let more = match (hint.ends_with('?'), more) {
        (_, "") => String::new(),
        (true, more) => format!(" ({more})"),
        (false, more) => format!("; {more}"),
    };
    format!("there is no {what} `{name}`: {hint}{more}")
}

/// The text of a file that a person wrote: a scenario, a graph, a description of an arm.
///
/// # Errors
/// [`Failure::Input`] with the remedy, if it cannot be read or has more than 4 MiB.
pub fn read(path: &Path) -> Result<String, Failure> {
    files::text(path, files::LARGEST_WRITTEN).map_err(Failure::Input)
}

/// The text of a file of targets.
///
/// # Errors
/// [`Failure::Input`] with the remedy, if it cannot be read or has more than 256 MiB; [`Failure::File`] if it is no list of targets.
pub(crate) fn targets(path: &Path, rate_hz: u32) -> Result<String, Failure> {
    let text = rows(path)?;
    target_file::parse(&text, rate_hz).map_err(|error| in_file(error, path, &text))?;
    Ok(text)
}

/// The text of a file that a program may have written: targets, a table of poses.
fn rows(path: &Path) -> Result<String, Failure> {
    files::text(path, files::LARGEST).map_err(Failure::Input)
}

/// The defect of a row, at its place in a file.
pub(crate) fn in_file(error: InvalidRow, path: &Path, text: &str) -> Failure {
    error.in_file(&path.display().to_string(), text).into()
}
