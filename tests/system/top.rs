//! `armplane top`: sees a run without touching it.

use std::process::Command;

use serde_json::Value;

use crate::command::{Desk, Known, assert_nothing_left, children_of_run, finish, run_of, until};

#[test]
fn a_run_is_seen_from_outside() {
    let desk = Desk::new();
    let run = desk.begin("run --set segment.1.duration_s=500 --no-record --json");
    let directory = || run_of(run.id());
    let name = directory().unwrap();
    let look = || {
        let said = desk.succeeds(&format!("top --run {name} --once --json"));
        said.json()
    };
    let ticks = |seen: &Value| seen["processes"][0]["ticks"].count();
    until("the first tick", || ticks(&look()) > 0);
    let (before, after) = (look(), look());
    assert!(ticks(&after) > ticks(&before), "{after}");
    let mut of_run: Vec<i64> = children_of_run(run.id())
        .into_iter()
        .map(|(_, pid)| i64::from(pid))
        .collect();
    let mut seen: Vec<i64> = after["processes"]
        .list()
        .iter()
        .map(|process| process["pid"].as_i64().unwrap())
        .collect();
    of_run.sort_unstable();
    seen.sort_unstable();
    assert_eq!(seen, of_run);
    assert!(
        after["processes"]
            .list()
            .iter()
            .all(|process| process["state"] == "running"),
        "{after}"
    );
    for process in after["processes"]
        .list()
        .iter()
        .filter(|process| process["name"] != "recorder")
    {
        let number = |what: &str, key: &str| {
            process[what][key]
                .as_f64()
                .unwrap_or_else(|| panic!("{what} {key}: {process}"))
        };
        for what in ["step_us", "age_us"] {
            assert!(
                number(what, "count") > 0.0
                    && number(what, "p50") <= number(what, "p99")
                    && number(what, "p99") <= number(what, "max")
            );
        }
    }
    // Nobody reads on: it ends.
    let mut unread = desk.start(&format!("top --run {name} --every-ms 10"));
    drop(unread.stdout.take());
    assert!(unread.wait().is_ok_and(|status| status.success()));
    let wrist = after["singularities"]
        .list()
        .iter()
        .find(|one| one["name"] == "wrist")
        .unwrap_or_else(|| panic!("{after}"));
    assert!(
        wrist["s"].number().abs() < 0.1 && wrist["inside"] == true && wrist["type"] == "type 2",
        "{wrist}"
    );
    assert!(
        after["drive"] == "active" && after["phase"] == "running",
        "{after}"
    );
    assert!(
        Command::new("kill")
            .args(["-INT", &run.id().to_string()])
            .status()
            .unwrap()
            .success()
    );
    let said = finish(run);
    assert_nothing_left(said.launcher);
    assert_eq!(
        desk.armplane(&format!("top --run {name} --once")).code,
        2,
        "it is gone"
    );
}

#[test]
fn being_watched_changes_no_byte() {
    let desk = Desk::new();
    let args = "run --seed 21 --set segment.1.duration_s=20 --no-record --json";
    let alone = desk.armplane(args).json();
    let run = desk.begin(args);
    let name = run_of(run.id()).unwrap();
    let watcher = desk.start(&format!("top --run {name} --every-ms 10 --json"));
    let watched = finish(run);
    let seen = finish(watcher);
    assert!(
        seen.code == 0 && seen.out.lines().count() > 3,
        "{}{}",
        seen.out,
        seen.err
    );
    let last: Value = serde_json::from_str(seen.out.lines().last().unwrap()).unwrap();
    assert!(last["processes"][0]["ticks"].count() > 0, "{last}");
    let watched = watched.json();
    assert_eq!(watched["topics"], alone["topics"]);
}
