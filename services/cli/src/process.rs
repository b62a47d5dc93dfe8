//! The processes of the graph that this program contains, as the launcher starts them: `armplane plant --run DIR` and so on.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, Subcommand};
use model::Robot;
use runtime::{ProcessError, Shell, drive};
use session::Failure;
use shared_types::job::{JOB, Job};
use shared_types::process::Program;

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
pub(crate) fn run(command: &Command) -> Result<bool, Failure> {
    let done = match command {
        Command::Plant(place) => take_part(Some(Program::Plant), place),
        Command::Estimator(place) => take_part(Some(Program::Estimator), place),
        Command::Analyzer(place) => take_part(Some(Program::Analyzer), place),
        Command::Controller(place) => take_part(Some(Program::Controller), place),
        Command::Recorder(place) => take_part(Some(Program::Recorder), place),
        Command::Operator(place) => take_part(Some(Program::Operator), place),
        Command::PlantFci(place) => take_part(None, place),
        Command::StandIn(place) => stand_in(place),
        Command::Guard(place) => {
            place.run.iter().for_each(|run| launcher::guard(run));
            Ok(())
        }
        Command::Watch(place) => {
            return session::watch(place.run.as_deref().unwrap_or(Path::new(".")));
        }
    };
    done.map(|()| true).map_err(Failure::work)
}

/// The time that a person has to start a program.
const LONGEST_EXTERNAL_START_S: u32 = 600;

fn stand_in(place: &Place) -> Result<(), ProcessError> {
    let missing = || ProcessError::setup("this process is one of a graph");
    let run = place.run.as_deref().ok_or_else(missing)?;
    let name = std::env::var(runtime::PROCESS_VARIABLE).map_err(|_| missing())?;
    let job = std::fs::read(run.join(JOB)).map_err(ProcessError::setup)?;
    let job: Job = serde_json::from_slice(&job).map_err(ProcessError::setup)?;
    let own = job.graph.process(&name).map(|process| process.join_limit_s);
    let limit_s = own
        .filter(|limit_s| *limit_s > 0)
        .unwrap_or(LONGEST_EXTERNAL_START_S);
    runtime::stand_in(run, &name, Duration::from_secs(limit_s.into()))
}

/// One of armplane's programs, or the plant at the address of a robot.
fn take_part(program: Option<Program>, place: &Place) -> Result<(), ProcessError> {
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
