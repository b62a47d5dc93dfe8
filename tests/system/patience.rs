//! Lockstep depends on no clock: processes that are stopped or traced are waited for, and no byte changes.

use std::process::Child;
use std::time::Duration;

use crate::command::{Desk, Known, Running, Said, skipped, until};

const PROCESSES: [&str; 5] = ["plant", "estimator", "analyzer", "controller", "recorder"];

/// A run, and what is done to it when it has begun.
fn run_with(desk: &Desk, more: &str, act: impl FnOnce(&Child)) -> Said {
    let run = desk.start(&format!(
        "run --set segment.1.duration_s=8 --json --out r {more}"
    ));
    until("the first ticks", || run.ticks() > 500);
    act(&run);
    run.finish()
}

#[test]
fn stopped_and_traced_processes_are_waited_for_and_no_byte_changes() {
    let desk = Desk::new();
    let calm = run_with(&desk, "", |_| {}).json();
    let stopped = run_with(&desk, "", |run| {
        for (step, process) in PROCESSES.iter().enumerate() {
            run.strike(process, "STOP");
            // The last one for longer than any process was ever given.
            std::thread::sleep(Duration::from_millis(if step == 1 { 3_000 } else { 250 }));
            run.strike(process, "CONT");
        }
    });
    let mut is_traced = true;
    let traced = run_with(&desk, "", |run| {
        is_traced = trace(run.pid("controller").unwrap())
    });
    for (said, is_held, names) in [
        (stopped, true, ["estimator", "SIGSTOP"]),
        (traced, is_traced, ["controller"; 2]),
    ] {
        let summary = said.json();
        summary.holds(r#"{"faults": []}"#);
        assert_eq!(summary["topics"], calm["topics"], "{}", said.err);
        let is_said = names.iter().all(|name| said.err.contains(name));
        assert!(!is_held || is_said, "{}", said.err);
    }
    if !is_traced {
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
