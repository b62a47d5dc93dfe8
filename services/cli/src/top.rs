//! `armplane top`: a running graph, seen from its control page. It only reads: nobody in the run can tell that it is there.
//! Percentiles are those of the time between two looks, the longest that of the whole run.

use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Args;
use runtime::{ControlPage, Counts, Distribution, FaultRecord, LiveSingularity, LiveState, Manifest, Mode, RunDir, SHM, State, Stop};
use serde_json::{Value, json};
use session::Failure;
use shared_types::codes::{self, name_of, singularity_name};
use shared_types::fault::Kind;

use crate::out::say;
use crate::table::{digits, number, table};

/// A process's counts between two samples.
struct Seen {
    pid: u32,
    incarnation: u32,
    state: State,
    ticks: u64,
    counts: Counts,
    step: Distribution,
    age: Distribution,
}

struct Look {
    at: Instant,
    processes: Vec<Seen>,
    arm: LiveState,
    faults: Vec<FaultRecord>,
}

#[derive(Args)]
pub(crate) struct TopArgs {
    /// The run's name, where several are alive (see `armplane doctor --json`).
    #[arg(long, value_name = "RUN")]
    run: Option<String>,
    /// One look, then leave.
    #[arg(long)]
    once: bool,
    /// Time between two looks; ms.
    #[arg(long, value_name = "MS", default_value_t = 500, value_parser = clap::value_parser!(u64).range(10..=60_000))]
    every_ms: u64,
}

pub(crate) fn top(args: &TopArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let name = choose(args.run.as_deref())?;
    let run = RunDir::open(&Path::new(SHM).join(&name)).map_err(Failure::input)?;
    let manifest = Manifest::read(&run).map_err(Failure::work)?;
    let control_page = ControlPage::open(&run).map_err(Failure::work)?;
    let every = Duration::from_millis(args.every_ms);
    let mut before = look(&control_page, &manifest);
    loop {
        std::thread::sleep(every);
        let now = look(&control_page, &manifest);
        if as_json {
            say!("{}", machine(&name, &manifest, &before, &now));
        } else {
            if !args.once {
                // To the upper left corner, and clear what is below.
                print!("\x1b[H\x1b[J");
            }
            people(&name, &manifest, &before, &now);
        }
        let is_over = control_page.stop() != Stop::No || !run.path().exists();
        if args.once || is_over {
            if is_over && !as_json {
                say!("the run has ended");
            }
            return Ok(ExitCode::SUCCESS);
        }
        before = now;
    }
}

/// The run asked for, or the only living one.
pub(crate) fn choose(wanted: Option<&str>) -> Result<String, Failure> {
    let alive: Vec<String> = RunDir::list().into_iter().filter(|run| run.alive).map(|run| run.name).collect();
    match (wanted, &alive[..]) {
        (Some(wanted), _) if alive.iter().any(|name| name == wanted) => Ok(wanted.to_owned()),
        (Some(wanted), _) => Err(Failure::Input(format!("no run {wanted} is alive; alive: {}", listed(&alive)))),
        (None, [only]) => Ok(only.clone()),
        (None, []) => Err(Failure::Input("no run is alive; start one with `armplane run`".to_owned())),
        (None, _) => Err(Failure::Input(format!("several runs are alive; choose one with --run: {}", listed(&alive)))),
    }
}

fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

fn look(control_page: &ControlPage, manifest: &Manifest) -> Look {
    let seen = |index: usize| {
        let line = control_page.process(index);
        Seen {
            pid: line.pid(),
            incarnation: line.incarnation(),
            state: line.state(),
            ticks: line.ticks(),
            counts: line.counts(),
            step: line.step(),
            age: line.age(),
        }
    };
    Look {
        at: Instant::now(),
        processes: (0..manifest.processes.len()).map(seen).collect(),
        arm: control_page.live_state(),
        faults: control_page.fault_table().records().map(|(_, account)| account).collect(),
    }
}

fn missed(counts: &Counts) -> u64 {
    counts.missed_major_fault + counts.missed_preempted + counts.missed_peer_restart + counts.missed_late_input + counts.missed_overrun
}

fn rate(before: &Look, now: &Look, index: usize) -> f64 {
    let ticks = now.processes[index].ticks.saturating_sub(before.processes[index].ticks);
    ticks as f64 / (now.at - before.at).as_secs_f64().max(1e-9)
}

fn state(state: State) -> &'static str {
    match state {
        State::Absent => "absent",
        State::Starting => "starting",
        State::Ready => "ready",
        State::Connected => "connected",
        State::Running => "running",
        State::Gone => "gone",
        State::Stopped => "stopped",
    }
}

fn mode(manifest: &Manifest) -> &'static str {
    match manifest.mode {
        Mode::Lockstep => "lockstep",
        Mode::Realtime => "realtime",
    }
}

