//! How a run ends: by Ctrl-C, by the death of a process, by the death of the launcher. Nothing is left of any of them.

use std::path::{Path, PathBuf};
use std::process::Child;

use serde_json::Value;

use crate::command::{
    Desk, Known, Running, assert_nothing_left, children_of_run, in_shared_memory, restarts, run_of,
    signal, source, until,
};
use crate::faults::recorded_ticks;

/// Long enough to be interrupted.
const LONG: &str = "run --set segment.1.duration_s=500 --json --out results";

/// Starts a long run and waits until its record grows.
fn recording(desk: &Desk, more: &str) -> Child {
    let run = desk.start(&format!("{LONG} {more}"));
    until("the record to grow", || bytes(desk) > 2_000_000);
    run
}

/// Bytes of the record.
fn bytes(desk: &Desk) -> u64 {
    std::fs::metadata(desk.at("results/messages.mcap")).map_or(0, |file| file.len())
}

/// Waits until a process is replaced by another one.
fn replaced(run: &Child, process: &str, act: impl FnOnce(i32)) {
    let before = run.pid(process).unwrap();
    act(before);
    until("a replacement", || {
        run.pid(process).is_some_and(|pid| pid != before)
    });
}

#[test]
fn ctrl_c_stops_cleanly_and_keeps_the_recording() {
    let desk = Desk::new();
    let said = recording(&desk, "").interrupt();
    assert_eq!(said.code, 1, "{}", said.err);
    let summary = said.json();
    summary.holds(r#"{"outcome": "interrupted", "completed": false, "recorder/lost": 0}"#);
    assert!(
        summary["recorder"]["bytes"].count() > 2_000_000,
        "{summary}"
    );
    let sentence: Value = serde_json::from_str(&said.err).expect(&said.err);
    let message = sentence["error"]["message"].text();
    assert!(message.contains("SIGINT"), "{message}");
}

/// A process that dies while it makes something leaves its node half-made.
#[test]
fn what_a_process_was_making_when_it_died_is_cleared_away() {
    let desk = Desk::new();
    let run = desk.begin(&format!("{LONG} --mode realtime"));
    let folder = Path::new("/dev/shm").join(run_of(run.id()).unwrap());
    let files = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        entries.map(|entry| entry.path()).collect()
    };
    let names_it = |file: &PathBuf| {
        let text = std::fs::read(file).unwrap_or_default();
        file.extension().is_some_and(|end| end == "details")
            && String::from_utf8_lossy(&text).contains("controller")
    };
    let mut nodes = files(&folder.join("nodes")).into_iter();
    let node = nodes.find(|node| files(node).iter().any(names_it)).unwrap();
    std::fs::write(node.join("unfinished.service_tag"), "").unwrap();
    replaced(&run, "controller", |pid| signal(pid, "KILL"));
    assert!(!node.exists(), "{}", node.display());
    let summary = run.interrupt().json();
    assert_eq!(restarts(&summary, "controller"), 1, "{}", summary["faults"]);
}

