//! The default scenario, end to end.

use crate::command::Desk;

#[test]
fn the_default_scenario_reaches_its_goal_and_leaves_a_recording() {
    let desk = Desk::new();
    let summary = desk.run(&["--out", "results"]);
    assert_eq!(summary["scenario"], "fig5-wrist-rotation");
    assert_eq!(summary["outcome"], "goal reached", "{}", summary["reason"]);
    assert_eq!(summary["completed"], true);

    let ticks = summary["ticks"].as_u64().unwrap();
    for topic in ["sensor", "plant_state", "estimate", "singularity", "torque"] {
        assert_eq!(summary["topics"][topic]["count"], ticks, "{topic}: every tick, once");
        assert_eq!(summary["topics"][topic]["hash"].as_str().unwrap().len(), 16);
    }
    assert_eq!(summary["recorder"]["lost"], 0);
    assert_eq!(summary["recorder"]["messages"], 5 * ticks);
    assert_eq!(summary["processes"].as_array().unwrap().len(), 5);

    let recording = desk.path().join("results").join(summary["recorder"]["file"].as_str().unwrap());
    assert_eq!(std::fs::metadata(&recording).unwrap().len(), summary["recorder"]["bytes"].as_u64().unwrap());
    assert_eq!(&std::fs::read(&recording).unwrap()[..4], b"RRF2", "a Rerun recording");
    let on_disk: serde_json::Value = serde_json::from_slice(&std::fs::read(desk.path().join("results/summary.json")).unwrap()).unwrap();
    assert_eq!(on_disk, summary, "what is printed is what is kept");
}

/// The paper's Figure 5: ζ turned by 90° while the end-effector is held, then a rotation of 45° about the original ζ.
#[test]
fn figure_5_turns_the_singular_direction_and_then_moves_along_it() {
    let summary = Desk::new().run(&["fig5-wrist-rotation", "--no-record"]);
    let wrist = summary["singularities"].as_array().unwrap().iter().find(|s| s["name"] == "wrist").expect("the wrist is reported");
    assert_eq!(wrist["type"], "type 2");
    let start: Vec<f64> = serde_json::from_value(summary["joints"]["q_start"].clone()).unwrap();
    let end: Vec<f64> = serde_json::from_value(summary["joints"]["q_end"].clone()).unwrap();
    let degrees = |joint: usize| (end[joint] - start[joint]).to_degrees();
    assert!((degrees(3).abs() - 90.0).abs() < 0.1, "joint 4 turned by {}°", degrees(3));
    assert!((degrees(4).abs() - 45.0).abs() < 0.1, "joint 5 turned by {}°", degrees(4));
    assert!((degrees(5).abs() - 90.0).abs() < 0.1, "joint 6 turned by {}°", degrees(5));
    let task = &summary["task"];
    // The bars of the exact plant (0.01 mm, 0.02°), within a factor of 5 with encoder noise.
    assert!(task["position_max_mm"].as_f64().unwrap() < 0.05, "{task}");
    assert!(task["orientation_max_deg"].as_f64().unwrap() < 0.1, "{task}");
    assert!(summary["joints"]["torque_max_ratio"].as_f64().unwrap() < 1.0 && summary["joints"]["speed_max_ratio"].as_f64().unwrap() < 1.0);
    let modes: Vec<&str> = summary["modes"].as_array().unwrap().iter().filter_map(|change| change["mode"].as_str()).collect();
    assert!(modes.contains(&"reorient"), "{modes:?}");
}

#[test]
fn without_a_name_for_the_results_each_run_gets_the_next_folder() {
    let desk = Desk::new();
    desk.run(&["--no-record", "--set", "segment.0.duration_s=1.5"]);
    desk.run(&["--no-record", "--set", "segment.0.duration_s=1.5"]);
    for n in 1..=2 {
        let folder = desk.path().join(format!("runs/fig5-wrist-rotation-{n:03}"));
        assert!(folder.join("summary.json").exists());
        assert!(!folder.join("run.rrd").exists(), "--no-record writes none");
    }
}

#[test]
fn real_time_keeps_its_rate_and_counts_its_deadlines() {
    let summary = Desk::new().run(&["--mode", "realtime", "--no-record"]);
    assert_eq!(summary["mode"], "realtime");
    let (ticks, wall_s) = (summary["ticks"].as_f64().unwrap(), summary["wall_s"].as_f64().unwrap());
    assert!(wall_s > 0.98 * ticks / 1000.0, "{ticks} ticks at 1 kHz cannot take {wall_s} s");
    assert!(summary["deadlines"]["total"].as_u64().unwrap() > 0);
}
