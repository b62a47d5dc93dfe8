//! Same scenario and seed, same bytes on every topic.

use serde_json::Value;

use crate::command::{Desk, finish};

fn hashes(summary: &Value) -> Value {
    summary["topics"].clone()
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let desk = Desk::new();
    let first = desk.run("--seed 5 --no-record");
    let second = desk.run("--seed 5 --out recorded");
    assert_eq!(hashes(&first), hashes(&second), "recording or not");
    let third = desk.run("--seed 6 --no-record");
    assert_ne!(
        first["topics"]["sensor"]["hash"],
        third["topics"]["sensor"]["hash"]
    );
}

#[test]
fn the_features_of_the_processor_change_no_byte() {
    let desk = Desk::new();
    let run = |masked: &str| {
        let mut command = desk.command("run ur5-wrist --no-record --json --out run");
        command.env("GLIBC_TUNABLES", format!("glibc.cpu.hwcaps={masked}"));
        let ran = finish(command.spawn().expect("armplane starts"));
        hashes(&ran.json())
    };
    let all = run("");
    for masked in ["-AVX512F,-AVX512VL", "-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"] {
        assert_eq!(run(masked), all, "{masked}");
    }
}
