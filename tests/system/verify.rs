//! `armplane verify`: the bytes do not depend on the circumstances, and where they do, it says where.

use serde_json::Value;

use crate::command::{Desk, assert_nothing_left};

const TOPICS: [&str; 5] = ["sensor", "plant_state", "estimate", "singularity", "torque"];

fn verify(args: &[&str]) -> (i32, Value) {
    let desk = Desk::new();
    let said = desk.armplane(&[&["verify", "--json"], args].concat());
    assert_nothing_left(said.launcher);
    assert_eq!(std::fs::read_dir(desk.path()).unwrap().count(), 0, "verify left something in the folder");
    (said.code, serde_json::from_str(&said.out).unwrap_or_else(|error| panic!("{error}: {}{}", said.out, said.err)))
}

#[test]
fn no_circumstance_changes_a_byte() {
    let (code, told) = verify(&["--runs", "6", "--seed", "11"]);
    assert_eq!((code, &told["identical"], &told["difference"]), (0, &true.into(), &Value::Null), "{told}");
    let runs = told["runs"].as_array().unwrap();
    let mut conditions: Vec<_> = runs.iter().map(|run| run["condition"].as_str().unwrap()).collect();
    conditions.sort_unstable();
    conditions.dedup();
    assert_eq!((runs.len(), conditions.len()), (6, 6), "each under a condition of its own: {conditions:?}");
    for run in runs {
        for topic in TOPICS {
            assert_eq!(run["topics"][topic]["hash"], told["reference"]["topics"][topic]["hash"]);
            assert_eq!(run["topics"][topic]["count"], told["reference"]["ticks"]);
        }
    }
}

#[test]
fn a_process_that_is_not_in_order_is_caught_with_tick_topic_and_field() {
    let (code, told) = verify(&["--runs", "2", "--unordered"]);
    assert_eq!((code, &told["identical"]), (1, &false.into()), "{told}");
    let difference = &told["difference"];
    assert!(difference["tick"].as_u64().is_some_and(|tick| tick > 0), "the start is the scenario's: {difference}");
    // A torque of another tick shows in what the plant says of itself first.
    assert!(["sensor", "plant_state"].contains(&difference["topic"].as_str().unwrap()), "{difference}");
    let [field, expected, found] = ["field", "expected", "found"].map(|key| difference[key].as_str().unwrap());
    assert!(field.starts_with("q") || field.starts_with("tau"), "{difference}");
    assert_ne!(expected.parse::<f64>().unwrap(), found.parse::<f64>().unwrap(), "{difference}");
}
