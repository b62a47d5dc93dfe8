//! The command line of `armplane`: one file per command, which owns its arguments, what it prints, and its verdict.
#![allow(non_snake_case)]

mod bench;
mod clean;
mod compare;
mod describe;
mod diff;
mod doctor;
mod drill;
mod experiments;
mod export;
mod failure;
mod fault;
mod generate;
mod graph;
mod inspect;
mod layout;
mod list;
mod live;
mod new;
mod out;
mod play;
mod process;
mod progress;
mod ps;
mod recover;
mod replay;
mod report;
mod run;
mod screen;
mod servo;
mod top;
mod usage;
mod verify;
mod view;

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

#[derive(Parser)]
#[command(
    name = "armplane",
    version,
    about = "Robot arms through kinematic singularities: five processes, shared memory, one recording",
    long_about = "Drives a robot arm through kinematic singularities by the strategy of Chang & Khatib (1995). Plant, estimator, analyzer, \
                  controller and recorder are processes that share memory.",
    after_help = "Examples:\n  armplane run                                run and record the default scenario\n  armplane run fig5-wrist-rotation --seed 7   the same with other noise\n  armplane list                               list scenarios and robots\n  armplane inspect --robot puma560 --q ready  show the arm at a posture\n\nExit code 0: success; 1: the run missed its goal, was stopped, or its results could not be written; 2: wrong input."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print results as JSON; an error is one JSON object on the last line of standard error.
    #[arg(long, global = true)]
    json: bool,
    /// Print more of a run's results; log more on standard error (-v, -vv).
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
}

