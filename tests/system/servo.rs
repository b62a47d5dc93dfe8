//! `armplane servo`: an arm that is steered, and its session repeated.

use std::fs::File;
use std::io::Write;
use std::process::{Child, Command, Stdio};

use serde_json::Value;
use shared_types::target_file;
use shared_types::topics::TOPICS;

use crate::command::{Desk, Said, assert_nothing_left, children_of_run, finish, until};
use crate::life::signal;
use crate::patience::ticks;

const TARGETS: &str = "# armplane targets 1, length mm\n0, twist, base, 0.3, 100 0 0 0 0 0.2\n0.2, twist, 7, 1, 0 0 0 0 0 0\n0.3, twist, hand, 0.3, \
                       NaN 0 0 0 0 0\n0.4, pose, base, 1, 450 -150 100 0 1 0 0\n0.9, end\n1, end\n1.1, twist, base, 1, 0 0 0 0 0 0\n1.2, \
                       twist, base, 1, 9 0 0 0 0 0\n";

fn summary(said: &Said) -> Value {
    assert_nothing_left(said.launcher);
    serde_json::from_str(&said.out)
        .unwrap_or_else(|error| panic!("{error}: {}{}", said.out, said.err))
}

fn same_bytes(one: &Value, two: &Value) {
    for topic in TOPICS {
        assert_eq!(
            (&one["topics"][topic], topic),
            (&two["topics"][topic], topic)
        );
        assert!(
            one["topics"][topic]["count"]
                .as_u64()
                .is_some_and(|count| count > 0),
            "{topic}"
        );
    }
}

#[test]
fn a_file_steers_the_arm_and_its_saved_scenario_gives_the_same_bytes() {
    let desk = Desk::new();
    desk.file("targets.csv", TARGETS);
    let first = summary(&desk.armplane(&[
        "servo",
        "puma560",
        "--from",
        "targets.csv",
        "--out",
        "one",
        "--json",
    ]));
    let session = &first["servo"];
    assert_eq!(
        (
            session["refused"].as_object().map(serde_json::Map::len),
            &session["after_end"]
        ),
        (Some(2), &2.into()),
        "{session}"
    );
    let stated: f64 = session["seconds"]
        .as_object()
        .into_iter()
        .flatten()
        .filter_map(|(_, seconds)| seconds.as_f64())
        .sum();
    assert!(
        (stated - first["ticks"].as_f64().unwrap_or_default() * 1e-3).abs() < 1e-9,
        "each tick has its reason: {session}"
    );
    assert_eq!(
        (
            &first["completed"],
            &first["processes"].as_array().map(Vec::len)
        ),
        (&true.into(), &Some(6)),
        "{}",
        first["reason"]
    );
    same_bytes(&first, &desk.run(&["one/scenario.toml", "--out", "two"]));
    let said = desk.armplane(&["verify", "one/scenario.toml", "--runs", "2", "--json"]);
    assert_eq!(
        said.code, 0,
        "one thread, and two runs in processes: {}{}",
        said.out, said.err
    );
    let said = desk.armplane(&["replay", "one", "--json"]);
    assert!(
        said.code == 0 && said.out.contains("servo_state"),
        "{}{}",
        said.out,
        said.err
    );
    let said = desk.armplane(&["servo", "two/scenario.toml", "--out", "three"]);
    assert!(
        said.out
            .contains("refused    1 × it holds a NaN or an infinity"),
        "{}",
        said.out
    );
}

/// A hand turned until joint 7 of a Panda is at its limit, and on.
fn turned_for(seconds: u32) -> String {
    format!(
        "# armplane targets 1, length mm\n0, twist, hand, 60, 0 0 0 0.5 0.5 1\n{seconds}, end\n"
    )
}

