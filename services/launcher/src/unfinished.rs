//! Checks from time to time for segments whose makers were killed before they finished, so that
//! processes waiting for them continue.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use runtime::RunDir;

use crate::outcome::LaunchError;

/// Interval between checks of shared memory.
const LOOK: Duration = Duration::from_millis(100);

/// Removes unfinished segments of a run until it is dropped. It has its own thread, because the
/// launcher itself may be waiting.
#[derive(Debug)]
pub(crate) struct Sweeper {
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Sweeper {
    /// Begins with a run.
    pub(crate) fn start(run: &RunDir) -> Result<Self, LaunchError> {
        let run = RunDir::open(run.path())?;
        let is_over = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&is_over);
        let work = move || {
            while !over.load(Ordering::Relaxed) {
                std::thread::park_timeout(LOOK);
                let removed = run.remove_unfinished();
                if removed > 0 {
                    tracing::debug!(
                        "{removed} segments of {} were never finished by a process that has died, and are removed",
                        run.name()
                    );
                }
            }
        };
        let thread = std::thread::Builder::new()
            .name("sweeper".into())
            .spawn(work)
            .map_err(LaunchError::Sweeper)?;
        Ok(Self {
            is_over,
            thread: Some(thread),
        })
    }
}

impl Drop for Sweeper {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}
