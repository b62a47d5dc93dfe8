//! `armplane verify`: the bytes do not depend on the circumstances; the first difference is shown.

use std::collections::BTreeSet;

use serde_json::Value;
use shared_types::topics::ALWAYS;

use crate::command::{Desk, Known, Running};

const TASK: &str = "name = \"short\"\nrobot = \"puma560\"\nstart.posture = \"nominal\"\nsettle_s = 0.2\n[[segment]]\nby_m = [0.05, 0.0, 0.05]\nduration_s = 0.8\n";

/// A process dies, and another one's messages are lost half the time.
const FAULTS: &str = "[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_tick = 300\nfor_ticks = 40\n\
                      [[fault]]\nprocess = \"estimator\"\nkind = \"drop\"\nat_tick = 600\nprobability = 0.5\n";

/// One thread has no recorder.
const RECORDER: &str = "[[fault]]\nprocess = \"recorder\"\nkind = \"kill\"\nat_tick = 500\n";

/// Verifies a short task with these faults, or the default scenario; it leaves nothing in the folder.
fn verify(faults: &[&str], args: &str, code: i32) -> Value {
    let desk = Desk::new();
    desk.file("task.toml", [TASK, &faults.concat()].concat());
    let scenario = if faults.is_empty() { "" } else { "task.toml" };
    let said = desk.refuses(code, &format!("verify {scenario} --json {args}"), "");
    assert_eq!(desk.names("."), ["task.toml"]);
    said.json()
}

/// Whether fewer torques than ticks were sent in a run.
fn lacks_torques(run: &Value) -> bool {
    run["topics"]["torque"]["count"].count() < run["ticks"].count()
}

#[test]
fn no_circumstance_changes_a_byte() {
    let json = verify(&[], "--runs 6 --seed 11", 0);
    json.holds(r#"{"identical": true, "difference": null, "runs/#": 6}"#);
    let (runs, reference) = (json["runs"].list(), &json["reference"]);
    let conditions: BTreeSet<_> = runs.iter().map(|run| run["condition"].text()).collect();
    assert_eq!(
        conditions.len(),
        6,
        "each under a condition of its own: {conditions:?}"
    );
    for (run, topic) in runs.iter().flat_map(|run| ALWAYS.map(|topic| (run, topic))) {
        let (found, expected) = (&run["topics"][topic], &reference["topics"][topic]);
        assert_eq!(found["hash"], expected["hash"], "{topic}");
        assert_eq!(found["count"], reference["ticks"], "{topic}");
    }
}

#[test]
fn a_process_that_is_not_in_order_is_caught_with_tick_topic_and_field() {
    let json = verify(&[], "--runs 2 --unordered", 1);
    json.holds(r#"{"identical": false}"#);
    let difference = &json["difference"];
    assert!(
        difference["tick"].count() > 0,
        "the start is the scenario's: {difference}"
    );
    let [topic, field] = ["topic", "field"].map(|key| difference[key].text());
    // A torque of another tick shows first in the plant's own state.
    assert!(["sensor", "plant_state"].contains(&topic), "{difference}");
    assert!(
        field.starts_with("q") || field.starts_with("tau"),
        "{difference}"
    );
    let [expected, found] = ["expected", "found"].map(|key| difference[key].text().parse::<f64>());
    assert_ne!(expected.unwrap(), found.unwrap(), "{difference}");
}

#[test]
fn runs_with_faults_are_compared_with_one_thread() {
    let json = verify(&[FAULTS], "--runs 2", 0);
    json.holds(r#"{"identical": true, "difference": null, "faults": 2, "reference_run": null}"#);
    assert!(lacks_torques(&json["reference"]), "{json}");
}

#[test]
fn runs_with_faults_that_one_thread_cannot_have_are_compared_with_each_other_and_that_is_said() {
    let json = verify(&[FAULTS, RECORDER], "--runs 3", 0);
    json.holds(
        r#"{"identical": true, "difference": null, "faults": 3, "reference_run": 1, "runs/#": 3}"#,
    );
    assert_eq!(json["reference"], json["runs"][0]);
    assert!(lacks_torques(&json["runs"][2]), "{json}");
    let desk = Desk::new();
    desk.file("task.toml", [TASK, FAULTS, RECORDER].concat());
    desk.refuses(2, "verify task.toml --runs 1", "--runs 2");
    // The first difference is found, too.
    let json = verify(&[FAULTS, RECORDER], "--runs 3 --unordered", 1);
    json.holds(r#"{"identical": false, "reference_run": 1}"#);
    let difference = &json["difference"];
    assert!(
        difference["run"].count() > 1 && difference["tick"].is_u64(),
        "{json}"
    );
    assert_ne!(difference["expected"], difference["found"], "{difference}");
}

#[test]
fn planned_deaths_have_no_budget_and_that_of_the_plant_costs_nothing() {
    let death = |i: u32| {
        format!(
            "[[fault]]\nprocess = \"analyzer\"\nkind = \"kill\"\nat_tick = {}\nfor_ticks = 10\n",
            120 * (i + 1)
        )
    };
    let many = verify(&[&(0..6).map(death).collect::<String>()], "--runs 2", 0);
    many.holds(r#"{"identical": true, "runs/0/failure": "", "reference_run": null}"#);
    let plant = FAULTS.replace("controller", "plant");
    let healed = verify(&[&plant], "--runs 2", 0);
    healed.holds(r#"{"identical": true, "runs/1/failure": ""}"#);
    let run = &healed["runs"][1];
    assert_eq!(run["topics"]["plant_state"]["count"], run["ticks"], "{run}");
}

#[test]
fn the_features_of_the_processor_change_no_byte() {
    let desk = Desk::new();
    let run = |masked: &str| {
        let mut command = desk.command("run ur5-wrist --no-record --json --out run");
        command.env("GLIBC_TUNABLES", format!("glibc.cpu.hwcaps={masked}"));
        let ran = command.spawn().expect("armplane starts").finish();
        ran.json()["topics"].take()
    };
    let all = run("");
    for masked in ["-AVX512F,-AVX512VL", "-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"] {
        assert_eq!(run(masked), all, "{masked}");
    }
}
