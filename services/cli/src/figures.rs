//! `armplane figures`: the figures of the paper, drawn from runs made for them.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use session::Failure;

use crate::out::say;
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct FiguresArgs {
    /// Folder for the figures [default: the next free runs/figures-NNN].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Override a value of every scenario, for example plant.encoder_bits=0 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

pub(crate) fn figures(args: &FiguresArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let (figures, numbers) =
        lab::studies::figures::figures(&args.set, args.out.as_deref(), &observe)?;
    if as_json {
        say!("{numbers}");
        return Ok(ExitCode::SUCCESS);
    }
    for (figure, [svg, png]) in &figures {
        say!("{}", figure.page.title);
        figure.page.notes.iter().for_each(|note| say!("  {note}"));
        say!("  {}\n  {}\n", svg.display(), png.display());
    }
    Ok(ExitCode::SUCCESS)
}
