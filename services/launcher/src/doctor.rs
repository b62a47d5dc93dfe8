//! The machine's settings that matter to a run, as data.

use std::path::Path;

use runtime::realtime::{Rights, allowed_cores};
use runtime::{FoundRun, RunDir, SHM};
use rustix::fs::{Access, access, statvfs};

/// The state of the machine as far as a run depends on it.
#[derive(Clone, Debug)]
pub struct Health {
    /// Shared memory; `None` when there is no `/dev/shm`.
    pub shm: Option<Shm>,
    /// Rights that real time needs.
    pub rights: Rights,
    /// Cores that this process may use.
    pub cores: Vec<usize>,
    /// Kernel name and version.
    pub kernel: String,
    /// Whether the kernel is built with `PREEMPT_RT`.
    pub preempt_rt: bool,
    /// The kernel's clock source ("tsc" is the fast one); empty where unknown.
    pub clock_source: String,
    /// The share of each period that real-time tasks may use, "950000 of 1000000 µs" on a stock kernel; `None` is no limit.
    pub realtime_budget: Option<(u64, u64)>,
    /// This user's runs in shared memory, living and dead.
    pub runs: Vec<FoundRun>,
}

/// The memory file system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shm {
    /// Whether this user may create files in it.
    pub writable: bool,
    /// Free; bytes.
    pub free_bytes: u64,
    /// In all; bytes.
    pub total_bytes: u64,
}

/// Looks at the machine; changes nothing.
#[must_use]
pub fn examine() -> Health {
    let uname = rustix::system::uname();
    let version = uname.version().to_string_lossy();
    Health {
        shm: shm(),
        rights: Rights::query(),
        cores: allowed_cores(),
        kernel: format!("{} {}", uname.sysname().to_string_lossy(), uname.release().to_string_lossy()),
        preempt_rt: version.contains("PREEMPT_RT"),
        clock_source: read("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        realtime_budget: realtime_budget(),
        runs: RunDir::list(),
    }
}

fn shm() -> Option<Shm> {
    let space = statvfs(SHM).ok()?;
    Some(Shm {
        writable: access(SHM, Access::WRITE_OK | Access::EXEC_OK).is_ok(),
        free_bytes: space.f_bavail * space.f_frsize,
        total_bytes: space.f_blocks * space.f_frsize,
    })
}

fn realtime_budget() -> Option<(u64, u64)> {
    // -1 stands for no limit.
    let runtime = read("/proc/sys/kernel/sched_rt_runtime_us").parse().ok()?;
    let period = read("/proc/sys/kernel/sched_rt_period_us").parse().ok()?;
    Some((runtime, period))
}

fn read(path: impl AsRef<Path>) -> String {
    std::fs::read_to_string(path).map(|text| text.trim().to_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_machine_that_runs_this_test_can_be_described() {
        let run = RunDir::create().unwrap();
        let health = examine();
        assert!(health.shm.as_ref().is_some_and(|shm| shm.writable && shm.free_bytes > 0 && shm.total_bytes >= shm.free_bytes));
        assert!(!health.cores.is_empty() && health.kernel.starts_with("Linux "));
        assert!(health.runs.iter().any(|found| found.name == run.name() && found.alive));
    }
}
