//! `armplane replay`: a run computed again from what it kept, process by process.

use serde_json::Value;

use crate::command::{Desk, Known, restarts};

const PROCESSES: [&str; 4] = ["plant", "estimator", "analyzer", "controller"];

/// A replay of a process that gives the same bytes to the end of the run.
fn same(desk: &Desk, process: &str) -> Value {
    let json = desk.json(&format!("replay run --process {process}"));
    json.holds(r#"{"identical": true, "ended": ""}"#);
    json
}

#[test]
fn every_process_computes_again_what_it_computed_in_the_run() {
    let desk = Desk::new();
    let summary = desk.run("--seed 3 --out run");
    assert!(summary["recorder"]["bytes"].count() > 0, "{summary}");
    let topics = [
        "sensor plant_state",
        "estimate",
        "singularity",
        "control_state torque",
    ];
    for (process, topics) in PROCESSES.iter().zip(topics) {
        let json = same(&desk, process);
        json.holds(r#"{"difference": null, "without_input": 0}"#);
        let replayed = json["topics"].list().iter();
        let names: Vec<_> = replayed
            .clone()
            .map(|topic| topic["topic"].text())
            .collect();
        assert_eq!(names.join(" "), topics);
        for topic in replayed {
            assert_eq!(topic["messages"], summary["ticks"], "{json}");
        }
    }
}

#[test]
fn a_changed_controller_is_told_where_it_first_differs_and_by_how_much() {
    let desk = Desk::new();
    desk.run("--out run");
    // The second segment only: until it begins the torques are the recorded ones.
    let args = "replay run --set segment.1.turn.by_deg=44";
    let json = desk.refuses(1, &format!("{args} --json"), "").json();
    json.holds(r#"{"identical": false, "difference/topic": "control_state"}"#);
    let first = &json["difference"];
    assert!(first["tick"].count() > 1000, "{first}");
    let values =
        |of: &Value| ["expected", "found"].map(|key| of[key].text().parse::<f64>().unwrap());
    let [expected, found] = values(first);
    assert_ne!(expected, found);
    let named = |all: &Value, key: &str, name: &str| -> Value {
        let mut all = all.list().iter();
        all.find(|one| one[key] == name).expect(name).clone()
    };
    let tau = named(
        &named(&json["topics"], "topic", "torque")["fields"],
        "field",
        "tau",
    );
    let [recorded, replayed] = values(&tau["at"]);
    assert!(
        (tau["largest"].number() - (recorded - replayed).abs()).abs() < 1e-12
            && recorded != replayed
            && tau["tick"].count() >= first["tick"].count(),
        "{tau}"
    );
    let said = desk.refuses(1, args, "");
    let tick = format!("tick {}", first["tick"]);
    assert!(said.out.contains(&tick), "{tick}: {}", said.out);
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
    let deaths = [
        scenario,
        &fault("controller", 1000),
        &fault("estimator", 2500),
    ];
    desk.file("deaths.toml", deaths.concat());
    let summary = desk.armplane("run deaths.toml --out run --json").json();
    assert_eq!(
        ["controller", "estimator"].map(|process| restarts(&summary, process)),
        [1, 1]
    );
    for process in PROCESSES {
        same(&desk, process);
    }
}

#[test]
fn a_message_that_a_fault_kept_from_leaving_is_computed_too() {
    let desk = Desk::new();
    let task = "name = \"short\"\nrobot = \"puma560\"\nstart.posture = \"nominal\"\nsettle_s = 0.2\n[[segment]]\nby_m = [0.05, 0.0, 0.05]\nduration_s = 0.8\n";
    for (process, fault) in [
        // The filter's state goes on from samples whose estimates were not recorded.
        ("estimator", "kind = \"drop\"\nprobability = 0.5"),
        (
            "estimator",
            "kind = \"corrupt\"\nas = \"nan\"\nprobability = 0.3",
        ),
        ("controller", "kind = \"stale\"\nprobability = 0.5"),
        (
            "controller",
            "kind = \"corrupt\"\nas = \"flip\"\nfield = \"tau[2]\"",
        ),
        (
            "controller",
            "kind = \"delay\"\ndelay_ticks = 2\njitter_ticks = 3",
        ),
        ("plant", "kind = \"corrupt\"\nas = \"huge\""),
        ("plant", "kind = \"duplicate\""),
    ] {
        let fault = format!("[[fault]]\nprocess = \"{process}\"\nat_tick = 300\n{fault}\n");
        desk.file("short.toml", [task, &fault].concat());
        desk.armplane("run short.toml --out run --json");
        let messages = same(&desk, process)["topics"][0]["messages"].count();
        assert!(messages > 800, "{fault}: {messages}");
    }
}
