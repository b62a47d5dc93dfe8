//! Faults of a process: it kills or stops itself, shares its core, or cannot write.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::fs::{MemfdFlags, ftruncate, memfd_create};
use rustix::mm::{Advice, MapFlags, ProtFlags, madvise, mmap};
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
        Self {
            place,
            stop,
            thread: std::thread::Builder::new()
                .name("cpu-load".into())
                .spawn(work)
                .ok(),
        }
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

/// Ends this process by SIGBUS, as a file does that is cut short while it is mapped.
pub(crate) fn bus_error() {
    const BYTES: usize = 4096;
    let read = || -> rustix::io::Result<()> {
        let file = memfd_create("bus-error", MemfdFlags::CLOEXEC)?;
        ftruncate(&file, BYTES as u64)?;
        // SAFETY: a fresh mapping that no reference of this process concerns; the read beyond the end of its file is meant to end the process.
        unsafe {
            let start = mmap(
                std::ptr::null_mut(),
                BYTES,
                ProtFlags::READ,
                MapFlags::SHARED,
                &file,
                0,
            )?;
            ftruncate(&file, 0)?;
            start.cast::<u8>().read_volatile();
        }
        Ok(())
    };
    // Where no such file can be made, the signal alone.
    let _ = read();
    let _ = kill_process(getpid(), Signal::BUS);
}

/// Gives the pages of this process's program and libraries back to the kernel, which reads them in again as they are needed. Pages that are locked,
/// as those of a process in real time with the right to it, stay.
pub(crate) fn give_up_pages() {
    for line in std::fs::read_to_string("/proc/self/maps")
        .unwrap_or_default()
        .lines()
    {
        let mut fields = line.split_ascii_whitespace();
        let (Some(range), Some(rights), Some(path)) = (fields.next(), fields.next(), fields.nth(3))
        else {
            continue;
        };
        // Of what can be written nothing may be lost, and shared memory is not the program's.
        if !rights.starts_with('r')
            || rights.contains('w')
            || rights.contains('s')
            || !path.starts_with('/')
        {
            continue;
        }
        let address = |text: &str| usize::from_str_radix(text, 16).ok();
        let Some((Some(from), Some(to))) = range
            .split_once('-')
            .map(|(from, to)| (address(from), address(to)))
        else {
            continue;
        };
        // SAFETY: pages of a private mapping of a file that this process cannot write: they are read in again with the same bytes.
        let _ = unsafe {
            madvise(
                std::ptr::with_exposed_provenance_mut(from),
                to - from,
                Advice::LinuxPageOut,
            )
        };
    }
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
    let _ = setrlimit(
        Resource::Fsize,
        Rlimit {
            current: if is_full { Some(0) } else { limit.maximum },
            ..limit
        },
    );
}
