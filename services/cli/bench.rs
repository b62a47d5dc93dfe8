//! `armplane bench`: what a hand-over, a cycle, a period and a step cost here, beside what the machine itself charges.

mod hour;
mod local;
mod realtime;
mod ring;
mod soak;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueEnum;
use hdrhistogram::Histogram;
use model::Robot;
use runtime::realtime::allowed_cores;
use serde::{Deserialize, Serialize};
use serde_json::json;
use shared_types::job::{Job, Mode};
use shared_types::scenario::Scenario;

use super::failure::Failure;
use super::out::say;
use super::plot::{Axis, Page, Panel, Row as PlotRow, numbered};
use super::table::{digits, number, table};
use super::{BenchArgs, load};
use ring::{Mechanism, Ring};

/// What can be measured.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Bench {
    /// Half a round trip between two processes.
    Hop,
    /// Once around four processes: sensor, estimate, singularities, torque.
    Cycle,
    /// The same on a grid of 1 and 4 kHz, and how late the grid's owner wakes.
    Paced,
    /// The arm's dynamics.
    Model,
    /// Estimator, analyzer and controller, one step.
    Control,
    /// The simulated arm, one step.
    Plant,
    /// What the recorder does with a tick, and how much it writes.
    Record,
    /// The whole graph in real time beside a busy thread on every core: deadlines missed, by process and cause (only when asked for).
    Realtime,
    /// An hour of the arm's time in lockstep: memory, files and the recorder's processor time (only when asked for).
    Hour,
    /// The whole graph in real time for 30 minutes, struck at random by every fault (only when asked for).
    Soak,
}

/// A distribution of times; µs, no sample left out.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Distribution {
    samples: u64,
    p50_us: f64,
    p99_us: f64,
    p999_us: f64,
    max_us: f64,
    /// For the picture: (−log₁₀ of the share of samples above it, time; µs).
    curve: Vec<(f64, f64)>,
}

/// Points of a curve per power of ten.
const PER_DECADE: u32 = 12;

impl Distribution {
    fn of(nanoseconds: &Histogram<u64>) -> Self {
        let at = |quantile| nanoseconds.value_at_quantile(quantile) as f64 / 1e3;
        let decades = (nanoseconds.len().max(1) as f64).log10();
        let nines = (0..=(decades * f64::from(PER_DECADE)) as u32).map(|step| f64::from(step) / f64::from(PER_DECADE));
        Self {
            samples: nanoseconds.len(),
            p50_us: at(0.5),
            p99_us: at(0.99),
            p999_us: at(0.999),
            max_us: nanoseconds.max() as f64 / 1e3,
            curve: nines.map(|nines| (nines, at(1.0 - 10_f64.powf(-nines)))).collect(),
        }
    }

    fn divided_by(mut self, n: f64) -> Self {
        for time in [&mut self.p50_us, &mut self.p99_us, &mut self.p999_us, &mut self.max_us] {
            *time /= n;
        }
        self.curve.iter_mut().for_each(|point| point.1 /= n);
        self
    }
}

/// Nanoseconds up to 100 s, three digits.
fn histogram() -> Histogram<u64> {
    #[allow(clippy::expect_used, reason = "the bounds are constants")]
    Histogram::new_with_bounds(1, 100_000_000_000, 3).expect("constant bounds are valid")
}

/// One line of the result.
struct Row {
    bench: String,
    mechanism: String,
    placement: String,
    /// Bytes of the message, or of all messages of a cycle; 0 where there is none.
    payload_bytes: usize,
    distribution: Distribution,
    /// Against the floor of the same bench, placement and payload; none where there is no floor.
    ratio_p50: Option<f64>,
    ratio_p99: Option<f64>,
}

impl Row {
    /// A row without a floor.
    fn alone(bench: &str, mechanism: &str, distribution: Distribution) -> Self {
        let (bench, mechanism, placement) = (bench.to_owned(), mechanism.to_owned(), "one thread".to_owned());
        Self { bench, mechanism, placement, payload_bytes: 0, distribution, ratio_p50: None, ratio_p99: None }
    }