#[derive(Subcommand)]
enum Command {
    /// Run a scenario and record it.
    #[command(
        after_help = "Examples:\n  armplane run\n  armplane run fig5-wrist-rotation --out /tmp/fig5 --seed 3\n  armplane run my.toml --set control.k_p=900 --set plant.friction=true"
    )]
    Run(run::RunArgs),
    /// Write a scenario to start from.
    #[command(
        long_about = "Writes NAME.toml, a commented scenario: a straight line that the arm follows, and back. It refuses to overwrite a file.",
        after_help = "Examples:\n  armplane new mine && armplane run mine.toml\n  armplane new mine --robot my-arm.urdf"
    )]
    New(new::NewArgs),
    /// Steer an arm by keyboard, file or program.
    #[command(
        long_about = "Moves an arm to targets as they arrive: twists, poses or joint positions. The arm keeps its limits, passes \
                      singularities, and reports at each tick what it does and why. It comes to rest when no new target arrives in time. Invalid \
                      targets are refused and counted.\n\n\
                      The targets are saved beside the run: `armplane run` of its scenario.toml gives the same bytes again. docs/servo.md \
                      describes the format.\n\n\
                      Keys of --from keyboard:\n\n  \
                      w s, a d, r f    move along x, y, z\n  \
                      i k, j l, u o    turn about x, y, z\n  \
                      1, 2, 3          axes of the base, the hand, the nearest singularity\n  \
                      + -              faster, slower\n  \
                      x                side on which to leave a singularity\n  \
                      space, q         stop, end",
        after_help = "Examples:\n  armplane servo servo-panda                    a built-in session\n  armplane servo ur5 --random 7                 60 s of random twists\n  armplane servo ur5 --from my-targets.csv --start bent\n  armplane servo --from topic --graph examples/steer/graph.toml panda --duration 10\n  armplane servo --seeds 20                     judge four arms on 20 seeds each\n\nExit code 1: the session did not end at rest at its reference, or --seeds found a session beyond its limits."
    )]
    Servo(servo::ServoArgs),
    /// Drag the hand of an arm in the browser.
    #[command(
        long_about = "Opens a browser page where you drag an arm by its hand through its singularities. The arm is a \
                      steered run (`armplane servo`). The page shows the singular direction ζ, measures and limits, and the reason for \
                      each slowing. Several browsers may watch, one steers.\n\nNeeds Python and its packages armplane and viser (docs/play.md).",
        after_help = "Examples:\n  armplane play\n  armplane play panda\n  armplane play my-arm.urdf --no-open\n  armplane play ur5 --host 0.0.0.0"
    )]
    Play(play::PlayArgs),
    /// Show what differs between two runs.
    #[command(
        long_about = "Compares the folders of two runs: the keys of their scenarios, robot, graph and version, outcome and numbers, and the first \
                      tick, topic and field whose messages differ. Timing, such as speed and latency, is left out.",
        after_help = "Examples:\n  armplane diff runs/fig5-wrist-rotation-001 runs/fig5-wrist-rotation-002\n  armplane diff before after --json\n\nExit code 0: they are the same; 1: they differ, or the answer could not be written; 2: wrong input."
    )]
    Diff(diff::DiffArgs),
    /// Check that runs under different conditions give the same bytes.
    #[command(
        long_about = "Runs a scenario in lockstep several times, each time under other conditions: other cores and nice values, random \
                      delays and pauses, stops, a busy thread on every core.\n\n\
                      Compares every message with a run on one thread. If a single thread cannot compute the scenario (death of the \
                      plant, recorder faults, programs of your own), it compares with the first run. It prints the first tick, topic and \
                      field that differ.",
        after_help = "Examples:\n  armplane verify fig5-wrist-rotation\n  armplane verify my.toml --runs 12 --json\n  armplane verify --kills 100\n\nExit code 1: some bytes differ."
    )]
    Verify(verify::VerifyArgs),
    /// Feed recorded inputs to one process and compare its outputs.
    #[command(
        long_about = "Feeds the recorded inputs of a run to one process of this build, and compares every output with the recorded one. \
                      It prints where they first differ (tick, topic, field, both values), and the largest difference of each field.\n\n\
                      Use it after changing a control law: build, replay an old run, and see what has changed.",
        after_help = "Examples:\n  armplane replay runs/fig5-wrist-rotation-001\n  armplane replay runs/fig5-wrist-rotation-001 --process estimator --json\n  armplane replay runs/fig5-wrist-rotation-001 --set control.k_p=900\n\nExit code 1: an output differs."
    )]
    Replay(replay::ReplayArgs),
    /// Measure hand-overs, cycles and steps on this machine.
    #[command(
        long_about = "Measures armplane's topics in alternating runs with bare iceoryx2, a futex and a pipe. The processes are real, \
                      pinned, and under SCHED_FIFO if allowed. A first round warms up; after it, every sample counts. Ratios are against \
                      the futex with the same placement and payload.",
        after_help = "Examples:
  armplane bench
  armplane bench hop cycle --samples 100000 --json
  armplane bench --out bench          table and JSON
  armplane bench lockstep --against ../base/target/release/armplane"
    )]
    Bench(bench::BenchArgs),
    /// Compare every control law on the same plant and seed.
    #[command(
        long_about = "Runs each scenario once per control law on one thread, with the same plant, seed, gains and governor. Prints one \
                      table per scenario and saves compare.json. The scenario `sweep` stands for seeded \
                      straight lines through and near each singularity of a PUMA.\n\n\
                      Errors are desired against true pose, split along and orthogonal to the singular directions ζ inside their \
                      neighbourhood. A jump is a tick in which a torque changes by more than a tenth of its limit. Chatter counts jumps \
                      back within 10 ms; energy sums the kinetic energy that each jump would leave in the arm before the velocity gain damps it.\n\n\
                      S1: orthogonal to ζ and at the end within 1 mm and 0.5°, no joint beyond its speed or position limit, no torque at \
                      its limit for more than 10 ms. S2: orthogonal to ζ within 1 mm and 3°, along ζ within 10 mm and 5°, otherwise the \
                      same.",
        after_help = "Examples:\n  armplane compare fig5-wrist-rotation elbow-in-and-out\n  armplane compare sweep --count 90 --speed 0.5 --json\n  armplane compare my.toml --law blended,damped-least-squares --set control.baseline.damped_least_squares.largest=0.1\n  armplane compare fig5-wrist-rotation --law blended,mine=mine.py\n\nExit code 1: a run failed, because a program ended by itself for instance."
    )]
    Compare(compare::CompareArgs),
    /// Run third-party controllers beside armplane's laws.
    #[command(
        long_about = "Runs armplane's laws and third-party controllers on the same tasks, in the same plant, under the same judge, and writes one page, a \
                      Parquet file and a hash. Needs the Python package that `python/build` makes, with its extra [arena]. The same command \
                      continues an arena that was stopped.",
        after_help = "Examples:\n  armplane arena --size short\n  armplane arena --law armplane --law mine=mine.py --robot ur5\n  armplane arena --law pin_pink:k_p=400:k_v=40 --out runs/soft\n  armplane arena -- --help"
    )]
    Arena(experiments::PythonArgs),
    /// Say what happened in a robot's log, and whether it was a singularity.
    #[command(
        long_about = "Reads a log of any arm (CSV, Parquet, MCAP, rosbag2, LeRobot) and says what happened, when, and why: a singularity, a limit, \
                      a gap, a jump, a NaN, an oscillation, or none of these. Needs the Python package that `python/build` makes, with its extra [autopsy].",
        after_help = "Examples:\n  armplane autopsy log.mcap --robot ur5e.urdf --tip tool0\n  armplane autopsy logs/ --robot panda\n  armplane autopsy -- --help"
    )]
    Autopsy(experiments::PythonArgs),
    /// Run a scenario under many settings on all cores, into Parquet.
    #[command(
        long_about = "Runs a scenario once per point of a grid or seeded sample over any keys of `armplane run --set`. Each run takes one \
                      thread and gives the same bytes as `armplane run`. It becomes a row of runs-*.parquet. If you stop a sweep, the \
                      same command continues it. Needs the Python package that `python/build` makes, with its extra [experiments].\n\n\
                      Arguments: SWEEP.toml, --out DIR, --jobs THREADS, --dask ADDRESS; or report DIR, --by COLUMN, --map KEY,KEY, --worst N.\n\n\
                      SWEEP.toml:\n\n  \
                      name = \"gains\"\n  scenario = \"fig5-wrist-rotation\"   # or a file beside this one\n\n  \
                      [[key]]\n  key = \"control.k_p\"\n  values = [100, 400, 900]\n\n  \
                      [[key]]\n  key = \"plant.mass_factor\"\n  from = 0.8\n  to = 1.2\n  steps = 5                          # evenly spaced; or scale = \"log\"\n\n  \
                      [sample]                           # at random, instead of steps; or method = \"sobol\"\n  runs = 1000\n  seed = 1",
        after_help = "Examples:\n  armplane sweep gains.toml\n  armplane sweep report runs/gains --by orientation_max_deg --map control.k_p,plant.mass_factor\n  armplane sweep gains.toml --dask tcp://host:8786"
    )]
    Sweep(experiments::PythonArgs),
    /// Draw the paper's Figures 1 to 5 from fresh runs.
    #[command(
        long_about = "Runs the scenarios of Chang & Khatib's Figures 1 to 5 and draws postures, errors and joint motion. Saves each figure as \
                      SVG, PDF and PNG, and the numbers as figures.json. Needs the Python package that `python/build` makes, with its extra [experiments].\n\n\
                      Arguments: --out DIR, --set KEY=VALUE.",
        after_help = "Examples:\n  armplane figures\n  armplane figures --out figures --set plant.encoder_bits=0"
    )]
    Figures(experiments::PythonArgs),
    /// List the runs that are alive: scenario, folder, tick.
    #[command(after_help = "Examples:\n  armplane ps\n  armplane ps --json")]
    Ps,
    /// Watch a running graph: processes, ticks, rates, misses.
    #[command(after_help = "Examples:\n  armplane top\n  armplane top --once --json")]
    Top(top::TopArgs),
    /// Open a recording in the Rerun viewer.
    #[command(
        long_about = "Opens a recording in the installed Rerun viewer, or in the one already open. To install it: `pip install \
                      rerun-sdk==0.36.3`, or `cargo install rerun-cli@0.36.3 --locked`.",
        after_help = "Examples:\n  armplane view\n  armplane view runs/fig5-wrist-rotation-001 --layout timing"
    )]
    View(view::ViewArgs),
    /// Write a run as one HTML page: the arm, plots, tables, log.
    #[command(
        after_help = "Examples:\n  armplane report\n  armplane report runs/fig5-wrist-rotation-001 --out fig5.html"
    )]
    Report(report::ReportArgs),
    /// Export a run's numbers and events for other tools.
    #[command(
        long_about = "Writes the numbers as one wide table (one row per tick), and log and states as another. Columns are named like \
                      `joint.q.1`, `singularity.s.wrist` or `error.position_mm.orthogonal`; Parquet has their units in its metadata.\n\n\
                      `rrd` is the recording for the Rerun viewer, `rbl` its layout. For MCAP, take messages.mcap from the \
                      run's folder.",
        after_help = "Examples:\n  armplane export --format csv\n  armplane export runs/fig5-wrist-rotation-001 --format parquet --out tables\n  armplane export --format rbl --layout timing"
    )]
    Export(export::ExportArgs),
    /// Inject a fault into a running graph.
    #[command(
        long_about = "Injects a fault into one process of a running graph, from its next tick on. The run leaves a scenario.toml with the \
                      fault planned at that tick: `armplane run` of it gives the same bytes again.",
        after_help = "Examples:\n  armplane fault --list\n  armplane fault controller kill\n  armplane fault estimator delay --delay 3 --for 0.5s\n  armplane fault plant sensor --as bias --joint 5 --amount 0.02"
    )]
    Fault(fault::FaultArgs),
    /// Try every fault on every process, and judge the arm.
    #[command(
        long_about = "Runs a scenario in lockstep once for every kind of fault in every process, and for a seeded sample of pairs. Each \
                      fault is injected live in mid-motion. The run is then repeated from its plan, which must give the same bytes.\n\n\
                      The simulator's true state is judged: torque and speed against their limits, age of the torque in force, largest \
                      torque step, distance from the fault-free path, and the final error. Lost messages and leftovers count too.\n\n\
                      With --realtime there is no repetition, and each run is judged by itself.",
        after_help = "Examples:\n  armplane drill\n  armplane drill --only controller:kill\n  armplane drill elbow-in-and-out --out drill\n  armplane drill --realtime --out drill\n\nExit code 1: a guarantee was broken."
    )]
    Drill(drill::DrillArgs),
    /// List the built-in scenarios and robots.
    #[command(after_help = "Example:\n  armplane list --json")]
    List,
    /// Show an arm's kinematics, dynamics and singularities at a posture.
    #[command(
        after_help = "Examples:\n  armplane inspect --robot puma560 --q ready\n  armplane inspect --robot puma560 --q-deg=20,-60,170,0,0,0\n  armplane inspect --robot my.urdf --frame tool0 --q=0,0.1,0.2,0,0,0 --qdot=0,0,0,0,0,1 --json"
    )]
    Inspect(inspect::InspectArgs),
    /// Finish a run whose launcher was killed.
    #[command(
        long_about = "Rebuilds the recording, summary.json and scenario.toml from job.json and the messages in the run's folder. Its faults are \
                      read from shared memory, so run this before `armplane clean`.",
        after_help = "Example:\n  armplane recover runs/fig5-wrist-rotation-001"
    )]
    Recover(recover::RecoverArgs),
    /// Show which process reads and writes which topic.
    #[command(
        after_help = "Examples:\n  armplane graph\n  armplane graph examples/energy/graph.toml --format topics\n  armplane graph --format dot | dot -Tsvg > graph.svg"
    )]
    Graph(graph::GraphArgs),
    /// Check shared memory, real-time rights, cores and leftovers.
    #[command(after_help = "Example:\n  armplane doctor")]
    Doctor,
    /// Remove leftovers of dead runs from shared memory; runs in progress stay.
    #[command(after_help = "Example:\n  armplane clean")]
    Clean,
    /// Generate completions, manual pages, JSON Schemas, or the wire for other languages.
    #[command(subcommand)]
    Generate(generate::Generate),
    /// One process of a bench.
    #[command(hide = true)]
    BenchPeer(bench::BenchPeerArgs),
    #[command(flatten)]
    Process(process::Command),
}

