//! Several runs at once, and a run that is interrupted at any moment: each has a folder of its own, whole.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::Value;

use crate::command::{Desk, Known, Running, in_shared_memory, until};

#[test]
fn six_runs_at_once_take_six_folders() {
    let desk = Desk::new();
    let run = |seed: u32| desk.start(&format!("run --json --no-record --seed {seed}"));
    let runs = [0, 1, 2, 3, 4, 5].map(run);
    let hash = |summary: Value| summary["topics"]["sensor"]["hash"].text().to_owned();
    let said: BTreeSet<_> = runs.map(|run| hash(run.finish().json())).into();
    let folders = desk.names("runs").into_iter();
    let kept = folders.map(|folder| hash(desk.read_json(&format!("runs/{folder}/summary.json"))));
    assert_eq!(said.len(), 6);
    assert_eq!(
        kept.collect::<BTreeSet<_>>(),
        said,
        "each run's own summary"
    );
}

#[test]
fn a_folder_into_which_a_run_writes_is_refused_to_another() {
    let desk = Desk::new();
    let first = desk.begin("run --set segment.1.duration_s=500 --json --out same");
    desk.refuses(2, "run --out same", "same: --out");
    first
        .interrupt()
        .json()
        .holds(r#"{"outcome": "interrupted"}"#);
    assert!(desk.has("same/summary.json"));
    // The folder is free again.
    desk.run("--out same")
        .holds(r#"{"outcome": "goal reached"}"#);
}

#[test]
fn ctrl_c_at_any_moment_of_the_start_leaves_nothing() {
    let desk = Desk::new();
    for attempt in 0..16 {
        let run = desk.start("run --out r");
        let pauses_ms = [0, 1].map(|k| runtime::random(attempt, k) % 80);
        for pause_ms in pauses_ms {
            std::thread::sleep(Duration::from_millis(pause_ms));
            run.signal("INT");
        }
        assert!(run.finish().code != 0, "after {pauses_ms:?} ms");
    }
}

#[test]
fn ctrl_c_at_the_end_costs_no_summary() {
    let desk = Desk::new();
    for attempt in 0..12 {
        let run = desk.start(&format!("run --no-record --out r{attempt}"));
        let is_there = || !in_shared_memory(run.id()).is_empty();
        until("the run to begin", is_there);
        // Removed by the launcher when all processes have ended: the summary is written after it.
        until("the run to end", || !is_there());
        std::thread::sleep(Duration::from_micros(runtime::random(attempt, 0) % 1_000));
        run.signal("INT");
        run.finish();
        assert!(
            desk.has(format!("r{attempt}/summary.json")),
            "attempt {attempt}"
        );
    }
}
