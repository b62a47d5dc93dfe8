//! The command line of `armplane`: one file per command, which owns its arguments, what it prints, and its exit code.
#![allow(non_snake_case)]

mod bench;
mod clean;
mod compare;
mod doctor;
mod drill;
mod export;
mod failure;
mod fault;
mod figures;
mod generate;
mod graph;
mod inspect;
mod layout;
mod list;
mod live;
mod out;
mod process;
mod progress;
mod recover;
mod replay;
mod report;
mod run;
mod screen;
mod servo;
mod sweep;
mod top;
mod verify;
mod view;

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

#[derive(Parser)]
#[command(
    name = "armplane",
    version,
    about = "Robot arms through kinematic singularities: five processes, shared memory, one recording",
    long_about = "Runs a robot arm through kinematic singularities with the dynamically consistent strategy of Chang & Khatib (1995): \
                  plant, estimator, analyzer, controller and recorder as processes over shared memory. Without a command it runs the \
                  default scenario.",
    after_help = "Examples:\n  armplane                                    run the default scenario, save a recording\n  armplane run fig5-wrist-rotation --seed 7   the same, with other noise\n  armplane list                               scenarios and robots\n  armplane inspect --robot puma560 --q ready  the arm's numbers at a posture\n\nExit codes: 0 success, 1 the run failed its goal or was stopped by a fault, 2 usage or invalid input."
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    /// Print results as JSON on standard output, for machines; an error is one JSON object, the last line of standard error.
    #[arg(long, global = true)]
    json: bool,
    /// Say more on standard error (-v, -vv).
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
}