#[test]
fn at_a_limit_and_after_the_end_the_arm_rests() {
    let desk = Desk::new();
    let posture_after = |name: &str, seconds: u32, settle: &str| -> Vec<f64> {
        let file = format!("{name}.csv");
        desk.file(&file, &turned_for(seconds));
        let summary = summary(&desk.armplane(&[
            "servo", "panda", "--from", &file, "--set", settle, "--out", name, "--json",
        ]));
        let limit =
            summary["servo"]["seconds"]["slowed before a joint limit: joint 7 at its upper limit"]
                .as_f64();
        assert!(
            limit.is_some_and(|seconds| seconds > 1.0),
            "{}",
            summary["servo"]
        );
        summary["joints"]["q_end"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(serde_json::Value::as_f64)
            .collect()
    };
    let rested = posture_after("rested", 6, "settle_s=0.5");
    for (name, later) in [
        ("longer", posture_after("longer", 9, "settle_s=0.5")),
        ("over", posture_after("over", 6, "settle_s=3")),
    ] {
        let moved = rested
            .iter()
            .zip(&later)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(
            later.len() == 7 && moved < 1e-3,
            "{name}: a joint moved by {moved} rad: {rested:?}, {later:?}"
        );
    }
}

/// A run that is steered by the lines of its standard input.
fn steered_by_lines(desk: &Desk) -> Child {
    Command::new(env!("CARGO_BIN_EXE_armplane"))
        .args(["servo", "ur5", "--from", "-", "--out", "one", "--json"])
        .current_dir(desk.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("armplane starts")
}

#[test]
fn every_line_that_is_no_target_is_counted_however_fast_they_come() {
    let desk = Desk::new();
    // Another run's messages are in the folder; a head whose unit is unknown spoils the lines after it.
    desk.run(&["servo-hostile", "--out", "one"]);
    let mut child = steered_by_lines(&desk);
    let mut lines = child.stdin.take().expect("a pipe");
    let text = "nonsense\n# armplane targets 1, length cm\nend\nend\n# armplane targets 1, length mm\ntwist, base, 0.2, 5 0 0 0 0 0\nend\n";
    lines.write_all(text.as_bytes()).expect("the run reads");
    drop(lines);
    let said = finish(child);
    assert_eq!(said.code, 1, "{}", said.err);
    let refused = &summary(&said)["servo"]["refused"];
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
    let read = |name: &str| File::open(desk.path().join(name)).expect("a file");
    let unreadable = File::create(desk.path().join("none")).expect("a file");
    let folder = read(".");
    for input in [
        read("unit"),
        read("returns"),
        read("empty"),
        folder,
        unreadable,
    ] {
        let mut command = desk.command("servo ur5 --from -");
        command.stdin(input);
        let said = finish(command.spawn().expect("armplane starts"));
        assert!(said.code == 1 && !said.err.is_empty(), "{}", said.err);
        assert_nothing_left(said.launcher);
    }
}

#[test]
fn a_session_that_ctrl_c_ends_is_repeated_to_its_last_tick() {
    let desk = Desk::new();
    // Steered while it lasts; the same without a single target; a file, faster than the clock.
    let sessions: [(&str, &[&str], &[&str]); 3] = [
        (
            "steered",
            &["ur5", "--from", "-"],
            &[
                "twist, base, 9, 0.05 0 0 0 0 0",
                "twist, hand, 9, 0 0 0.05 0 0.1 0",
            ],
        ),
        ("untouched", &["panda", "--from", "-"], &[]),
        (
            "random",
            &["puma560", "--random", "3", "--duration", "3600"],
            &[],
        ),
    ];
    for (name, args, lines) in sessions {
        let mut child = Command::new(env!("CARGO_BIN_EXE_armplane"))
            .arg("servo")
            .args(args)
            .args(["--out", name, "--json"])
            .current_dir(desk.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("armplane starts");
        // Held open: the end of the input would end the session.
        let mut input = child.stdin.take().expect("a pipe");
        lines
            .iter()
            .for_each(|line| writeln!(input, "{line}").expect("the run reads"));
        until("the first ticks", || ticks(&child) > 100);
        // SAFETY: a signal to a child that has not been waited for.
        unsafe { libc::kill(child.id().cast_signed(), libc::SIGINT) };
        let first = summary(&finish(child));
        drop(input);
        assert_eq!(
            (&first["outcome"], &first["completed"]),
            (&"interrupted".into(), &false.into()),
            "{name}: {}",
            first["reason"]
        );
        let ended = &first["ticks"];
        for topic in TOPICS {
            assert_eq!(
                &first["topics"][topic]["count"], ended,
                "{name}, {topic}: every topic ends with the last tick"
            );
        }
        let said = desk.armplane(&[
            "run",
            &format!("{name}/scenario.toml"),
            "--out",
            &format!("{name}-again"),
            "--json",
        ]);
        let again = summary(&said);
        assert_eq!(&again["ticks"], ended, "{name}: {}", again["reason"]);
        same_bytes(&first, &again);
    }
}

#[test]
fn a_unit_on_standard_input_holds_after_the_death_of_the_operator_too() {
    let desk = Desk::new();
    let mut child = steered_by_lines(&desk);
    let mut lines = child.stdin.take().expect("a pipe");
    let head = "# armplane targets 1, length mm";
    writeln!(lines, "{head}\n\ntwist, base, 9, 5 0 0 0 0 0").expect("the run reads");
    until("the first ticks", || ticks(&child) > 100);
    let operator = || {
        let children = children_of_run(child.id());
        let found = children.into_iter().find(|(name, _)| name == "operator");
        found.map(|(_, pid)| pid)
    };
    let first = operator().expect("an operator");
    signal(first, "KILL");
    until("its replacement", || {
        operator().is_some_and(|pid| pid != first)
    });
    writeln!(lines, "twist, base, 0.1, 7 0 0 0 0 0").expect("the run reads");
    drop(lines);
    let summary = summary(&finish(child));
    assert_eq!(
        (&summary["completed"], &summary["faults"][0]["process"]),
        (&true.into(), &"operator".into()),
        "{summary}"
    );
    let targets = desk.read("one/targets.csv");
    let speeds: Vec<_> = target_file::parse(&targets, 1000)
        .expect("targets")
        .iter()
        .map(|row| row.target.twist[0])
        .filter(|speed| *speed != 0.0)
        .collect();
    assert!(
        speeds.contains(&0.007) && speeds.iter().all(|speed| [0.005, 0.007].contains(speed)),
        "{targets}"
    );
    same_bytes(&summary, &desk.run(&["one/scenario.toml", "--out", "two"]));
}

#[test]
fn the_last_target_before_the_end_of_input_is_followed_to_its_end() {
    let desk = Desk::new();
    let mut child = steered_by_lines(&desk);
    writeln!(
        child.stdin.take().expect("a pipe"),
        "twist, base, 0.5, 0.05 0 0 0 0 0"
    )
    .expect("the run reads");
    let summary = summary(&finish(child));
    assert_eq!(summary["completed"], true, "{}", summary["reason"]);
    assert!(
        (500..3_000).contains(&summary["ticks"].as_u64().expect("ticks")),
        "{}",
        summary["ticks"]
    );
}

#[test]
fn a_scenario_that_cannot_be_steered_says_why() {
    let desk = Desk::new();
    desk.file(
        "wrong.csv",
        "# armplane targets 1, length mm\n0, twist, tool, 1, 0 0 0 0 0 0\n",
    );
    desk.file(
        "joints.csv",
        "# armplane targets 1, length mm\n0, posture, joints, 1, 0 0 0 -1 0 1\n",
    );
    desk.file("headless.csv", "0, twist, base, 1, 0 0 0 0 0 0\n");
    for (args, expected) in [
        (&["servo", "panda"][..], "is not steered: it has no [servo]"),
        (
            &["servo", "panda", "--from", "nowhere.csv"],
            "there is no file nowhere.csv",
        ),
        (
            &["servo", "panda", "--from", "wrong.csv"],
            "wrong.csv:2: there is no frame `tool`",
        ),
        (
            &["servo", "panda", "--from", "headless.csv"],
            "the first line must be",
        ),
        (&["servo", "pandas", "--random", "1"], "pandas"),
        (
            &["servo", "panda", "--random", "1", "--start", "lying"],
            "--start: ",
        ),
        (
            &["servo", "panda", "--from", "joints.csv"],
            "joints.csv:2: the posture has 6 values, and the arm has 7 joints",
        ),
        (
            &["servo", "panda", "ur5", "--random", "1"],
            "give one robot or scenario",
        ),
        (&["servo", "fig5-wrist-rotation"], "is not steered"),
        (
            &["servo", "panda", "--from", "keyboard"],
            "standard input is no terminal",
        ),
        // With the feature: there is none to be found.
        (&["servo", "panda", "--from", "gamepad"], "gamepad"),
        (
            &["servo", "panda", "--from", "topic"],
            "name a graph with a process of yours that writes `target`",
        ),
    ] {
        let said = desk.armplane(args);
        assert!(
            said.code == 2 && said.err.contains(expected),
            "{args:?}: {}{}",
            said.out,
            said.err
        );
    }
    assert!(
        !desk.path().join("runs").exists(),
        "what is refused leaves no folder"
    );
}
