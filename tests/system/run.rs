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
fn an_arm_in_mjcf_is_run_and_its_saved_scenario_repeats_it() {
    let desk = Desk::new();
    desk.file("odd.xml", include_str!("../golden/odd.xml"));
    desk.file(
        "up.toml",
        "name = \"up\"\nrobot = \"odd.xml\"\nsettle_s = 0.1\n[start]\nq = [0.1, 0.2, 0.3, 0.05, 0.4]\n[[segment]]\nby_m = [0.0, 0.0, 0.01]\nduration_s = 0.5\n",
    );
    let first = desk.run("up.toml --out one");
    first.holds(r#"{"outcome": "goal reached"}"#);
    let again = desk.run("one/scenario.toml --out two");
    assert_eq!(first["topics"], again["topics"]);
    assert!(desk.has("two/robot.xml"));
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
