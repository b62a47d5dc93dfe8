//! Faults of a process: it kills or stops itself, or cannot write.

use std::sync::Arc;

use rustix::process::{Resource, Rlimit, Signal, getpid, getrlimit, kill_process, setrlimit};

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
    let _ = setrlimit(
        Resource::Fsize,
        Rlimit {
            current: if is_full { Some(0) } else { limit.maximum },
            ..limit
        },
    );
}
