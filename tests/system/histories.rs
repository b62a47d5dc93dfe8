//! Processes killed from outside in lockstep: the scenario that a run leaves repeats it byte for byte, and no kill holds it up.

use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;

use serde_json::Value;

use crate::command::{Desk, Known, assert_nothing_left, finish, pid_of, until};
use crate::life::signal;

/// A motion of a second, to be followed by a fault.
const SHORT: &str = "name = \"short\"\nrobot = \"puma560\"\nstart.posture = \"nominal\"\nsettle_s = 0.2\n\n[[segment]]\nby_m = [0.05, 0.0, 0.05]\nduration_s = 0.8\n\n";

#[test]
fn random_deaths_repeat_themselves_byte_for_byte() {
    let desk = Desk::new();
    let killed = desk.json("verify --kills 5 --set segment.1.duration_s=1");
    assert_eq!(
        (&killed["unrepeated"], &killed["histories"]),
        (&Value::Array(vec![]), &5.into()),
        "{killed}"
    );
    assert!(killed["deaths"].count() >= 3, "{killed}");
}

#[test]
fn a_death_between_two_outputs_of_a_tick_is_planned_and_repeats() {
    let desk = Desk::new();
    let count = |topics: &Value, topic: &str| topics[topic]["count"].count();
    let fault = |more: &str| {
        desk.file(
            "s.toml",
            &format!(
                "{SHORT}[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_tick = 300\n{more}"
            ),
        );
        // The arm leaves its path while no torque comes, and its task ends before it is back.
        let run = |out| {
            desk.armplane(&format!("run s.toml --json --out {out}"))
                .json()
        };
        let [one, other] = ["a", "b"].map(|out| run(out)["topics"].take());
        assert_eq!(one, other, "{more}");
        (count(&one, "control_state"), count(&one, "torque"))
    };
    let (states, torques) = fault("");
    assert_eq!(states, torques, "a whole tick");
    let (states, torques) = fault("after_outputs = 1");
    assert_eq!(
        states,
        torques + 1,
        "the state of its last tick, and no torque"
    );
    desk.file(
        "t.toml",
        &format!("{SHORT}[[fault]]\nprocess = \"plant\"\nkind = \"drop\"\nafter_outputs = 1"),
    );
    desk.refuses(2, "run t.toml", &["after_outputs"]);
}

#[test]
fn deaths_during_start_up_repeat_themselves() {
    let desk = Desk::new();
    desk.file("s.toml", SHORT);
    let run = desk.start("run s.toml --json --out a");
    for (process, name) in [
        ("estimator", "KILL"),
        ("analyzer", "BUS"),
        ("recorder", "SEGV"),
        ("controller", "KILL"),
    ] {
        let pid = || pid_of(run.id(), process);
        until("the process", || pid().is_some());
        signal(pid().unwrap(), name);
    }
    let said = finish(run);
    let one = said.json();
    assert_eq!(
        (said.code, &one["outcome"]),
        (0, &"goal reached".into()),
        "{}",
        said.err
    );
    assert!(
        one["processes"]
            .list()
            .iter()
            .any(|process| process["restarts"] == 1),
        "{}",
        one["processes"]
    );
    assert_nothing_left(said.launcher);
    assert_eq!(one["topics"], desk.run("a/scenario.toml --out b")["topics"]);
}

#[test]
fn a_process_killed_while_it_makes_a_connection_holds_nobody_up() {
    let desk = Desk::new();
    let run = desk.begin("run --set segment.1.duration_s=5 --json --no-record --out r");
    let analyzer = pid_of(run.id(), "analyzer").unwrap();
    let launcher = run.id().cast_signed();
    signal(launcher, "STOP");
    let maps = std::fs::read_to_string(format!("/proc/{analyzer}/maps")).unwrap();
    let connections = maps.lines().filter_map(|line| {
        line.split_once('/')
            .map(|(_, path)| PathBuf::from(format!("/{path}")))
    });
    let connections: Vec<_> = connections
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "connection")
        })
        .collect();
    signal(analyzer, "KILL");
    for connection in &connections {
        let _ = std::fs::remove_file(connection);
        // As a process leaves it that is killed between the first two steps of making it.
        std::fs::OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o200)
            .open(connection)
            .unwrap();
    }
    signal(launcher, "CONT");
    let said = finish(run);
    let summary = said.json();
    assert!(connections.len() >= 3, "{connections:?}");
    assert_eq!(
        (&summary["outcome"], &summary["processes"][2]["restarts"]),
        (&"goal reached".into(), &1.into()),
        "{}",
        said.err
    );
    assert_nothing_left(said.launcher);
}
