//! Lockstep depends on no clock: processes that are stopped or traced are waited for, and no byte changes.

use std::process::Child;
use std::time::Duration;

use serde_json::Value;

use crate::command::{Desk, Said, assert_nothing_left, finish, pid_of, run_of, skipped, until};
use crate::life::signal;

const PROCESSES: [&str; 5] = ["plant", "estimator", "analyzer", "controller", "recorder"];

const RUN: &str = "run --set segment.1.duration_s=8 --json --out";

/// Ticks that a run has begun.
pub(crate) fn ticks(run: &Child) -> u64 {
    let Some(run) = run_of(run.id())
        .and_then(|name| runtime::RunDir::open(&std::path::Path::new("/dev/shm").join(name)).ok())
    else {
        return 0;
    };
    runtime::ControlPage::open(&run).map_or(0, |page| page.process(0).ticks())
}

/// A run, and what is done to it when it has begun.
fn run_with(desk: &Desk, out: &str, more: &str, act: impl FnOnce(&Child)) -> (Value, Said) {
    let run = desk.start(&format!("{RUN} {out} {more}"));
    until("the first ticks", || ticks(&run) > 500);
    act(&run);
    let said = finish(run);
    assert_nothing_left(said.launcher);
    (said.json(), said)
}

#[test]
fn stopped_and_traced_processes_are_waited_for_and_no_byte_changes() {
    let desk = Desk::new();
    let (calm, _) = run_with(&desk, "calm", "", |_| {});
    let (stopped, said) = run_with(&desk, "stopped", "", |run| {
        for (step, process) in PROCESSES.iter().enumerate() {
            let pid = pid_of(run.id(), process).unwrap();
            signal(pid, "STOP");
            // The last one for longer than any process was ever given.
            std::thread::sleep(Duration::from_millis(if step == 1 { 3_000 } else { 250 }));
            signal(pid, "CONT");
        }
    });
    assert_eq!(
        (&stopped["topics"], &stopped["faults"]),
        (&calm["topics"], &Value::Array(vec![])),
        "{}",
        said.err
    );
    assert!(
        said.err.contains("estimator is stopped (SIGSTOP): waiting"),
        "{}",
        said.err
    );
    let mut is_traced = true;
    let (traced, said) = run_with(&desk, "traced", "", |run| {
        is_traced = trace(pid_of(run.id(), "controller").unwrap())
    });
    assert_eq!(
        (&traced["topics"], &traced["faults"]),
        (&calm["topics"], &Value::Array(vec![])),
        "{}",
        said.err
    );
    if is_traced {
        assert!(
            said.err
                .contains("controller is held by a debugger: waiting"),
            "{}",
            said.err
        );
    } else {
        skipped("this machine lets no process trace another one");
    }
}

/// Holds a process as a debugger does for longer than a silence in real time may last; whether this machine allows it.
fn trace(pid: i32) -> bool {
    let none = std::ptr::null_mut::<libc::c_void>();
    // SAFETY: requests about another process, with no memory of this one.
    unsafe {
        if libc::ptrace(libc::PTRACE_SEIZE, pid, none, none) != 0 {
            return false;
        }
        assert_eq!(libc::ptrace(libc::PTRACE_INTERRUPT, pid, none, none), 0);
        // No other thread of this program waits for this process: it is a grandchild.
        assert_eq!(libc::waitpid(pid, std::ptr::null_mut(), libc::__WALL), pid);
        std::thread::sleep(Duration::from_millis(2_500));
        assert_eq!(libc::ptrace(libc::PTRACE_DETACH, pid, none, none), 0);
    }
    true
}

#[test]
fn a_user_may_set_a_limit_after_which_a_stopped_process_is_replaced() {
    let desk = Desk::new();
    let (summary, said) = run_with(&desk, "r", "--silence-limit 0.2", |run| {
        signal(pid_of(run.id(), "analyzer").unwrap(), "STOP")
    });
    assert_eq!(
        (
            said.code,
            &summary["faults"][0]["process"],
            &summary["faults"][0]["kind"]
        ),
        (0, &"analyzer".into(), &"kill".into())
    );
    assert!(
        said.err.contains("analyzer has done nothing for"),
        "{}",
        said.err
    );
    desk.refuses(2, "run --silence-limit=-1", &["--silence-limit"]);
}
