//! `armplane bench`: what a hand-over, a cycle, a period and a step cost here, beside baseline transports of the machine.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use lab::benchmarks::realtime::Ran;
use lab::benchmarks::{self, Lockstep, Only, Row, Rows};
use lab::faults;
use serde_json::json;
use session::{Failure, load};

use crate::out::{say, show};
use crate::progress::Terminal;

#[derive(Args)]
pub(crate) struct BenchArgs {
    /// Benchmarks to run [default: everything].
    #[arg(value_enum, value_name = "BENCH")]
    what: Vec<Bench>,
    /// Samples of each hop and cycle.
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u64).range(1000..=10_000_000))]
    samples: u64,
    /// Measure only the rows of `hop` and `cycle` that have each of these words in placement or mechanism, or this number of bytes; with their
    /// baseline. Example: --only 4096 --only "same core".
    #[arg(long, value_name = "WORD")]
    only: Vec<String>,
    /// Another armplane, for example of an earlier version, that `lockstep` runs in turns with this one.
    #[arg(long, value_name = "PROGRAM")]
    against: Option<PathBuf>,
    /// Runs of `lockstep`, of each program.
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    runs: u32,
    /// How long each paced measurement lasts; s [default: 5; `realtime` 60 at 1 kHz and 20 at 4 kHz; `hour` 3600; `soak` 1800].
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u64).range(1..=86_400))]
    seconds: Option<u64>,
    /// Rates of `realtime`, the first of them that of `soak`; Hz [default: 1000 4000].
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(50..=20_000))]
    rate: Vec<u32>,
    /// Seed of the faults in `soak`, and of its runs [default: another one each time].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Run `realtime` without the competing load.
    #[arg(long)]
    idle: bool,
    /// Save bench.json and a picture for each benchmark, such as bench-hop.svg and bench-hop.png, in this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Args)]
pub(crate) struct BenchPeerArgs {
    /// Which.
    name: String,
    /// The run's directory in shared memory.
    #[arg(long, value_name = "DIR")]
    run: PathBuf,
}

/// The benchmarks.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Bench {
    /// Half a round trip between two processes.
    Hop,
    /// Once around four processes: sensor, estimate, singularities, torque.
    Cycle,
    /// The same on a grid of 1 and 4 kHz, and how late the process that makes the ticks wakes.
    Paced,
    /// The arm's dynamics.
    Model,
    /// Estimator, analyzer and controller, one step.
    Control,
    /// The simulated arm, one step.
    Plant,
    /// The recorder's work per tick, and its output.
    Record,
    /// Ticks a second of the whole graph in lockstep, recording on; with --against in turns with another armplane (only when asked for).
    Lockstep,
    /// The whole graph in real time beside a busy thread on every core: deadlines missed, by process and cause (only when asked for).
    Realtime,
    /// An hour of the arm's time in lockstep: memory, files and the recorder's processor time (only when asked for).
    Hour,
    /// The whole graph in real time for 30 minutes, with every fault at random (only when asked for).
    Soak,
}

