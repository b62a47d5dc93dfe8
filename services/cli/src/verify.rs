//! `armplane verify`: the same scenario under different conditions, compared byte by byte.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use lab::conformance::kills::{self, Killed};
use lab::conformance::verify::{Place, Ran, Request, Verified};
use message_log::Difference;
use serde_json::json;
use session::{Failure, load};
use shared_types::scenario::Scenario;
use shared_types::summary::TopicSummary;

use crate::out::say;
use crate::progress::Terminal;
use crate::table::{number, table};

#[derive(Args)]
pub(crate) struct VerifyArgs {
    /// A built-in scenario's name, or a scenario file.
    #[arg(value_name = "SCENARIO|FILE.toml", default_value = load::DEFAULT_SCENARIO)]
    scenario: String,
    /// How often to run it, each time under another condition.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    runs: u32,
    /// Instead: kill processes at random moments of so many runs, and repeat each run from the scenario that it leaves.
    #[arg(long, value_name = "N", conflicts_with_all = ["runs", "unordered"], value_parser = clap::value_parser!(u32).range(1..=100_000))]
    kills: Option<u32>,
    /// Seed of every random number of the run [default: the scenario's].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Lay a value over the scenario's, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// A process graph of your own instead of the built-in one.
    #[arg(long, value_name = "FILE.toml")]
    graph: Option<PathBuf>,
    /// Keep all messages and recordings of all runs in this folder [default: they are removed].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Let the plant take the torque of the tick before where the right one is late: shows that `verify` can fail.
    #[arg(long, hide = true)]
    unordered: bool,
}