/// Its processes could go on, but none could be replaced, and the recorder's account would be lost.
#[test]
fn a_run_whose_shared_memory_is_emptied_ends_at_once_and_says_so() {
    for mode in ["lockstep", "realtime"] {
        let desk = Desk::new();
        let run = recording(&desk, &format!("--mode {mode}"));
        let names = in_shared_memory(run.id());
        for path in names.iter().map(|name| Path::new("/dev/shm").join(name)) {
            let is_folder = path.is_dir();
            let removed = match is_folder {
                true => std::fs::remove_dir_all(&path),
                false => std::fs::remove_file(&path),
            };
            assert!(removed.is_ok() || !path.exists(), "{}", path.display());
        }
        // Of 500 s only the ticks until then.
        let summary = run.finish().json();
        summary.holds(r#"{"outcome": "failed", "completed": false}"#);
        assert!(desk.has("results/messages.mcap") && summary["ticks"].count() < 400_000);
    }
}

/// A run in real time with something done to it, until it is interrupted.
fn in_real_time(act: impl Fn(&Desk, &Child)) -> Value {
    let desk = Desk::new();
    let run = recording(&desk, "--mode realtime");
    act(&desk, &run);
    let summary = run.interrupt().json();
    summary.holds(r#"{"outcome": "interrupted"}"#);
    summary
}

fn pause_ms(ms: u64) {
    std::thread::sleep(std::time::Duration::from_millis(ms));
}

#[test]
fn in_real_time_a_death_costs_one_restart_and_no_message() {
    for process in ["estimator", "controller", "recorder"] {
        let summary = in_real_time(|_, run| {
            run.strike(process, "KILL");
            pause_ms(1_000);
        });
        assert_eq!(restarts(&summary, process), 1, "{process}: {summary}");
        // A process that is away for longer than the writers' buffers, a second, may lose messages; this machine may be that busy.
        let was_long_away = summary["faults"][0]["recovered_ms"].number() > 600.0;
        let is_whole = summary["recorder"]["lost"] == 0;
        assert!(
            is_whole || process == "recorder" && was_long_away,
            "{process}: {summary}"
        );
        let ticks = summary["topics"]["plant_state"]["count"].count();
        assert!(
            was_long_away || ticks + 1 >= summary["ticks"].count(),
            "{process}: {summary}"
        );
    }
}

#[test]
fn in_real_time_a_stopped_process_is_replaced_whatever_befell_it_before_and_who_waits_for_it_is_not()
 {
    let fault = |desk: &Desk, run: &Child, what: &str| {
        let name = run_of(run.id()).unwrap();
        desk.succeeds(&format!("fault analyzer {what} --run {name}"));
    };
    let summary = in_real_time(|desk, run| {
        fault(desk, run, "delay --for 20ms");
        pause_ms(100);
        replaced(run, "analyzer", |pid| signal(pid, "STOP"));
    });
    assert_eq!(restarts(&summary, "analyzer"), 1, "{}", summary["faults"]);
    // It is silent, and the controller waits for it.
    let summary = in_real_time(|desk, run| {
        fault(desk, run, "drop --for 3s");
        pause_ms(3_200);
    });
    assert_eq!(restarts(&summary, "controller"), 0, "{}", summary["faults"]);
}

#[test]
fn in_real_time_the_death_of_the_plant_or_of_a_process_without_a_budget_ends_the_run_and_is_named()
{
    let graph = source("shared-types/graph.toml");
    let graph = graph.replace("restart = \"always\"", "restart = \"never\"");
    for process in ["plant", "controller"] {
        let desk = Desk::new();
        desk.file("graph.toml", &graph);
        let run = recording(&desk, "--graph graph.toml --mode realtime");
        run.strike(process, "KILL");
        let said = run.finish();
        assert_eq!(said.code, 1, "{}", said.err);
        for words in [process, "signal 9"] {
            assert!(said.err.contains(words), "{process}: {}", said.err);
        }
        said.json().holds(r#"{"outcome": "failed"}"#);
    }
}

#[test]
fn no_process_outlives_a_killed_launcher_and_clean_removes_what_it_left() {
    let desk = Desk::new();
    let run = recording(&desk, "");
    run.signal("KILL");
    let launcher = run.finish().launcher;
    until("the processes to go", || {
        children_of_run(launcher).is_empty()
    });
    let left = in_shared_memory(launcher);
    assert!(!left.is_empty(), "a killed launcher cannot clean up");
    let doctor = desk.json("doctor");
    let summary = desk.json("recover results --only-results");
    summary.holds(r#"{"outcome": "interrupted"}"#);
    let ticks = summary["ticks"].count();
    let torques = summary["topics"]["torque"]["count"].count();
    assert!(ticks > 100 && torques.abs_diff(ticks) <= 512, "{summary}");
    let recorded = recorded_ticks(&desk, "results").len() as u64;
    assert_eq!(recorded, ticks, "every tick once in the recording");
    desk.succeeds("report results");
    desk.succeeds("replay results");
    desk.refuses(2, "recover results --only-results", "summary.json");
    let ours = format!("-{launcher}-");
    let mut runs = doctor["runs"].list().iter();
    let found = runs.any(|run| run["run"].text().contains(&ours) && run["alive"] == false);
    assert!(found, "{doctor}");
    desk.succeeds("clean");
    assert_nothing_left(launcher);
}

#[test]
fn a_launcher_that_stood_still_goes_on_and_its_run_did_not_notice() {
    let desk = Desk::new();
    let run = recording(&desk, "--set segment.1.duration_s=20");
    run.signal("STOP");
    let before = bytes(&desk);
    until("the run to go on without it", || bytes(&desk) > before);
    run.signal("CONT");
    let said = run.finish();
    assert_eq!(said.code, 0, "{}", said.err);
    said.json()
        .holds(r#"{"outcome": "goal reached", "faults": []}"#);
}

#[test]
fn every_signal_that_would_end_the_launcher_ends_the_run_and_leaves_nothing() {
    for name in [
        "QUIT", "HUP", "USR1", "USR2", "ALRM", "VTALRM", "PROF", "XCPU", "IO",
    ] {
        let desk = Desk::new();
        let run = desk.begin(LONG);
        // It changes nothing: a write into a broken pipe fails.
        run.signal("PIPE");
        run.signal(name);
        let said = run.finish();
        let summary = said.json();
        assert_eq!(said.code, 1, "{summary}");
        summary.holds(r#"{"outcome": "interrupted"}"#);
        let reason = summary["reason"].text();
        assert!(reason.contains(&format!("SIG{name} ")), "{reason}");
    }
}

#[test]
fn a_terminal_that_goes_away_costs_the_run_nothing() {
    let desk = Desk::new();
    let mut run = desk.begin("run --set segment.1.duration_s=10 --no-record --out results");
    drop((run.stdout.take(), run.stderr.take()));
    // The launcher reports the death on standard error.
    run.strike("controller", "KILL");
    assert_eq!(run.finish().code, 0);
    desk.read_json("results/summary.json")
        .holds(r#"{"completed": true, "faults/#": 1}"#);
}

#[test]
fn a_run_that_is_killed_at_any_moment_of_its_start_is_recovered_or_its_folder_is_as_it_was() {
    let desk = Desk::new();
    for attempt in 0..18 {
        let out = format!("r{attempt}");
        let run = desk.start(&LONG.replace("results", &out));
        // Every third one before its first process; the others at any moment after that.
        let is_early = attempt % 3 == 0;
        let sign = if is_early {
            "summary.json.reserved"
        } else {
            "job.json"
        };
        while !desk.has(format!("{out}/{sign}")) {
            std::hint::spin_loop();
        }
        if !is_early {
            pause_ms(runtime::random(attempt, 0) % 100);
        }
        run.signal("KILL");
        let launcher = run.finish().launcher;
        until("the processes to go", || {
            children_of_run(launcher).is_empty()
        });
        desk.succeeds("clean");
        let before = desk.names(&out);
        let again = desk.armplane(&format!("recover {out} --only-results --json"));
        if again.code == 0 {
            let summary = again.json();
            summary.holds(r#"{"outcome": "interrupted"}"#);
            desk.succeeds(&format!("report {out}"));
        } else {
            assert_eq!(
                (is_early, again.code, again.err.lines().count()),
                (true, 2, 1),
                "{}",
                again.err
            );
            assert!(again.err.contains("job.json"), "{}", again.err);
            assert_eq!(desk.names(&out), before);
        }
    }
    // As a launcher leaves it that is killed before its first process, which the attempts above need not have met.
    desk.file("early/summary.json.reserved", "");
    desk.refuses(2, "recover early --only-results", "job.json --out early");
    assert!(desk.has("early/summary.json.reserved"));
}