/// The commands by what they are for: those that a newcomer needs, and more.
const GROUPS: [(&str, &[&str], &[&str]); 5] = [
    (
        "Run and look",
        &["new", "run", "view", "report", "play"],
        &[
            "servo", "ps", "top", "export", "fault", "recover", "autopsy",
        ],
    ),
    ("Arms and graphs", &["list", "inspect"], &["graph"]),
    (
        "Compare",
        &["compare"],
        &["diff", "sweep", "arena", "figures", "replay"],
    ),
    ("Prove", &["verify"], &["drill"]),
    ("Machine", &["doctor"], &["clean", "bench", "generate"]),
];

/// The command line, whose help shows the groups.
fn command() -> clap::Command {
    // `--seed -1` is a wrong number, and no option `-1`.
    let numbers = |arg: clap::Arg| {
        let takes = arg.get_action().takes_values() && !arg.is_positional();
        arg.allow_negative_numbers(takes)
    };
    let command = Cli::command().mut_subcommands(|one| one.mut_args(numbers));
    let about = |name: &str| {
        let found = command
            .find_subcommand(name)
            .and_then(clap::Command::get_about);
        found.map(ToString::to_string).unwrap_or_default()
    };
    let mut template = "{about-with-newline}\n{usage-heading} {usage}\n\n".to_owned();
    for (title, first, more) in GROUPS {
        template += &format!("{title}:\n");
        for name in first {
            template += &format!("  {name:<9} {}\n", about(name));
        }
        if !more.is_empty() {
            template += &format!("  {:<9} {}\n", "more:", more.join(", "));
        }
        template.push('\n');
    }
    command.help_template(
        template + "`armplane COMMAND --help` shows options and examples.\n\nOptions:\n{options}{after-help}",
    )
}

