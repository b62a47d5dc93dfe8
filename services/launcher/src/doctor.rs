//! The machine's settings that matter to a run, as data.

use std::path::{Path, PathBuf};

use crate::folders::abandoned;
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
    /// The kernel's clock source ("tsc" is the fast one); empty if unknown.
    pub clock_source: String,
    /// The share of each period that real-time tasks may use, "950000 of 1000000 µs" on a stock kernel; `None` is no limit.
    pub realtime_budget: Option<(u64, u64)>,
    /// Temporary folders of experiments that were killed.
    pub folders: Vec<PathBuf>,
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
pub fn examine() -> Health {
    let uname = rustix::system::uname();
    let version = uname.version().to_string_lossy();
    Health {
        shm: shm(),
        rights: Rights::query(),
        cores: allowed_cores(),
        kernel: format!(
            "{} {}",
            uname.sysname().to_string_lossy(),
            uname.release().to_string_lossy()
        ),
        preempt_rt: version.contains("PREEMPT_RT"),
        clock_source: read("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        realtime_budget: realtime_budget(),
        folders: abandoned(),
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

/// Judges the machine: one check a row, those that nothing runs without first.
pub fn checks(health: &Health) -> Vec<Check> {
    let machine = [
        (
            "cores",
            health.cores.len() >= 2,
            {
                let cores = health.cores.iter().map(ToString::to_string);
                let cores: Vec<_> = cores.collect();
                format!("{} usable: {}", cores.len(), cores.join(", "))
            },
            "with two or more cores, the recorder does not disturb the control chain",
        ),
        (
            "kernel",
            health.preempt_rt,
            format!(
                "{}, {}PREEMPT_RT",
                health.kernel,
                if health.preempt_rt { "" } else { "not " }
            ),
            "a PREEMPT_RT kernel bounds the worst latency; the median is the same without",
        ),
        (
            "clock source",
            health.clock_source == "tsc",
            health.clock_source.clone(),
            "with `tsc`, reading the time takes 20 ns instead of a system call",
        ),
    ];
    let [cores, kernel, clock] = machine;
    let [fifo, memory, share] = real_time(health);
    let rows = [
        shared_memory(health.shm.as_ref()),
        cores,
        fifo,
        memory,
        share,
        kernel,
        clock,
        leftovers(health),
    ];
    rows.map(|(what, good, finding, remedy)| Check {
        what,
        optional: what != SHARED_MEMORY,
        good,
        finding,
        remedy,
    })
    .into()
}

/// Subject, whether it is good, finding, remedy.
type Row = (&'static str, bool, String, &'static str);

/// The only check without which nothing runs.
const SHARED_MEMORY: &str = "shared memory";

fn shared_memory(shm: Option<&Shm>) -> Row {
    let mb = |bytes: u64| bytes / 1_000_000;
    let found = |shm: &Shm| {
        let (not, free) = (if shm.writable { "" } else { "not " }, mb(shm.free_bytes));
        let text = format!("{not}writable, {free} MB free of {}", mb(shm.total_bytes));
        (shm.writable && shm.free_bytes >= SHM_NEEDED, text)
    };
    let (good, text) = shm.map_or((false, "there is no /dev/shm".to_owned()), found);
    let remedy =
        "mount a writable tmpfs with at least 64 MB on /dev/shm (containers: --shm-size=256m)";
    (SHARED_MEMORY, good, text, remedy)
}

/// The rights of real time.
fn real_time(health: &Health) -> [Row; 3] {
    let rights = &health.rights;
    let (used, period) = health.realtime_budget.unwrap_or((1, 1));
    [
        (
            "FIFO scheduling",
            rights.fifo(),
            match rights.fifo() {
                true => "allowed".to_owned(),
                // A limit above 0 would allow it.
                false => "not allowed (RLIMIT_RTPRIO is 0)".to_owned(),
            },
            "for --mode realtime: ulimit -r 90, or `@realtime - rtprio 90` in /etc/security/limits.conf",
        ),
        (
            "locked memory",
            rights.lock_memory(),
            match rights.lock_memory() {
                true => "allowed".to_owned(),
                false => format!(
                    "limited to {} bytes",
                    rights.memlock_limit.unwrap_or_default()
                ),
            },
            "for --mode realtime: ulimit -l unlimited",
        ),
        (
            "real-time share",
            used >= period,
            match used >= period {
                true => "unlimited".to_owned(),
                false => format!("{used} of {period} µs"),
            },
            "it affects only processes that spin under FIFO; those of armplane block instead",
        ),
    ]
}

fn leftovers(health: &Health) -> Row {
    let (dead, alive): (Vec<_>, Vec<_>) = health.runs.iter().partition(|run| !run.alive);
    let folders = health.folders.len();
    (
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
