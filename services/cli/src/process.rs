//! The processes of the graph that this program contains, as the launcher starts them: `armplane plant --run DIR` and so on.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Arg, ArgMatches, FromArgMatches, Subcommand, value_parser};
use runtime::{ProcessError, Shell};
use session::{EXCHANGE, Failure, load};
use shared_types::process::Program;

/// One process of a running graph; the launcher starts these.
pub(crate) struct Command {
    /// `None`: it holds the exchange page of a program of others.
    program: Option<Program>,
    /// The run's directory in shared memory; `None`: that of the run that started this program.
    run: Option<PathBuf>,
}

impl FromArgMatches for Command {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let of = |name| if name == EXCHANGE { Some(None) } else { Program::named(name).map(Some) };
        let chosen = matches.subcommand().and_then(|(name, matches)| Some((of(name)?, matches.get_one::<PathBuf>("run").cloned())));
        let (program, run) = chosen.ok_or_else(|| clap::Error::new(clap::error::ErrorKind::InvalidSubcommand))?;
        Ok(Self { program, run })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Subcommand for Command {
    fn augment_subcommands(command: clap::Command) -> clap::Command {
        Program::ALL.into_iter().map(Program::name).chain([EXCHANGE]).fold(command, |command, name| {
            let run = Arg::new("run").long("run").value_name("DIR").value_parser(value_parser!(PathBuf));
            command.subcommand(clap::Command::new(name).hide(true).arg(run.help("The run's directory in shared memory")))
        })
    }

    fn augment_subcommands_for_update(command: clap::Command) -> clap::Command {
        Self::augment_subcommands(command)
    }

    fn has_subcommand(name: &str) -> bool {
        name == EXCHANGE || Program::named(name).is_some()
    }
}

/// Takes part in a run.
pub(crate) fn run(command: &Command) -> Result<ExitCode, Failure> {
    work(command).map_err(Failure::work)?;
    Ok(ExitCode::SUCCESS)
}

fn work(Command { program, run }: &Command) -> Result<(), ProcessError> {
    let shell = Shell::started(run.as_deref(), program.map(Program::name))?;
    let job = shell.job()?;
    let robot = load::robot_of(&job.robot).map_err(ProcessError::setup)?;
    let Some(program) = program else {
        let name = shell.name();
        let command = load::command(&job.graph, name);
        return exchange::run(&shell, &job.graph, name, robot.dof(), job.scenario.planned_ticks(), command);
    };
    match program {
        Program::Plant => plant::run(&shell, &robot, &job.scenario),
        Program::Estimator => estimator::run(&shell, &robot, &job.scenario),
        Program::Analyzer => analyzer::run(&shell, &robot, &job.scenario),
        Program::Controller => controller::run(&shell, &robot, &job.scenario),
        Program::Recorder => recorder::run(&shell, &robot, &job, shell.run_dir()),
    }
}
