//! `armplane recover`: the results of a run whose launcher was killed.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use session::{Failure, RunText};

use crate::out::{say_json, show};
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct RecoverArgs {
    /// The run's folder.
    #[arg(value_name = "RUN")]
    run: PathBuf,
}

pub(crate) fn recover(args: &RecoverArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let _signals = session::interrupts()?;
    let summary = session::recover(&args.run, &observe)?;
    if as_json {
        say_json(&summary)?;
    } else {
        show(&RunText {
            summary: &summary,
            folder: &args.run,
        });
    }
    session::whole(&summary).map(|()| ExitCode::SUCCESS)
}