pub(crate) fn bench(args: &BenchArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let chosen = |bench: Bench| {
        args.what.contains(&bench)
            || args.what.is_empty()
                && !matches!(
                    bench,
                    Bench::Lockstep | Bench::Realtime | Bench::Hour | Bench::Soak
                )
    };
    let load::Loaded {
        scenario, robot, ..
    } = load::scenario(load::DEFAULT_SCENARIO, &[], None)?;
    let out = args.out.as_deref().map(folder).transpose()?;
    let terminal = Terminal::default();
    let observer: session::Observer<'_> = &|progress| terminal.show(progress);
    let (mut rows, mut record, mut realtime, mut hour) = (Vec::new(), None, Vec::new(), None);
    if args.only.iter().any(|word| word.trim().is_empty()) {
        return Err(Failure::Input(
            "--only needs a word or a number of bytes, as in --only \"same core\" --only 4096"
                .to_owned(),
        ));
    }
    if chosen(Bench::Hop) {
        rows.extend(benchmarks::hop(args.samples, &Only(&args.only), observer)?);
    }
    if chosen(Bench::Cycle) {
        rows.extend(benchmarks::cycle(
            args.samples,
            &Only(&args.only),
            observer,
        )?);
    }
    if rows.is_empty() && !args.only.is_empty() {
        return Err(Failure::Input(format!(
            "no row of `hop` or `cycle` has all of --only {}: see the table without it",
            args.only.join(" --only ")
        )));
    }
    if chosen(Bench::Paced) {
        for rate_hz in [1_000, 4_000] {
            rows.extend(benchmarks::paced(
                rate_hz,
                args.seconds.unwrap_or(5),
                observer,
            )?);
        }
    }
    if chosen(Bench::Model) {
        rows.extend(benchmarks::model(&robot)?);
    }
    if chosen(Bench::Control) {
        rows.extend(benchmarks::control(&robot, &scenario)?);
    }
    if chosen(Bench::Plant) {
        rows.extend(benchmarks::plant(&robot, &scenario)?);
    }
    if chosen(Bench::Record) {
        let (measured, account) = benchmarks::record(&robot, &scenario, observer)?;
        rows.extend(measured);
        record = Some(account);
    }
    let lockstep = match chosen(Bench::Lockstep) || args.against.is_some() {
        true => Some(benchmarks::lockstep(
            args.runs,
            args.against.as_deref(),
            observer,
        )?),
        false => None,
    };
    if chosen(Bench::Realtime) {
        let rates = if args.rate.is_empty() {
            vec![1_000, 4_000]
        } else {
            args.rate.clone()
        };
        for rate_hz in rates {
            let seconds = args
                .seconds
                .unwrap_or(if rate_hz > 1_000 { 20 } else { 60 });
            realtime.push(benchmarks::realtime::graph(
                &robot, &scenario, rate_hz, seconds, !args.idle, observer,
            )?);
        }
    }
    if chosen(Bench::Hour) {
        hour = Some(benchmarks::hour::hour(
            &robot,
            &scenario,
            args.seconds.unwrap_or(3600),
            observer,
        )?);
    }
    let soaked = if chosen(Bench::Soak) {
        let (rate_hz, seconds) = (
            args.rate.first().copied().unwrap_or(1_000),
            args.seconds.unwrap_or(1_800),
        );
        Some(faults::soak::soak(
            &robot,
            &scenario,
            rate_hz,
            seconds,
            args.seed,
            out.as_deref(),
            observer,
        )?)
    } else {
        None
    };
    let machine = benchmarks::machine();
    let machine_line = benchmarks::machine_line(&machine);
    let whole = json!({
        "machine": machine, "rows": rows.iter().map(Row::json).collect::<Vec<_>>(), "record": record,
        "lockstep": lockstep.as_ref().map(Lockstep::json), "realtime": realtime.iter().map(Ran::json).collect::<Vec<_>>(), "hour": hour, "soak": soaked,
    });
    let mut pictures = match &out {
        Some(out) => save(out, &whole, &rows, &machine_line)?,
        None => Vec::new(),
    };
    if let (Some(out), Some(soaked)) = (&out, &soaked) {
        pictures.extend(
            faults::soak::picture(soaked)
                .save(&out.join("soak"))
                .map_err(Failure::work)?,
        );
    }
    if as_json {
        say!("{whole}");
    } else {
        if !rows.is_empty() {
            show(&Rows(&rows));
            if !args.only.is_empty() {
                say!(
                    "only the rows with {}, and their baseline: the whole table without --only",
                    args.only.join(", ")
                );
            }
        }
        record.iter().for_each(show);
        lockstep.iter().for_each(show);
        realtime.iter().for_each(show);
        hour.iter().for_each(show);
        soaked.iter().for_each(show);
        say!("{machine_line}");
        match &out {
            Some(_) => pictures.iter().for_each(|path| say!("{}", path.display())),
            None if rows.is_empty() => {}
            None => say!("pictures: --out DIR"),
        }
    }
    match soaked
        .as_ref()
        .map(|soaked| (soaked.passed, soaked.interrupted.as_deref()))
    {
        Some((_, Some(signal))) => Err(Failure::Work(format!("the soak was stopped by {signal}"))),
        Some((false, None)) => Ok(ExitCode::from(1)),
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// Takes part in a ring.
pub(crate) fn peer(args: &BenchPeerArgs) -> Result<ExitCode, Failure> {
    benchmarks::peer(&args.name, &args.run).map_err(Failure::work)?;
    Ok(ExitCode::SUCCESS)
}

/// The folder for what is saved, made before anything is measured.
fn folder(out: &Path) -> Result<PathBuf, Failure> {
    let made = std::fs::create_dir_all(out).and_then(|()| out.canonicalize());
    made.map_err(|error| {
        Failure::Input(format!(
            "cannot write to {}: {error}; choose another folder with --out",
            out.display()
        ))
    })
}

fn save(
    out: &Path,
    whole: &serde_json::Value,
    rows: &[Row],
    machine: &str,
) -> Result<Vec<PathBuf>, Failure> {
    let path = out.join("bench.json");
    let text = serde_json::to_vec_pretty(whole).map_err(Failure::work)?;
    std::fs::write(&path, text)
        .map_err(|error| Failure::Work(format!("cannot write {}: {error}", path.display())))?;
    let mut paths = vec![path];
    for (bench, page) in benchmarks::pictures(rows, machine) {
        paths.extend(
            page.save(&out.join(format!("bench-{bench}")))
                .map_err(Failure::work)?,
        );
    }
    Ok(paths)
}
