//! Signals to the processes of a run.

use std::os::fd::OwnedFd;

use rustix::process::{Pid, PidfdFlags, pidfd_open};

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
