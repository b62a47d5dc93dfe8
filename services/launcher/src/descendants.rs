//! Ends the descendants of a run's programs with the run, even if its launcher is killed.
//!
//! Each process of the run is a child of the launcher and cannot outlive it. A third-party program
//! may start further processes in other groups and sessions. They are found by the run's name in
//! their environment, so a descendant that has replaced its environment is not found.

use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::Child;

use runtime::{PROCESS_VARIABLE, RUN_VARIABLE};
use rustix::process::{Pid, Signal, getpid, kill_process};

use crate::plan::start_beside;

/// A descendant that is being killed may start another one: so often its run is looked through.
const ROUNDS: u32 = 50;

/// Kills all processes that have the run, or one process of it, in their environment.
///
/// Requires that the process, or all processes of the run, have ended: a process that lives has the run in its environment too.
pub fn end_descendants(run: &Path, process: Option<&str>) {
    let entry = |name: &str, value: &[u8]| [name.as_bytes(), b"=", value].concat();
    let run = entry(RUN_VARIABLE, run.as_os_str().as_bytes());
    let process = process.map(|process| entry(PROCESS_VARIABLE, process.as_bytes()));
    for _ in 0..ROUNDS {
        let found: Vec<Pid> = processes()
            .filter(|pid| belongs_to(*pid, &run, process.as_deref()))
            .collect();
        if found.is_empty() {
            break;
        }
        for pid in found {
            // It fails where the process has just ended.
            let _ = kill_process(pid, Signal::KILL);
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
}

fn processes() -> impl Iterator<Item = Pid> {
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    entries
        .filter_map(|entry| Pid::from_raw(entry.file_name().to_str()?.parse().ok()?))
        .filter(|pid| *pid != getpid())
}

/// Whether the environment of a process has both entries. The environment of another user's process, and of one that has ended, cannot be read.
fn belongs_to(pid: Pid, run: &[u8], process: Option<&[u8]>) -> bool {
    let environment =
        std::fs::read(format!("/proc/{}/environ", pid.as_raw_nonzero())).unwrap_or_default();
    let has = |wanted: &[u8]| {
        environment
            .split(|byte| *byte == 0)
            .any(|entry| entry == wanted)
    };
    has(run) && process.is_none_or(has)
}

/// A process beside the launcher that ends the descendants of a run when the launcher has ended, however it has.
#[derive(Debug)]
pub struct Guard {
    /// Its standard input is a pipe whose other end the launcher alone holds: the kernel closes it when the launcher is killed.
    child: Child,
    run: std::path::PathBuf,
}

impl Guard {
    /// Starts the subcommand that calls [`guard`], for a run.
    ///
    /// # Errors
    /// When it cannot be started.
    pub fn start(subcommand: &str, run: &Path) -> std::io::Result<Self> {
        Ok(Self {
            child: start_beside(subcommand, run)?,
            run: run.to_owned(),
        })
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        end_descendants(&self.run, None);
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Waits until the launcher of a run has ended, then ends the run's remaining processes.
pub fn guard(run: &Path) {
    let mut nothing = [0; 64];
    while !matches!(std::io::stdin().read(&mut nothing), Ok(0) | Err(_)) {}
    end_descendants(run, None);
}