/// A fault of the fault table in words: to whom, what, from where, since when, and whether it acts now.
fn fault(account: &FaultRecord, manifest: &Manifest, now: &Look) -> (String, &'static str, bool) {
    let process = manifest.processes.get(account.scheduled.process as usize).map(|process| process.name.clone()).unwrap_or_default();
    let tick = now.processes.iter().map(|seen| seen.ticks).max().unwrap_or(0);
    (process, account.scheduled.kind().map_or("unknown", Kind::name), account.scheduled.concerns(tick))
}

/// Percentiles of what came between two looks.
fn quantiles(before: &Distribution, now: &Distribution) -> [Option<f64>; 3] {
    let spread = now.since(before);
    [0.5, 0.99, 0.999].map(|share| spread.quantile_us(share))
}

/// "p50 / p99 / longest" in µs; empty for a process that computes nothing.
fn times(before: &Distribution, now: &Distribution) -> String {
    let part = |time: Option<f64>| time.map_or("–".to_owned(), digits);
    let [p50, p99, _] = quantiles(before, now);
    if now.count() == 0 { String::new() } else { format!("{} / {} / {}", part(p50), part(p99), digits(now.longest_us())) }
}

fn people(name: &str, manifest: &Manifest, before: &Look, now: &Look) {
    say!("{name}: {}, {} Hz", mode(manifest), manifest.rate_hz);
    let headings = ["process", "state", "pid", "starts", "core", "ticks", "ticks/s", "step µs", "age µs", "missed", "lost", "refused"];
    let mut rows = table(&headings);
    for (index, (process, seen)) in manifest.processes.iter().zip(&now.processes).enumerate() {
        let earlier = &before.processes[index];
        rows.add_row([
            process.name.clone().into(),
            state(seen.state).into(),
            number(seen.pid),
            number(seen.incarnation),
            number(process.core.map_or("any".to_owned(), |core| core.to_string())),
            number(seen.ticks),
            number(format!("{:.0}", rate(before, now, index))),
            number(times(&earlier.step, &seen.step)),
            number(times(&earlier.age, &seen.age)),
            number(missed(&seen.counts)),
            number(seen.counts.lost),
            number(seen.counts.not_finite + seen.counts.fenced),
        ]);
    }
    say!("{rows}");
    say!("step: input to output; age: since the tick's sample; p50 / p99 / longest");
    let arm = &now.arm;
    let stale = if arm.stale_ticks > 0 { format!(", no fresh torque for {} ticks", arm.stale_ticks) } else { String::new() };
    say!("arm   drive {}{stale}; task {}", name_of(codes::DRIVES, arm.drive), name_of(codes::PHASES, arm.phase));
    for (place, LiveSingularity { kind, class, is_inside, s, mode }) in arm.singularities.iter().enumerate() {
        let (name, class) = (singularity_name(*kind, place), name_of(codes::TYPES, *class));
        say!("      {name:<9} s = {s:+.4}, {}, {class}, {}", if *is_inside { "inside" } else { "outside" }, name_of(codes::MODES, *mode));
    }
    for account in &now.faults {
        let (process, kind, acts) = fault(account, manifest, now);
        let acts = if acts { "active" } else { "inactive" };
        say!("fault {kind} of {process} from tick {}, {}, {acts}", account.scheduled.at, account.origin.name());
    }
}

fn machine(name: &str, manifest: &Manifest, before: &Look, now: &Look) -> Value {
    let spread = |before: &Distribution, now: &Distribution| {
        let [p50, p99, p999] = quantiles(before, now);
        json!({"count": now.since(before).count(), "p50": p50, "p99": p99, "p999": p999, "max": now.longest_us()})
    };
    let processes = manifest.processes.iter().zip(&now.processes).enumerate().map(|(index, (process, seen))| {
        let earlier = &before.processes[index];
        json!({
            "name": process.name, "state": state(seen.state), "pid": seen.pid, "starts": seen.incarnation, "core": process.core,
            "ticks": seen.ticks, "ticks_per_s": rate(before, now, index), "missed": missed(&seen.counts), "counts": seen.counts,
            "step_us": spread(&earlier.step, &seen.step), "age_us": spread(&earlier.age, &seen.age),
        })
    });
    let singularity = |(place, one): (usize, &LiveSingularity)| {
        json!({
            "name": singularity_name(one.kind, place), "s": one.s, "inside": one.is_inside, "type": name_of(codes::TYPES, one.class),
            "mode": name_of(codes::MODES, one.mode),
        })
    };
    let faulty = |account: &FaultRecord| {
        let (process, kind, acts) = fault(account, manifest, now);
        json!({"process": process, "kind": kind, "origin": account.origin.name(), "tick": account.scheduled.at, "active": acts})
    };
    json!({
        "faults": now.faults.iter().map(faulty).collect::<Vec<_>>(),
        "run": name, "mode": mode(manifest), "rate_hz": manifest.rate_hz, "processes": processes.collect::<Vec<_>>(),
        "drive": name_of(codes::DRIVES, now.arm.drive), "stale_ticks": now.arm.stale_ticks, "phase": name_of(codes::PHASES, now.arm.phase),
        "singularities": now.arm.singularities.iter().enumerate().map(singularity).collect::<Vec<_>>(),
    })
}
