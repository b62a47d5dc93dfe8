//! The default scenario, end to end.

use shared_types::topics::ALWAYS;

use crate::command::Desk;

#[test]
fn the_default_scenario_reaches_its_goal_and_leaves_a_recording() {
    let desk = Desk::new();
    let summary = desk.run(&["--out", "results"]);
    assert_eq!(summary["scenario"], "fig5-wrist-rotation");
    assert_eq!(summary["outcome"], "goal reached", "{}", summary["reason"]);
    assert_eq!(summary["completed"], true);

    let ticks = summary["ticks"].as_u64().unwrap();
    for topic in ALWAYS {
        assert_eq!(
            summary["topics"][topic]["count"], ticks,
            "{topic}: every tick, once"
        );
        assert_eq!(summary["topics"][topic]["hash"].as_str().unwrap().len(), 16);
    }
    assert_eq!(summary["recorder"]["lost"], 0);
    assert_eq!(summary["recorder"]["messages"], ALWAYS.len() as u64 * ticks);
    assert_eq!(summary["processes"].as_array().unwrap().len(), 5);

    let recording = desk
        .path()
        .join("results")
        .join(summary["recorder"]["file"].as_str().unwrap());
    assert_eq!(
        std::fs::metadata(&recording).unwrap().len(),
        summary["recorder"]["bytes"].as_u64().unwrap()
    );
    assert_eq!(
        &std::fs::read(&recording).unwrap()[..4],
        b"RRF2",
        "a Rerun recording"
    );
    let on_disk: serde_json::Value =
        serde_json::from_slice(&std::fs::read(desk.path().join("results/summary.json")).unwrap())
            .unwrap();
    assert_eq!(on_disk, summary, "what is printed is what is kept");
}

#[test]
fn every_built_in_scenario_reaches_its_goal() {
    let desk = Desk::new();
    let listed: serde_json::Value =
        serde_json::from_str(&desk.succeeds("list --json").out).unwrap();
    let names = listed["scenarios"].as_array().unwrap().iter();
    let names: Vec<_> = names.map(|one| one["name"].as_str().unwrap()).collect();
    assert!(names.len() > 20);
    for name in names {
        let run = desk.run(&[name, "--no-record", "--no-messages", "--out", name]);
        assert_eq!(run["outcome"], "goal reached", "{name}: {}", run["reason"]);
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
    assert_eq!(first["outcome"], "goal reached", "{}", first["reason"]);
    let again = desk.run("one/scenario.toml --out two");
    assert_eq!(first["topics"], again["topics"]);
    assert!(desk.path().join("two/robot.xml").exists());
}

#[test]
fn real_time_keeps_its_rate_and_counts_its_deadlines() {
    let summary = Desk::new().run(&["--mode", "realtime", "--no-record"]);
    assert_eq!(summary["mode"], "realtime");
    let (ticks, wall_s) = (
        summary["ticks"].as_f64().unwrap(),
        summary["wall_s"].as_f64().unwrap(),
    );
    assert!(
        wall_s > 0.98 * ticks / 1000.0,
        "{ticks} ticks at 1 kHz cannot take {wall_s} s"
    );
    assert!(summary["deadlines"]["total"].as_u64().unwrap() > 0);
}
