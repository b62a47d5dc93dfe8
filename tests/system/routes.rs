//! Lines through exactly singular postures, and paths along them and back.

use std::path::Path;

use serde_json::Value;

use crate::command::Desk;
use crate::exchange::root;

/// Seeded lines through locks of an arm with a sliding joint and of two others. An inverse kinematics that shares nothing with the planner has followed
/// all postures of their poses: each line has a route without a jump but one.
#[test]
fn lines_through_locks_reach_their_goal_or_are_refused_as_they_should() {
    let desk = Desk::new();
    let folder = root().join("tests/golden/lines");
    let entries = std::fs::read_dir(folder).expect("the lines").flatten();
    let files: Vec<_> = entries.map(|entry| entry.path()).collect();
    let is_line = |file: &&std::path::PathBuf| file.extension().is_some_and(|end| end == "toml");
    let lines = files.iter().filter(is_line);
    assert_eq!(lines.clone().count(), 8);
    for line in lines {
        let refused = line.file_stem() == Some("ur10-1-1".as_ref());
        let args =
            [line.as_path(), Path::new("--no-record")].map(|part| part.display().to_string());
        let said = desk.armplane(&[&["run".to_owned()], &args[..]].concat());
        let code = if refused { 2 } else { 0 };
        assert_eq!(said.code, code, "{}: {}", line.display(), said.err);
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
        desk.file(
            "returns.toml",
            &format!(
                "name = \"returns\"\nrobot = \"{name}\"\n[start]\nq = {q}\n{}",
                leg.repeat(10)
            ),
        );
        let said = desk.succeeds(&[
            "run",
            "returns.toml",
            "--no-record",
            "--no-messages",
            "--json",
        ]);
        let summary: Value = serde_json::from_str(&said.out).unwrap();
        let posture = |end: &str| -> Vec<f64> {
            let list = summary["joints"][end].as_array().unwrap();
            list.iter().map(|q| q.as_f64().unwrap()).collect()
        };
        for (begin, end) in posture("q_start").iter().zip(posture("q_end")) {
            // After 20 crossings without the way back: 122° (fr3), 33° (iiwa14).
            assert!(
                (begin - end).abs() < 5_f64.to_radians(),
                "{name}: {begin} {end}"
            );
        }
    }
}
