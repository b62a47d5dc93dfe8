//! Checks from time to time for segments whose makers were killed before they finished, so that
//! processes waiting for them continue.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
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
    /// The thread, and the sender whose end tells it to end.
    work: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Sweeper {
    /// Begins with a run.
    pub(crate) fn start(run: &RunDir) -> Result<Self, LaunchError> {
        let run = RunDir::open(run.path())?;
        let (over, is_over) = channel();
        let work = move || {
            while is_over.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
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
            work: Some((over, thread)),
        })
    }
}

impl Drop for Sweeper {
    fn drop(&mut self) {
        if let Some((over, thread)) = self.work.take() {
            drop(over);
            let _ = thread.join();
        }
    }
}
