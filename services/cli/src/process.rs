//! The processes of the graph that this program contains, as the launcher starts them: `armplane plant --run DIR` and so on.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::{Args, Subcommand};
use model::Robot;
use runtime::{ProcessError, Shell, drive};
use session::Failure;
use shared_types::job::{JOB, Job};
use shared_types::process::Program;

use crate::out::passed;

/// One process of a running graph; the launcher starts these.
#[derive(Subcommand)]
pub(crate) enum Command {
    #[command(hide = true)]
    Plant(Place),
    #[command(hide = true)]
    Estimator(Place),
    #[command(hide = true)]
    Analyzer(Place),
    #[command(hide = true)]
    Controller(Place),
    #[command(hide = true)]
    Recorder(Place),
    #[command(hide = true)]
    Operator(Place),
    /// A program that is started separately.
    #[command(hide = true)]
    StandIn(Place),
    /// A robot at the address that the graph gives.
    #[command(hide = true)]
    PlantFci(Place),
    /// It ends what is left when the launcher has ended.
    #[command(hide = true)]
    Guard(Place),
    /// It draws a run into the viewer while it lasts.
    #[command(hide = true)]
    Watch(Place),
}

#[derive(Args)]
pub(crate) struct Place {
    /// The run's directory in shared memory; without it that of the run that started this program.
    #[arg(long, value_name = "DIR")]
    run: Option<PathBuf>,
}

/// Takes part in a run.
pub(crate) fn run(command: &Command) -> Result<ExitCode, Failure> {
    if let Command::Watch(place) = command {
        return passed(session::watch(
            place.run.as_deref().unwrap_or(Path::new(".")),
        )?);
    }
    work(command).map_err(Failure::work)?;
    Ok(ExitCode::SUCCESS)
}

/// The time that a person has to start a program.
const LONGEST_EXTERNAL_START_S: u32 = 600;

fn stand_in(place: &Place) -> Result<(), ProcessError> {
    let missing = || ProcessError::setup("this process is one of a graph");
    let run = place.run.as_deref().ok_or_else(missing)?;
    let name = std::env::var(runtime::PROCESS_VARIABLE).map_err(|_| missing())?;
    let job = std::fs::read(run.join(JOB)).map_err(ProcessError::setup)?;
    let job: Job = serde_json::from_slice(&job).map_err(ProcessError::setup)?;
    let limit_s = job
        .graph
        .process(&name)
        .map_or(0, |process| process.join_limit_s);
    let limit_s = if limit_s == 0 {
        LONGEST_EXTERNAL_START_S
    } else {
        limit_s
    };
    runtime::stand_in(run, &name, Duration::from_secs(limit_s.into()))
}

fn work(command: &Command) -> Result<(), ProcessError> {
    let (program, place) = match command {
        Command::Plant(place) => (Some(Program::Plant), place),
        Command::Estimator(place) => (Some(Program::Estimator), place),
        Command::Analyzer(place) => (Some(Program::Analyzer), place),
        Command::Controller(place) => (Some(Program::Controller), place),
        Command::Recorder(place) => (Some(Program::Recorder), place),
        Command::Operator(place) => (Some(Program::Operator), place),
        Command::PlantFci(place) => (None, place),
        Command::Guard(place) => {
            place.run.iter().for_each(|run| launcher::guard(run));
            return Ok(());
        }
        Command::Watch(_) => return Ok(()),
        Command::StandIn(place) => return stand_in(place),
    };
    let shell = Shell::started(place.run.as_deref(), program.map(Program::name))?;
    let job = shell.job()?;
    let robot = Robot::from_source(&job.robot).map_err(ProcessError::setup)?;
    let (name, scenario) = (shell.name(), &job.scenario);
    let done = match program {
        Some(Program::Recorder) => recorder::run(&shell, &robot, &job, shell.run_dir()),
        Some(Program::Operator) => {
            operator::run(&shell, scenario, &job.out.join(session::GIVEN_TARGETS))
        }
        Some(program) => {
            let step = chain::step_of(program, &robot, scenario).map_err(ProcessError::setup)?;
            step.map_or(Ok(()), |mut step| drive(&shell, &mut *step, &mut ()))
        }
        None => {
            let process = job.graph.process(name);
            let address = process.map_or("", |process| process.robot.as_str());
            let address: plant_fci::Address = address.parse().map_err(ProcessError::Setup)?;
            plant_fci::run(&shell, &robot, scenario, &address)
        }
    };
    done.inspect(|()| shell.pass_signal_on())
}
