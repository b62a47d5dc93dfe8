//! `armplane bench`: what a hand-over, a cycle, a period and a step cost here, beside baseline transports of the machine.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use lab::benchmarks::hour::Hour;
use lab::benchmarks::realtime::Ran;
use lab::benchmarks::{self, Lockstep, Only, Recorded, Row, Rows};
use lab::faults::soak::{self, Soak};
use serde::Serialize;
use serde_json::json;
use session::Failure;
use session::load::{self, Loaded};

use crate::out::{passed, say, show};
use crate::progress::observe;

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

/// Everything that was measured.
#[derive(Default)]
struct Measured {
    rows: Vec<Row>,
    record: Option<Recorded>,
    lockstep: Option<Lockstep>,
    realtime: Vec<Ran>,
    hour: Option<Hour>,
    soaked: Option<Soak>,
}

impl Bench {
    /// Benchmarks of hand-overs, whose rows `--only` chooses.
    const HAND_OVERS: [Self; 2] = [Self::Hop, Self::Cycle];

    fn is_chosen(self, args: &BenchArgs) -> bool {
        let usual = || {
            !matches!(
                self,
                Self::Lockstep | Self::Realtime | Self::Hour | Self::Soak
            )
        };
        args.what.contains(&self)
            || args.what.is_empty() && usual()
            || self == Self::Lockstep && args.against.is_some()
    }
}

pub(crate) fn bench(args: &BenchArgs, as_json: bool) -> Result<ExitCode, Failure> {
    if args.only.iter().any(|word| word.trim().is_empty()) {
        return Err(Failure::Input(
            "--only needs a word or a number of bytes, as in --only \"same core\" --only 4096"
                .to_owned(),
        ));
    }
    let loaded = load::scenario(load::DEFAULT_SCENARIO, &[], None)?;
    let out = args.out.as_deref().map(folder).transpose()?;
    let mut measured = Measured::default();
    let (hand_overs, rest): (Vec<Bench>, _) = Bench::value_variants()
        .iter()
        .filter(|bench| bench.is_chosen(args))
        .partition(|bench| Bench::HAND_OVERS.contains(bench));
    for bench in hand_overs {
        measured.measure(bench, args, &loaded, out.as_deref())?;
    }
    if measured.rows.is_empty() && !args.only.is_empty() {
        return Err(Failure::Input(format!(
            "no row of `hop` or `cycle` has all of --only {}: see the table without it",
            args.only.join(" --only ")
        )));
    }
    for bench in rest {
        measured.measure(bench, args, &loaded, out.as_deref())?;
    }
    let machine = benchmarks::machine();
    let machine_line = benchmarks::machine_line(&machine);
    let whole = measured.json(&machine);
    let pictures = match &out {
        Some(out) => measured.save(out, &whole, &machine_line)?,
        None => Vec::new(),
    };
    if as_json {
        say!("{whole}");
    } else {
        measured.print(args, &machine_line, &pictures);
    }
    match measured.soaked {
        Some(Soak {
            interrupted: Some(signal),
            ..
        }) => Err(Failure::Work(format!("the soak was stopped by {signal}"))),
        soaked => passed(soaked.is_none_or(|soaked| soaked.passed)),
    }
}

impl Measured {
    fn measure(
        &mut self,
        bench: Bench,
        args: &BenchArgs,
        Loaded {
            robot, scenario, ..
        }: &Loaded,
        out: Option<&Path>,
    ) -> Result<(), Failure> {
        let (only, seconds) = (Only(&args.only), |usual| args.seconds.unwrap_or(usual));
        let rates = |usual: &[u32]| match &args.rate[..] {
            [] => usual.to_vec(),
            rates => rates.to_vec(),
        };
        match bench {
            Bench::Hop => self
                .rows
                .extend(benchmarks::hop(args.samples, &only, &observe)?),
            Bench::Cycle => self
                .rows
                .extend(benchmarks::cycle(args.samples, &only, &observe)?),
            Bench::Paced => {
                for rate_hz in [1_000, 4_000] {
                    let paced = benchmarks::paced(rate_hz, seconds(5), &observe)?;
                    self.rows.extend(paced);
                }
            }
            Bench::Model => self.rows.extend(benchmarks::model(robot)?),
            Bench::Control => self.rows.extend(benchmarks::control(robot, scenario)?),
            Bench::Plant => self.rows.extend(benchmarks::plant(robot, scenario)?),
            Bench::Record => {
                let (rows, account) = benchmarks::record(robot, scenario, &observe)?;
                self.rows.extend(rows);
                self.record = Some(account);
            }
            Bench::Lockstep => {
                let against = args.against.as_deref();
                self.lockstep = Some(benchmarks::lockstep(args.runs, against, &observe)?);
            }
            Bench::Realtime => {
                for rate_hz in rates(&[1_000, 4_000]) {
                    let seconds = seconds(if rate_hz > 1_000 { 20 } else { 60 });
                    self.realtime.push(benchmarks::realtime::graph(
                        robot, scenario, rate_hz, seconds, !args.idle, &observe,
                    )?);
                }
            }
            Bench::Hour => {
                let ran = benchmarks::hour::hour(robot, scenario, seconds(3600), &observe)?;
                self.hour = Some(ran);
            }
            Bench::Soak => {
                let (rate_hz, seconds) = (rates(&[1_000])[0], seconds(1_800));
                self.soaked = Some(soak::soak(
                    robot, scenario, rate_hz, seconds, args.seed, out, &observe,
                )?);
            }
        }
        Ok(())
    }

    fn json(&self, machine: &impl Serialize) -> serde_json::Value {
        json!({
            "machine": machine, "rows": self.rows.iter().map(Row::json).collect::<Vec<_>>(), "record": self.record,
            "lockstep": self.lockstep.as_ref().map(Lockstep::json), "realtime": self.realtime.iter().map(Ran::json).collect::<Vec<_>>(),
            "hour": self.hour, "soak": self.soaked,
        })
    }

    fn print(&self, args: &BenchArgs, machine: &str, pictures: &[PathBuf]) {
        if !self.rows.is_empty() {
            show(&Rows(&self.rows));
            if !args.only.is_empty() {
                say!(
                    "only the rows with {}, and their baseline: the whole table without --only",
                    args.only.join(", ")
                );
            }
        }
        self.record.iter().for_each(show);
        self.lockstep.iter().for_each(show);
        self.realtime.iter().for_each(show);
        self.hour.iter().for_each(show);
        self.soaked.iter().for_each(show);
        say!("{machine}");
        pictures.iter().for_each(|path| say!("{}", path.display()));
        if args.out.is_none() && !self.rows.is_empty() {
            say!("pictures: --out DIR");
        }
    }

    fn save(
        &self,
        out: &Path,
        whole: &serde_json::Value,
        machine: &str,
    ) -> Result<Vec<PathBuf>, Failure> {
        let path = out.join("bench.json");
        let text = serde_json::to_vec_pretty(whole).map_err(Failure::work)?;
        std::fs::write(&path, text).map_err(Failure::cannot("write", &path))?;
        let mut paths = vec![path];
        let mut pages: Vec<_> = benchmarks::pictures(&self.rows, machine)
            .into_iter()
            .map(|(bench, page)| (format!("bench-{bench}"), page))
            .collect();
        pages.extend(
            self.soaked
                .as_ref()
                .map(|soaked| ("soak".to_owned(), soak::picture(soaked))),
        );
        for (name, page) in pages {
            paths.extend(page.save(&out.join(name)).map_err(Failure::work)?);
        }
        Ok(paths)
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
