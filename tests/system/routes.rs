//! Lines through exactly singular postures, and paths along them and back.

use crate::command::{Desk, Known, root};

/// Seeded lines through locks of an arm with a sliding joint and of two others. An inverse kinematics that shares nothing with the planner has followed
/// all postures of their poses: each line has a route without a jump but one.
#[test]
fn lines_through_locks_reach_their_goal_or_are_refused_as_they_should() {
    let desk = Desk::new();
    let folder = root().join("tests/golden/lines");
    let entries = std::fs::read_dir(folder).expect("the lines").flatten();
    let files = entries.map(|entry| entry.path().display().to_string());
    let lines: Vec<_> = files.filter(|file| file.ends_with(".toml")).collect();
    assert_eq!(lines.len(), 8);
    for line in lines {
        let code = if line.ends_with("/ur10-1-1.toml") {
            2
        } else {
            0
        };
        desk.refuses(code, &format!("run {line} --no-record"), "");
    }
}

#[test]
fn a_path_that_returns_brings_spare_joints_back() {
    let desk = Desk::new();
    for (name, q, by, duration_s) in [
        // Away from every lock; through that of a wrist, with its start in it.
        (
            "fr3",
            "[0.3, -0.4, 0.2, -2.0, 0.3, 1.8, 0.7]",
            "[0.1, 0.2, -0.15]",
            4.0,
        ),
        (
            "iiwa14",
            "[0.3, 0.5, 0.1, -1.4, 0.4, 0.0, 0.2]",
            "[0.05, 0.10, -0.08]",
            5.0,
        ),
    ] {
        let leg = format!(
            "[[segment]]\nby_m = {by}\npath = \"there-and-back\"\nduration_s = {duration_s}\n"
        );
        let head = format!("name = \"returns\"\nrobot = \"{name}\"\n[start]\nq = {q}\n");
        desk.file("returns.toml", head + &leg.repeat(10));
        let summary = desk.run("returns.toml --no-record");
        let [begin, end] = ["q_start", "q_end"].map(|end| summary["joints"][end].list());
        for (begin, end) in begin.iter().zip(end) {
            // After 20 crossings without the way back: 122° (fr3), 33° (iiwa14).
            let moved = (begin.number() - end.number()).abs();
            assert!(moved < 5_f64.to_radians(), "{name}: {begin} {end}");
        }
    }
}
