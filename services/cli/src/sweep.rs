//! `armplane sweep`: a scenario under many settings, into Parquet; its shards put together; its report.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Subcommand};
use lab::sweeps::{self, Done, Merged, Report, ReportRequest, Request, Shard};
use serde_json::json;
use session::Failure;

use crate::out::say;
use crate::progress::Terminal;
use session::table::{number, table};
use viz::plot::digits;

#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct SweepArgs {
    #[command(subcommand)]
    command: Option<SweepCommand>,
    /// The sweep's file.
    #[arg(value_name = "SWEEP.toml", required_unless_present = "merge")]
    file: Option<PathBuf>,
    /// Folder for the results; where the sweep has begun in it, it goes on [default: runs/NAME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Compute one part of n, in a folder of its own: for batch systems.
    #[arg(long, value_name = "I/N", value_parser = shard, conflicts_with = "merge")]
    shard: Option<Shard>,
    /// Put the folders of all shards of a sweep together.
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with = "file")]
    merge: Vec<PathBuf>,
}

#[derive(Subcommand)]
enum SweepCommand {
    /// Outcomes, distributions, a map over two keys, and the worst runs with the commands that repeat them.
    Report(ReportArgs),
}

#[derive(Args)]
struct ReportArgs {
    /// The results folder of a sweep.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The column that orders the worst runs and colours the map.
    #[arg(long, value_name = "COLUMN", default_value = "position_max_mm")]
    by: String,
    /// The two keys of the map [default: the first two].
    #[arg(long, value_name = "KEY,KEY", value_delimiter = ',')]
    map: Vec<String>,
    /// How many of the worst runs.
    #[arg(long, value_name = "N", default_value_t = 10)]
    worst: usize,
}

fn shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
    let valid = numbers.filter(|(index, of)| (1..=*of).contains(index));
    valid.map(|(index, of)| Shard { index, of }).ok_or_else(|| format!("`{text}` is not a shard: 1/4, 2/4, 3/4 and 4/4 are those of four"))
}

pub(crate) fn sweep(args: &SweepArgs, as_json: bool) -> Result<ExitCode, Failure> {
    if let Some(SweepCommand::Report(args)) = &args.command {
        return report(args, as_json);
    }
    let terminal = Terminal::default();
    let observer = |progress: session::Progress<'_>| terminal.show(progress);
    let Some(file) = &args.file else {
        let merged = sweeps::merge(&args.merge, args.out.as_deref(), &observer)?;
        print_merged(&merged, as_json);
        return Ok(ExitCode::SUCCESS);
    };
    let done = sweeps::run(&Request { file, out: args.out.as_deref(), shard: args.shard }, &observer)?;
    print_done(&done, args.shard, as_json);
    Ok(ExitCode::SUCCESS)
}

fn print_done(done: &Done, shard: Option<Shard>, as_json: bool) {
    let Done { name, folder, runs, found, simulated_s, wall_s, cores } = done;
    if as_json {
        let whole = json!({"sweep": name, "folder": folder, "runs": runs, "found": found, "simulated_s": simulated_s, "wall_s": wall_s, "cores": cores,
            "shard": shard.map(|shard| shard.to_string())});
        return say!("{whole}");
    }
    let of_shard = shard.map(|shard| format!(", shard {shard}")).unwrap_or_default();
    let computed = runs - found;
    let before = if *found > 0 { format!(", {found} of them before") } else { String::new() };
    say!("{name}{of_shard}: {runs} runs{before}");
    if computed > 0 {
        say!(
            "time       {computed} runs in {wall_s:.1} s on {cores} cores: {:.1} runs/s, {:.0} × real time",
            computed as f64 / wall_s,
            simulated_s / wall_s
        );
    }
    print_folder(folder, shard.is_none());
}

fn print_merged(Merged { name, folder, runs }: &Merged, as_json: bool) {
    if as_json {
        return say!("{}", json!({"sweep": name, "folder": folder, "runs": runs}));
    }
    say!("{name}: {runs} runs, whole");
    print_folder(folder, true);
}

fn print_folder(folder: &Path, is_whole: bool) {
    say!("\n{}", folder.display());
    say!("  runs/*.parquet  a row a run: duckdb -c \"FROM '{}/runs/*.parquet'\"", folder.display());
    if is_whole {
        say!("  look at it with: armplane sweep report {}", folder.display());
    }
}

fn report(args: &ReportArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let ReportArgs { folder, by, map, worst } = args;
    let report = sweeps::report(&ReportRequest { folder, by, map, worst: *worst })?;
    if as_json {
        say!("{}", report.json());
    } else {
        print_report(&report);
    }
    Ok(ExitCode::SUCCESS)
}

fn print_report(report: &Report) {
    let [runs, of] = report.runs;
    let outcomes: Vec<String> = report.outcomes.iter().map(|(outcome, count)| format!("{outcome} {count}")).collect();
    let counted = if runs == of { format!("{runs} runs") } else { format!("{runs} of {of} runs, those of complete partitions") };
    say!("{}: {counted}; {}", report.name, outcomes.join(", "));
    if let Some(reason) = &report.refused {
        say!("refused    for example: {reason}");
    }
    let mut rows = table(&["", "runs", "smallest", "median", "90 %", "99 %", "largest"]);
    for spread in &report.spreads {
        let values = spread.values.map(|value| number(digits(value)));
        rows.add_row([spread.column.clone().into(), number(spread.runs)].into_iter().chain(values).collect::<Vec<_>>());
    }
    say!("{rows}");
    if !report.worst.is_empty() {
        say!("The worst by {}, each with the command that repeats it as a recording:", report.by);
    }
    for worst in &report.worst {
        let settings: Vec<String> = worst.settings.iter().map(|(key, value)| format!("{key} = {value}")).collect();
        say!("run {}: {}, {}; {}", worst.run, digits(worst.value), worst.outcome, settings.join(", "));
        say!("  {}", worst.command);
    }
    if !report.remark.is_empty() {
        say!("{}", report.remark);
    }
    say!("\n{}", report.folder.display());
    say!("  report.svg, report.png  distributions and map\n  report.json             all of this for machines");
}
