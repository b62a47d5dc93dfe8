//! `armplane servo`: an arm that is steered, and its session repeated.

use std::fs::File;
use std::io::Write;
use std::process::{Child, ChildStdin, Stdio};

use serde_json::Value;
use shared_types::target_file;
use shared_types::topics::TOPICS;
use shared_types::{Message, WristForce};

use crate::command::{Desk, Known, Running, signal, until};

const TARGETS: &str = "# armplane targets 1, length mm\n0, twist, base, 0.3, 100 0 0 0 0 0.2\n0.2, twist, 7, 1, 0 0 0 0 0 0\n0.3, twist, hand, 0.3, \
                       NaN 0 0 0 0 0\n0.4, pose, base, 1, 450 -150 100 0 1 0 0\n0.9, end\n1, end\n1.1, twist, base, 1, 0 0 0 0 0 0\n1.2, \
                       twist, base, 1, 9 0 0 0 0 0\n";

/// The topics of a steered run: no graph of its own has a sensor at the wrist.
fn topics() -> impl Iterator<Item = &'static str> {
    let steered = |topic: &&str| *topic != WristForce::TOPIC;
    TOPICS.into_iter().filter(steered)
}

fn same_bytes(one: &Value, two: &Value) {
    for topic in topics() {
        assert_eq!(one["topics"][topic], two["topics"][topic], "{topic}");
        assert!(one["topics"][topic]["count"].count() > 0, "{topic}");
    }
}

