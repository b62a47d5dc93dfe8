//! The machine's settings that matter to a run, as data.

use crate::folders::abandoned;
use runtime::realtime::{Rights, allowed_cores};
use runtime::{FoundRun, RunDir, SHM};
use rustix::fs::{Access, access, statvfs};

/// The state of the machine as far as a run depends on it.
#[derive(Clone, Debug)]
pub struct Health {
    /// Rights that real time needs.
    pub rights: Rights,
    /// Cores that this process may use.
    pub cores: Vec<usize>,
    /// Kernel name and version.
    pub kernel: String,
    /// Whether the kernel is built with `PREEMPT_RT`.
    pub preempt_rt: bool,
    /// The kernel's clock source ("tsc" is the fast one); empty if unknown.
    pub clock_source: String,
    /// This user's runs in shared memory, living and dead.
    pub runs: Vec<FoundRun>,
}

/// Looks at the machine; changes nothing.
pub fn examine() -> Health {
    let uname = rustix::system::uname();
    let version = uname.version().to_string_lossy();
    Health {
        rights: Rights::query(),
        cores: allowed_cores(),
        kernel: format!(
            "{} {}",
            uname.sysname().to_string_lossy(),
            uname.release().to_string_lossy()
        ),
        preempt_rt: version.contains("PREEMPT_RT"),
        clock_source: read("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        runs: RunDir::list(),
    }
}

/// The share of each period that real-time tasks may use, "950000 of 1000000 µs" on a stock kernel; `None` is no limit.
fn realtime_budget() -> Option<(u64, u64)> {
    // -1 stands for no limit.
    let runtime = read("/proc/sys/kernel/sched_rt_runtime_us").parse().ok()?;
    let period = read("/proc/sys/kernel/sched_rt_period_us").parse().ok()?;
    Some((runtime, period))
}

fn read(path: &str) -> String {
    std::fs::read_to_string(path)
        .map(|text| text.trim().to_owned())
        .unwrap_or_default()
}

/// Shared memory that a run may need: iceoryx2's segments and the control page, generously.
const SHM_NEEDED: u64 = 64 << 20;

/// One finding about the machine, with the remedy if it is bad.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// Subject of the check.
    pub what: &'static str,
    /// Without it nothing runs (false), or real time is not as good as it could be (true).
    pub optional: bool,
    /// Whether the machine has it.
    pub good: bool,
    /// State of the machine.
    pub finding: String,
    /// The remedy.
    pub remedy: &'static str,
}

/// Without this nothing runs; all other checks are of real time.
const SHARED_MEMORY: &str = "shared memory";

fn check(what: &'static str, good: bool, finding: String, remedy: &'static str) -> Check {
    Check {
        what,
        optional: what != SHARED_MEMORY,
        good,
        finding,
        remedy,
    }
}

/// Looks at the rest of the machine, and judges it: one check a row, those that nothing runs without first.
pub fn checks(health: &Health) -> Vec<Check> {
    let cores: Vec<_> = health.cores.iter().map(ToString::to_string).collect();
    let no = if health.preempt_rt { "" } else { "not " };
    let [fifo, memory, share] = real_time(health);
    vec![
        shared_memory(),
        check(
            "cores",
            cores.len() >= 2,
            format!("{} usable: {}", cores.len(), cores.join(", ")),
            "with two or more cores, the recorder does not disturb the control chain",
        ),
        fifo,
        memory,
        share,
        check(
            "kernel",
            health.preempt_rt,
            format!("{}, {no}PREEMPT_RT", health.kernel),
            "a PREEMPT_RT kernel bounds the worst latency; the median is the same without",
        ),
        check(
            "clock source",
            health.clock_source == "tsc",
            health.clock_source.clone(),
            "with `tsc`, reading the time takes 20 ns instead of a system call",
        ),
        leftovers(health),
    ]
}

fn shared_memory() -> Check {
    let (good, text) = match statvfs(SHM) {
        Err(_) => (false, "there is no /dev/shm".to_owned()),
        Ok(space) => {
            let writable = access(SHM, Access::WRITE_OK | Access::EXEC_OK).is_ok();
            let not = if writable { "" } else { "not " };
            let [free, total] = [space.f_bavail, space.f_blocks].map(|of| of * space.f_frsize);
            let [free_mb, total_mb] = [free, total].map(|bytes| bytes / 1_000_000);
            let text = format!("{not}writable, {free_mb} MB free of {total_mb}");
            (writable && free >= SHM_NEEDED, text)
        }
    };
    let remedy =
        "mount a writable tmpfs with at least 64 MB on /dev/shm (containers: --shm-size=256m)";
    check(SHARED_MEMORY, good, text, remedy)
}

/// The rights of real time.
fn real_time(health: &Health) -> [Check; 3] {
    let rights = &health.rights;
    let (used, period) = realtime_budget().unwrap_or((1, 1));
    let found = |what, good, well: &str, ill: String, remedy| {
        let finding = if good { well.to_owned() } else { ill };
        check(what, good, finding, remedy)
    };
    [
        found(
            "FIFO scheduling",
            rights.fifo(),
            "allowed",
            // A limit above 0 would allow it.
            "not allowed (RLIMIT_RTPRIO is 0)".to_owned(),
            "for --mode realtime: ulimit -r 90, or `@realtime - rtprio 90` in /etc/security/limits.conf",
        ),
        found(
            "locked memory",
            rights.lock_memory(),
            "allowed",
            format!(
                "limited to {} bytes",
                rights.memlock_limit.unwrap_or_default()
            ),
            "for --mode realtime: ulimit -l unlimited",
        ),
        found(
            "real-time share",
            used >= period,
            "unlimited",
            format!("{used} of {period} µs"),
            "it affects only processes that spin under FIFO; those of armplane block instead",
        ),
    ]
}

fn leftovers(health: &Health) -> Check {
    let (dead, alive): (Vec<_>, Vec<_>) = health.runs.iter().partition(|run| !run.alive);
    let folders = abandoned().len();
    check(
        "leftovers",
        dead.is_empty() && folders == 0,
        format!(
            "of dead runs: {}; temporary folders: {folders}; runs alive: {}",
            dead.len(),
            alive.len()
        ),
        "armplane clean",
    )
}
