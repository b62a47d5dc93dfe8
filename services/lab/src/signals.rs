//! Disturbances of a run from outside, in the background: signals to its processes, and load on the cores.

use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use runtime::realtime;
use rustix::process::{Pid, PidfdFlags, pidfd_open};

/// A thread that works until it is dropped.
pub(crate) struct Background {
    over: Over,
    thread: Option<JoinHandle<()>>,
}

/// Whether the work in the background is to end.
#[derive(Clone, Default)]
pub(crate) struct Over(Arc<AtomicBool>);

impl Background {
    pub(crate) fn start(work: impl FnOnce(&Over) + Send + 'static) -> Self {
        let over = Over::default();
        let its = over.clone();
        Self {
            over,
            thread: Some(std::thread::spawn(move || work(&its))),
        }
    }

    /// A spinning thread on every core.
    pub(crate) fn load() -> Vec<Self> {
        let spin = |core: usize| {
            Self::start(move |over| {
                // A thread that cannot be pinned loads some core all the same.
                let _ = realtime::pin(core);
                while !over.is_over() {
                    std::hint::spin_loop();
                }
            })
        };
        realtime::allowed_cores().into_iter().map(spin).collect()
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        self.over.0.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Over {
    pub(crate) fn is_over(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Waits until something is so; whether the work goes on.
    pub(crate) fn wait(&self, until: impl Fn() -> bool) -> bool {
        while !until() && !self.is_over() {
            std::thread::sleep(Duration::from_micros(50));
        }
        !self.is_over()
    }

    /// Waits for a time; whether the work goes on.
    pub(crate) fn rest(&self, time: Duration) -> bool {
        let until = Instant::now() + time;
        self.wait(|| Instant::now() >= until)
    }
}

/// A process's parent; none where there is no such process.
pub(crate) fn parent(pid: u32) -> Option<u32> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The second field is the command in parentheses and may contain anything: count from its end.
    stat.rsplit_once(") ")?.1.split(' ').nth(1)?.parse().ok()
}

/// A handle on a child of this process; `None` where there is none of that process id.
pub(crate) fn child(pid: u32) -> Option<OwnedFd> {
    let process = pidfd_open(Pid::from_raw(pid.cast_signed())?, PidfdFlags::empty()).ok()?;
    // Behind the handle is a child of ours, or its process id belongs to another process by now.
    (parent(pid) == Some(std::process::id())).then_some(process)
}
