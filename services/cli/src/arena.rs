//! `armplane arena`: armplane's laws and controllers of others on the same tasks. The work is a module of the package in Python.

use clap::Args;
use session::{Failure, Python};

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

/// Becomes the arena.
pub(crate) fn arena(args: ArenaArgs) -> Failure {
    Python::exec("arena", args.options)
}
