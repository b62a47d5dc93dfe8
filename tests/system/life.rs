//! How a run ends: by Ctrl-C, by the death of a process, by the death of the launcher. Nothing is left of any of them.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::command::{
    Desk, Known, assert_nothing_left, children_of_run, finish, in_shared_memory, interrupt, pid_of,
    restarts, run_of, until,
};

/// Long enough to be interrupted.
const LONG: &str = "run --set segment.1.duration_s=500 --json --out results";

pub(crate) fn signal(pid: i32, name: &str) {
    let status = Command::new("kill")
        .args([format!("-{name}"), pid.to_string()])
        .status()
        .unwrap();
    assert!(status.success());
}

fn has_recorded_ticks(desk: &Desk) -> bool {
    // The pictures of the arm come first; what grows beyond them are ticks.
    std::fs::metadata(desk.path().join("results/run.rrd")).is_ok_and(|file| file.len() > 2_000_000)
}

#[test]
fn ctrl_c_stops_cleanly_and_keeps_the_recording() {
    let desk = Desk::new();
    let child = desk.start(LONG);
    until("the recording to grow", || has_recorded_ticks(&desk));
    let said = interrupt(child);
    assert_eq!(said.code, 1, "{}", said.err);
    let summary = said.json();
    assert_eq!(
        (&summary["outcome"], &summary["completed"]),
        (&"interrupted".into(), &false.into()),
        "{summary}"
    );
    let sentence: Value =
        serde_json::from_str(&said.err).unwrap_or_else(|error| panic!("{error}: {}", said.err));
    assert!(
        sentence["error"]["message"]
            .text()
            .contains(": the run was stopped by SIGINT after "),
        "{sentence}"
    );
    assert!(
        summary["recorder"]["bytes"].count() > 2_000_000 && summary["recorder"]["lost"] == 0,
        "{}",
        summary["recorder"]
    );
}

/// A process that dies while it makes something leaves its node half-made.
#[test]
fn what_a_process_was_making_when_it_died_is_cleared_away() {
    let desk = Desk::new();
    let child = desk.begin(LONG);
    let run = Path::new("/dev/shm").join(run_of(child.id()).unwrap());
    let files = |folder: &Path| {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        entries.map(|entry| entry.path()).collect::<Vec<_>>()
    };
    let names_it = |file: &PathBuf| {
        let text = std::fs::read(file).unwrap_or_default();
        file.extension().is_some_and(|end| end == "details")
            && String::from_utf8_lossy(&text).contains("controller")
    };
    let mut nodes = files(&run.join("nodes")).into_iter();
    let node = nodes.find(|node| files(node).iter().any(names_it)).unwrap();
    std::fs::write(node.join("unfinished.service_tag"), "").unwrap();
    let killed = pid_of(child.id(), "controller");
    kill(&child, "controller");
    until("a replacement", || {
        ![None, killed].contains(&pid_of(child.id(), "controller"))
    });
    assert!(!node.exists(), "{}", node.display());
    let summary = interrupt(child).json();
    assert_eq!(restarts(&summary, "controller"), 1, "{}", summary["faults"]);
}

fn kill(child: &std::process::Child, process: &str) {
    let victim = pid_of(child.id(), process).unwrap();
    signal(victim, "KILL");
}

/// A run in real time with something done to it, until it is interrupted.
fn in_real_time(act: impl Fn(&Desk, &std::process::Child)) -> Value {
    let desk = Desk::new();
    let child = desk.start(&format!("{LONG} --mode realtime"));
    until("the recording to grow", || has_recorded_ticks(&desk));
    act(&desk, &child);
    let said = interrupt(child);
    let summary = said.json();
    assert_eq!(
        summary["outcome"], "interrupted",
        "{}\n{}",
        summary["reason"], said.err
    );
    summary
}

fn pause_ms(ms: u64) {
    std::thread::sleep(std::time::Duration::from_millis(ms));
}

#[test]
fn in_real_time_a_death_costs_one_restart_and_no_message() {
    for process in ["estimator", "controller", "recorder"] {
        let summary = in_real_time(|_, child| {
            kill(child, process);
            pause_ms(1_000);
        });
        assert_eq!(
            restarts(&summary, process),
            1,
            "{process}: {}",
            summary["faults"]
        );
        // A process that is away for longer than the writers' buffers, a second, may lose messages; this machine may be that busy.
        let away_ms = summary["faults"][0]["recovered_ms"].number();
        assert!(
            summary["recorder"]["lost"] == 0 || process == "recorder" && away_ms > 600.0,
            "{process}: {}",
            summary["recorder"]
        );
        let ticks = summary["topics"]["plant_state"]["count"].count();
        assert!(
            away_ms > 600.0 || ticks + 1 >= summary["ticks"].count(),
            "{process}: {}",
            summary["topics"]
        );
    }
}

