//! Faults on real processes: survived, said, and the same again.

use serde_json::Value;

use crate::command::{Desk, Known, Running, is_sent, restarts, run_of, until};

/// Writes a short task with faults after it.
fn scenario(desk: &Desk, faults: &str) {
    let text = "name = \"short\"\nrobot = \"puma560\"\nstart.posture = \"nominal\"\nsettle_s = 0.2\n\n[[segment]]\nby_m = [0.05, 0.0, 0.05]\nduration_s = 0.8\n\n";
    desk.file("s.toml", [text, faults].concat());
}

fn fault(process: &str, kind: &str, more: &str) -> String {
    format!("[[fault]]\nprocess = \"{process}\"\nkind = \"{kind}\"\nat_tick = 400\n{more}\n")
}

fn topics(summary: &Value) -> &Value {
    summary.holds(r#"{"recorder/lost": 0}"#);
    &summary["topics"]
}

#[test]
fn an_estimate_that_no_arm_can_have_moved_to_gets_no_torque() {
    for (field, amount) in [("q[1]", "1e6"), ("qdot[4]", "1000.0")] {
        let desk = Desk::new();
        let corrupt =
            format!("as = \"huge\"\nfield = \"{field}\"\namount = {amount}\nfor_ticks = 80");
        scenario(&desk, &fault("estimator", "corrupt", &corrupt));
        let summary = desk.run("s.toml --no-record");
        summary.holds(r#"{"faults/0/occurred": true, "outcome": "goal reached", "joints/rejected_estimate_ticks": 80}"#);
        // It takes 22 % of the limits to follow the path, and as much to be brought to rest: not the full torque of 80 ms.
        for ratio in ["torque_max_ratio", "speed_max_ratio"] {
            let found = summary["joints"][ratio].number();
            assert!(found < 0.3, "{field}: {ratio} {found}");
        }
    }
}

/// The ticks of a run's record, in order, as a table has them.
pub(crate) fn recorded_ticks(desk: &Desk, run: &str) -> Vec<u64> {
    desk.succeeds(&format!("export {run} --out ticks"));
    let table = desk.read("ticks/signals.csv");
    let rows = table
        .lines()
        .skip(1)
        .filter_map(|row| row.split(',').next());
    rows.map(|tick| tick.parse().expect("a tick")).collect()
}

/// A fault that somebody injects while a run goes on is recorded; its run can be repeated, and its processes compute the same again.
#[test]
fn a_live_fault_is_recorded_and_its_run_can_be_repeated_and_replayed() {
    for (process, fault) in [
        ("controller", "controller kill --for 50ms"),
        ("plant", "plant sensor --as bias --joint 2"),
    ] {
        let desk = Desk::new();
        let run = desk.start("run --set segment.1.duration_s=12 --json --out live");
        let launcher = format!("-{}-", run.id());
        until("the run to take a fault", || {
            let runs = desk.json("doctor");
            let mut names = runs["runs"].list().iter().map(|one| one["run"].text());
            let name = names.find(|name| name.contains(&launcher));
            name.is_some_and(|name| desk.armplane(&format!("fault {fault} --run {name}")).code == 0)
        });
        let said = run.finish();
        let live = said.json();
        assert!(said.code == 0 || process == "plant", "{}", said.err);
        live.holds(r#"{"faults/0/origin": "live", "faults/0/occurred": true}"#);
        let again = desk
            .armplane("run live/scenario.toml --out again --json")
            .json();
        assert_eq!(topics(&live), topics(&again));
        again.holds(r#"{"faults/0/origin": "planned"}"#);
        desk.json(&format!("replay live --process {process}"))
            .holds(r#"{"identical": true, "ended": ""}"#);
    }
}

#[test]
fn drill_judges_a_cell_and_takes_only_cells_that_exist() {
    let desk = Desk::new();
    scenario(&desk, "");
    for cell in [
        "controller:kill",
        "plant:kill",
        "recorder:disk-full",
        "plant:delay",
        "controller:zombie",
    ] {
        let drill = desk.json(&format!("drill s.toml --only {cell}"));
        drill.holds(r#"{"passed": true, "cells/0/replayed_identically": true}"#);
        let one = &drill["cells"][0];
        assert!(
            one["stale_ticks"].count() <= 3 && one["torque_max_ratio"].number() <= 1.0,
            "{one}"
        );
        assert_eq!(one["goal_reached"], true, "{one}");
    }
    // The bounds stay, whatever a scenario allows itself; nor does it pass without what it tests.
    for (changed, cell, check) in [
        ("--set plant.hold_ticks=200", "controller:kill", "age"),
        ("--without hold", "controller:kill", "age"),
        (
            "--without torque-check",
            "controller:corrupt:huge",
            "torque",
        ),
        ("--without fencing", "controller:zombie", "fence"),
    ] {
        let args = format!("drill s.toml --json --only {cell} {changed}");
        let drill = desk.refuses(1, &args, "").json();
        let mut broken = drill["cells"][0]["broken"].list().iter();
        assert!(
            broken.any(|one| one["check"] == check),
            "{changed}: {drill}"
        );
    }
    desk.refuses(
        1,
        "drill s.toml --only controller:kill --set goal.position_mm=1e-7",
        "s.toml 0.0000001",
    );
    desk.refuses(2, "drill --only recorder:drop", "`recorder:drop` plant,");
}

#[test]
fn drill_judges_runs_in_real_time_by_themselves() {
    let desk = Desk::new();
    scenario(&desk, "");
    let said = desk.armplane("drill s.toml --realtime --only controller:kill --json --out d");
    let (drill, passed) = (said.json(), said.code == 0);
    drill.holds(&format!(r#"{{"passed": {passed}, "cells/0/restarts": 1}}"#));
    let cell = &drill["cells"][0];
    // A recorder that this machine leaves without a processor for seconds loses messages, which must be reported; nothing else may break.
    let is_of_time = |broken: &Value| ["lost", "rows", "files"].contains(&broken["check"].text());
    assert!(cell["broken"].list().iter().all(is_of_time), "{cell}");
    let number = |key: &str| cell["messages"][key].count();
    let arrived = ["taken_in", "refused", "fenced", "lost"].map(number);
    assert_eq!(number("sent"), arrived.iter().sum::<u64>(), "{cell}");
    assert_eq!(desk.read_json("d/drill.json"), drill);
}

#[test]
fn a_cut_edge_keeps_messages_from_one_reader_alone() {
    let desk = Desk::new();
    scenario(
        &desk,
        &fault("controller", "cut", "topic = \"estimate\"\nfor_ticks = 2"),
    );
    let summary = desk.run("s.toml --no-record");
    let count = |topic: &str| summary["topics"][topic]["count"].count();
    let ticks = count("plant_state");
    // The others have them, and it has nothing to answer.
    let counts = ["estimate", "singularity", "torque"].map(count);
    assert_eq!(counts, [ticks, ticks, ticks - 2]);
    summary.holds(r#"{"outcome": "goal reached", "faults/0/occurred": true}"#);
    assert!(summary["faults"][0]["detected_ms"].is_number());
    assert_eq!(restarts(&summary, "controller"), 0);
}

#[test]
fn a_run_of_another_folder_is_named_before_anything_happens_to_it() {
    let (desk, elsewhere) = (Desk::new(), Desk::new());
    let run = desk.begin("run --set segment.1.duration_s=500 --json --no-record --out r");
    let folder = desk.at("r").display().to_string();
    elsewhere.refuses(2, "fault controller kill", &format!("{folder} --run"));
    run.interrupt().json().holds(r#"{"faults": []}"#);
}

#[test]
fn a_recorder_killed_after_the_last_tick_loses_nothing() {
    let desk = Desk::new();
    scenario(&desk, "");
    let expected = desk.run("s.toml --out expected");
    let is_death = |fault: &&Value| fault["origin"] == "detected" && fault["process"] == "recorder";
    let attempt = |_| {
        let run = desk.start("run s.toml --out results --json");
        until("the recorder", || run.pid("recorder").is_some());
        let recorder = run.pid("recorder").unwrap_or_default();
        while run.ticks() < expected["ticks"].count() && run_of(run.id()).is_some() {
            std::hint::spin_loop();
        }
        let is_killed = is_sent(recorder, "KILL");
        let said = run.finish();
        assert_eq!(said.code, 0, "{}", said.err);
        let summary = said.json();
        assert_eq!(topics(&summary), &expected["topics"]);
        let deaths = summary["faults"].list().iter().filter(is_death).count();
        is_killed && deaths == 1
    };
    // In some it has ended by itself.
    assert!((0..20).any(attempt), "no recorder was killed");
}
