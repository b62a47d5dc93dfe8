//! `armplane top`: sees a run without touching it.

use serde_json::Value;

use crate::command::{Desk, Known, Running, children_of_run, run_of};

#[test]
fn a_run_is_seen_from_outside() {
    let desk = Desk::new();
    let run = desk.begin("run --set segment.1.duration_s=500 --no-record --json");
    let name = run_of(run.id()).unwrap();
    let look = || desk.json(&format!("top --run {name} --once"));
    let (before, after) = (look(), look());
    let ticks = |seen: &Value| seen["processes"][0]["ticks"].count();
    assert!(ticks(&after) > ticks(&before), "{after}");
    let processes = after["processes"].list();
    let mut seen: Vec<_> = processes
        .iter()
        .map(|process| {
            (
                process["name"].text().to_owned(),
                process["pid"].count() as i32,
            )
        })
        .collect();
    let mut of_run = children_of_run(run.id());
    seen.sort();
    of_run.sort();
    assert_eq!(seen, of_run);
    for process in processes {
        assert_eq!(process["state"], "running", "{process}");
        for times in ["step_us", "age_us"] {
            if process["name"] != "recorder" {
                let times = &process[times];
                let spread = ["p50", "p99", "max"].map(|key| times[key].number());
                assert!(
                    times["count"].count() > 0 && spread.is_sorted(),
                    "{process}"
                );
            }
        }
    }
    // Nobody reads on: it ends.
    let mut unread = desk.start(&format!("top --run {name} --every-ms 10"));
    drop(unread.stdout.take());
    assert!(unread.wait().is_ok_and(|status| status.success()));
    after.holds(r#"{"drive": "active", "phase": "running"}"#);
    let mut listed = after["singularities"].list().iter();
    let wrist = listed
        .find(|one| one["name"] == "wrist")
        .expect("the wrist");
    wrist.holds(r#"{"inside": true, "type": "type 2"}"#);
    assert!(wrist["s"].number().abs() < 0.1, "{wrist}");
    run.interrupt();
    desk.refuses(2, &format!("top --run {name} --once"), "");
}

#[test]
fn being_watched_changes_no_byte() {
    let desk = Desk::new();
    let args = "run --seed 21 --set segment.1.duration_s=20 --no-record --json";
    let alone = desk.armplane(args).json();
    let run = desk.begin(args);
    let name = run_of(run.id()).unwrap();
    let watcher = desk.start(&format!("top --run {name} --every-ms 10 --json"));
    let watched = run.finish().json();
    let seen = watcher.finish();
    let last: Value = serde_json::from_str(seen.out.lines().last().unwrap()).unwrap();
    assert!(
        seen.code == 0 && seen.out.lines().count() > 3,
        "{}",
        seen.err
    );
    assert!(last["processes"][0]["ticks"].count() > 0, "{last}");
    assert_eq!(watched["topics"], alone["topics"]);
}
