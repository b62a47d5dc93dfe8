//! Processes killed from outside in lockstep: the bytes are those of the undisturbed run, and no kill holds it up.

use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use crate::command::{Desk, Known, Running, signal, until};

#[test]
fn random_deaths_change_no_byte() {
    let desk = Desk::new();
    let killed = desk.json("verify --kills 50 --set segment.1.duration_s=2");
    killed.holds(r#"{"identical": true, "runs/#": 51}"#);
    let runs = killed["runs"].list().iter();
    let deaths = runs
        .filter_map(|run| run.get("deaths"))
        .map(|all| all.list().len());
    assert!(deaths.sum::<usize>() >= 40, "{killed}");
}

#[test]
fn the_sixth_death_from_the_same_tick_ends_the_run_and_is_named() {
    let desk = Desk::new();
    let run = desk.begin("run --set segment.1.duration_s=500 --json --no-record --out r");
    let mut before = None;
    for _ in 0..6 {
        // Read once: the one just killed is still found, then gone, before the next appears.
        let mut another = None;
        until("another analyzer", || {
            another = run.pid("analyzer").filter(|pid| Some(*pid) != before);
            another.is_some() && run.ticks() > 50
        });
        before = another;
        signal(another.expect("it was found"), "KILL");
    }
    let said = run.finish();
    assert_eq!(said.code, 1, "{}", said.err);
    said.json()
        .holds(r#"{"outcome": "failed", "faults/#": 6, "processes/2/restarts": 5}"#);
    for words in ["analyzer", "signal 9", "tick"] {
        assert!(said.err.contains(words), "{}", said.err);
    }
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
