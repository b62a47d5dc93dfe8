//! `armplane arena`: armplane's laws and controllers of others on the same tasks. The work is a module of the package in Python.

use std::io::ErrorKind;
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};

use clap::Args;
use session::{Failure, Python};

/// The module, and the variable by which it finds this program.
const MODULE: &str = "armplane.arena";
const PROGRAM: &str = "ARMPLANE";

#[derive(Args)]
pub(crate) struct ArenaArgs {
    /// Options of the arena; `armplane arena -- --help` lists them.
    #[arg(
        value_name = "OPTION",
        trailing_var_arg = true,
        allow_hyphen_values = true
    )]
    options: Vec<String>,
}

pub(crate) fn arena(args: &ArenaArgs) -> Result<ExitCode, Failure> {
    let command = Python::command(MODULE, args.options.iter().cloned());
    let program = std::env::current_exe().map_err(Failure::work)?;
    let mut python = Command::new(&command[0]);
    let error = python.args(&command[1..]).env(PROGRAM, program).exec();
    Err(match error.kind() {
        ErrorKind::NotFound => Failure::Input(format!("{} 'armplane[arena]'", Python::MISSING)),
        _ => Failure::work(format!("cannot start Python: {error}")),
    })
}