#[derive(Subcommand)]
enum Command {
    /// Run a scenario in its processes and save a recording.
    #[command(
        after_help = "Examples:\n  armplane run\n  armplane run fig5-wrist-rotation --out /tmp/fig5 --seed 3\n  armplane run my.toml --set control.k_p=900 --set plant.friction=true"
    )]
    Run(run::RunArgs),
    /// Steer an arm: targets from a file, from a program of yours, or at random, through singularities.
    #[command(
        long_about = "Runs an arm that follows targets (a twist, a pose, or joint positions) as they come, without a path to look ahead on. The law \
                      keeps speed, torque and torque rate, passes singularities, slows before joint limits and at the boundary of reach, and \
                      states at each tick what it does and why. A target older than its validity brings the arm to rest; one with a NaN or an \
                      unknown frame is refused and counted. The targets are saved beside the run: `armplane run` of its scenario.toml gives the \
                      same bytes again. docs/servo.md has the format.",
        after_help = "Examples:\n  armplane servo servo-panda                    a built-in session\n  armplane servo panda --random 7               60 s of random twists\n  armplane servo ur5 --from my-targets.csv --start bent\n  armplane servo --from topic --graph examples/python/spiral.toml panda --duration 10\n  armplane servo --seeds 20                     judge an arm of each family, 20 seeds each, and print a table\n\nExit code 1: the session did not end at rest at its reference, or --seeds found a bar broken."
    )]
    Servo(servo::ServoArgs),
    /// Run a scenario several times under different conditions and compare every byte.
    #[command(
        long_about = "Runs a scenario in lockstep several times, in real processes under deliberately different conditions: other cores, other \
                      nice values, random delays at the start and random pauses in every process, a spinning thread on every core, with and \
                      without a recording. Compares every message of every topic with what one thread computes without shared memory, planned faults \
                      included; with the first run where one thread cannot have it: a death of the plant, a fault of the recorder, a \
                      program of the graph's own. Where they differ it names the first tick, topic and field.",
        after_help = "Examples:\n  armplane verify fig5-wrist-rotation\n  armplane verify my.toml --runs 12 --json\n  armplane verify --kills 100\n\nExit code 1: some bytes differ."
    )]
    Verify(verify::VerifyArgs),
    /// Feed a run's recorded inputs to one process and show where its outputs first differ.
    #[command(
        long_about = "Takes the recorded messages of a run, feeds its inputs to the step of one process as this program computes it, and compares every \
                      output with the recorded one: where they first differ (tick, topic, field, both values), and by how much each field \
                      differs at most. For a changed control law: build it, replay an old run, see what has changed and what has not.",
        after_help = "Examples:\n  armplane replay runs/fig5-wrist-rotation-001\n  armplane replay runs/fig5-wrist-rotation-001 --process estimator --json\n  armplane replay runs/fig5-wrist-rotation-001 --set control.k_p=900\n\nExit code 1: an output differs."
    )]
    Replay(replay::ReplayArgs),
    /// Measure hand-overs, cycles and steps beside baseline transports of the machine.
    #[command(
        long_about = "Measures in alternating runs the topics of armplane and baseline transports built into the same program: bare iceoryx2, a futex, a \
                      pipe. Times are of real processes, pinned and under SCHED_FIFO where the machine allows; a first round warms everything up, \
                      after it no sample is left out. Ratios are against the futex of the same placement and payload.",
        after_help = "Examples:
  armplane bench
  armplane bench hop cycle --samples 100000 --json
  armplane bench --out bench          table, JSON and pictures
  armplane bench lockstep --against ../base/target/release/armplane"
    )]
    Bench(bench::BenchArgs),
    /// Run scenarios under every control law, on the same plant and seed, and put them side by side.
    #[command(
        long_about = "Runs each scenario once per control law on one thread (the same bytes as the processes give), with the same plant, seed, \
                      gains and governor, and prints one table per scenario. SCENARIO `sweep` stands for seeded straight lines through and near \
                      each singularity of a PUMA. Saves compare.json and a picture per scenario (SVG and PNG).\n\n\
                      Errors are desired against true pose, split along and orthogonal to the singular directions ζ while those are engaged. A jump is \
                      a tick in which a torque changes by more than a tenth of its limit; chatter counts jumps back within 10 ms; energy sums \
                      ½ΔΓᵀA⁻¹ΔΓ/k_v² over the jumps, whatever their cause. S1: end within 1 mm and 0.5°, orthogonal within 1 mm and 0.5°, no joint beyond its speed or \
                      position, no torque at its limit for more than 10 ms. S2: the same, but orthogonal within 1 mm and 3°, along within 10 mm and 5°.",
        after_help = "Examples:\n  armplane compare fig5-wrist-rotation elbow-in-and-out\n  armplane compare sweep --count 90 --speed 0.5 --json\n  armplane compare my.toml --law blended,damped-least-squares --set control.baseline.damped_least_squares.largest=0.1\n  armplane compare sweep --tune --count 30"
    )]
    Compare(compare::CompareArgs),
    /// Run a scenario under many settings, a grid or a sample, on all cores, into Parquet.
    #[command(
        long_about = "Computes a scenario once for each point of a grid, or of a seeded sample, over any keys that `armplane run --set` takes: one run on \
                      one thread per core, without processes and shared memory, with the same bytes on every topic as `armplane run`. Each run is \
                      a row of runs/*.parquet (zstd; units and provenance in the files' metadata). A sweep that was stopped or killed goes on \
                      with the same command: no run is lost, none is computed twice.\n\n\
                      SWEEP.toml:\n\n  \
                      name = \"gains\"\n  scenario = \"fig5-wrist-rotation\"   # or a file beside this one\n\n  \
                      [[key]]\n  key = \"control.k_p\"\n  values = [100, 400, 900]\n\n  \
                      [[key]]\n  key = \"plant.mass_factor\"\n  from = 0.8\n  to = 1.2\n  steps = 5                          # scale = \"log\" is possible\n\n  \
                      [sample]                           # instead of steps: drawn at random\n  runs = 1000\n  seed = 1",
        after_help = "Examples:\n  armplane sweep gains.toml\n  armplane sweep report runs/gains --by orientation_max_deg --map control.k_p,plant.mass_factor\n  armplane sweep gains.toml --shard 3/16 --out shards/3\n  armplane sweep --merge shards/* --out gains\n\nExit code 1: stopped before its end; the same command goes on."
    )]
    Sweep(sweep::SweepArgs),
    /// Draw the paper's Figures 1 to 5 from runs made for it.
    #[command(
        long_about = "Runs the scenarios of Chang & Khatib's Figures 1 to 5 on one thread and draws them: arm postures, errors, joint motion, \
                      with the numbers below. Saves each as SVG and PNG, and the numbers as figures.json.",
        after_help = "Examples:\n  armplane figures\n  armplane figures --out figures --set plant.encoder_bits=0"
    )]
    Figures(figures::FiguresArgs),
    /// Watch a running graph: processes, ticks, rates, misses.
    #[command(after_help = "Examples:\n  armplane top\n  armplane top --once --json")]
    Top(top::TopArgs),
    /// Open a run's recording in the installed Rerun viewer.
    #[command(
        long_about = "Opens a run's recording in the Rerun viewer that is installed (`pip install rerun-sdk==0.36.3`, or `cargo install \
                      rerun-cli@0.36.3 --locked`). If a viewer is running, it shows the recording there.",
        after_help = "Examples:\n  armplane view\n  armplane view runs/fig5-wrist-rotation-001 --layout timing"
    )]
    View(view::ViewArgs),
    /// Write a run up as one HTML page with plots, tables and the log, for people without a viewer.
    #[command(
        after_help = "Examples:\n  armplane report\n  armplane report runs/fig5-wrist-rotation-001 --out fig5.html"
    )]
    Report(report::ReportArgs),
    /// Write a run's numbers and events for other tools.
    #[command(
        long_about = "Reads the recording back and writes its numbers as one wide table (a row a tick) and its log and states as another, \
                      into the run's folder or --out. Columns: `joint.q.1`, `singularity.s.wrist`, `error.position_mm.orthogonal` and so on, and from the \
                      run's messages the pose and twist of the end-effector, encoders, torques, singular directions. Units are in the metadata of \
                      Parquet. MCAP is there already: messages.mcap in the run's folder. `rrd` joins the parts of a long recording in one file; `rbl` is the layout for the viewer.",
        after_help = "Examples:\n  armplane export --format csv\n  armplane export runs/fig5-wrist-rotation-001 --format parquet --out tables\n  armplane export --format rbl --layout timing"
    )]
    Export(export::ExportArgs),
    /// Inject a fault into a running graph.
    #[command(
        long_about = "Injects a fault into one process of a running graph, from its next tick on. The run records it with that tick, and leaves \
                      a scenario.toml beside its results in which the fault is planned: `armplane run` of it gives the same bytes again.",
        after_help = "Examples:\n  armplane fault --list\n  armplane fault controller kill\n  armplane fault estimator delay --delay 3 --for 0.5s\n  armplane fault plant sensor --as bias --joint 5 --amount 0.02"
    )]
    Fault(fault::FaultArgs),
    /// Try every fault on every process of a real graph, and judge what the arm does.
    #[command(
        long_about = "Runs a scenario once for every kind of fault and every process it can happen to, and for a seeded sample of pairs, in its \
                      processes and in lockstep. The fault is injected live in the middle of the motion; then the run is repeated from the \
                      plan it left, which must give the same bytes. Judged on the simulator's truth: torque and speed against the limits, age of \
                      the torque in force, largest torque step, distance from the fault-free path, the end; and what was lost or left behind.\n\n\
                      --soak runs the graph in real time instead, a minute at a time, with every fault at random, and judges each round by the same \
                      guarantees, and by every death, message and file. A round that breaks one leaves its files with a scenario.toml of its faults.",
        after_help = "Examples:\n  armplane drill\n  armplane drill --only controller:kill\n  armplane drill elbow-in-and-out --out drill\n  armplane drill --soak 1800 --out soak\n\nExit code 1: a guarantee does not hold."
    )]
    Drill(drill::DrillArgs),
    /// List the built-in scenarios and robots.
    #[command(after_help = "Example:\n  armplane list --json")]
    List,
    /// Show an arm's kinematics, dynamics and singularities at one posture.
    #[command(
        after_help = "Examples:\n  armplane inspect --robot puma560 --q ready\n  armplane inspect --robot puma560 --q-deg=20,-60,170,0,0,0\n  armplane inspect --robot my.urdf --frame tool0 --q=0,0.1,0.2,0,0,0 --qdot=0,0,0,0,0,1 --json"
    )]
    Inspect(inspect::InspectArgs),
    /// Make the recording and the summary of a run whose launcher was killed.
    #[command(
        long_about = "Makes run.rrd, summary.json and scenario.toml of a run whose launcher was killed, from job.json and the messages in its folder. Its \
                      faults come from shared memory, as long as `armplane clean` has not removed what the run left there.",
        after_help = "Example:\n  armplane recover runs/fig5-wrist-rotation-001"
    )]
    Recover(recover::RecoverArgs),
    /// Show which process reads and writes what, and the topics between them.
    #[command(
        after_help = "Examples:\n  armplane graph\n  armplane graph examples/energy/graph.toml --format topics\n  armplane graph --format dot | dot -Tsvg > graph.svg"
    )]
    Graph(graph::GraphArgs),
    /// Check what the machine offers: shared memory, real-time rights, cores, leftovers.
    #[command(after_help = "Example:\n  armplane doctor")]
    Doctor,
    /// Remove what dead runs left in shared memory; living runs are not touched.
    #[command(after_help = "Example:\n  armplane clean")]
    Clean,
    /// Print or write what other programs read: completions, manual pages, JSON Schemas, the wire for C and Python.
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
        &["run", "view", "report", "servo"],
        &["top", "export", "fault", "recover"],
    ),
    ("Arms and graphs", &["list", "inspect", "graph"], &[]),
    ("Compare", &["compare"], &["sweep", "figures", "replay"]),
    ("Prove", &["verify"], &["drill"]),
    ("Machine", &["doctor"], &["clean", "bench", "generate"]),
];

