//! The processes of the graph that this program contains, as the launcher starts them: `armplane plant --run DIR` and so on.

use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Arg, ArgMatches, FromArgMatches, Subcommand, value_parser};
use model::Robot;
use runtime::{ProcessError, Shell};
use session::{EXCHANGE, FEED, Failure, GUARD, ROBOT, load};
use shared_types::process::Program;

/// One process of a running graph; the launcher starts these.
pub(crate) struct Command {
    part: Part,
    /// The run's directory in shared memory; `None`: that of the run that started this program.
    run: Option<PathBuf>,
}

/// The part of this program in a run.
#[derive(Clone, Copy)]
enum Part {
    /// One of its own processes.
    Process(Program),
    /// The exchange page of a program of others.
    Exchange,
    /// A robot at the address that the graph gives.
    Robot,
    /// It ends what is left when the launcher has ended.
    Guard,
    /// It passes the recording in a folder on to the viewer.
    Feed,
}

impl Part {
    fn named(name: &str) -> Option<Self> {
        match name {
            EXCHANGE => Some(Self::Exchange),
            GUARD => Some(Self::Guard),
            FEED => Some(Self::Feed),
            ROBOT => Some(Self::Robot),
            _ => Program::named(name).map(Self::Process),
        }
    }
}

impl FromArgMatches for Command {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let chosen = matches.subcommand().and_then(|(name, matches)| {
            Some((
                Part::named(name)?,
                matches.get_one::<PathBuf>("run").cloned(),
            ))
        });
        let (part, run) =
            chosen.ok_or_else(|| clap::Error::new(clap::error::ErrorKind::InvalidSubcommand))?;
        Ok(Self { part, run })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Subcommand for Command {
    fn augment_subcommands(command: clap::Command) -> clap::Command {
        let names = Program::ALL
            .into_iter()
            .chain([Program::Operator])
            .map(Program::name);
        names
            .chain([EXCHANGE, GUARD, ROBOT, FEED])
            .fold(command, |command, name| {
                let run = Arg::new("run")
                    .long("run")
                    .value_name("DIR")
                    .value_parser(value_parser!(PathBuf));
                command.subcommand(
                    clap::Command::new(name)
                        .hide(true)
                        .arg(run.help("The run's directory in shared memory")),
                )
            })
    }

    fn augment_subcommands_for_update(command: clap::Command) -> clap::Command {
        Self::augment_subcommands(command)
    }

    fn has_subcommand(name: &str) -> bool {
        Part::named(name).is_some()
    }
}

/// Takes part in a run.
pub(crate) fn run(command: &Command) -> Result<ExitCode, Failure> {
    work(command).map_err(Failure::work)?;
    Ok(ExitCode::SUCCESS)
}

fn work(Command { part, run }: &Command) -> Result<(), ProcessError> {
    let program = match part {
        Part::Process(program) => Some(*program),
        Part::Exchange | Part::Robot => None,
        Part::Guard => {
            run.iter().for_each(|run| launcher::guard(run));
            return Ok(());
        }
        Part::Feed => {
            let folder = run.as_deref().unwrap_or(Path::new("."));
            let viewer = std::io::stdout().as_fd().try_clone_to_owned();
            return viewer
                .and_then(|viewer| session::feed(folder, viewer))
                .map_err(ProcessError::setup);
        }
    };
    let shell = Shell::started(run.as_deref(), program.map(Program::name))?;
    let job = shell.job()?;
    let robot = Robot::from_source(&job.robot).map_err(ProcessError::setup)?;
    let name = shell.name();
    let done = match program {
        Some(Program::Plant) => plant::run(&shell, &robot, &job.scenario),
        Some(Program::Estimator) => estimator::run(&shell, &robot, &job.scenario),
        Some(Program::Analyzer) => analyzer::run(&shell, &robot, &job.scenario),
        Some(Program::Controller) => controller::run(&shell, &robot, &job.scenario),
        Some(Program::Recorder) => recorder::run(&shell, &robot, &job, shell.run_dir()),
        Some(Program::Operator) => operator::run(&shell, &job.scenario),
        None if matches!(part, Part::Robot) => {
            let address = job
                .graph
                .process(name)
                .map(|process| process.robot.as_str())
                .unwrap_or_default();
            plant_fci::run(
                &shell,
                &robot,
                &job.scenario,
                &address.parse().map_err(ProcessError::Setup)?,
            )
        }
        None => exchange::run(
            &shell,
            &job.graph,
            name,
            robot.dof(),
            job.scenario.planned_ticks(),
            load::command(&job.graph, name),
        ),
    };
    done.inspect(|()| shell.pass_early_signal_on())
}
