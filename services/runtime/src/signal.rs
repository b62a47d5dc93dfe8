//! A signal from outside that ends a process, or the program behind it, during a run.
//!
//! The launcher replaces a process that was killed by a signal. A process that exits by itself
//! before the first tick rejects the run, and ends it.

use std::fmt::Display;
use std::sync::atomic::Ordering;

use rustix::process::{Resource, Rlimit, setrlimit};

use crate::shell::Shell;

impl Shell {
    /// Ends the process by the signal that it got while the run did not stop; does nothing without one. An exit code of 0 would call the process
    /// complete: a replacement would not come, and of the plant the run would take it for its end.
    pub fn pass_signal_on(&self) {
        let shared = self.shared();
        let signal = shared.stop.signalled.load(Ordering::Relaxed) as i32;
        if signal != 0 && !self.is_run_stopping() {
            end_by(signal);
        }
    }

    /// Ends the process by the signal that has ended the program for which it takes part, with a last line that says so. Does nothing where the run
    /// stops.
    pub fn end_by(&self, signal: i32, line: &impl Display) {
        if !self.is_run_stopping() {
            crate::complain(&format_args!("armplane: {line}"));
            end_by(signal);
        }
    }

    fn is_run_stopping(&self) -> bool {
        let shared = self.shared();
        shared.control_page.stop() >= shared.stop.at
    }
}

/// Without an image of the process's memory. Where the signal does not end it, its exit code does.
fn end_by(signal: i32) {
    let _ = setrlimit(
        Resource::Core,
        Rlimit {
            current: Some(0),
            maximum: Some(0),
        },
    );
    let _ = signal_hook::low_level::emulate_default_handler(signal);
}
