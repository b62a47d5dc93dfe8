//! The plant's account of its ticks in real time: torque in time, late or none; and no summary has a signal and no fault.

use serde_json::Value;

use crate::command::{Desk, Known, children_of_run, finish, until};
use crate::life::signal;
use crate::patience::ticks;

const REAL_TIME: &str = "run --mode realtime --no-record --json --out r";

/// Every tick is in one of the three counts, and every missed deadline has its cause.
fn sums(summary: &Value) -> [u64; 3] {
    let deadlines = &summary["deadlines"];
    let count = |name: &str| deadlines[name].count();
    let [in_time, late, none] = ["in_time", "late", "none"].map(count);
    let causes = deadlines["by_cause"].as_object().expect("causes");
    let caused: u64 = causes.values().filter_map(Value::as_u64).sum();
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
    let child = desk.start(REAL_TIME);
    until("the first ticks", || ticks(&child) > 300);
    let children = children_of_run(child.id());
    let victim = children.iter().find(|(name, _)| name == process);
    signal(victim.expect("a victim").1, "KILL");
    if cut {
        until("later ticks", || ticks(&child) > 1_000);
        signal(child.id().cast_signed(), "INT");
    }
    finish(child).json()
}

#[test]
fn ticks_without_torque_are_counted_by_the_plant_and_sum_to_its_ticks() {
    for (process, cut) in [("controller", false), ("estimator", true)] {
        let summary = killed(process, cut);
        let [in_time, _, none] = sums(&summary);
        assert!(in_time > 0 && none > 0, "{}", summary["deadlines"]);
        let silent = summary["deadlines"]["by_cause"][process].as_u64();
        // The process is down for 10 ms at least.
        assert!(silent.is_some_and(|ticks| ticks >= 10), "{summary}");
        assert_eq!(summary["faults"][0]["process"], process, "{summary}");
    }
}

#[test]
fn the_death_of_the_plant_leaves_a_whole_account() {
    let summary = killed("plant", false);
    sums(&summary);
    assert_eq!(
        (&summary["outcome"], &summary["faults"][0]["process"]),
        (&"failed".into(), &"plant".into())
    );
}

#[test]
fn processes_that_die_with_the_run_are_faults() {
    let desk = Desk::new();
    let child = desk.start("run --set segment.1.duration_s=500 --no-record --json --out r");
    until("the first ticks", || ticks(&child) > 300);
    for (_, pid) in children_of_run(child.id()) {
        // SAFETY: a signal to a process of this run; the others end by themselves when the plant is gone.
        unsafe { libc::kill(pid, libc::SIGKILL) };
    }
    let summary = finish(child).json();
    for process in summary["processes"].list() {
        let faults = summary["faults"].list();
        let is_listed = faults
            .iter()
            .any(|fault| fault["process"] == process["name"]);
        let has_died = process["restarts"] != 0 || process["exit"] != "exit code 0";
        assert!(is_listed || !has_died, "{process}: {faults:?}");
    }
    assert_eq!(summary["outcome"], "failed");
}

#[test]
fn a_recovered_run_has_an_account_that_sums_or_none() {
    for cleaned in [false, true] {
        let desk = Desk::new();
        let child =
            desk.start(&format!("{REAL_TIME} --set settle_s=60").replace("--no-record ", ""));
        let messages = desk.path().join("r/messages.mcap");
        let has_ticks = || std::fs::metadata(&messages).is_ok_and(|file| file.len() > 1 << 20);
        until("messages on disk", has_ticks);
        let children = children_of_run(child.id());
        let victim = children.iter().find(|(name, _)| name == "estimator");
        signal(victim.expect("an estimator").1, "KILL");
        until("its replacement", || {
            let now = children_of_run(child.id());
            now.iter()
                .any(|one| one.0 == "estimator" && Some(one) != victim)
        });
        signal(child.id().cast_signed(), "KILL");
        let said = finish(child);
        until("the processes to go", || {
            children_of_run(said.launcher).is_empty()
        });
        if cleaned {
            desk.succeeds("clean");
        }
        let summary = desk.json("recover r");
        desk.succeeds("clean");
        assert!(summary["ticks"].count() > 0, "{summary}");
        if !summary["deadlines"].is_null() {
            sums(&summary);
        }
        let faults = summary["faults"].list();
        let kills = |process: &str| {
            faults
                .iter()
                .filter(|fault| fault["process"] == process)
                .count()
        };
        assert_eq!(
            (kills("launcher"), kills("estimator")),
            (1, usize::from(!cleaned)),
            "{summary}"
        );
    }
}
