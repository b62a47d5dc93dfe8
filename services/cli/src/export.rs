//! `armplane export`: a recording's numbers and events for other tools, and its layout for the viewer.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use session::{Failure, Run, save_blueprint};
use shared_types::scenario::Layout;
use viz::ExportNews;

use crate::layout::layout;
use crate::out::say;

#[derive(Args)]
pub(crate) struct ExportArgs {
    /// The run's folder, or its name under runs/ [default: the latest].
    #[arg(value_name = "RUN")]
    run: Option<PathBuf>,
    /// The format.
    #[arg(long, value_enum, default_value = "csv")]
    format: ExportFormat,
    /// Folder for the files [default: the run's].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Which layout, for rbl [default: the scenario's].
    #[arg(long, value_parser = layout, value_name = "control|timing|faults")]
    layout: Option<Layout>,
}

#[derive(Clone, Copy, ValueEnum)]
enum ExportFormat {
    /// signals.csv and events.csv.
    Csv,
    /// signals.parquet and events.parquet.
    Parquet,
    /// run.mcap, as Foxglove reads it.
    Mcap,
    /// The layout for the Rerun viewer.
    Rbl,
}

pub(crate) fn export(args: &ExportArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let run = Run::find(args.run.as_deref())?;
    let out = args.out.clone().unwrap_or_else(|| run.folder.clone());
    std::fs::create_dir_all(&out).map_err(|error| Failure::Input(format!("cannot write to {}: {error}", out.display())))?;
    let format = match args.format {
        ExportFormat::Csv => Some(viz::ExportFormat::Csv),
        ExportFormat::Parquet => Some(viz::ExportFormat::Parquet),
        ExportFormat::Mcap => Some(viz::ExportFormat::Mcap),
        ExportFormat::Rbl => None,
    };
    let files = match format {
        None => {
            let layout = args.layout.map_or_else(|| run.job().map(|job| job.scenario.view.layout), Ok)?;
            let path = out.join(format!("{}.rbl", layout.name()));
            save_blueprint(&run, layout, &path)?;
            vec![path]
        }
        Some(_) if args.layout.is_some() => return Err(Failure::Input("--layout goes with --format rbl only".to_owned())),
        Some(format) => write(run.recording()?, format, &out)?,
    };
    let bytes = |path: &PathBuf| std::fs::metadata(path).map_or(0, |file| file.len());
    if as_json {
        let files: Vec<_> = files.iter().map(|path| serde_json::json!({"file": path, "bytes": bytes(path)})).collect();
        say!("{}", serde_json::json!({"files": files}));
    } else {
        files.iter().for_each(|path| say!("{}  {:.1} MB", path.display(), bytes(path) as f64 / 1e6));
    }
    Ok(ExitCode::SUCCESS)
}

fn write(parts: &[PathBuf], format: viz::ExportFormat, out: &Path) -> Result<Vec<PathBuf>, Failure> {
    let bar = ProgressBar::new_spinner().with_message("rows");
    if let Ok(style) = ProgressStyle::with_template("{spinner} {pos} {msg}  {per_sec}") {
        bar.set_style(style);
    }
    let written = viz::export(parts, format, out, &mut |news| match news {
        ExportNews::Rows(rows) => bar.inc(rows),
        ExportNews::Damaged(damage) => bar.suspend(|| eprintln!("{damage}")),
    });
    bar.finish_and_clear();
    written.map_err(Failure::work)
}