/// The command line, whose help shows the groups.
fn command() -> clap::Command {
    let command = Cli::command();
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
        template + "`armplane COMMAND --help` has examples.\n\nOptions:\n{options}{after-help}",
    )
}

/// Parses the arguments of the process and executes the command; the exit code of the program.
#[must_use]
pub fn main() -> ExitCode {
    launcher::with_room(work).unwrap_or_else(|error| {
        failure::report(session::Failure::work(error), failure::wants_json())
    })
}

fn work() -> ExitCode {
    let mut command = command();
    if failure::has_codes() {
        // Their colours could not be told from ours.
        command = command.styles(clap::builder::Styles::plain());
    }
    let parsed = command.try_get_matches();
    let cli = match parsed.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) => return failure::usage(&error),
    };
    let (json, supervises) = (cli.json, cli.supervises());
    // A process of a run writes by itself: its launcher reads whatever it writes.
    if !matches!(
        cli.command,
        Some(Command::Process(_) | Command::BenchPeer(_))
    ) {
        out::start();
    }
    let code = execute(cli).unwrap_or_else(|failure| failure::report(failure, json));
    // The results are kept: what ends in a moment anyway needs no second Ctrl-C.
    let _signals = supervises.then(session::interrupts);
    if !out::finish(supervises) {
        return code;
    }
    out::tell(&"armplane: nobody reads standard output: results are missing there");
    out::finish(supervises);
    if code == ExitCode::SUCCESS {
        ExitCode::from(1)
    } else {
        code
    }
}

