//! System calls in the steady state, counted from outside with ptrace: the wake-up and nothing else.

use std::collections::BTreeMap;
use std::path::Path;

use runtime::{ControlPage, Manifest, RunDir};

use crate::command::{Desk, Running, run_of, skipped, until};

/// Ticks over which calls are counted.
const TICKS: u64 = 300;

/// A process whose system calls are watched; let go when dropped.
struct Traced {
    pid: libc::pid_t,
}

impl Traced {
    /// `None` where this machine does not let us watch our own children.
    fn seize(pid: libc::pid_t) -> Option<Self> {
        // SAFETY: plain system calls on a process of ours; no memory of this process is touched.
        unsafe {
            if libc::ptrace(libc::PTRACE_SEIZE, pid, 0, libc::PTRACE_O_TRACESYSGOOD) != 0 {
                let error = std::io::Error::last_os_error();
                assert_eq!(error.raw_os_error(), Some(libc::EPERM), "{error}");
                return None;
            }
            assert_eq!(libc::ptrace(libc::PTRACE_INTERRUPT, pid, 0, 0), 0);
        }
        let traced = Self { pid };
        traced.wait();
        Some(traced)
    }

    fn wait(&self) -> i32 {
        let mut status = 0;
        // SAFETY: a plain system call that fills an integer.
        let waited = unsafe { libc::waitpid(self.pid, &raw mut status, libc::__WALL) };
        assert!(
            waited == self.pid && libc::WIFSTOPPED(status),
            "the process has ended: {status:x}"
        );
        status
    }

    /// Lets it run to the beginning of its next system call and returns which.
    fn next_call(&self) -> u64 {
        let mut signal = 0;
        loop {
            // SAFETY: the process is stopped and ours to continue.
            assert_eq!(
                unsafe { libc::ptrace(libc::PTRACE_SYSCALL, self.pid, 0, signal) },
                0
            );
            let status = self.wait();
            let stop = libc::WSTOPSIG(status);
            signal = if status >> 16 == 0 && stop != libc::SIGTRAP | 0x80 {
                stop
            } else {
                0
            };
            if stop == libc::SIGTRAP | 0x80 {
                // SAFETY: `ptrace_syscall_info` is plain integers; the kernel fills at most its size.
                let info = unsafe {
                    let mut info: libc::ptrace_syscall_info = std::mem::zeroed();
                    let size = size_of::<libc::ptrace_syscall_info>();
                    assert!(
                        libc::ptrace(libc::PTRACE_GET_SYSCALL_INFO, self.pid, size, &raw mut info)
                            > 0
                    );
                    info
                };
                if info.op == libc::PTRACE_SYSCALL_INFO_ENTRY {
                    // SAFETY: at an entry this is the member that is filled.
                    return unsafe { info.u.entry.nr };
                }
            }
        }
    }
}

impl Drop for Traced {
    fn drop(&mut self) {
        // SAFETY: the process is stopped by us; it fails when it has ended.
        unsafe { libc::ptrace(libc::PTRACE_DETACH, self.pid, 0, 0) };
    }
}

/// System calls of a process by number, over [`TICKS`] of its ticks; `None` where ptrace is not allowed.
fn calls(pid: libc::pid_t, ticks: impl Fn() -> u64) -> Option<BTreeMap<i64, u64>> {
    let traced = Traced::seize(pid)?;
    let mut calls = BTreeMap::new();
    let begin = ticks();
    while ticks() < begin + TICKS {
        *calls.entry(traced.next_call().cast_signed()).or_default() += 1;
    }
    Some(calls)
}

/// Of each process: the calls of the futex that a tick may need, a sleep for each input (two where a writer rang for the other one) and a ring for each
/// reader; and its waits, in each of which it gives its core away once: for each input, and for its turn to begin a tick.
const PROCESSES: [(&str, u64, u64); 4] = [
    ("plant", 3, 2),
    ("estimator", 4, 1),
    ("analyzer", 3, 1),
    ("controller", 5, 2),
];

/// In lockstep a tick is turns on the core, or a sleep and a ring. In real time the plant sleeps to its deadline besides; and the kernel's counters are read
/// at a missed deadline, of which this tracing causes some, and every 64th tick. The interrupt that begins the tracing may meet a sleep, which the kernel then
/// restarts, once.
#[test]
fn a_tick_is_turns_on_the_core_or_a_sleep_and_a_ring() {
    for is_lockstep in [true, false] {
        let desk = Desk::new();
        let mode = if is_lockstep { "lockstep" } else { "realtime" };
        let args = format!("run --mode {mode} --set segment.1.duration_s=500 --no-record --json");
        let child = desk.start(&args);
        until("the steady state", || child.ticks() > 500);
        let name = run_of(child.id()).unwrap();
        let run = RunDir::open(&Path::new("/dev/shm").join(name)).unwrap();
        let manifest = Manifest::read(&run).unwrap();
        let control_page = ControlPage::open(&run).unwrap();
        for (process, rings, waits) in PROCESSES {
            let line = control_page.process(manifest.index_of(process).unwrap());
            let pid = child.pid(process).unwrap();
            let Some(mut calls) = calls(pid, || line.ticks()) else {
                skipped(format!(
                    "this machine does not allow ptrace: the system calls of the {process} are not counted"
                ));
                continue;
            };
            let all = format!("{process} in {TICKS} ticks: {calls:?}");
            let sleeps = if process == "plant" {
                TICKS + TICKS / 10
            } else {
                0
            };
            for (call, most) in [
                (libc::SYS_futex, TICKS * rings),
                (
                    libc::SYS_sched_yield,
                    if is_lockstep { TICKS * waits } else { 0 },
                ),
                (
                    libc::SYS_clock_nanosleep,
                    if is_lockstep { 0 } else { sleeps },
                ),
                (libc::SYS_getrusage, if is_lockstep { 0 } else { TICKS }),
                (libc::SYS_restart_syscall, 1),
            ] {
                let count = calls.remove(&call).unwrap_or_default();
                assert!(
                    count <= most,
                    "{mode}: {count} of {most} calls {call}: {all}"
                );
            }
            assert!(calls.is_empty(), "{mode}: other system calls: {all}");
        }
        child.interrupt();
    }
}
