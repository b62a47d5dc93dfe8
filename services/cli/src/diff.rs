//! `armplane diff`: what differs between two runs.

use std::path::PathBuf;

use clap::Args;
use session::Failure;

use crate::out::answer;

#[derive(Args)]
pub(crate) struct DiffArgs {
    /// The first run's folder, or its name under runs/.
    #[arg(value_name = "RUN")]
    first: PathBuf,
    /// The second run's.
    #[arg(value_name = "RUN")]
    second: PathBuf,
}

pub(crate) fn diff(args: &DiffArgs, as_json: bool) -> Result<bool, Failure> {
    let differing = lab::conformance::diff([&args.first, &args.second])?;
    answer(as_json, &differing, &differing);
    Ok(differing.same && differing.damage.is_empty())
}