impl Cli {
    /// Whether it is a run, whose results stand in its folder too: it ends although nobody reads them.
    fn supervises(&self) -> bool {
        matches!(
            self.command,
            None | Some(Command::Run(_) | Command::Servo(_))
        )
    }
}

fn execute(cli: Cli) -> Result<ExitCode, session::Failure> {
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
    match cli
        .command
        .unwrap_or_else(|| Command::Run(run::RunArgs::default()))
    {
        Command::Run(args) => run::run(&args, json),
        Command::Servo(args) => servo::servo(&args, json),
        Command::Verify(args) => verify::verify(&args, json),
        Command::Replay(args) => replay::replay(&args, json),
        Command::Bench(args) => bench::bench(&args, json),
        Command::Compare(args) => compare::compare(&args, json),
        Command::Sweep(args) => sweep::sweep(&args, json),
        Command::Figures(args) => figures::figures(&args, json),
        Command::Top(args) => top::top(&args, json),
        Command::BenchPeer(args) => bench::peer(&args),
        Command::Drill(args) => drill::drill(&args, json),
        Command::View(args) => view::view(&args, json),
        Command::Report(args) => report::report(&args, json),
        Command::Export(args) => export::export(&args, json),
        Command::Recover(args) => recover::recover(&args, json),
        Command::Fault(args) => fault::fault(&args, json),
        Command::List => list::list(json),
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
