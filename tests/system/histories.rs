//! Processes killed from outside in lockstep: the scenario that a run leaves repeats it byte for byte, and no kill holds it up.

use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use crate::command::{Desk, Known, Running, until};

/// A motion of a second, to be followed by a fault.
const SHORT: &str = "name = \"short\"\nrobot = \"puma560\"\nstart.posture = \"nominal\"\nsettle_s = 0.2\n\n[[segment]]\nby_m = [0.05, 0.0, 0.05]\nduration_s = 0.8\n\n";

#[test]
fn random_deaths_repeat_themselves_byte_for_byte() {
    let desk = Desk::new();
    let killed = desk.json("verify --kills 5 --set segment.1.duration_s=1");
    killed.holds(r#"{"unrepeated": [], "histories": 5}"#);
    assert!(killed["deaths"].count() >= 3, "{killed}");
}

#[test]
fn a_death_between_two_outputs_of_a_tick_is_planned_and_repeats() {
    let desk = Desk::new();
    let fault = "[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_tick = 300\n";
    for (more, states_without_torque) in [("", 0), ("after_outputs = 1", 1)] {
        desk.file("s.toml", [SHORT, fault, more].concat());
        // The arm leaves its path while no torque comes, and its task ends before it is back.
        let run = |out| {
            desk.armplane(&format!("run s.toml --json --out {out}"))
                .json()
        };
        let [one, other] = ["a", "b"].map(|out| run(out)["topics"].take());
        assert_eq!(one, other, "{more}");
        let [states, torques] =
            ["control_state", "torque"].map(|topic| one[topic]["count"].count());
        assert_eq!(states, torques + states_without_torque, "{more}");
    }
    let drop = "[[fault]]\nprocess = \"plant\"\nkind = \"drop\"\nafter_outputs = 1";
    desk.file("s.toml", [SHORT, drop].concat());
    desk.refuses(2, "run s.toml", "after_outputs");
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
        until("the process", || run.pid(process).is_some());
        run.strike(process, name);
    }
    let said = run.finish();
    let one = said.json();
    assert_eq!(said.code, 0, "{}", said.err);
    one.holds(r#"{"outcome": "goal reached"}"#);
    let mut processes = one["processes"].list().iter();
    assert!(processes.any(|process| process["restarts"] == 1), "{one}");
    assert_eq!(one["topics"], desk.run("a/scenario.toml --out b")["topics"]);
}

#[test]
fn a_process_killed_while_it_makes_a_connection_holds_nobody_up() {
    let desk = Desk::new();
    let run = desk.begin("run --set segment.1.duration_s=5 --json --no-record --out r");
    let analyzer = run.pid("analyzer").unwrap();
    run.signal("STOP");
    let maps = std::fs::read_to_string(format!("/proc/{analyzer}/maps")).unwrap();
    let paths = maps
        .lines()
        .filter_map(|line| line.find('/').map(|at| Path::new(&line[at..])));
    let connections: Vec<_> = paths
        .filter(|path| path.extension().is_some_and(|end| end == "connection"))
        .collect();
    run.strike("analyzer", "KILL");
    for connection in &connections {
        let _ = std::fs::remove_file(connection);
        // As a process leaves it that is killed between the first two steps of making it.
        let mut made = std::fs::OpenOptions::new();
        made.write(true)
            .create_new(true)
            .mode(0o200)
            .open(connection)
            .unwrap();
    }
    run.signal("CONT");
    let summary = run.finish().json();
    assert!(connections.len() >= 3, "{connections:?}");
    summary.holds(r#"{"outcome": "goal reached", "processes/2/restarts": 1}"#);
}
