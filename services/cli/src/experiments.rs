//! `armplane arena`, `autopsy`, `sweep` and `figures`: modules of the package in Python, which read the arguments.

use clap::Args;
use session::{Failure, Python};

#[derive(Args)]
pub(crate) struct PythonArgs {
    /// Arguments of the Python program; `-- --help` lists them.
    #[arg(
        value_name = "ARGUMENT",
        trailing_var_arg = true,
        allow_hyphen_values = true
    )]
    arguments: Vec<String>,
}

/// Becomes the arena.
pub(crate) fn arena(args: PythonArgs) -> Failure {
    Python::exec("arena", args.arguments)
}

/// Becomes the autopsy of logs.
pub(crate) fn autopsy(args: PythonArgs, as_json: bool) -> Failure {
    let json = as_json.then(|| "--json".to_owned());
    Python::exec("autopsy", args.arguments.into_iter().chain(json))
}

/// Becomes the sweep, its report, or the figures.
pub(crate) fn experiment(command: &str, args: PythonArgs, as_json: bool) -> Failure {
    let mut words = args.arguments;
    if words.first().is_none_or(|word| word != "report") {
        words.insert(0, command.to_owned());
    }
    words.extend(as_json.then(|| "--json".to_owned()));
    Python::exec("experiments", words)
}
