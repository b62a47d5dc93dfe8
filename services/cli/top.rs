//! `armplane top`: a running graph, seen from its control page. It only reads: nobody in the run can tell that it is there.

use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use runtime::{Board, Counts, Manifest, Mode, RunDir, SHM, State, Stop};
use serde_json::json;

use super::TopArgs;
use super::failure::Failure;
use super::out::say;
use super::table::{number, table};

/// What a process did between two looks.
struct Seen {
    pid: u32,
    incarnation: u32,
    state: State,
    ticks: u64,
    counts: Counts,
}

struct Look {
    at: Instant,
    processes: Vec<Seen>,
}

pub(crate) fn top(args: &TopArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let name = choose(args.run.as_deref())?;
    let run = RunDir::open(&Path::new(SHM).join(&name)).map_err(Failure::input)?;
    let manifest = Manifest::read(&run).map_err(Failure::work)?;
    let board = Board::open(&run).map_err(Failure::work)?;
    let every = Duration::from_millis(args.every_ms);
    let mut before = look(&board, &manifest);
    loop {
        std::thread::sleep(every);
        let now = look(&board, &manifest);
        if as_json {
            say!("{}", machine(&name, &manifest, &before, &now));
        } else {
            if !args.once {
                // To the upper left corner, and clear what is below.
                print!("\x1b[H\x1b[J");
            }
            people(&name, &manifest, &before, &now);
        }
        let is_over = board.stop() != Stop::No || !run.path().exists();
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
fn choose(wanted: Option<&str>) -> Result<String, Failure> {
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

fn look(board: &Board, manifest: &Manifest) -> Look {
    let seen = |index: usize| {
        let line = board.line(index);
        Seen { pid: line.pid(), incarnation: line.incarnation(), state: line.state(), ticks: line.ticks(), counts: line.counts() }
    };
    Look { at: Instant::now(), processes: (0..manifest.processes.len()).map(seen).collect() }
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

fn people(name: &str, manifest: &Manifest, before: &Look, now: &Look) {
    say!("{name}: {}, {} Hz", mode(manifest), manifest.rate_hz);
    let mut rows = table(&["process", "state", "pid", "starts", "core", "ticks", "ticks/s", "missed", "lost", "refused"]);
    for (index, (process, seen)) in manifest.processes.iter().zip(&now.processes).enumerate() {
        rows.add_row([
            process.name.clone().into(),
            state(seen.state).into(),
            number(seen.pid),
            number(seen.incarnation),
            number(process.core.map_or("any".to_owned(), |core| core.to_string())),
            number(seen.ticks),
            number(format!("{:.0}", rate(before, now, index))),
            number(missed(&seen.counts)),
            number(seen.counts.lost),
            number(seen.counts.not_finite + seen.counts.fenced),
        ]);
    }
    say!("{rows}");
}

fn machine(name: &str, manifest: &Manifest, before: &Look, now: &Look) -> serde_json::Value {
    let processes = manifest.processes.iter().zip(&now.processes).enumerate().map(|(index, (process, seen))| {
        json!({
            "name": process.name, "state": state(seen.state), "pid": seen.pid, "starts": seen.incarnation, "core": process.core,
            "ticks": seen.ticks, "ticks_per_s": rate(before, now, index), "missed": missed(&seen.counts), "counts": seen.counts,
        })
    });
    json!({"run": name, "mode": mode(manifest), "rate_hz": manifest.rate_hz, "processes": processes.collect::<Vec<_>>()})
}
