//! Processes of a run stopped from outside (SIGSTOP), one after the other, for times at which a watchdog would call them dead.

use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use runtime::{ControlPage, State, random};
use rustix::process::{Pid, PidfdFlags, Signal, getpid, pidfd_open, pidfd_send_signal};

/// The shortest stop and the longest one; ms.
const STOP_MS: (u64, u64) = (50, 500);
/// The longest time between two stops; ms.
const BETWEEN_MS: u64 = 60;
/// The fewest ticks between two stops. On a busy machine the time between two stops alone is not enough for a single tick, and the run would last for
/// minutes.
const BETWEEN_TICKS: u64 = 100;
/// How soon a stop ends with the run.
const LOOK: Duration = Duration::from_millis(5);

/// Stops processes until it is dropped.
pub(crate) struct Stops {
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Stops {
    /// Begins to stop the first `count` processes of a control page, in a seeded order.
    pub(crate) fn start(control_page: ControlPage, count: usize, seed: u64) -> Self {
        let is_over = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&is_over);
        let work = move || {
            let rest = |ms: u64| {
                let until = Instant::now() + Duration::from_millis(ms);
                while Instant::now() < until && !over.load(Ordering::Relaxed) {
                    std::thread::sleep(LOOK);
                }
            };
            let ticks = || {
                (0..count)
                    .map(|index| control_page.process(index).ticks())
                    .max()
                    .unwrap_or(0)
            };
            let mut next = 0;
            for step in 0.. {
                let draw = |what: u64, most: u64| random(seed, 4 * step + what) % most;
                rest(draw(0, BETWEEN_MS));
                while ticks() < next && !over.load(Ordering::Relaxed) {
                    std::thread::sleep(LOOK);
                }
                if over.load(Ordering::Relaxed) {
                    break;
                }
                next = ticks() + BETWEEN_TICKS;
                let entry = control_page.process(draw(1, count as u64) as usize);
                if entry.state() == State::Running {
                    stop(entry.pid(), || {
                        rest(STOP_MS.0 + draw(2, STOP_MS.1 - STOP_MS.0))
                    });
                }
            }
        };
        Self {
            is_over,
            thread: Some(std::thread::spawn(work)),
        }
    }
}

/// Stops a child of this process for as long as `wait` takes.
fn stop(pid: u32, wait: impl FnOnce()) {
    let Some(process) = child(pid) else { return };
    if pidfd_send_signal(&process, Signal::STOP).is_ok() {
        wait();
        let _ = pidfd_send_signal(&process, Signal::CONT);
    }
}

/// A handle on a child of this process; `None` where there is none of that process id.
pub(super) fn child(pid: u32) -> Option<OwnedFd> {
    let process = pidfd_open(Pid::from_raw(pid.cast_signed())?, PidfdFlags::empty()).ok()?;
    // Behind the handle is a child of ours, or its process id belongs to another process by now.
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let parent = stat
        .rsplit_once(") ")
        .and_then(|(_, rest)| rest.split(' ').nth(1)?.parse().ok());
    (parent == Some(getpid().as_raw_nonzero().get())).then_some(process)
}

impl Drop for Stops {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
