//! `armplane replay`: recorded inputs, fed to the step of one process again.

use std::path::PathBuf;

use clap::Args;
use session::Failure;

use crate::out::{answer, whole};
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct ReplayArgs {
    /// The run's folder.
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// The process, by its name in the graph [default: controller].
    #[arg(long, value_name = "PROCESS")]
    process: Option<String>,
    /// Override a value of the recorded scenario, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

pub(crate) fn replay(args: &ReplayArgs, as_json: bool) -> Result<bool, Failure> {
    let mut replayed =
        lab::conformance::replay(&args.run, args.process.as_deref(), &args.set, &observe)?;
    answer(as_json, &replayed, &replayed);
    whole(replayed.lack.take()).map(|is_whole| is_whole && replayed.passed())
}
