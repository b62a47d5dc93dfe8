//! `armplane replay`: a run computed again from what it kept, process by process.

use serde_json::Value;

use crate::command::{Desk, Known, finish, run_of, until};

fn replay(desk: &Desk, args: &str) -> (i32, Value) {
    let said = desk.armplane(&format!("replay --json {args}"));
    (said.code, said.json())
}

/// A replay that gives the same bytes to the end of the run.
fn same(desk: &Desk, args: &str) -> Value {
    let (code, json) = replay(desk, args);
    assert_eq!(
        (code, &json["identical"], &json["ended"]),
        (0, &true.into(), &"".into()),
        "{args}: {json}"
    );
    json
}

#[test]
fn every_process_computes_again_what_it_computed_in_the_run() {
    let desk = Desk::new();
    let summary = desk.run("--seed 3 --out run");
    assert!(
        summary["recorder"]["messages_bytes"].count() > 0,
        "{}",
        summary["recorder"]
    );
    for (process, topics) in [
        ("plant", vec!["sensor", "plant_state"]),
        ("estimator", vec!["estimate"]),
        ("analyzer", vec!["singularity"]),
        ("controller", vec!["control_state", "torque"]),
    ] {
        let json = same(&desk, &format!("run --process {process}"));
        assert_eq!(
            (&json["difference"], &json["without_input"]),
            (&Value::Null, &0.into())
        );
        let replayed: Vec<_> = json["topics"]
            .list()
            .iter()
            .map(|topic| topic["topic"].text())
            .collect();
        assert_eq!(replayed, topics);
        assert!(
            json["topics"]
                .list()
                .iter()
                .all(|topic| topic["messages"] == summary["ticks"]),
            "{json}"
        );
    }
}

#[test]
fn a_changed_controller_is_told_where_it_first_differs_and_by_how_much() {
    let desk = Desk::new();
    desk.run("--out run");
    // The second segment only: until it begins the torques are the recorded ones.
    let (code, json) = replay(&desk, "run --set segment.1.turn.by_deg=44");
    assert_eq!((code, &json["identical"]), (1, &false.into()), "{json}");
    let difference = &json["difference"];
    assert!(
        difference["tick"].count() > 1000 && difference["topic"] == "control_state",
        "{difference}"
    );
    let value = |of: &Value| of.as_str().unwrap().parse::<f64>().unwrap();
    assert_ne!(value(&difference["expected"]), value(&difference["found"]));
    let torque = json["topics"]
        .list()
        .iter()
        .find(|topic| topic["topic"] == "torque")
        .unwrap();
    let fields = torque["fields"].list();
    let of = |name: &str| {
        fields
            .iter()
            .find(|field| field["field"] == name)
            .unwrap_or_else(|| panic!("{name}: {json}"))
    };
    let tau = of("tau");
    let (recorded, replayed) = (value(&tau["at"]["expected"]), value(&tau["at"]["found"]));
    assert!(
        (tau["largest"].number() - (recorded - replayed).abs()).abs() < 1e-12
            && recorded != replayed,
        "{tau}"
    );
    assert!(tau["tick"].count() >= difference["tick"].count());
    let said = desk.armplane("replay run --set segment.1.turn.by_deg=44");
    assert!(
        said.code == 1 && said.out.contains("controller first differs at tick"),
        "{}",
        said.out
    );
}

#[test]
fn a_process_that_cannot_be_replayed_says_why() {
    let desk = Desk::new();
    desk.run("--out bare --no-messages");
    desk.run("--out run");
    for (args, expected) in [
        ("replay nowhere", "is not the folder of a run"),
        ("replay bare", "without --no-messages"),
        ("replay run --set control.kp=1", "unknown field `kp`"),
        ("replay run --set robot=ur5", "keeps the robot of its run"),
    ] {
        desk.refuses(2, args, &[expected]);
    }
}

#[test]
fn a_death_and_a_return_are_replayed_too() {
    let desk = Desk::new();
    let scenario = sim::scenarios::text("fig5-wrist-rotation").unwrap();
    let fault = |process: &str, tick: u64| {
        format!(
            "\n[[fault]]\nprocess = \"{process}\"\nkind = \"kill\"\nat_tick = {tick}\nfor_ticks = 20\n"
        )
    };
    desk.file(
        "deaths.toml",
        &[
            scenario,
            &fault("controller", 1000),
            &fault("estimator", 2500),
        ]
        .concat(),
    );
    let said = desk.armplane("run deaths.toml --out run --json");
    let summary = said.json();
    let restarted = summary["processes"]
        .list()
        .iter()
        .filter(|process| process["restarts"] == 1)
        .count();
    assert_eq!(restarted, 2, "{summary}");
    for process in ["plant", "estimator", "analyzer", "controller"] {
        same(&desk, &format!("run --process {process}"));
    }
}

/// A short task with a fault.
fn short(fault: &str) -> String {
    let task = "name = \"short\"\nrobot = \"puma560\"\nstart.posture = \"nominal\"\nsettle_s = 0.2\n[[segment]]\nby_m = [0.05, 0.0, 0.05]\nduration_s = 0.8\n";
    format!("{task}[[fault]]\nat_tick = 300\n{fault}\n")
}

#[test]
fn a_message_that_a_fault_kept_from_leaving_is_computed_too() {
    let desk = Desk::new();
    for (process, fault) in [
        // The filter's state goes on from samples whose estimates were not recorded.
        (
            "estimator",
            "process = \"estimator\"\nkind = \"drop\"\nprobability = 0.5",
        ),
        (
            "estimator",
            "process = \"estimator\"\nkind = \"corrupt\"\nas = \"nan\"\nprobability = 0.3",
        ),
        (
            "controller",
            "process = \"controller\"\nkind = \"stale\"\nprobability = 0.5",
        ),
        (
            "controller",
            "process = \"controller\"\nkind = \"corrupt\"\nas = \"flip\"\nfield = \"tau[2]\"",
        ),
        (
            "controller",
            "process = \"controller\"\nkind = \"delay\"\ndelay_ticks = 2\njitter_ticks = 3",
        ),
        (
            "plant",
            "process = \"plant\"\nkind = \"corrupt\"\nas = \"huge\"",
        ),
        ("plant", "process = \"plant\"\nkind = \"duplicate\""),
    ] {
        desk.file("short.toml", &short(fault));
        desk.armplane("run short.toml --out run --json");
        let json = same(&desk, &format!("run --process {process}"));
        assert!(
            json["topics"][0]["messages"].count() > 800,
            "{fault}: {json}"
        );
    }
}

#[test]
fn a_fault_that_nobody_planned_is_known_to_the_replay() {
    let desk = Desk::new();
    let child = desk.start("run --set segment.1.duration_s=12 --json --out run");
    let lie = "fault plant sensor --as bias --joint 2 --run";
    until("the run to take a fault", || {
        run_of(child.id()).is_some_and(|name| desk.armplane(&format!("{lie} {name}")).code == 0)
    });
    let said = finish(child);
    let summary = said.json();
    assert_eq!(
        (
            &summary["faults"][0]["origin"],
            &summary["faults"][0]["occurred"]
        ),
        (&"live".into(), &true.into()),
        "{summary}"
    );
    same(&desk, "run --process plant");
}
