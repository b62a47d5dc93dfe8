//! `armplane drill --soak`: rounds of the whole graph in real time, each with faults at random.

use std::path::Path;

use model::Robot;
use runtime::random;
use session::{Failure, Observer, Progress, Results, load};
use shared_types::fault::Fault;
use shared_types::job::Mode;
use shared_types::scenario::{Scenario, Segment, Turn};

use super::judge::{Broken, Cell};
use super::plan::Deck;
use super::run::Stage;
use super::show::Drilled;
use crate::folder::Folder;

/// How long a round is planned; s. The budget of restarts and the fault table are a run's.
const ROUND_S: f64 = 60.0;

/// A shorter rest is not worth another round; s.
const SHORTEST_S: f64 = 10.0;

/// A round may take so many times as long as planned, and so many seconds more: whoever is stopped again and again is late at the goal.
const LONGEST: (f64, f64) = (1.5, 10.0);

/// Runs rounds until so many seconds of the arm's time are over; what is broken stays in `out`, or in a temporary folder that is named.
///
/// # Errors
/// [`Failure`] where a round cannot be run, or a file cannot be written.
pub fn soak(
    robot: &Robot,
    scenario: &Scenario,
    seconds: u64,
    seed: Option<u64>,
    out: Option<&Path>,
    observer: Observer<'_>,
) -> Result<Drilled, Failure> {
    let mut signals = session::interrupts()?;
    let folder = Folder::create(out)?;
    let seed = seed.unwrap_or_else(|| runtime::now_ns() % 1_000_000);
    let (rate_hz, graph) = (f64::from(scenario.rate_hz), load::graph(None)?);
    let mut deck = Deck::new(robot, graph.clone(), scenario.rate_hz, seed);
    observer(Progress::Begin {
        title: "round 1",
        length: (seconds as f64 * rate_hz) as u64,
        unit: "ticks",
    });
    let (mut cells, mut done, mut interrupted) = (Vec::<Cell>::new(), 0, None);
    while interrupted.is_none() {
        // A round that ends early leaves time for another.
        let left_s = seconds as f64 - done as f64 / rate_hz;
        if !cells.is_empty() && left_s < SHORTEST_S {
            break;
        }
        let number = cells.len() + 1;
        let mut scenario = prolonged(scenario, left_s.min(ROUND_S));
        scenario.seed = random(seed, number as u64) % 1_000_000_000;
        let results = Results::within(folder.path(), &format!("round-{number:03}"))?;
        let out = results.folder.clone();
        let job = load::job(robot, scenario, graph.clone(), Mode::Realtime, out);
        let stage = Stage {
            results,
            job,
            robot,
            without: None,
        };
        let plan = deck.round(stage.job.scenario.duration_s());
        let progress = |ticks| observer(Progress::Position(done + ticks));
        let round = round(&stage, &plan, &progress);
        interrupted = signals.pending();
        let cell = match round {
            Ok(cell) => cell,
            Err(_) if interrupted.is_some() => break,
            Err(failure) => return Err(failure),
        };
        for Broken { check, detail } in &cell.broken {
            let out = stage.job.out.display();
            let line = format!("round {number}: {check}: {detail} ({out})");
            observer(Progress::Line(&line));
        }
        done += cell.ticks;
        cells.push(cell);
    }
    observer(Progress::End);
    if cells.iter().any(|cell| !cell.broken.is_empty()) {
        folder.keep();
    }
    Drilled::new(cells, Some(seed), interrupted, out)
}

/// Runs and judges a round; only what broke a guarantee stays, for the messages take a hundred megabytes a minute.
fn round(stage: &Stage<'_>, plan: &[Fault], progress: &dyn Fn(u64)) -> Result<Cell, Failure> {
    let (scenario, out) = (&stage.job.scenario, &stage.job.out);
    let most_s = LONGEST.0 * scenario.duration_s() + LONGEST.1;
    let most_ticks = (most_s * f64::from(scenario.rate_hz)) as u64;
    let ran = stage.run(scenario.clone(), plan, most_ticks, progress)?;
    session::keep(out, &ran.job, &ran.summary)?;
    let cell = stage.judge(&ran, None)?;
    if cell.broken.is_empty() {
        stage.results.clear()?;
    } else {
        let _ = files::write(&out.join(session::LINES), ran.lines.join("\n"));
    }
    Ok(cell)
}

/// A scenario's motion without its faults, there and back again until the time is over.
fn prolonged(scenario: &Scenario, seconds: f64) -> Scenario {
    let mut scenario = Scenario {
        fault: Vec::new(),
        ..scenario.clone()
    };
    let back = |segment: &Segment| {
        let turn = segment.turn.clone().map(|turn| Turn {
            by_deg: -turn.by_deg,
            ..turn
        });
        Segment {
            turn,
            ..segment.clone()
        }
    };
    while scenario.duration_s() < seconds
        && let Some(last) = scenario.segment.last()
    {
        scenario.segment.push(back(last));
    }
    scenario
}