#[test]
fn in_real_time_a_stopped_process_is_replaced_whatever_befell_it_before() {
    let summary = in_real_time(|desk, child| {
        desk.succeeds(&[
            "fault",
            "analyzer",
            "delay",
            "--for",
            "20ms",
            "--run",
            &run_of(child.id()).unwrap(),
        ]);
        pause_ms(100);
        let analyzer = || pid_of(child.id(), "analyzer");
        let stopped = analyzer().unwrap();
        signal(stopped, "STOP");
        until("a replacement", || {
            analyzer().is_some_and(|pid| pid != stopped)
        });
    });
    assert_eq!(restarts(&summary, "analyzer"), 1, "{}", summary["faults"]);
}

#[test]
fn in_real_time_who_waits_for_a_silent_one_is_not_killed() {
    let summary = in_real_time(|desk, child| {
        desk.succeeds(&[
            "fault",
            "analyzer",
            "drop",
            "--for",
            "3s",
            "--run",
            &run_of(child.id()).unwrap(),
        ]);
        pause_ms(3_200);
    });
    assert_eq!(restarts(&summary, "controller"), 0, "{}", summary["faults"]);
}

#[test]
fn the_death_of_the_plant_or_of_a_process_without_a_budget_ends_the_run_and_is_named() {
    let graph = include_str!("../../shared-types/graph.toml")
        .replace("restart = \"always\"", "restart = \"never\"");
    for process in ["plant", "controller"] {
        let desk = Desk::new();
        desk.file("graph.toml", &graph);
        let child = desk.start(&format!("{LONG} --graph graph.toml"));
        until("the recording to grow", || has_recorded_ticks(&desk));
        kill(&child, process);
        let said = finish(child);
        assert_eq!(said.code, 1, "{}", said.err);
        assert!(
            said.err.contains(process) && said.err.contains("signal 9"),
            "{process}: {}",
            said.err
        );
        let summary = said.json();
        assert_eq!(summary["outcome"], "failed");
        assert_nothing_left(said.launcher);
    }
}

#[test]
fn no_process_outlives_a_killed_launcher_and_clean_removes_what_it_left() {
    let desk = Desk::new();
    let child = desk.start(LONG);
    until("the recording to grow", || has_recorded_ticks(&desk));
    signal(child.id() as i32, "KILL");
    let said = finish(child);
    until("the processes to go", || {
        children_of_run(said.launcher).is_empty()
    });
    assert!(
        !in_shared_memory(said.launcher).is_empty(),
        "a killed launcher cannot clean up"
    );
    let doctor = desk.armplane("doctor --json").json();
    let recovered = desk.succeeds("recover results --json");
    let summary = recovered.json();
    let ticks = summary["ticks"].count();
    assert!(
        ticks > 100 && summary["topics"]["torque"]["count"].count().abs_diff(ticks) <= 512,
        "{summary}"
    );
    assert_eq!(summary["outcome"], "interrupted");
    let mut rows = 0;
    let count = |piece: viz::Piece| {
        if let viz::Piece::Rows(read) = piece {
            rows += read.ticks.len() as u64;
        }
        Ok::<(), viz::ReadError>(())
    };
    viz::read(&viz::parts_in(&desk.path().join("results")), count).unwrap();
    assert_eq!(rows, ticks, "every tick once in the recording");
    for command in ["report results", "replay results"] {
        desk.succeeds(command);
    }
    desk.refuses(2, "recover results", &["nothing to recover"]);
    let ours = format!("-{}-", said.launcher);
    let found = doctor["runs"]
        .list()
        .iter()
        .any(|run| run["run"].text().contains(&ours) && run["alive"] == false);
    assert!(found, "{doctor}");
    desk.succeeds("clean");
    assert_nothing_left(said.launcher);
}

