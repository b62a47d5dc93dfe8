//! Several runs at once, and a run that is interrupted at any moment: each has a folder of its own, whole.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::Value;

use crate::command::{
    Desk, Known, assert_nothing_left, finish, in_shared_memory, interrupt, until,
};
use crate::life::signal;

#[test]
fn six_runs_at_once_take_six_folders() {
    let desk = Desk::new();
    let runs: Vec<_> = (0..6)
        .map(|seed| desk.start(&["run", "--json", "--no-record", "--seed", &seed.to_string()]))
        .collect();
    let hashes: BTreeSet<String> = runs
        .into_iter()
        .map(|run| {
            let said = finish(run);
            assert_eq!(said.code, 0, "{}", said.err);
            let summary = said.json();
            summary["topics"]["sensor"]["hash"].text().to_owned()
        })
        .collect();
    let folders = std::fs::read_dir(desk.path().join("runs"))
        .unwrap()
        .flatten()
        .map(|entry| entry.path());
    let kept = |folder: std::path::PathBuf| {
        let summary: Value =
            serde_json::from_slice(&std::fs::read(folder.join("summary.json")).unwrap()).unwrap();
        summary["topics"]["sensor"]["hash"].text().to_owned()
    };
    assert_eq!(
        folders.map(kept).collect::<BTreeSet<_>>(),
        hashes,
        "each run's own summary in a folder of its own"
    );
}

#[test]
fn a_folder_into_which_a_run_writes_is_refused_to_another() {
    let desk = Desk::new();
    let first = desk.begin("run --set segment.1.duration_s=500 --json --out same");
    desk.refuses(
        2,
        "run --out same",
        &["another run writes its results into"],
    );
    let said = interrupt(first);
    let summary = said.json();
    assert_eq!(
        (
            &summary["outcome"],
            desk.path().join("same/summary.json").exists()
        ),
        (&"interrupted".into(), true)
    );
    assert_eq!(
        desk.run("--out same")["outcome"],
        "goal reached",
        "the folder is free again"
    );
}

#[test]
fn ctrl_c_at_any_moment_of_the_start_leaves_nothing() {
    let desk = Desk::new();
    for attempt in 0..16 {
        let run = desk.start("run --out r");
        let pauses_ms = [0, 1].map(|k| runtime::random(attempt, k) % 80);
        for pause_ms in pauses_ms {
            std::thread::sleep(Duration::from_millis(pause_ms));
            signal(run.id() as i32, "INT");
        }
        let said = finish(run);
        assert!(said.code != 0, "after {pauses_ms:?} ms");
        assert_nothing_left(said.launcher);
    }
}

#[test]
fn ctrl_c_at_the_end_costs_no_summary() {
    let desk = Desk::new();
    for attempt in 0..12 {
        let out = format!("r{attempt}");
        let run = desk.start(&format!("run --no-record --out {out}"));
        until("the run to begin", || {
            !in_shared_memory(run.id()).is_empty()
        });
        // Removed by the launcher when all processes have ended: the summary is written after it.
        until("the run to end", || in_shared_memory(run.id()).is_empty());
        std::thread::sleep(Duration::from_micros(runtime::random(attempt, 0) % 1_000));
        signal(run.id() as i32, "INT");
        finish(run);
        assert!(
            desk.path().join(&out).join("summary.json").exists(),
            "attempt {attempt}"
        );
    }
}
