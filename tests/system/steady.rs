//! System calls in the steady state, counted from outside with ptrace: the wake-up and nothing else.

use std::collections::BTreeMap;
use std::path::Path;

use runtime::{ControlPage, Manifest, RunDir};

use crate::command::{Desk, children_of_run, interrupt, run_of, skipped, until};

/// Ticks over which calls are counted.
const TICKS: u64 = 300;

const FUTEX: u64 = libc::SYS_futex as u64;
const SCHED_YIELD: u64 = libc::SYS_sched_yield as u64;
const CLOCK_NANOSLEEP: u64 = libc::SYS_clock_nanosleep as u64;
const GETRUSAGE: u64 = libc::SYS_getrusage as u64;

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
fn calls(pid: libc::pid_t, ticks: impl Fn() -> u64) -> Option<BTreeMap<u64, u64>> {
    let traced = Traced::seize(pid)?;
    let mut calls = BTreeMap::new();
    let begin = ticks();
    while ticks() < begin + TICKS {
        *calls.entry(traced.next_call()).or_default() += 1;
    }
    Some(calls)
}

fn in_the_steady_state(mode: &str, judge: impl Fn(&str, &BTreeMap<u64, u64>)) {
    let desk = Desk::new();
    let child = desk.begin(&format!(
        "run --mode {mode} --set segment.1.duration_s=500 --no-record --json"
    ));
    let name = run_of(child.id()).unwrap();
    let run = RunDir::open(&Path::new("/dev/shm").join(name)).unwrap();
    let (manifest, control_page) = (
        Manifest::read(&run).unwrap(),
        ControlPage::open(&run).unwrap(),
    );
    let ticks = |process: &str| {
        control_page
            .process(manifest.index_of(process).unwrap())
            .ticks()
    };
    until("the steady state", || ticks("controller") > 500);
    let children = children_of_run(child.id());
    for process in ["plant", "estimator", "analyzer", "controller"] {
        let pid = children.iter().find(|(name, _)| name == process).unwrap().1;
        match calls(pid, || ticks(process)) {
            Some(calls) => judge(process, &calls),
            None => skipped(format!(
                "this machine does not allow ptrace: the system calls of the {process} are not counted"
            )),
        }
    }
    interrupt(child);
}

/// Waits of a tick, in each of which a process gives its core away once: for each input, and for its turn to begin a tick.
fn waits(process: &str) -> u64 {
    match process {
        "plant" | "controller" => 2,
        _ => 1,
    }
}

/// Calls of the futex that a tick may need: a sleep for each input (two where a writer rang for the other one), a ring for each reader.
fn futex_bound(process: &str) -> u64 {
    let (inputs, readers) = match process {
        "plant" => (1, 1),
        "estimator" => (1, 2),
        "analyzer" => (1, 1),
        _ => (2, 1),
    };
    TICKS * (2 * inputs + readers)
}

#[test]
fn in_lockstep_a_tick_is_turns_on_the_core_or_a_sleep_and_a_ring() {
    in_the_steady_state("lockstep", |process, calls| {
        assert!(
            calls.keys().all(|call| [FUTEX, SCHED_YIELD].contains(call)),
            "{process} makes other system calls: {calls:?}"
        );
        let count = |call: u64| calls.get(&call).copied().unwrap_or_default();
        assert!(
            count(FUTEX) <= futex_bound(process),
            "{process}: {calls:?} in {TICKS} ticks"
        );
        assert!(
            count(SCHED_YIELD) <= TICKS * waits(process),
            "{process}: {calls:?} in {TICKS} ticks"
        );
    });
}

#[test]
fn in_real_time_the_plant_sleeps_to_its_deadline_besides() {
    in_the_steady_state("realtime", |process, calls| {
        let count = |call: u64| calls.get(&call).copied().unwrap_or_default();
        let allowed = [FUTEX, CLOCK_NANOSLEEP, GETRUSAGE];
        assert!(
            calls.keys().all(|call| allowed.contains(call)),
            "{process}: {calls:?}"
        );
        assert!(count(FUTEX) <= futex_bound(process), "{process}: {calls:?}");
        let sleeps = if process == "plant" {
            TICKS + TICKS / 10
        } else {
            0
        };
        assert!(count(CLOCK_NANOSLEEP) <= sleeps, "{process}: {calls:?}");
        // The kernel's counters are read at a missed deadline, and this tracing causes some; and every 64th tick.
        assert!(count(GETRUSAGE) <= TICKS, "{process}: {calls:?}");
    });
}