#[test]
fn a_launcher_that_stood_still_goes_on_and_its_run_did_not_notice() {
    let desk = Desk::new();
    let child = desk.start("run --set segment.1.duration_s=20 --json --out results");
    until("the recording to grow", || has_recorded_ticks(&desk));
    signal(child.id() as i32, "STOP");
    let size =
        || std::fs::metadata(desk.path().join("results/run.rrd")).map_or(0, |file| file.len());
    let before = size();
    until("the run to go on without it", || size() > before);
    signal(child.id() as i32, "CONT");
    let said = finish(child);
    let summary = said.json();
    assert_eq!(
        (said.code, &summary["outcome"], &summary["faults"]),
        (0, &"goal reached".into(), &Value::Array(vec![])),
        "{}",
        said.err
    );
    assert_nothing_left(said.launcher);
}

#[test]
fn every_signal_that_would_end_the_launcher_ends_the_run_and_leaves_nothing() {
    for name in [
        "QUIT", "HUP", "USR1", "USR2", "ALRM", "VTALRM", "PROF", "XCPU", "IO",
    ] {
        let desk = Desk::new();
        let child = desk.begin(LONG);
        // It changes nothing: a write into a broken pipe fails.
        signal(child.id() as i32, "PIPE");
        signal(child.id() as i32, name);
        let said = finish(child);
        let summary = said.json();
        let reason = summary["reason"].as_str().unwrap_or_default();
        assert!(
            said.code == 1
                && summary["outcome"] == "interrupted"
                && reason.starts_with(&format!("stopped by SIG{name} ")),
            "{summary}"
        );
        assert_nothing_left(said.launcher);
    }
}

#[test]
fn a_terminal_that_goes_away_costs_the_run_nothing() {
    let desk = Desk::new();
    let mut child = desk.begin("run --set segment.1.duration_s=10 --no-record --out results");
    drop((child.stdout.take(), child.stderr.take()));
    // The launcher reports the death on standard error.
    kill(&child, "controller");
    let said = finish(child);
    let summary: Value = desk.read_json("results/summary.json");
    assert_eq!(
        (
            said.code,
            &summary["completed"],
            summary["faults"].as_array().map(Vec::len)
        ),
        (0, &true.into(), Some(1)),
        "{summary}"
    );
    assert_nothing_left(said.launcher);
}

#[test]
fn a_run_that_is_killed_at_any_moment_of_its_start_is_recovered_or_its_folder_is_as_it_was() {
    let desk = Desk::new();
    for attempt in 0..18 {
        let out = format!("r{attempt}");
        let child = desk.start(&LONG.replace("results", &out));
        // Every third one before its first process; the others at any moment after that.
        let sign = desk.path().join(&out).join(if attempt % 3 == 0 {
            "summary.json.reserved"
        } else {
            "job.json"
        });
        while !sign.exists() {
            std::hint::spin_loop();
        }
        std::thread::sleep(std::time::Duration::from_millis(if attempt % 3 == 0 {
            0
        } else {
            runtime::random(attempt, 0) % 100
        }));
        signal(child.id() as i32, "KILL");
        let said = finish(child);
        until("the processes to go", || {
            children_of_run(said.launcher).is_empty()
        });
        desk.succeeds("clean");
        let folder = desk.path().join(&out);
        let names = || {
            let entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
            entries
                .map(|entry| entry.file_name())
                .collect::<std::collections::BTreeSet<_>>()
        };
        let before = names();
        let again = desk.armplane(&format!("recover {out} --json"));
        if again.code == 0 {
            let summary = again.json();
            let (ticks, reason) = (summary["ticks"].count(), summary["reason"].text());
            assert_eq!(
                (
                    &summary["outcome"],
                    reason.contains("before the messages of a whole tick")
                ),
                (&"interrupted".into(), ticks == 0)
            );
            let reported = desk.armplane(&format!("report {out}"));
            assert_eq!(reported.code, 0, "{ticks} ticks: {}", reported.err);
        } else {
            assert_eq!(
                (attempt % 3, again.code, again.err.lines().count()),
                (0, 2, 1),
                "{}",
                again.err
            );
            assert!(again.err.contains("makes the run in it"), "{}", again.err);
            assert_eq!(names(), before);
        }
    }
    // As a launcher leaves it that is killed before its first process, which the attempts above need not have met.
    let folder = desk.path().join("early");
    std::fs::create_dir(&folder).unwrap();
    desk.file("early/summary.json.reserved", "");
    desk.refuses(2, "recover early", &["makes the run in it"]);
    assert!(folder.join("summary.json.reserved").exists());
}
