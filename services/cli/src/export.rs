//! `armplane export`: a run's numbers and events for other tools, its recording and its layout for the viewer.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use session::table::size;
use session::{ExportFormat as Form, Failure, Run};
use shared_types::scenario::Layout;

use crate::layout::layout;
use crate::out::{say, whole};
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct ExportArgs {
    /// The run's folder, or its name under runs/ [default: the latest].
    #[arg(value_name = "RUN")]
    run: Option<PathBuf>,
    /// File format.
    #[arg(long, value_enum, default_value = "csv")]
    format: ExportFormat,
    /// Folder for the files [default: the run's].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Layout for rbl [default: the scenario's].
    #[arg(long, value_parser = layout, value_name = "control|timing")]
    layout: Option<Layout>,
}

#[derive(Clone, Copy, ValueEnum)]
enum ExportFormat {
    /// signals.csv and events.csv.
    Csv,
    /// signals.parquet and events.parquet.
    Parquet,
    /// run.rrd: the recording for the Rerun viewer.
    Rrd,
    /// The layout for the Rerun viewer.
    Rbl,
}

pub(crate) fn export(args: &ExportArgs, as_json: bool) -> Result<bool, Failure> {
    let run = Run::find(args.run.as_deref())?;
    let out = args.out.clone().unwrap_or_else(|| run.folder.clone());
    let form = match args.format {
        ExportFormat::Rbl => Form::Layout(args.layout),
        _ if args.layout.is_some() => {
            return Err(Failure::input("--layout needs --format rbl"));
        }
        ExportFormat::Csv => Form::Numbers(viz::ExportFormat::Csv),
        ExportFormat::Parquet => Form::Numbers(viz::ExportFormat::Parquet),
        ExportFormat::Rrd => Form::Recording,
    };
    let session::Export {
        files,
        last_tick,
        shortfall,
    } = session::export(&run, form, &out, &observe)?;
    let bytes = |path: &PathBuf| std::fs::metadata(path).map_or(0, |file| file.len());
    if as_json {
        let files: Vec<_> = files
            .iter()
            .map(|path| serde_json::json!({"file": path, "bytes": bytes(path)}))
            .collect();
        say!(
            "{}",
            serde_json::json!({"files": files, "last_tick": last_tick})
        );
    } else {
        files
            .iter()
            .for_each(|path| say!("{}  {}", path.display(), size(bytes(path))));
    }
    whole(shortfall)
}
