//! Completions, manual pages, and errors for machines.

use serde_json::Value;

use crate::command::{Desk, Known};

#[test]
fn every_command_has_a_manual_page_and_no_process_has() {
    let desk = Desk::new();
    let said = desk.succeeds("generate man pages");
    assert_eq!((said.out.as_str(), said.err.as_str()), ("", ""));
    for name in ["", "-run", "-export", "-generate-man"] {
        let page = desk.read(format!("pages/armplane{name}.1"));
        assert!(page.contains(".TH"), "{name}");
    }
    for process in ["plant", "bench-peer"] {
        assert!(!desk.has(format!("pages/armplane-{process}.1")));
    }
}

#[test]
fn an_error_for_machines_is_one_object() {
    let desk = Desk::new();
    desk.file("bad.toml", "name = \"x\"\nrobot = \"puma560\"\n[start]\nposture = \"ready\"\n[[segment]]\nduration_s = -1.0\n");
    for (args, kind, expected) in [
        ("run nothing", "input", "`nothing`"),
        ("run --seed x", "usage", "'x' for '--seed"),
        ("frobnicate", "usage", "'frobnicate'"),
        ("export nowhere", "input", "runs/"),
        ("fault controller explode", "usage", "explode"),
        ("generate man /proc/nowhere", "input", "/proc/nowhere:"),
        ("run bad.toml", "input", "-1 s"),
    ] {
        let said = desk.refuses(2, &format!("{args} --json"), "");
        let last = said.err.lines().last().unwrap_or_default();
        let error: Value = serde_json::from_str(last).expect(&said.err);
        assert_eq!(
            (said.out.as_str(), error["error"]["kind"].text()),
            ("", kind),
            "{args}"
        );
        error.holds(r#"{"error/exit_code": 2}"#);
        assert!(
            error["error"]["message"].text().contains(expected),
            "{args}: {error}"
        );
        if args == "run bad.toml" {
            error.holds(r#"{"error/place/file": "bad.toml", "error/place/line": 6}"#);
        }
    }
}
