//! `armplane bench`: every mechanism passes every message, and the result has the agreed shape. No time is asserted.

use serde_json::Value;
use shared_types::{PlantState, SensorSample};

use crate::command::{
    Args, Desk, Known, assert_nothing_left, finish, in_shared_memory, interrupt, until,
};
use crate::life::signal;

#[test]
fn hops_and_cycles_are_measured_beside_their_floors() {
    let desk = Desk::new();
    let said = desk.succeeds("bench hop cycle steps --samples 1000 --json --out bench");
    assert_nothing_left(said.launcher);
    let json = said.json();
    assert!(
        json["machine"]["cores"]
            .as_u64()
            .is_some_and(|cores| cores > 0)
    );
    let rows = json["rows"].list();
    let has = |bench: &str, mechanism: &str, bytes: Option<u64>| {
        let is_it = |row: &&Value| row["bench"] == bench && row["mechanism"] == mechanism;
        assert!(
            rows.iter()
                .filter(is_it)
                .any(|row| bytes.is_none_or(|bytes| row["payload_bytes"] == bytes)),
            "{bench}: {mechanism}"
        );
    };
    ["futex", "topic + doorbell", "pipe"]
        .iter()
        .for_each(|mechanism| has("cycle", mechanism, None));
    // The real topic beside the same messages bare.
    let messages = size_of::<SensorSample>().midpoint(size_of::<PlantState>()) as u64;
    ["futex", "pipe", "topic + doorbell", "iceoryx2 + doorbell"]
        .iter()
        .for_each(|mechanism| has("hop", mechanism, Some(messages)));
    for mechanism in ["futex", "pipe", "topic + doorbell", "iceoryx2 + doorbell"] {
        [64, 1024, 4096]
            .iter()
            .for_each(|bytes| has("hop", mechanism, Some(*bytes)));
    }
    for mechanism in ["futex", "pipe", "iceoryx2 + doorbell"]
        .into_iter()
        .chain((!said.err.contains("left out")).then_some("topic + doorbell"))
    {
        [16_384, 262_144, 4_194_304]
            .iter()
            .for_each(|bytes| has("hop", mechanism, Some(*bytes)));
    }
    ["controller, seven-joints", "whole tick, seven-joints"]
        .iter()
        .for_each(|step| has("steps", step, None));
    for row in rows {
        let number = |key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key}: {row}"));
        assert!(
            number("samples") >= 1000.0 && number("p50_us") > 0.0,
            "{row}"
        );
        assert!(
            number("p50_us") <= number("p99_us")
                && number("p99_us") <= number("p999_us")
                && number("p999_us") <= number("max_us") * 1.001
        );
        if row["mechanism"] == "futex" {
            assert_eq!(
                (number("ratio_p50"), number("ratio_p99")),
                (1.0, 1.0),
                "{row}"
            );
        }
    }
    for (file, begins) in [
        ("bench.json", &b"{"[..]),
        ("bench-hop.svg", b"<svg"),
        ("bench-hop.png", b"\x89PNG"),
        ("bench-steps.svg", b"<svg"),
    ] {
        assert!(
            std::fs::read(desk.path().join("bench").join(file))
                .unwrap()
                .starts_with(begins),
            "{file}"
        );
    }
}

#[test]
fn only_the_rows_asked_for_are_measured_with_their_floor() {
    let desk = Desk::new();
    let only = |bytes: &str| {
        let first = "bench hop cycle --samples 1000 --json --only topic --only".words();
        [
            first,
            ["same core", "--only", bytes].map(str::to_owned).to_vec(),
        ]
        .concat()
    };
    let json = desk.succeeds(&only("4096")).json();
    let rows = json["rows"].list().iter();
    let rows: Vec<_> = rows
        .map(|row| (row["mechanism"].text(), row["payload_bytes"].count()))
        .collect();
    assert_eq!(rows, [("futex", 4096), ("topic + doorbell", 4096)]);
    desk.refuses(2, &only("4097"), &["4097"]);
}

/// A recorder that this machine leaves without a processor for seconds loses messages, and the soak must report it; nothing else may break.
fn is_of_time(broken: &Value) -> bool {
    ["lost", "rows", "files"]
        .iter()
        .any(|check| broken["check"] == *check)
}

#[test]
fn a_short_soak_strikes_and_judges_and_leaves_nothing() {
    let desk = Desk::new();
    let said = desk.armplane("drill --soak 6 --seed 8 --set rate_hz=500 --json --out soak");
    let soak = said.json();
    let passed = soak["passed"] == true;
    assert_eq!(said.code, i32::from(!passed), "{}", said.err);
    assert_nothing_left(said.launcher);
    let round = &soak["cells"][0];
    assert!(round["ticks"].count() > 500, "{round}");
    assert!(round["broken"].list().iter().all(is_of_time), "{round}");
    let faults = round["faults"].list();
    let occurred = faults.iter().filter(|fault| fault["occurred"] == true);
    let number = |key: &str| round["messages"][key].count();
    assert_eq!(
        number("sent"),
        number("taken_in") + number("refused") + number("fenced") + number("lost"),
        "{}",
        round["messages"]
    );
    let kinds = soak["kinds"].list().iter();
    let times: u64 = kinds.map(|kind| kind["times"].count()).sum();
    assert!(times > 0 && times == occurred.count() as u64, "{round}");
    assert_eq!(
        desk.path().join("soak/round-001").exists(),
        !passed,
        "what kept every guarantee is not kept"
    );
    for (file, begins) in [
        ("drill.json", &b"{"[..]),
        ("drill.svg", b"<svg"),
        ("drill.png", b"\x89PNG"),
    ] {
        let text = std::fs::read(desk.path().join("soak").join(file)).unwrap();
        assert!(text.starts_with(begins), "{file}");
    }
}

#[test]
fn an_interrupted_soak_ends_cleanly() {
    let desk = Desk::new();
    let child = desk.begin("drill --soak 60 --json");
    std::thread::sleep(std::time::Duration::from_secs(2));
    let said = interrupt(child);
    assert_eq!(said.code, 1, "{}", said.err);
    let soak = said.json();
    assert_eq!(soak["interrupted"], "SIGINT", "{soak}");
    let cells = soak["cells"].list().iter();
    let mut broken = cells.flat_map(|round| round["broken"].list());
    assert!(broken.all(is_of_time), "{soak}");
}

#[test]
fn an_interrupted_bench_leaves_nothing() {
    let desk = Desk::new();
    let temporary = desk.path().join("temporary");
    std::fs::create_dir(&temporary).unwrap();
    let left = || std::fs::read_dir(&temporary).unwrap().count();
    for attempt in 0..8 {
        let what = ["hop", "lockstep"][attempt as usize % 2];
        let mut command = desk.command(&format!("bench {what}"));
        let child = command.env("TMPDIR", &temporary).spawn().unwrap();
        until("it to begin", || {
            left() > 0 || !in_shared_memory(child.id()).is_empty()
        });
        std::thread::sleep(std::time::Duration::from_millis(
            runtime::random(attempt, 0) % 300,
        ));
        signal(
            child.id().cast_signed(),
            if attempt < 4 { "INT" } else { "TERM" },
        );
        let said = finish(child);
        assert_ne!(said.code, 0, "{what}");
        assert_nothing_left(said.launcher);
        assert_eq!(left(), 0, "{what}");
    }
}
