//! A signal from outside that ends a process during a run.
//!
//! The launcher replaces a process that was killed by a signal. A process that exits by itself
//! before the first tick rejects the run, and ends it.

use std::sync::atomic::Ordering;

use rustix::process::{Resource, Rlimit, setrlimit};

use crate::shell::Shell;

impl Shell {
    /// Ends the process by the signal that it got while the run did not stop; does nothing without one. An exit code of 0 would call the process
    /// complete: a replacement would not come, and of the plant the run would take it for its end.
    pub fn pass_signal_on(&self) {
        let shared = &self.shared;
        let signal = shared.signalled.load(Ordering::Relaxed) as i32;
        if signal == 0 || shared.is_run_stopping() {
            return;
        }
        // Without an image of the process's memory. Where the signal does not end it, its exit code does.
        let nothing = Rlimit {
            current: Some(0),
            maximum: Some(0),
        };
        let _ = setrlimit(Resource::Core, nothing);
        let _ = signal_hook::low_level::emulate_default_handler(signal);
    }
}