/// Parses the arguments of the process and executes the command; the exit code of the program.
pub fn main() -> ExitCode {
    launcher::with_room(work)
        .unwrap_or_else(|error| failure::report(session::Failure::work(error), out::wants_json()))
}

fn work() -> ExitCode {
    let parsed = command()
        .try_get_matches()
        .and_then(|matches| Cli::from_arg_matches(&matches));
    let (json, supervises) = match &parsed {
        Ok(cli) => (cli.json, cli.supervises()),
        Err(_) => (out::wants_json(), false),
    };
    // A process of a run writes by itself: its launcher reads whatever it writes.
    let is_peer = |cli: &Cli| matches!(cli.command, Command::Process(_) | Command::BenchPeer(_));
    if !parsed.as_ref().is_ok_and(is_peer) {
        out::start();
    }
    let code = match parsed {
        Ok(cli) => match execute(cli) {
            Ok(is_good) => ExitCode::from(u8::from(!is_good)),
            Err(failure) => failure::report(failure, json),
        },
        Err(error) => failure::usage(&error, &command()),
    };
    // The results are kept: what ends in a moment anyway needs no second Ctrl-C.
    let _signals = supervises.then(session::interrupts);
    // After Ctrl-C the program waits for no reader.
    let is_bounded = supervises || session::Interrupts::has_come();
    let Some(reason) = out::finish(is_bounded) else {
        return code;
    };
    let lost = session::Failure::Work(format!("results are missing: {reason}"));
    let lost = failure::report(lost, json);
    out::finish(is_bounded);
    if code == ExitCode::SUCCESS {
        lost
    } else {
        code
    }
}

