//! `armplane recover`: goes on with a run whose launcher was killed, or makes its results.

use std::path::PathBuf;

use clap::Args;
use session::Failure;

use crate::out::{Form, show_run, tell, unread};
use crate::progress::observe;
use crate::run::conclude;

#[derive(Args)]
pub(crate) struct RecoverArgs {
    /// The run's folder.
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Do not go on with it: make the results of the ticks that it has.
    #[arg(long)]
    only_results: bool,
}

pub(crate) fn recover(args: &RecoverArgs, form: Form) -> Result<bool, Failure> {
    let remains = session::remains(&args.run)?;
    match remains.ended {
        _ if args.only_results => {}
        Some(why) => tell(&format!(
            "armplane: {}: {why}: these are the results of the ticks that it has",
            args.run.display()
        )),
        None => return conclude(session::go_on(remains, unread, &observe)?, form),
    }
    let _signals = session::interrupts()?;
    let summary = session::recover(remains, &observe)?;
    show_run(&summary, &args.run, form)?;
    session::whole(&summary).map(|()| true)
}