    fn json(&self) -> serde_json::Value {
        let Distribution { samples, p50_us, p99_us, p999_us, max_us, .. } = self.distribution;
        json!({
            "bench": self.bench, "mechanism": self.mechanism, "placement": self.placement, "payload_bytes": self.payload_bytes,
            "samples": samples, "p50_us": p50_us, "p99_us": p99_us, "p999_us": p999_us, "max_us": max_us,
            "ratio_p50": self.ratio_p50, "ratio_p99": self.ratio_p99,
        })
    }
}

/// Where the processes of a ring are, by name.
fn placements(count: usize) -> Vec<(&'static str, Vec<Option<usize>>)> {
    let cores = allowed_cores();
    let mut placements = vec![("same core", vec![cores.first().copied(); count])];
    if cores.len() > 1 {
        let alternating = (0..count).map(|index| Some(cores[index % 2])).collect();
        placements.push((if count == 2 { "cross core" } else { "alternating cores" }, alternating));
    }
    placements
}

pub(crate) fn bench(args: &BenchArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let chosen =
        |bench: Bench| args.what.contains(&bench) || args.what.is_empty() && !matches!(bench, Bench::Realtime | Bench::Hour | Bench::Soak);
    let load::Loaded { scenario, robot } = load::scenario(load::DEFAULT_SCENARIO, &[], None)?;
    let out = args.out.as_deref().map(folder).transpose()?;
    let (mut rows, mut record, mut realtime, mut hour) = (Vec::new(), None, Vec::new(), None);
    if chosen(Bench::Hop) {
        rows.extend(hop(args.samples)?);
    }
    if chosen(Bench::Cycle) {
        rows.extend(cycle(args.samples)?);
    }
    if chosen(Bench::Paced) {
        for rate_hz in [1_000, 4_000] {
            rows.extend(paced(rate_hz, args.seconds.unwrap_or(5))?);
        }
    }
    if chosen(Bench::Model) {
        rows.extend(local::model(&robot)?);
    }
    if chosen(Bench::Control) {
        rows.extend(local::steps(&robot, &scenario, "control")?);
    }
    if chosen(Bench::Plant) {
        rows.extend(local::steps(&robot, &scenario, "plant")?);
    }
    if chosen(Bench::Record) {
        let (measured, account) = local::record(&robot, &scenario)?;
        rows.extend(measured);
        record = Some(account);
    }
    if chosen(Bench::Realtime) {
        let rates = if args.rate.is_empty() { vec![1_000, 4_000] } else { args.rate.clone() };
        for rate_hz in rates {
            let seconds = args.seconds.unwrap_or(if rate_hz > 1_000 { 20 } else { 60 });
            realtime.push(realtime::graph(&robot, &scenario, rate_hz, seconds, !args.idle)?);
        }
    }
    if chosen(Bench::Hour) {
        hour = Some(hour::hour(&robot, &scenario, args.seconds.unwrap_or(3600))?);
    }
    let soak = if chosen(Bench::Soak) {
        let rate_hz = args.rate.first().copied().unwrap_or(1_000);
        Some(soak::soak(&robot, &scenario, rate_hz, args.seconds.unwrap_or(1_800), args.seed, out.as_deref())?)
    } else {
        None
    };
    let machine = machine();
    let whole = json!({
        "machine": machine, "rows": rows.iter().map(Row::json).collect::<Vec<_>>(), "record": record,
        "realtime": realtime.iter().map(realtime::Ran::json).collect::<Vec<_>>(), "hour": hour, "soak": soak,
    });
    let mut pictures = match &out {
        Some(out) => save(out, &whole, &rows, &machine)?,
        None => Vec::new(),
    };
    if let (Some(out), Some(soak)) = (&out, &soak) {
        pictures.extend(soak.picture().save(&out.join("soak")).map_err(Failure::work)?);
    }
    if as_json {
        say!("{whole}");
    } else {
        if !rows.is_empty() {
            tell(&rows);
        }
        if let Some(record) = &record {
            say!("{}", record.sentence());
        }
        realtime.iter().for_each(realtime::Ran::tell);
        hour.iter().for_each(hour::Hour::tell);
        soak.iter().for_each(soak::Soak::tell);
        say!("{}", machine_line(&machine));
        match &out {
            Some(_) => pictures.iter().for_each(|path| say!("{}", path.display())),
            None if rows.is_empty() => {}
            None => say!("a picture of the distributions: --out DIR"),
        }
    }
    match soak.as_ref().map(|soak| (soak.has_passed(), soak.interrupted())) {
        Some((_, Some(signal))) => Err(Failure::Work(format!("the soak was stopped by {signal}"))),
        Some((false, None)) => Ok(ExitCode::from(1)),
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// A folder for the files of a run that is only measured; they go with it.
fn scratch() -> Result<tempfile::TempDir, Failure> {
    let folder = tempfile::Builder::new().prefix("armplane-bench-").tempdir();
    folder.map_err(|error| Failure::Work(format!("cannot make a temporary folder: {error}")))
}

/// A run of the usual graph with everything recorded.
fn job(robot: &Robot, scenario: Scenario, mode: Mode, out: &Path) -> Result<Job, Failure> {
    Ok(load::job(robot, scenario, load::graph(None)?, mode, out.to_owned()))
}

/// The folder for what is saved, made before anything is measured.
fn folder(out: &Path) -> Result<PathBuf, Failure> {
    let made = std::fs::create_dir_all(out).and_then(|()| out.canonicalize());
    made.map_err(|error| Failure::Input(format!("cannot write to {}: {error}; choose another folder with --out", out.display())))
}

fn save(out: &Path, whole: &serde_json::Value, rows: &[Row], machine: &serde_json::Value) -> Result<Vec<PathBuf>, Failure> {
    let path = out.join("bench.json");
    let text = serde_json::to_vec_pretty(whole).map_err(Failure::work)?;
    std::fs::write(&path, text).map_err(|error| Failure::Work(format!("cannot write {}: {error}", path.display())))?;
    let mut paths = vec![path];
    if !rows.is_empty() {
        paths.extend(page(rows, machine).save(&out.join("bench")).map_err(Failure::work)?);
    }
    Ok(paths)
}

/// One panel for each bench, placement and payload: how long the slowest share of samples took.
fn page(rows: &[Row], machine: &serde_json::Value) -> Page {
    type Key<'a> = (&'a str, &'a str, usize);
    let mut panels: Vec<(Key<'_>, Panel, usize)> = Vec::new();
    for row in rows {
        let key = (row.bench.as_str(), row.placement.as_str(), row.payload_bytes);
        let place = panels.iter().position(|(known, ..)| *known == key).unwrap_or_else(|| {
            let bytes = if row.payload_bytes > 0 { format!(", {} bytes", row.payload_bytes) } else { String::new() };
            let title = format!("{}, {}{bytes}; µs", row.bench, row.placement);
            panels.push((key, Panel::new(&title, Axis::named("share above: 10 to the minus"), Axis::default().logarithmic()), 0));
            panels.len() - 1
        });
        let (_, panel, lines) = &mut panels[place];
        panel.line(&row.mechanism, numbered(*lines), &row.distribution.curve);
        *lines += 1;
    }
    for (key, panel, _) in &mut panels {
        // Whole powers of ten, so that there are at least two to read.
        let of_panel = rows.iter().filter(|row| *key == (row.bench.as_str(), row.placement.as_str(), row.payload_bytes));
        let times = || of_panel.clone().flat_map(|row| &row.distribution.curve).map(|point| point.1).filter(|time| *time > 0.0);
        let (least, most) = (times().fold(f64::INFINITY, f64::min), times().fold(0.0, f64::max));
        if most > 0.0 {
            panel.y_within(10_f64.powf(least.log10().floor())..10_f64.powf(most.log10().ceil()));
        }
    }
    let mut panels: Vec<Panel> = panels.into_iter().map(|(_, panel, _)| panel).collect();
    let mut pairs = Vec::new();
    while !panels.is_empty() {
        let rest = panels.split_off(panels.len().min(2));
        pairs.push(PlotRow::of(240.0, std::mem::replace(&mut panels, rest)));
    }
    Page {
        title: "armplane bench".to_owned(),
        subtitle: format!("0: all samples, 2: the slowest hundredth, 3: the slowest thousandth. {}", machine_line(machine)),
        rows: pairs,
        width: 1600.0,
        ..Page::default()
    }
}

fn machine_line(machine: &serde_json::Value) -> String {
    let text = |key: &str| machine[key].as_str().unwrap_or_default().to_owned();
    let rights = if machine["fifo"] == true { "SCHED_FIFO" } else { "without SCHED_FIFO" };
    format!("{}, {}, {} cores, {rights}, load {}", text("cpu"), text("kernel"), machine["cores"], text("load"))
}

/// Trips of a block: long enough to be in the steady state, short enough to see the same machine as the other mechanisms.
const TRIPS: u64 = 500;

fn names(topics: &[&str]) -> Vec<String> {
    topics.iter().map(ToString::to_string).collect()
}

fn hop(samples: u64) -> Result<Vec<Row>, Failure> {
    use shared_types::{PlantState, SensorSample, SingularityReport, TorqueCommand};
    let mut rows = Vec::new();
    for (placement, cores) in placements(2) {
        // Two that spin on one core only wait for each other's time slice to end.
        let is_split = placement != "same core";
        let ring = |topics: &[&str], block_bytes: Option<usize>, mechanisms: Vec<Mechanism>| Ring {
            topics: names(topics),
            block_bytes,
            cores: cores.clone(),
            mechanisms,
            rounds: samples.div_ceil(TRIPS),
            trips: TRIPS,
            period_ns: None,
        };
        let mut measure = |ring: Ring, bytes: usize| -> Result<(), Failure> {
            let measured = ring.measure()?.into_iter().map(|one| (one.mechanism, one.trip.divided_by(2.0)));
            rows.extend(against_floor("hop", placement, bytes, Mechanism::Futex, measured.collect()));
            Ok(())
        };
        for bytes in [64, 1024, 4096] {
            let mut mechanisms = vec![Mechanism::Futex, Mechanism::Doorbell, Mechanism::Listener, Mechanism::WaitSet, Mechanism::Pipe];
            if is_split {
                mechanisms.extend([Mechanism::Spin, Mechanism::Poll]);
            }
            measure(ring(&["sensor", "plant_state"], Some(bytes), mechanisms), bytes)?;
        }
        for (topics, bytes) in [
            (["sensor", "plant_state"], size_of::<SensorSample>().midpoint(size_of::<PlantState>())),
            (["singularity", "torque"], size_of::<SingularityReport>().midpoint(size_of::<TorqueCommand>())),
        ] {
            measure(ring(&topics, None, vec![Mechanism::Futex, Mechanism::Topic]), bytes)?;
        }
    }
    Ok(rows)
}

const CYCLE: [&str; 4] = ["sensor", "estimate", "singularity", "torque"];

fn cycle_bytes() -> usize {
    use shared_types::{SensorSample, SingularityReport, StateEstimate, TorqueCommand};
    size_of::<SensorSample>() + size_of::<StateEstimate>() + size_of::<SingularityReport>() + size_of::<TorqueCommand>()
}

fn cycle(samples: u64) -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for (placement, cores) in placements(4).into_iter().chain([("not pinned, no FIFO", vec![None; 4])]) {
        let mechanisms = vec![Mechanism::Futex, Mechanism::Topic, Mechanism::Pipe];
        let ring = Ring {
            topics: names(&CYCLE),
            block_bytes: None,
            cores,
            mechanisms,
            rounds: samples.div_ceil(TRIPS),
            trips: TRIPS,
            period_ns: None,
        };
        let measured = ring.measure()?.into_iter().map(|one| (one.mechanism, one.trip));
        rows.extend(against_floor("cycle", placement, cycle_bytes(), Mechanism::Futex, measured.collect()));
    }
    Ok(rows)
}

fn paced(rate_hz: u64, seconds: u64) -> Result<Vec<Row>, Failure> {
    // A block is a quarter of a second: the mechanisms take turns within one run.
    let (rounds, trips) = (4 * seconds, rate_hz / 4);
    let (placement, cores) = placements(4).swap_remove(0);
    let mechanisms = vec![Mechanism::Nothing, Mechanism::Futex, Mechanism::Topic];
    let period_ns = Some(1_000_000_000 / rate_hz);
    let measured = Ring { topics: names(&CYCLE), block_bytes: None, cores, mechanisms, rounds, trips, period_ns }.measure()?;
    let wakes = measured.iter().map(|one| (one.mechanism, one.wake.clone())).collect();
    let mut rows = against_floor(&format!("wake-up at {rate_hz} Hz"), placement, 0, Mechanism::Nothing, wakes);
    let trips = measured.iter().filter(|one| one.mechanism != Mechanism::Nothing).map(|one| (one.mechanism, one.trip.clone())).collect();
    rows.extend(against_floor(&format!("paced at {rate_hz} Hz"), placement, cycle_bytes(), Mechanism::Futex, trips));
    Ok(rows)
}

/// Rows of one bench, placement and payload, with their ratios to the floor among them.
fn against_floor(
    bench: &str,
    placement: &str,
    payload_bytes: usize,
    floor: Mechanism,
    measured: Vec<(Mechanism, Distribution)>,
) -> Vec<Row> {
    let floor = measured.iter().find(|(mechanism, _)| *mechanism == floor).map(|(_, distribution)| distribution.clone());
    let ratio = |value: f64, of: fn(&Distribution) -> f64| floor.as_ref().map(of).filter(|floor| *floor > 0.0).map(|floor| value / floor);
    let row = |(mechanism, distribution): (Mechanism, Distribution)| Row {
        bench: bench.to_owned(),
        mechanism: mechanism.name().to_owned(),
        placement: placement.to_owned(),
        payload_bytes,
        ratio_p50: ratio(distribution.p50_us, |floor| floor.p50_us),
        ratio_p99: ratio(distribution.p99_us, |floor| floor.p99_us),
        distribution,
    };
    measured.into_iter().map(row).collect()
}

/// What was measured on.
fn machine() -> serde_json::Value {
    let health = launcher::doctor::examine();
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let cpu = read("/proc/cpuinfo").lines().find_map(|line| Some(line.strip_prefix("model name")?.split_once(':')?.1.trim().to_owned()));
    let load = read("/proc/loadavg").split(' ').take(3).collect::<Vec<_>>().join(" ");
    json!({
        "cpu": cpu.unwrap_or_default(), "cores": health.cores.len(), "pinned_to": allowed_cores(), "kernel": health.kernel, "preempt_rt": health.preempt_rt,
        "clock_source": health.clock_source, "fifo": health.rights.fifo(), "locked_memory": health.rights.lock_memory(), "load": load,
    })
}

fn tell(rows: &[Row]) {
    let mut lines = table(&["bench", "placement", "bytes", "mechanism", "samples", "p50 µs", "p99", "p99.9", "max", "ratio p50", "p99"]);
    for row in rows {
        let Distribution { samples, p50_us, p99_us, p999_us, max_us, .. } = row.distribution;
        let ratio = |ratio: Option<f64>| number(ratio.map_or(String::new(), |ratio| format!("{ratio:.2}")));
        lines.add_row([
            row.bench.clone().into(),
            row.placement.clone().into(),
            number(row.payload_bytes),
            row.mechanism.clone().into(),
            number(samples),
            number(digits(p50_us)),
            number(digits(p99_us)),
            number(digits(p999_us)),
            number(digits(max_us)),
            ratio(row.ratio_p50),
            ratio(row.ratio_p99),
        ]);
    }
    say!("{lines}");
}

/// Takes part in a ring.
pub(crate) fn peer(name: &str, run: &Path) -> Result<ExitCode, Failure> {
    ring::peer(name, run).map_err(Failure::work)?;
    Ok(ExitCode::SUCCESS)
}
