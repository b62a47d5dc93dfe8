//! `armplane completions`, `armplane man`, `armplane schema`: what shells, `man` and editors read.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Command, ValueEnum};
use session::Failure;

use crate::out::say;

#[derive(Args)]
pub(crate) struct CompletionsArgs {
    /// The shell.
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

pub(crate) fn completions(
    args: &CompletionsArgs,
    mut command: Command,
) -> Result<ExitCode, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "armplane", &mut script);
    say!("{}", String::from_utf8_lossy(&script).trim_end());
    Ok(ExitCode::SUCCESS)
}

#[derive(Args)]
pub(crate) struct ManArgs {
    /// The folder for the pages.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

pub(crate) fn man(args: &ManArgs, command: Command) -> Result<ExitCode, Failure> {
    let written = std::fs::create_dir_all(&args.folder)
        .and_then(|()| clap_mangen::generate_to(command, &args.folder));
    written.map_err(|error| {
        Failure::Input(format!(
            "cannot write to {}: {error}; choose another folder",
            args.folder.display()
        ))
    })?;
    Ok(ExitCode::SUCCESS)
}

#[derive(Args)]
pub(crate) struct SchemaArgs {
    /// Which file.
    #[arg(value_enum)]
    file: Schema,
}

#[derive(Clone, Copy, ValueEnum)]
enum Schema {
    /// A scenario, as given to `armplane run`.
    Scenario,
    /// summary.json of a run.
    Summary,
}

pub(crate) fn schema(args: &SchemaArgs) -> Result<ExitCode, Failure> {
    let text = match args.file {
        Schema::Scenario => session::schema::SCENARIO,
        Schema::Summary => session::schema::SUMMARY,
    };
    say!("{}", text.trim_end());
    Ok(ExitCode::SUCCESS)
}
