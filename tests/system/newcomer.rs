//! The first minutes: a scenario to start from, and two runs of it compared.

use model::Robot;

use crate::command::{Desk, Known};

#[test]
fn a_new_scenario_runs_and_is_never_overwritten() {
    let desk = Desk::new();
    let arm = Robot::builtin("ur10").expect("an arm").source;
    desk.file("arm.urdf", &arm.urdf);
    std::fs::create_dir(desk.at("folder")).expect("a folder");
    for (name, robot) in [
        ("mine", "puma560"),
        ("yours.toml", "planar3r"),
        ("folder/its", "arm.urdf"),
    ] {
        let args = format!("new {name} --robot {robot}");
        let written = desk.json(&args);
        let file = written["file"].text();
        let text = desk.read(file);
        desk.refuses(2, &args, file);
        assert_eq!(desk.read(file), text);
        let summary = desk.run(&format!("{file} --out out"));
        summary.holds(r#"{"outcome": "goal reached"}"#);
    }
}

#[test]
fn two_runs_are_compared() {
    let desk = Desk::new();
    for (out, more) in [
        ("a", ""),
        ("b", ""),
        ("c", "--set control.k_p=300"),
        ("d", "--set control.k_p=300 --no-record"),
    ] {
        desk.run(&format!(
            "--set segment.1.duration_s=0.5 --out {out} {more}"
        ));
    }
    desk.json("diff a b")
        .holds(r#"{"same": true, "topics/#": 0}"#);
    for (other, is_kept) in [("c", true), ("d", false)] {
        let differing = desk
            .refuses(1, &format!("diff a {other} --json"), "")
            .json();
        differing.holds(r#"{"topics/#": 6}"#);
        let changes = differing["changes"].list();
        let mut keys = changes
            .iter()
            .filter(|one| one["key"] == "scenario.control.k_p");
        let gain = keys.next().expect("the gain");
        gain.holds(r#"{"values": [400.0, 300.0]}"#);
        let [tick, without] = [&differing["difference"]["tick"], &differing["without"]];
        assert_eq!((tick.is_u64(), without.is_string()), (is_kept, !is_kept));
        assert!(changes.iter().all(|one| one["key"] != "results.outcome"));
    }
    for args in ["diff a nothere", "diff a .", "diff a"] {
        desk.refuses(2, args, "");
    }
    // The log itself is read: its hash in the summary may be older than the damage.
    for log in ["damaged", ""] {
        desk.file("b/messages.mcap", log);
        let differing = desk.refuses(1, "diff a b --json", "").json();
        assert!(differing["remark"].is_string(), "{differing}");
    }
}
