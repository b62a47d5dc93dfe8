//! Faults of a process: it ends itself, stops itself, shares its core, or cannot write.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::process::{Resource, Rlimit, Signal, getpid, getrlimit, kill_process, setrlimit};

use crate::clock::now_ns;
use crate::realtime;

/// A thread that keeps the process's core busy for the length of a fault.
pub(crate) struct CpuLoad {
    pub(crate) place: usize,
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl CpuLoad {
    /// Busy for so long at a time ...
    const BUSY_NS: u64 = 300_000;
    /// ... with so short a rest that the process it starves is not starved for ever under SCHED_FIFO.
    const REST: std::time::Duration = std::time::Duration::from_micros(30);

    /// Starts the load of the fault at `place` of the table.
    pub(crate) fn start(place: usize, core: Option<usize>) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let stop_requested = Arc::clone(&stop);
        let work = move || {
            if let Some(core) = core {
                // A load on any core is a load.
                let _ = realtime::pin(core);
            }
            while !stop_requested.load(Ordering::Relaxed) {
                let until = now_ns() + Self::BUSY_NS;
                while now_ns() < until {
                    std::hint::spin_loop();
                }
                std::thread::sleep(Self::REST);
            }
        };
        Self { place, stop, thread: std::thread::Builder::new().name("cpu-load".into()).spawn(work).ok() }
    }
}

impl Drop for CpuLoad {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Ends this process by SIGKILL.
pub(crate) fn kill_self() {
    // It does not return; if it could fail, the next wait would find the process down at every tick of the fault.
    let _ = kill_process(getpid(), Signal::KILL);
}

/// Stops this process (SIGSTOP) until it is continued.
pub(crate) fn stop_self() {
    let _ = kill_process(getpid(), Signal::STOP);
}

/// Lets every write to a file fail as on a full volume, or lifts that.
pub(crate) fn forbid_writes(is_full: bool) {
    // Without this the signal would end the process; the error is what a full volume gives.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
    let limit = getrlimit(Resource::Fsize);
    let _ = setrlimit(Resource::Fsize, Rlimit { current: if is_full { Some(0) } else { limit.maximum }, ..limit });
}
