//! The plant's account of its ticks in real time: torque in time, late or none; and no summary has a signal and no fault.

use serde_json::Value;

use crate::command::{Desk, Known, Running, children_of_run, signal, until};

const REAL_TIME: &str = "run --mode realtime --no-record --json --out r";

/// Every tick is in one of the three counts, and every missed deadline has its cause.
fn sums(summary: &Value) -> [u64; 3] {
    let deadlines = &summary["deadlines"];
    let count = |name: &str| deadlines[name].count();
    let [in_time, late, none] = ["in_time", "late", "none"].map(count);
    let causes = deadlines["by_cause"].as_object().expect("causes");
    let caused: u64 = causes.values().map(Value::count).sum();
    assert_eq!(
        [in_time + late + none, late + none, count("total")],
        [summary["ticks"].count(), caused, in_time + count("missed")],
        "{deadlines}"
    );
    let sent = summary["topics"]["torque"]["count"].as_u64().unwrap_or(0);
    let lost = summary["recorder"]["lost"].count();
    assert!(sent + lost >= in_time + late, "{summary}");
    [in_time, late, none]
}

/// Kills a process of a run in real time when it has done 300 ticks, ends the run by a signal where it is `cut`, and reads the summary.
fn killed(process: &str, cut: bool) -> Value {
    let desk = Desk::new();
    let run = desk.start(REAL_TIME);
    until("the first ticks", || run.ticks() > 300);
    run.strike(process, "KILL");
    if cut {
        until("later ticks", || run.ticks() > 1_000);
        run.signal("INT");
    }
    run.finish().json()
}

#[test]
fn ticks_without_torque_are_counted_by_the_plant_and_sum_to_its_ticks() {
    for (process, cut) in [("controller", false), ("estimator", true)] {
        let summary = killed(process, cut);
        let [in_time, _, none] = sums(&summary);
        assert!(in_time > 0 && none > 0, "{}", summary["deadlines"]);
        // The process is down for 10 ms at least.
        assert!(summary["deadlines"]["by_cause"][process].count() >= 10);
        assert_eq!(summary["faults"][0]["process"], process, "{summary}");
    }
    let summary = killed("plant", false);
    sums(&summary);
    summary.holds(r#"{"outcome": "failed", "faults/0/process": "plant"}"#);
}

#[test]
fn processes_that_die_with_the_run_are_faults() {
    let desk = Desk::new();
    let run = desk.begin("run --set segment.1.duration_s=500 --no-record --json --out r");
    let killed: Vec<i32> = children_of_run(run.id()).iter().map(|one| one.1).collect();
    for &pid in &killed {
        // SAFETY: a signal to a process of this run.
        unsafe { libc::kill(pid, libc::SIGKILL) };
    }
    until("all processes to start again", || {
        children_of_run(run.id())
            .iter()
            .any(|(name, pid)| name == "plant" && !killed.contains(pid))
    });
    let summary = run.interrupt().json();
    for process in summary["processes"].list() {
        let mut faults = summary["faults"].list().iter();
        let is_listed = faults.any(|fault| fault["process"] == process["name"]);
        let has_died = process["restarts"] != 0 || process["exit"] != "exit code 0";
        assert!(is_listed || !has_died, "{process}: {summary}");
    }
    summary.holds(r#"{"outcome": "interrupted"}"#);
}

#[test]
fn a_recovered_run_has_an_account_that_sums_or_none() {
    for cleaned in [false, true] {
        let desk = Desk::new();
        let args = REAL_TIME.replace("--no-record", "--set settle_s=60");
        let run = desk.start(&args);
        let messages = desk.at("r/messages.mcap");
        let has_ticks = || std::fs::metadata(&messages).is_ok_and(|file| file.len() > 1 << 20);
        until("messages on disk", has_ticks);
        let victim = run.pid("estimator").expect("an estimator");
        signal(victim, "KILL");
        until("its replacement", || {
            run.pid("estimator").is_some_and(|pid| pid != victim)
        });
        run.signal("KILL");
        let launcher = run.finish().launcher;
        until("the processes to go", || {
            children_of_run(launcher).is_empty()
        });
        if cleaned {
            desk.succeeds("clean");
        }
        let summary = desk.json("recover r --only-results");
        desk.succeeds("clean");
        assert!(summary["ticks"].count() > 0, "{summary}");
        if !summary["deadlines"].is_null() {
            sums(&summary);
        }
        let kills = |process: &str| {
            let faults = summary["faults"].list().iter();
            faults.filter(|fault| fault["process"] == process).count()
        };
        assert_eq!(
            (kills("launcher"), kills("estimator")),
            (1, usize::from(!cleaned)),
            "{summary}"
        );
    }
}
