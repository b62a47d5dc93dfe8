//! The processes of the graph, as the launcher starts them: `armplane plant --run DIR` and so on.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Subcommand};
use runtime::{ProcessError, Shell};
use shared_types::job::Job;

use session::Failure;
use session::{JOB, load};

/// One process of a running graph; the launcher starts these.
#[derive(Subcommand)]
pub(crate) enum Command {
    /// Simulate the arm.
    #[command(hide = true)]
    Plant(JobArgs),
    /// Estimate the state.
    #[command(hide = true)]
    Estimator(JobArgs),
    /// Analyse singularities.
    #[command(hide = true)]
    Analyzer(JobArgs),
    /// Control the arm.
    #[command(hide = true)]
    Controller(JobArgs),
    /// Record and judge.
    #[command(hide = true)]
    Recorder(JobArgs),
}

#[derive(Args)]
pub(crate) struct JobArgs {
    /// The run's directory in shared memory.
    #[arg(long, value_name = "DIR")]
    run: PathBuf,
}

/// Takes part in a run.
pub(crate) fn run(command: &Command) -> Result<ExitCode, Failure> {
    let (name, args) = match command {
        Command::Plant(args) => ("plant", args),
        Command::Estimator(args) => ("estimator", args),
        Command::Analyzer(args) => ("analyzer", args),
        Command::Controller(args) => ("controller", args),
        Command::Recorder(args) => ("recorder", args),
    };
    work(name, args).map_err(Failure::work)?;
    Ok(ExitCode::SUCCESS)
}

fn work(name: &str, args: &JobArgs) -> Result<(), ProcessError> {
    let path = args.run.join(JOB);
    let text = std::fs::read(&path).map_err(|error| ProcessError::setup(format!("cannot read {}: {error}", path.display())))?;
    let job: Job = serde_json::from_slice(&text).map_err(|error| ProcessError::setup(format!("{}: {error}", path.display())))?;
    let robot = load::robot_of(&job.robot).map_err(ProcessError::setup)?;
    let shell = Shell::open(&args.run, name)?;
    match name {
        "plant" => plant::run(&shell, &robot, &job.scenario),
        "estimator" => estimator::run(&shell, &robot, &job.scenario),
        "analyzer" => analyzer::run(&shell, &robot, &job.scenario),
        "controller" => controller::run(&shell, &robot, &job.scenario),
        _ => recorder::run(&shell, &robot, &job, &args.run),
    }
}
