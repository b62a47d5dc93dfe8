//! The first minutes: a scenario to start from, two runs of it compared, and files that are none.

use model::Robot;
use serde_json::Value;

use crate::command::{Desk, Known};

#[test]
fn a_new_scenario_runs_and_is_never_overwritten() {
    let desk = Desk::new();
    let arm = Robot::builtin("ur10").expect("an arm").source;
    desk.file("arm.urdf", &arm.urdf);
    std::fs::create_dir(desk.path().join("folder")).expect("a folder");
    for (number, name, robot) in [
        (0, "mine", "puma560"),
        (1, "yours.toml", "planar3r"),
        (2, "folder/its", "arm.urdf"),
    ] {
        let written = desk.json(&format!("new {name} --robot {robot}"));
        let file = written["file"].text();
        let text = desk.read(file);
        desk.refuses(2, &format!("new {name} --robot {robot}"), &[file]);
        assert_eq!(desk.read(file), text);
        let summary = desk.run(&format!("{file} --out out-{number}"));
        assert_eq!(summary["outcome"], "goal reached", "{}", summary["reason"]);
    }
}

#[test]
fn two_runs_are_compared() {
    let desk = Desk::new();
    for (out, more) in [
        ("a", ""),
        ("b", ""),
        ("c", "--set control.k_p=300"),
        ("d", "--set control.k_p=300 --no-messages"),
    ] {
        desk.run(&format!(
            "--set segment.1.duration_s=0.5 --out {out} {more}"
        ));
    }
    let same = desk.json("diff a b");
    assert_eq!(
        (&same["same"], same["topics"].list().len()),
        (&true.into(), 0),
        "{same}"
    );
    for (other, is_kept) in [("c", true), ("d", false)] {
        let said = desk.refuses(1, &format!("diff a {other} --json"), &[]);
        let differing = said.json();
        let changes = differing["changes"].list();
        let is_key = |one: &&Value| one["key"] == "scenario.control.k_p";
        let key = changes.iter().find(is_key).unwrap_or(&Value::Null);
        assert_eq!(
            (&key["key"], key["values"].list()),
            (
                &"scenario.control.k_p".into(),
                &[400.0.into(), 300.0.into()][..]
            )
        );
        assert_eq!(differing["topics"].list().len(), 6, "{differing}");
        assert_eq!(
            (
                differing["difference"]["tick"].is_u64(),
                differing["without"].is_string()
            ),
            (is_kept, !is_kept)
        );
        assert!(changes.len() > 5, "results differ, too: {differing}");
    }
    for args in ["diff a nothere", "diff a .", "diff a"] {
        desk.refuses(2, args, &[]);
    }
    // The log itself is read: its hash in the summary may be older than the damage.
    for log in [&b"damaged"[..], &[]] {
        std::fs::write(desk.path().join("b/messages.mcap"), log).unwrap();
        let differing = desk.refuses(1, "diff a b --json", &[]).json();
        assert!(differing["remark"].is_string(), "{differing}");
    }
}

#[test]
fn what_is_no_scenario_is_refused_in_one_line() {
    let desk = Desk::new();
    desk.run("--set settle_s=0 --out a");
    desk.file("arm.urdf", "<robot/>");
    desk.file("arm.xml", "<mujoco/>");
    for file in [
        "arm.urdf",
        "arm.xml",
        "a/run.rrd",
        "a/messages.mcap",
        "a",
        ".",
    ] {
        let said = desk.refuses(2, &format!("run {file}"), &[file]);
        assert_eq!(said.err.lines().count(), 1, "{}", said.err);
    }
    // The sentence and the lines of the file do not say the same.
    desk.file(
        "typo.toml",
        "name = \"x\"\nrobot = \"pumma560\"\n[start]\nq = [0]\n[[segment]]\nduration_s = 1\n",
    );
    let said = desk.refuses(2, "run typo.toml", &["typo.toml:2", "`puma560`", "MJCF"]);
    assert_eq!(said.err.matches("MJCF").count(), 1, "{}", said.err);
}