pub(crate) fn verify(args: &VerifyArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let _signals = session::interrupts()?;
    let load::Loaded { scenario, robot, graph } = load::scenario_in(args.graph.as_deref(), &args.scenario, &args.set, args.seed)?;
    let terminal = Terminal::default();
    if let Some(histories) = args.kills {
        let request =
            kills::Request { scenario: &scenario, robot: &robot, graph: &graph, histories, seed: scenario.seed, out: args.out.as_deref() };
        let killed = kills::verify_kills(&request, &|progress| terminal.show(progress))?;
        print_killed(&scenario, &killed, as_json);
        return Ok(if killed.unrepeated.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(1) });
    }
    let request = Request {
        name: &args.scenario,
        scenario: &scenario,
        robot: &robot,
        graph: &graph,
        runs: args.runs,
        out: args.out.as_deref(),
        unordered: args.unordered,
    };
    let verified = lab::conformance::verify::verify(&request, &|progress| terminal.show(progress))?;
    if as_json {
        print_json(&scenario, &verified);
    } else {
        print(&scenario, &verified);
    }
    Ok(if verified.is_identical { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn print_killed(scenario: &Scenario, killed: &Killed, as_json: bool) {
    let Killed { histories, deaths, within_tick, at_start, unrepeated, kept } = killed;
    if as_json {
        let one = |run: &kills::Unrepeated| {
            let place = run.place.as_ref().map(|place| json!({"tick": place.tick, "topic": place.topic, "field": place.difference.field}));
            json!({"run": run.number, "reason": run.reason, "deaths": run.deaths, "difference": place})
        };
        let whole = json!({
            "scenario": scenario.name, "seed": scenario.seed, "histories": histories, "deaths": deaths, "within_tick": within_tick,
            "at_start": at_start, "unrepeated": unrepeated.iter().map(one).collect::<Vec<_>>(), "kept": kept,
        });
        say!("{whole}");
        return;
    }
    for kills::Unrepeated { number, place, .. } in unrepeated {
        if let Some(Place { tick, topic, difference: Difference { field, expected, found }, .. }) = place {
            say!(
                "run {number} and its repetition first differ at tick {tick}, topic {topic}, field {field}: {found} instead of {expected}"
            );
        }
    }
    if let Some(kept) = kept {
        say!("the runs that were not repeated are in {}", kept.display());
    }
    let deaths = format!("{deaths} deaths, {within_tick} between two messages of a tick, {at_start} of replacements that had not answered");
    let repeated = *histories as usize - unrepeated.len();
    say!("{}, seed {}: {repeated} of {histories} runs repeated byte for byte ({deaths})", scenario.name, scenario.seed);
}

/// Why the first run is the reference, where it is.
const WHY: &str =
    "one thread has no processes to which faults could happen, and none of the graph's own programs: run 1 is the reference of the others";

fn print(scenario: &Scenario, verified: &Verified) {
    let Verified { reference, runs, place, is_identical } = verified;
    let names = reference.ran.topics.iter().map(|(name, _)| name.as_str());
    let headings: Vec<_> = ["", "condition", "ticks/s"].into_iter().chain(names).collect();
    let mut rows = table(&headings);
    let row = |name: String, ran: &Ran, marks: Vec<String>| {
        let head = [name.into(), ran.condition.clone().into(), number(format!("{:.0}", ran.ticks_per_s))];
        head.into_iter().chain(marks.into_iter().map(Into::into)).collect::<Vec<comfy_table::Cell>>()
    };
    let (name, first) = if reference.is_run { ("run 1, reference", 2) } else { ("reference", 1) };
    rows.add_row(row(name.to_owned(), &reference.ran, reference.ran.topics.iter().map(|(_, topic)| topic.hash.clone()).collect()));
    for (number, ran) in (first..).zip(runs) {
        let mut wanted = reference.ran.topics.iter();
        let mark = |topic| if wanted.next() == Some(topic) { "equal".to_owned() } else { format!("≠ {}", topic.1.hash) };
        let marks = ran.topics.iter().map(mark).collect();
        rows.add_row(row(format!("run {number}"), ran, marks));
    }
    say!("{rows}");
    let all = reference.is_run.then_some(&reference.ran).into_iter().chain(runs);
    for (number, ran) in (1..).zip(all).filter(|(_, ran)| !ran.failure.is_empty()) {
        say!("run {number} did not come to its end: {}", ran.failure);
    }
    if let Some(Place { run, tick, topic, difference: Difference { field, expected, found } }) = place {
        say!("run {} first differs at tick {tick}, topic {topic}, field {field}: {found} instead of {expected}", run + 1);
    }
    if reference.is_run {
        say!("{WHY}");
    }
    let verdict = if *is_identical { "the same bytes everywhere" } else { "NOT the same bytes" };
    let count = runs.len() + usize::from(reference.is_run);
    say!("{}, seed {}, {} ticks, {count} runs: {verdict}", scenario.name, scenario.seed, reference.ran.ticks);
}

fn print_json(scenario: &Scenario, verified: &Verified) {
    let Verified { reference, runs, place, is_identical } = verified;
    let of = |ran: &Ran| {
        let topic = |(name, topic): &(String, TopicSummary)| {
            let is_equal = reference.ran.topics.iter().any(|(one, wanted)| one == name && wanted == topic);
            (name.clone(), json!({"count": topic.count, "hash": topic.hash, "equal": is_equal}))
        };
        let topics: serde_json::Map<_, _> = ran.topics.iter().map(topic).collect();
        json!({"condition": ran.condition, "ticks": ran.ticks, "ticks_per_s": ran.ticks_per_s, "failure": ran.failure, "topics": topics})
    };
    let difference = place.as_ref().map(|place| {
        let Difference { field, expected, found } = &place.difference;
        json!({"run": place.run + 1, "tick": place.tick, "topic": place.topic, "field": field, "expected": expected, "found": found})
    });
    let all = reference.is_run.then_some(&reference.ran).into_iter().chain(runs);
    let whole = json!({
        "scenario": scenario.name, "seed": scenario.seed, "identical": is_identical, "faults": scenario.fault.len(),
        "reference_run": reference.is_run.then_some(1), "reference": of(&reference.ran), "runs": all.map(of).collect::<Vec<_>>(),
        "difference": difference,
    });
    say!("{whole}");
}
