//! Faults that need an eye on the run. `tests/transcripts` has the others: `deaths.txt`, `faults.txt`.

use serde_json::Value;

use crate::command::{Desk, Known, Running, is_sent, run_of, until};

fn topics(summary: &Value) -> &Value {
    summary.holds(r#"{"recorder/lost": 0}"#);
    &summary["topics"]
}

#[test]
fn drill_judges_runs_in_real_time_by_themselves() {
    let desk = Desk::new();
    desk.golden("task.toml");
    let said = desk.armplane("drill task.toml --realtime --only controller:kill --json --out d");
    let (drill, passed) = (said.json(), said.code == 0);
    drill.holds(&format!(r#"{{"passed": {passed}, "cells/0/restarts": 1}}"#));
    let cell = &drill["cells"][0];
    // A recorder that this machine leaves without a processor for seconds loses messages, which must be reported; nothing else may break.
    let is_of_time = |broken: &Value| ["lost", "rows", "files"].contains(&broken["check"].text());
    assert!(cell["broken"].list().iter().all(is_of_time), "{cell}");
    assert_eq!(desk.read_json("d/drill.json"), drill);
}

#[test]
fn a_recorder_killed_after_the_last_tick_loses_nothing() {
    let desk = Desk::new();
    desk.golden("task.toml");
    let expected = desk.run("task.toml --out expected");
    let is_death = |fault: &&Value| fault["origin"] == "detected" && fault["process"] == "recorder";
    let attempt = |_| {
        let run = desk.start("run task.toml --out results --json");
        until("the recorder", || run.pid("recorder").is_some());
        let recorder = run.pid("recorder").unwrap_or_default();
        while run.ticks() < expected["ticks"].count() && run_of(run.id()).is_some() {
            std::hint::spin_loop();
        }
        let is_killed = is_sent(recorder, "KILL");
        let said = run.finish();
        assert_eq!(said.code, 0, "{}", said.err);
        let summary = said.json();
        assert_eq!(topics(&summary), &expected["topics"]);
        let deaths = summary["faults"].list().iter().filter(is_death).count();
        is_killed && deaths == 1
    };
    // In some it has ended by itself.
    assert!((0..20).any(attempt), "no recorder was killed");
}
