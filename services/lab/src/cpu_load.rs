//! CPU load: competition for every core.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use runtime::realtime;

/// A spinning thread on every core, until dropped.
pub(crate) struct CpuLoad {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl CpuLoad {
    pub(crate) fn start() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let spin = |core: usize| {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || {
                // A thread that cannot be pinned loads some core all the same.
                let _ = realtime::pin(core);
                while !stop.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            })
        };
        let threads = realtime::allowed_cores().into_iter().map(spin).collect();
        Self { stop, threads }
    }
}

impl Drop for CpuLoad {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}
