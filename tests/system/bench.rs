//! `armplane bench`: every mechanism passes every message, and the result has the agreed shape. No time is asserted.

use serde_json::Value;

use crate::command::{Desk, assert_nothing_left};

#[test]
fn hops_and_cycles_are_measured_beside_their_floors() {
    let said = Desk::new().armplane(&["bench", "hop", "cycle", "model", "--samples", "1000", "--json"]);
    assert_eq!(said.code, 0, "{}", said.err);
    assert_nothing_left(said.launcher);
    let told: Value = serde_json::from_str(&said.out).unwrap();
    assert!(told["machine"]["cores"].as_u64().is_some_and(|cores| cores > 0));
    let rows = told["rows"].as_array().unwrap();
    for bench in ["hop", "cycle"] {
        let mechanisms: Vec<_> = rows.iter().filter(|row| row["bench"] == bench).map(|row| row["mechanism"].as_str().unwrap()).collect();
        for mechanism in ["futex + copy", "topic + doorbell", "pipe"] {
            assert!(mechanisms.contains(&mechanism), "{bench}: {mechanisms:?}");
        }
    }
    for row in rows {
        let number = |key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key}: {row}"));
        assert!(number("samples") >= 1000.0 && number("p50_us") > 0.0, "{row}");
        assert!(
            number("p50_us") <= number("p99_us") && number("p99_us") <= number("p999_us") && number("p999_us") <= number("max_us") * 1.001
        );
        if row["mechanism"] == "futex + copy" {
            assert_eq!((number("ratio_p50"), number("ratio_p99")), (1.0, 1.0), "{row}");
        }
    }
}