#[test]
fn a_file_steers_the_arm_and_its_saved_scenario_gives_the_same_bytes() {
    let desk = Desk::new();
    desk.file("targets.csv", TARGETS);
    let first = desk
        .armplane("servo puma560 --from targets.csv --out one --json")
        .json();
    first.holds(r#"{"completed": true, "processes/#": 6, "servo/after_end": 2}"#);
    let session = &first["servo"];
    assert_eq!(
        session["refused"].as_object().map(|all| all.len()),
        Some(2),
        "{session}"
    );
    let stated = session["seconds"].as_object().expect("reasons").values();
    let stated: f64 = stated.map(Value::number).sum();
    assert!(
        (stated - first["ticks"].number() * 1e-3).abs() < 1e-9,
        "each tick has its reason: {session}"
    );
    same_bytes(&first, &desk.run("one/scenario.toml --out two"));
    // One thread, and two runs in processes.
    desk.succeeds("verify one/scenario.toml --runs 2");
    let replayed = desk.succeeds("replay one --json").out;
    assert!(replayed.contains("servo_state"), "{replayed}");
    let said = desk.armplane("servo two/scenario.toml --out three");
    assert_eq!(said.out.matches(" 1 × ").count(), 2, "{}", said.out);
}

/// A session that is steered by the lines of its standard input.
fn steered(desk: &Desk, args: &str) -> (Child, ChildStdin) {
    let mut command = desk.command(&format!("servo {args} --out one --json"));
    let mut child = command
        .stdin(Stdio::piped())
        .spawn()
        .expect("armplane starts");
    let lines = child.stdin.take().expect("a pipe");
    (child, lines)
}

#[test]
fn every_line_that_is_no_target_is_counted_however_fast_they_come() {
    let desk = Desk::new();
    // Another run's messages are in the folder; a head whose unit is unknown spoils the lines after it.
    desk.run("servo-hostile --out one");
    let (child, mut lines) = steered(&desk, "ur5 --from -");
    let text = "nonsense\n# armplane targets 1, length cm\nend\nend\n# armplane targets 1, length mm\ntwist, base, 0.2, 5 0 0 0 0 0\nend\n";
    lines.write_all(text.as_bytes()).expect("the run reads");
    drop(lines);
    let said = child.finish();
    assert_eq!(said.code, 1, "{}", said.err);
    let refused = &said.json()["servo"]["refused"];
    let counts: Vec<_> = refused.as_object().expect("counts").values().collect();
    assert_eq!(counts, [4], "{refused}");
}

#[test]
fn an_input_without_a_target_is_in_the_exit_code() {
    let desk = Desk::new();
    desk.file("unit", "# armplane targets 1, length cm\n");
    // A file of an old Mac is one line.
    desk.file("returns", "# armplane targets 1, length mm\rend\r");
    desk.file("empty", "");
    let inputs = ["unit", "returns", "empty", "."].map(|name| File::open(desk.at(name)));
    let unreadable = File::create(desk.at("unreadable"));
    for input in inputs.into_iter().chain([unreadable]) {
        let mut command = desk.command("servo ur5 --from -");
        let said = command
            .stdin(input.expect("a file"))
            .spawn()
            .expect("armplane starts")
            .finish();
        assert!(said.code == 1 && !said.err.is_empty(), "{}", said.err);
    }
}

#[test]
fn a_session_that_ctrl_c_ends_is_repeated_to_its_last_tick() {
    // Steered while it lasts; the same without a single target; a file, faster than the clock.
    let lines = "twist, base, 9, 0.05 0 0 0 0 0\ntwist, hand, 9, 0 0 0.05 0 0.1 0\n";
    for (args, lines) in [
        ("ur5 --from -", lines),
        ("panda --from -", ""),
        ("puma560 --random 3 --duration 3600", ""),
    ] {
        let desk = Desk::new();
        let (child, mut input) = steered(&desk, args);
        input.write_all(lines.as_bytes()).expect("the run reads");
        until("the first ticks", || child.ticks() > 100);
        let first = child.interrupt().json();
        // Held open: the end of the input would end the session.
        drop(input);
        first.holds(r#"{"outcome": "interrupted", "completed": false}"#);
        for topic in topics() {
            let count = &first["topics"][topic]["count"];
            assert_eq!(
                count, &first["ticks"],
                "{args}: {topic} ends with the last tick"
            );
        }
        let again = desk
            .armplane("run one/scenario.toml --out again --json")
            .json();
        assert_eq!(
            again["ticks"], first["ticks"],
            "{args}: {}",
            again["reason"]
        );
        same_bytes(&first, &again);
    }
}

#[test]
fn a_unit_on_standard_input_holds_after_the_death_of_the_operator_too() {
    let desk = Desk::new();
    let (child, mut lines) = steered(&desk, "ur5 --from -");
    let head = "# armplane targets 1, length mm";
    writeln!(lines, "{head}\n\ntwist, base, 9, 5 0 0 0 0 0").expect("the run reads");
    until("the first ticks", || child.ticks() > 100);
    let first = child.pid("operator").expect("an operator");
    signal(first, "KILL");
    until("its replacement", || {
        child.pid("operator").is_some_and(|pid| pid != first)
    });
    writeln!(lines, "twist, base, 0.1, 7 0 0 0 0 0").expect("the run reads");
    drop(lines);
    let summary = child.finish().json();
    summary.holds(r#"{"completed": true, "faults/0/process": "operator"}"#);
    let targets = target_file::parse(&desk.read("one/targets.csv"), 1000).expect("targets");
    let mut speeds: Vec<_> = targets.iter().map(|row| row.target.twist[0]).collect();
    speeds.sort_by(f64::total_cmp);
    speeds.dedup();
    assert!(
        speeds.ends_with(&[0.005, 0.007]) && speeds.len() < 4,
        "{speeds:?}"
    );
    same_bytes(&summary, &desk.run("one/scenario.toml --out two"));
}

#[test]
fn the_last_target_before_the_end_of_input_is_followed_to_its_end() {
    let desk = Desk::new();
    let (child, mut lines) = steered(&desk, "ur5 --from -");
    writeln!(lines, "twist, base, 0.5, 0.05 0 0 0 0 0").expect("the run reads");
    drop(lines);
    let summary = child.finish().json();
    summary.holds(r#"{"completed": true}"#);
    assert!(
        (500..3_000).contains(&summary["ticks"].count()),
        "{summary}"
    );
}

#[test]
fn a_scenario_that_cannot_be_steered_says_why() {
    let desk = Desk::new();
    let head = "# armplane targets 1, length mm\n";
    let tool = "0, twist, tool, 1, 0 0 0 0 0 0\n";
    desk.file("wrong.csv", [head, tool].concat());
    desk.file(
        "joints.csv",
        [head, "0, posture, joints, 1, 0 0 0 -1 0 1\n"].concat(),
    );
    desk.file("headless.csv", "0, twist, base, 1, 0 0 0 0 0 0\n");
    desk.refuses_each(&[
        ("servo panda", "panda [servo] --from"),
        ("servo panda --from nowhere.csv", "nowhere.csv:"),
        ("servo panda --from wrong.csv", "wrong.csv:2: `tool`"),
        ("servo panda --from headless.csv", "headless.csv:1: `mm`"),
        ("servo pandas --random 1", "pandas"),
        ("servo panda --random 1 --start lying", "--start: "),
        ("servo panda --from joints.csv", "joints.csv:2: 6 7"),
        ("servo panda ur5 --random 1", "--seeds N"),
        ("servo fig5-wrist-rotation", "fig5-wrist-rotation [servo]"),
        ("servo panda --from keyboard", "--from FILE, -"),
        // With the feature: there is none to be found.
        ("servo panda --from topic", "`target`, --graph"),
    ]);
}
