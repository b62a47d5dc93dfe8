//! `armplane sweep`: a scenario under many settings, into Parquet; its shards put together; its report.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Subcommand};
use lab::sweeps::{self, ReportRequest, Request, Shard};
use session::Failure;

use crate::out::{answer, say, show, whole};
use crate::progress::observe;

#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct SweepArgs {
    #[command(subcommand)]
    command: Option<SweepCommand>,
    /// The sweep's file.
    #[arg(value_name = "SWEEP.toml", required_unless_present = "merge")]
    file: Option<PathBuf>,
    /// Folder for the results; continues a sweep begun there [default: runs/NAME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Compute part I of N, for batch systems; give each a separate --out.
    #[arg(long, value_name = "I/N", value_parser = shard, conflicts_with = "merge")]
    shard: Option<Shard>,
    /// Merge the folders of all shards.
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with = "file")]
    merge: Vec<PathBuf>,
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
    /// Column that ranks the worst runs and colours the map.
    #[arg(long, value_name = "COLUMN", default_value = "position_max_mm")]
    by: String,
    /// Keys of the map's axes [default: the first two].
    #[arg(long, value_name = "KEY,KEY", value_delimiter = ',')]
    map: Vec<String>,
    /// Number of worst runs to list.
    #[arg(long, value_name = "N", default_value_t = 10)]
    worst: usize,
}

fn shard(text: &str) -> Result<Shard, String> {
    let numbers = text
        .split_once('/')
        .and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
    let valid = numbers.filter(|(index, of)| (1..=*of).contains(index));
    valid
        .map(|(index, of)| Shard { index, of })
        .ok_or_else(|| format!("`{text}` is not a shard: write I/N, such as 1/4"))
}

pub(crate) fn sweep(args: &SweepArgs, as_json: bool) -> Result<ExitCode, Failure> {
    if let Some(SweepCommand::Report(args)) = &args.command {
        return report(args, as_json);
    }
    let done = match &args.file {
        None => sweeps::merge(&args.merge, args.out.as_deref(), &observe),
        Some(file) => sweeps::run(
            &Request {
                file,
                out: args.out.as_deref(),
                shard: args.shard,
            },
            &observe,
        ),
    }?;
    if as_json {
        say!("{}", serde_json::to_string(&done).map_err(Failure::work)?);
        return whole(done.lack());
    }
    let folder = done.folder.display();
    show(&done);
    say!(
        "\n{folder}\n  runs/*.parquet  one row per run: duckdb -c \"FROM '{folder}/runs/*.parquet'\""
    );
    if args.shard.is_none() {
        say!("  look at it with: armplane sweep report {folder}");
    }
    // A failure where something that was asked for has no result.
    whole(done.lack())
}

fn report(args: &ReportArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let ReportArgs {
        folder,
        by,
        map,
        worst,
    } = args;
    let report = sweeps::report(&ReportRequest {
        folder,
        by,
        map,
        worst: *worst,
    })?;
    let json = serde_json::to_string(&report).map_err(Failure::work)?;
    answer(as_json, &json, &report);
    Ok(ExitCode::SUCCESS)
}
