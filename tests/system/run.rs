//! The default scenario, end to end.

use shared_types::topics::ALWAYS;

use crate::bench::assert_kinds;
use crate::command::{Desk, Known};

#[test]
fn the_default_scenario_reaches_its_goal_and_leaves_a_recording() {
    let desk = Desk::new();
    let summary = desk.run("--out results");
    summary.holds(
        r#"{"scenario": "fig5-wrist-rotation", "outcome": "goal reached", "completed": true, "recorder/lost": 0, "processes/#": 5}"#,
    );
    let ticks = summary["ticks"].count();
    for topic in ALWAYS {
        let of_topic = &summary["topics"][topic];
        assert_eq!(of_topic["count"], ticks, "{topic}: every tick, once");
        assert_eq!(of_topic["hash"].text().len(), 16);
    }
    let recorder = &summary["recorder"];
    assert_eq!(recorder["messages"], ALWAYS.len() as u64 * ticks);
    assert_kinds(&desk, &["results/run.rrd"]);
    let record = format!("results/{}", recorder["file"].text());
    assert_eq!(recorder["bytes"], desk.bytes(&record).len());
    let kept = desk.read_json("results/summary.json");
    assert_eq!(kept, summary, "what is printed is what is kept");
}

#[test]
fn every_built_in_scenario_reaches_its_goal() {
    let desk = Desk::new();
    let listed = desk.json("list");
    let scenarios = listed["scenarios"].list();
    assert!(scenarios.len() > 20);
    for name in scenarios.iter().map(|one| one["name"].text()) {
        let run = desk.run(&format!("{name} --no-record --out {name}"));
        run.holds(r#"{"outcome": "goal reached"}"#);
        assert_eq!(run["scenario"], name);
    }
}

#[test]
fn real_time_keeps_its_rate_and_counts_its_deadlines() {
    let summary = Desk::new().run("--mode realtime --no-record");
    summary.holds(r#"{"mode": "realtime"}"#);
    let [ticks, wall_s] = ["ticks", "wall_s"].map(|key| summary[key].number());
    assert!(
        wall_s > 0.98 * ticks / 1000.0,
        "{ticks} ticks at 1 kHz cannot take {wall_s} s"
    );
    assert!(summary["deadlines"]["total"].count() > 0);
}
