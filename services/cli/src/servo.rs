//! `armplane servo`: a person, a file or another program steers the arm.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use lab::studies::steered;
use runtime::RunDir;
use session::{Failure, Observer, Progress, Python, Request, Steering, Targets, load};
use shared_types::job::Mode;

use crate::live::{Lines, OperatorSocket, Panel, read_keys};
use crate::out::Form;
use crate::progress::observe;
use crate::run;

#[derive(Args)]
pub(crate) struct ServoArgs {
    /// A robot, URDF file, scenario, or scenario file; several robots with --seeds.
    #[arg(value_name = "ROBOT|SCENARIO", default_values_t = [DEFAULT.to_owned()])]
    subject: Vec<String>,
    /// Source of the targets: a file (format in docs/servo.md), `-` for lines on standard input, `keyboard`, or `topic` for a process of the
    /// graph [default: the scenario's own].
    #[arg(long, value_name = "FILE|-|keyboard|topic", conflicts_with = "random")]
    from: Option<String>,
    /// Random twists with this seed.
    #[arg(long, value_name = "SEED")]
    random: Option<u64>,
    /// Judge random twists with N seeds per robot, and print a table; no run is kept. Needs the Python package.
    #[arg(long, value_name = "N", conflicts_with_all = ["from", "random", "out", "start", "graph", "live", "ros2"], value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: Option<u64>,
    /// Start posture: a name, or joint positions in degrees [default: nominal, bent or ready].
    #[arg(long, value_name = "NAME|DEG,DEG,…", allow_hyphen_values = true)]
    start: Option<String>,
    /// Longest duration in seconds; random twists last 60 by default.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    duration: Option<f64>,
    /// In place of the simulated arm: MuJoCo (docs/python.md).
    #[arg(long, value_name = "mujoco|mujoco:SCENE.xml", conflicts_with = "seeds")]
    plant: Option<String>,
    /// Folder for the results [default: the next free runs/NAME-NNN].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Pace of the run.
    #[arg(long, value_enum, default_value = "lockstep")]
    mode: run::ModeArg,
    /// Your own process graph (`extends = "servo"`).
    #[arg(long, value_name = "FILE.toml")]
    graph: Option<PathBuf>,
    /// Override a value of the scenario, for example servo.speed_m_s=0.1 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Show the run live in the Rerun viewer.
    #[arg(long)]
    live: bool,
    /// Show the run on topics of ROS 2 (docs/ros2.md), and by default steer it there; options: rate=HZ, units, clock, network.
    #[arg(long, value_name = "OPTION,…", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    ros2: Option<String>,
}

/// The session of `armplane servo` without arguments.
const DEFAULT: &str = "servo-panda";

/// Words of `--from`.
const KEYBOARD: &str = "keyboard";
const LINES: &str = "-";
const TOPIC: &str = "topic";

/// Duration of random twists, s.
const RANDOM_S: f64 = 60.0;

/// A duration that a session can have.
fn seconds(text: &str) -> Result<f64, String> {
    let longest = 36_000.0;
    let duration = text
        .parse()
        .ok()
        .filter(|duration: &f64| *duration > 0.0 && *duration <= longest);
    duration
        .ok_or_else(|| format!("it must be a number of seconds, more than 0 and at most {longest}"))
}

pub(crate) fn servo(args: &ServoArgs, form: Form) -> Result<bool, Failure> {
    if let Some(seeds) = args.seeds {
        return Err(judge(args, seeds, matches!(form, Form::Json)));
    }
    let [subject] = args.subject.as_slice() else {
        return Err(Failure::input(
            "give one robot or scenario; several need --seeds N",
        ));
    };
    let from = args.from.as_deref();
    from.map_or(Ok(()), check_source)?;
    let loaded = steering(args, subject, targets(args)).load()?;
    // Before anything is made for the run.
    if from == Some(KEYBOARD) && !std::io::stdin().is_terminal() {
        return Err(Failure::input(
            "standard input is not a terminal: use --from FILE, or --from - for lines",
        ));
    }
    let request = Request {
        plant: args.plant.clone(),
        ros2: args.ros2.clone(),
        scenario: subject.clone(),
        settings: Vec::new(),
        from: None,
        seed: None,
        graph: None,
        mode: Mode::from(args.mode),
        out: args.out.clone(),
        record: true,
        live: args.live,
        silence_limit: None,
        unread: crate::out::unread,
    };
    let (lines, rate_hz) = (Arc::<Lines>::default(), loaded.scenario.rate_hz);
    let (operator, mut panel, mut has_begun) = (OperatorSocket::default(), None, false);
    let mut begin = |run: &RunDir| -> Result<(), Failure> {
        let is_first = !std::mem::replace(&mut has_begun, true);
        operator.move_to(run);
        // The one before leaves the terminal as it was.
        drop(panel.take());
        match from {
            Some(KEYBOARD) => {
                panel = Some(Panel::of_keyboard(run)?);
                if is_first {
                    read_keys(&operator)?;
                }
            }
            Some(LINES) if is_first => lines.send(&operator, rate_hz)?,
            _ => {}
        }
        Ok(())
    };
    // The panel has the terminal's last line.
    let has_panel = from == Some(KEYBOARD);
    let silent = |_: Progress<'_>| {};
    let shown: Observer<'_> = if has_panel { &silent } else { &observe };
    let finished = session::run_loaded(&request, loaded, &mut begin, shown);
    drop(panel);
    let is_done = run::conclude(finished?, form)?;
    lines.verdict().map(|()| is_done)
}

/// The source of the targets.
fn targets(args: &ServoArgs) -> Targets {
    match (args.from.as_deref(), args.random) {
        (_, Some(seed)) => Targets::Text(steered::twists(seed, args.duration.unwrap_or(RANDOM_S))),
        (None, None) if args.ros2.is_some() => Targets::Live,
        (None, None) => Targets::Scenario,
        (Some(TOPIC), _) => Targets::Process,
        (Some(KEYBOARD | LINES), _) => Targets::Live,
        (Some(file), _) => Targets::File(file.into()),
    }
}

/// Refuses a word that is neither a source of targets nor a file.
fn check_source(from: &str) -> Result<(), Failure> {
    let (path, known) = (Path::new(from), [KEYBOARD, TOPIC, LINES]);
    if known.contains(&from) || path.exists() || path.extension().is_some() {
        return Ok(());
    }
    let more = "or give the path of a file of targets, see docs/servo.md";
    let sentence = load::unknown("source of targets", from, known.into_iter(), more);
    Err(Failure::Input(sentence))
}

/// Becomes the study of random twists of so many seeds on each robot.
fn judge(args: &ServoArgs, seeds: u64, as_json: bool) -> Failure {
    let given = args.subject.iter().filter(|one| *one != DEFAULT).cloned();
    let option = |name: &str, value: &dyn ToString| format!("--{name}={}", value.to_string());
    let words = ["steered".to_owned()].into_iter().chain(given);
    let words = words.chain([option("seeds", &seeds)]);
    let duration = args.duration.map(|seconds| option("duration", &seconds));
    let set = args.set.iter().map(|setting| option("set", setting));
    let json = as_json.then(|| "--json".to_owned());
    Python::exec("experiments", words.chain(duration).chain(set).chain(json))
}

fn steering(args: &ServoArgs, subject: &str, targets: Targets) -> Steering {
    Steering {
        subject: subject.to_owned(),
        targets,
        start: args.start.clone(),
        duration_s: args.duration,
        settings: args.set.clone(),
        seed: None,
        graph: args.graph.clone(),
    }
}
