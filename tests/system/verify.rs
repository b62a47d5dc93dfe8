//! `armplane verify`: the bytes do not depend on the circumstances; the first difference is shown.

use serde_json::Value;
use shared_types::topics::ALWAYS;

use crate::command::{Desk, Known, assert_nothing_left, finish};

/// A short task in which a process dies and another one's messages are lost half the time.
const FAULTS: &str = r#"
name = "short"
robot = "puma560"
start.posture = "nominal"
settle_s = 0.2
[[segment]]
by_m = [0.05, 0.0, 0.05]
duration_s = 0.8
[[fault]]
process = "controller"
kind = "kill"
at_tick = 300
for_ticks = 40
[[fault]]
process = "estimator"
kind = "drop"
at_tick = 600
probability = 0.5
"#;

/// One thread has no recorder.
const RECORDER: &str = "[[fault]]\nprocess = \"recorder\"\nkind = \"kill\"\nat_tick = 500\n";

fn verify(args: &str) -> (i32, Value) {
    let desk = Desk::new();
    desk.file("faults.toml", FAULTS);
    desk.file("recorder.toml", &[FAULTS, RECORDER].concat());
    let said = desk.armplane(&format!("verify --json {args}"));
    assert_nothing_left(said.launcher);
    assert_eq!(
        std::fs::read_dir(desk.path()).unwrap().count(),
        2,
        "verify left something in the folder"
    );
    (said.code, said.json())
}

/// A verification that finds no difference.
fn identical(args: &str) -> Value {
    let (code, json) = verify(args);
    assert_eq!(
        (code, &json["identical"], &json["difference"]),
        (0, &true.into(), &Value::Null),
        "{json}"
    );
    json
}

#[test]
fn no_circumstance_changes_a_byte() {
    let json = identical("--runs 6 --seed 11");
    let runs = json["runs"].list();
    let mut conditions: Vec<_> = runs.iter().map(|run| run["condition"].text()).collect();
    conditions.sort_unstable();
    conditions.dedup();
    assert_eq!(
        (runs.len(), conditions.len()),
        (6, 6),
        "each under a condition of its own: {conditions:?}"
    );
    for run in runs {
        for topic in ALWAYS {
            assert_eq!(
                run["topics"][topic]["hash"],
                json["reference"]["topics"][topic]["hash"]
            );
            assert_eq!(run["topics"][topic]["count"], json["reference"]["ticks"]);
        }
    }
}

#[test]
fn a_process_that_is_not_in_order_is_caught_with_tick_topic_and_field() {
    let (code, json) = verify("--runs 2 --unordered");
    assert_eq!((code, &json["identical"]), (1, &false.into()), "{json}");
    let difference = &json["difference"];
    assert!(
        difference["tick"].as_u64().is_some_and(|tick| tick > 0),
        "the start is the scenario's: {difference}"
    );
    // A torque of another tick shows first in the plant's own state.
    assert!(
        ["sensor", "plant_state"].contains(&difference["topic"].text()),
        "{difference}"
    );
    let [field, expected, found] = ["field", "expected", "found"].map(|key| difference[key].text());
    assert!(
        field.starts_with("q") || field.starts_with("tau"),
        "{difference}"
    );
    assert_ne!(
        expected.parse::<f64>().unwrap(),
        found.parse::<f64>().unwrap(),
        "{difference}"
    );
}

#[test]
fn runs_with_faults_are_compared_with_one_thread() {
    let json = identical("faults.toml --runs 2");
    assert_eq!(
        (&json["faults"], &json["reference_run"]),
        (&2.into(), &Value::Null),
        "{json}"
    );
    assert!(
        json["reference"]["topics"]["torque"]["count"].count() < json["reference"]["ticks"].count(),
        "{json}"
    );
}

#[test]
fn runs_with_faults_that_one_thread_cannot_have_are_compared_with_each_other_and_that_is_said() {
    let json = identical("recorder.toml --runs 3");
    assert_eq!(
        (&json["faults"], &json["reference_run"]),
        (&3.into(), &1.into()),
        "{json}"
    );
    assert_eq!(json["runs"].list().len(), 3);
    assert_eq!(json["reference"], json["runs"][0]);
    assert!(
        json["runs"][2]["topics"]["torque"]["count"].count() < json["reference"]["ticks"].count(),
        "{json}"
    );
    let desk = Desk::new();
    desk.file("recorder.toml", &[FAULTS, RECORDER].concat());
    let said = desk.armplane("verify recorder.toml --runs 2");
    assert!(
        said.code == 0 && said.out.contains("run 1 is the reference of the others"),
        "{}{}",
        said.out,
        said.err
    );
    desk.refuses(2, "verify recorder.toml --runs 1", &["at least --runs 2"]);
}

#[test]
fn the_first_difference_between_runs_with_faults_is_found_too() {
    let (code, json) = verify("recorder.toml --runs 3 --unordered");
    assert_eq!(
        (code, &json["identical"], &json["reference_run"]),
        (1, &false.into(), &1.into()),
        "{json}"
    );
    let difference = &json["difference"];
    assert!(
        difference["run"].as_u64().is_some_and(|run| run > 1)
            && difference["tick"].as_u64().is_some(),
        "{json}"
    );
    assert_ne!(difference["expected"], difference["found"], "{difference}");
}

#[test]
fn a_budget_that_deaths_spend_is_the_end_on_one_thread_too() {
    let desk = Desk::new();
    let deaths: String = (0..6)
        .map(|i| {
            format!(
                "[[fault]]\nprocess = \"analyzer\"\nkind = \"kill\"\nat_tick = {}\n",
                120 * (i + 1)
            )
        })
        .collect();
    let task = FAULTS.split("[[fault]]").next().unwrap();
    desk.file("spent.toml", &[task, &deaths].concat());
    let said = desk.armplane("verify spent.toml --runs 1 --json");
    let json = said.json();
    assert!(
        json["runs"][0]["failure"].text().contains("analyzer"),
        "{json}"
    );
    assert_eq!(
        json["runs"][0]["topics"]["torque"], json["reference"]["topics"]["torque"],
        "{json}"
    );
}

#[test]
fn an_end_that_a_fault_plans_is_the_end_of_every_run() {
    let desk = Desk::new();
    desk.file(
        "end.toml",
        &FAULTS.replace("process = \"controller\"", "process = \"plant\""),
    );
    let json = desk.json("verify end.toml --runs 2");
    assert_eq!(json["identical"], true, "{json}");
    assert!(
        json["runs"][1]["failure"].text().contains("plant"),
        "{json}"
    );
    assert_eq!(json["runs"][1]["topics"]["sensor"]["count"], 300, "{json}");
}

#[test]
fn the_features_of_the_processor_change_no_byte() {
    let desk = Desk::new();
    let run = |masked: &str| {
        let mut command = desk.command("run ur5-wrist --no-record --json --out run");
        command.env("GLIBC_TUNABLES", format!("glibc.cpu.hwcaps={masked}"));
        let ran = finish(command.spawn().expect("armplane starts"));
        ran.json()["topics"].clone()
    };
    let all = run("");
    for masked in ["-AVX512F,-AVX512VL", "-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"] {
        assert_eq!(run(masked), all, "{masked}");
    }
}
