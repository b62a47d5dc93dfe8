//! `armplane replay`: recorded inputs, fed to the step of one process again.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use lab::conformance::{ReplayedText, replay};
use session::Failure;
use shared_types::process::Program;

use crate::out::{say, show};
use crate::progress::Terminal;

#[derive(Args)]
pub(crate) struct ReplayArgs {
    /// The results folder of a run.
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Which process.
    #[arg(long, value_name = "PROCESS", default_value = "controller", value_parser = replayable)]
    process: Program,
    /// Override a value of the recorded scenario, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// A process whose step can be fed again: all but the one that records.
fn replayable(name: &str) -> Result<Program, String> {
    let is_replayable = |program: &Program| ![Program::Recorder, Program::Operator].contains(program);
    let known =
        || Program::ALL.iter().filter(|program| is_replayable(program)).map(|program| program.name()).collect::<Vec<_>>().join(", ");
    Program::named(name).filter(is_replayable).ok_or_else(|| format!("its step cannot be fed again; it can be of {}", known()))
}

pub(crate) fn replay(args: &ReplayArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let terminal = Terminal::default();
    let process = args.process;
    let (job, replayed) = replay::replay(&args.run, process, &args.set, &|progress| terminal.show(progress))?;
    if as_json {
        say!("{}", replayed.json(process.name(), &job, &args.set));
    } else {
        show(&ReplayedText { process: process.name(), job: &job, replayed: &replayed });
    }
    Ok(ExitCode::from(u8::from(replayed.first().is_some() || !replayed.is_complete())))
}
