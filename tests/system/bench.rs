//! `armplane bench`: every mechanism passes every message, and the result has the agreed shape. No time is asserted.

use serde_json::Value;
use shared_types::{PlantState, SensorSample};

use crate::command::{Desk, Known, Running, in_shared_memory, until};

/// The files begin as their kind does.
pub(crate) fn assert_kinds(desk: &Desk, files: &[&str]) {
    for file in files {
        let begins = match file.rsplit_once('.') {
            Some((_, "svg")) => &b"<svg"[..],
            Some((_, "png")) => b"\x89PNG",
            Some((_, "rrd" | "rbl")) => b"RRF2",
            _ => b"{",
        };
        assert!(desk.bytes(file).starts_with(begins), "{file}");
    }
}

#[test]
fn hops_and_cycles_are_measured_beside_their_floors() {
    let desk = Desk::new();
    let said = desk.succeeds("bench hop cycle steps --samples 1000 --json --out bench");
    let json = said.json();
    assert!(json["machine"]["cores"].count() > 0);
    let rows = json["rows"].list();
    let has = |bench: &str, mechanisms: &[&str], sizes: &[Value]| {
        for (mechanism, bytes) in mechanisms
            .iter()
            .flat_map(|one| sizes.iter().map(move |size| (one, size)))
        {
            let is_it = |row: &Value| {
                row["bench"] == bench
                    && row["mechanism"] == **mechanism
                    && (bytes.is_null() || row["payload_bytes"] == *bytes)
            };
            assert!(rows.iter().any(is_it), "{bench}: {mechanism}, {bytes}");
        }
    };
    let all = ["futex", "pipe", "iceoryx2 + doorbell", "topic + doorbell"];
    // The real topic beside the same messages bare.
    let messages = size_of::<SensorSample>().midpoint(size_of::<PlantState>());
    has("cycle", &all, &[Value::Null]);
    has("hop", &all, &[messages.into()]);
    let steps = ["controller, seven-joints", "whole tick, seven-joints"];
    has("steps", &steps, &[Value::Null]);
    for row in rows {
        let [samples, p50, p99, p999, max] =
            ["samples", "p50_us", "p99_us", "p999_us", "max_us"].map(|key| row[key].number());
        assert!(samples >= 1000.0 && p50 > 0.0, "{row}");
        assert!([p50, p99, p999, max * 1.001].is_sorted(), "{row}");
        if row["mechanism"] == "futex" {
            row.holds(r#"{"ratio_p50": 1.0, "ratio_p99": 1.0}"#);
        }
    }
    assert_eq!(desk.read_json("bench/bench.json")["rows"], json["rows"]);
}

#[test]
fn only_the_rows_asked_for_are_measured_with_their_floor() {
    let desk = Desk::new();
    let only = |word| format!("bench hop cycle --samples 1000 --only topic --only {word}");
    let json = desk.json(&only("'not pinned'"));
    let rows = json["rows"].list().iter();
    let rows: Vec<_> = rows.map(|row| row["mechanism"].text()).collect();
    assert_eq!(rows, ["futex", "topic + doorbell"]);
    desk.refuses(2, &only("4097"), "4097");
}

#[test]
fn an_interrupted_bench_leaves_nothing() {
    let desk = Desk::new();
    let temporary = desk.at("temporary");
    std::fs::create_dir(&temporary).unwrap();
    for attempt in 0..8 {
        let what = ["hop", "lockstep"][attempt as usize % 2];
        let mut command = desk.command(&format!("bench {what}"));
        let child = command.env("TMPDIR", &temporary).spawn().unwrap();
        until("it to begin", || {
            !desk.names("temporary").is_empty() || !in_shared_memory(child.id()).is_empty()
        });
        let pause_ms = runtime::random(attempt, 0) % 300;
        std::thread::sleep(std::time::Duration::from_millis(pause_ms));
        child.signal(if attempt < 4 { "INT" } else { "TERM" });
        assert_ne!(child.finish().code, 0, "{what}");
        assert!(desk.names("temporary").is_empty(), "{what}");
    }
}