impl Cli {
    /// Whether it is a run, whose results stand in its folder too: it ends although nobody reads them.
    fn supervises(&self) -> bool {
        matches!(self.command, Command::Run(_) | Command::Servo(_))
    }
}

/// Executes a command; its verdict, which is the exit code: 0 if it is good, else 1.
fn execute(cli: Cli) -> Result<bool, session::Failure> {
    let level = match cli.verbose {
        0 => "warn",
        1 => "info",
        _ => "debug",
    };
    let filter = tracing_subscriber::EnvFilter::try_from_env("ARMPLANE_LOG")
        .unwrap_or_else(|_| level.into());
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(|| out::Log)
        .with_ansi(out::is_coloured(&std::io::stderr()))
        .log_internal_errors(false)
        .without_time()
        .with_target(false)
        .init();
    let json = cli.json;
    let form = match cli.verbose {
        _ if json => out::Form::Json,
        0 => out::Form::Short,
        _ => out::Form::Long,
    };
    match cli.command {
        Command::Run(args) => run::run(&args, form),
        Command::Servo(args) => servo::servo(&args, form),
        Command::Play(args) => Err(play::play(args)),
        Command::Verify(args) => verify::verify(&args, json),
        Command::Replay(args) => replay::replay(&args, json),
        Command::Bench(args) => bench::bench(&args, json),
        Command::Compare(args) => compare::compare(&args, json),
        Command::Arena(args) => Err(experiments::arena(args)),
        Command::Autopsy(args) => Err(experiments::autopsy(args, json)),
        Command::Sweep(args) => Err(experiments::experiment("sweep", args, json)),
        Command::Figures(args) => Err(experiments::experiment("figures", args, json)),
        Command::Top(args) => top::top(&args, json),
        Command::BenchPeer(args) => bench::peer(&args),
        Command::Drill(args) => drill::drill(&args, json),
        Command::View(args) => view::view(&args, json),
        Command::Report(args) => report::report(&args, json),
        Command::Export(args) => export::export(&args, json),
        Command::Recover(args) => recover::recover(&args, form),
        Command::Fault(args) => fault::fault(&args, json),
        Command::List => list::list(json),
        Command::New(args) => new::new(&args, json),
        Command::Diff(args) => diff::diff(&args, json),
        Command::Ps => ps::ps(json),
        Command::Inspect(args) => inspect::inspect(&args, json),
        Command::Graph(args) => graph::graph(&args, json),
        Command::Generate(what) => generate::generate(&what, command()),
        Command::Doctor => doctor::doctor(json),
        Command::Clean => clean::clean(json),
        Command::Process(command) => process::run(&command),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn each_command_is_in_one_group_and_ten_come_first() {
        let command = command();
        let visible = command.get_subcommands().filter(|one| !one.is_hide_set());
        let names: BTreeSet<_> = visible.map(clap::Command::get_name).collect();
        let first = GROUPS.iter().flat_map(|group| group.1);
        let grouped: Vec<_> = GROUPS
            .iter()
            .flat_map(|group| group.1.iter().chain(group.2))
            .collect();
        assert_eq!((first.count(), grouped.len()), (10, names.len()));
        assert!(
            grouped.iter().all(|name| names.contains(**name)),
            "{names:?}"
        );
    }
}
