//! `armplane sweep` and `armplane figures`: modules of the package in Python.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use session::{Failure, Python};

#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct SweepArgs {
    #[command(subcommand)]
    command: Option<SweepCommand>,
    /// The sweep's file.
    #[arg(value_name = "SWEEP.toml", required = true)]
    file: Option<PathBuf>,
    /// Folder for the results; continues a sweep begun there [default: runs/NAME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of threads [default: all cores].
    #[arg(long, value_name = "N")]
    jobs: Option<u32>,
    /// Run on the workers of this dask scheduler.
    #[arg(long, value_name = "ADDRESS")]
    dask: Option<String>,
}

#[derive(Subcommand)]
enum SweepCommand {
    /// Show outcomes, distributions, a map over two keys, and the worst runs.
    #[command(
        after_help = "Example:\n  armplane sweep report runs/gains --by orientation_max_deg --map control.k_p,plant.mass_factor"
    )]
    Report(ReportArgs),
}

#[derive(Args)]
struct ReportArgs {
    /// The sweep's folder.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Column that ranks the worst runs and colours the map [default: position_max_mm].
    #[arg(long, value_name = "COLUMN")]
    by: Option<String>,
    /// Keys of the map's axes [default: the first two].
    #[arg(long, value_name = "KEY,KEY")]
    map: Option<String>,
    /// Number of worst runs to list [default: 10].
    #[arg(long, value_name = "N")]
    worst: Option<u32>,
}

#[derive(Args)]
pub(crate) struct FiguresArgs {
    /// Folder for the figures [default: the next free runs/figures-NNN].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Override a value of every scenario, for example plant.encoder_bits=0 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// The words of a command line for the module.
struct Words(Vec<String>);

impl Words {
    fn new(command: &str, subject: Option<&PathBuf>, as_json: bool) -> Self {
        let subject = subject.map(|path| path.display().to_string());
        let json = as_json.then(|| "--json".to_owned());
        let words = [command.to_owned()].into_iter().chain(subject);
        Self(words.chain(json).collect())
    }

    fn with(mut self, option: &str, value: Option<impl ToString>) -> Self {
        let word = value.map(|value| format!("--{option}={}", value.to_string()));
        self.0.extend(word);
        self
    }

    /// Becomes the module.
    fn exec(self) -> Failure {
        Python::exec("experiments", self.0)
    }
}

fn shown(path: &Option<PathBuf>) -> Option<String> {
    path.as_ref().map(|path| path.display().to_string())
}

/// Becomes the sweep, or its report.
pub(crate) fn sweep(args: &SweepArgs, as_json: bool) -> Failure {
    if let Some(SweepCommand::Report(args)) = &args.command {
        return Words::new("report", Some(&args.folder), as_json)
            .with("by", args.by.as_ref())
            .with("map", args.map.as_ref())
            .with("worst", args.worst)
            .exec();
    }
    Words::new("sweep", args.file.as_ref(), as_json)
        .with("out", shown(&args.out))
        .with("jobs", args.jobs)
        .with("dask", args.dask.as_ref())
        .exec()
}

/// Becomes the figures.
pub(crate) fn figures(args: &FiguresArgs, as_json: bool) -> Failure {
    let words = Words::new("figures", None, as_json).with("out", shown(&args.out));
    let set = |words: Words, setting| words.with("set", Some(setting));
    args.set.iter().fold(words, set).exec()
}
