//! `armplane doctor`: what the machine offers, what is missing, and what to do about it.

use std::process::ExitCode;

use launcher::doctor::{Health, examine};
use serde_json::json;

use crate::out::say;
use session::Failure;

/// Shared memory that a run may need: iceoryx2's segments and the control page, generously.
const SHM_NEEDED: u64 = 64 << 20;

/// One finding.
struct Check {
    what: &'static str,
    /// Without it nothing runs (false), or real time is not as good as it could be (true).
    optional: bool,
    good: bool,
    finding: String,
    remedy: &'static str,
}

pub(crate) fn doctor(as_json: bool) -> Result<ExitCode, Failure> {
    let health = examine();
    let checks = checks(&health);
    let sound = checks.iter().all(|check| check.good || check.optional);
    if as_json {
        let list: Vec<_> = checks
            .iter()
            .map(|check| json!({"check": check.what, "good": check.good, "optional": check.optional, "finding": check.finding, "remedy": if check.good { "" } else { check.remedy }}))
            .collect();
        let runs: Vec<_> = health
            .runs
            .iter()
            .map(|run| json!({"run": run.name, "launcher_pid": run.launcher_pid, "alive": run.alive, "bytes": run.bytes}))
            .collect();
        say!("{}", json!({"sound": sound, "checks": list, "runs": runs}));
    } else {
        for check in &checks {
            let mark = match (check.good, check.optional) {
                (true, _) => "ok  ",
                (false, true) => "note",
                (false, false) => "FAIL",
            };
            say!("{mark}  {:<18} {}", check.what, check.finding);
            if !check.good {
                say!("      {:<18} → {}", "", check.remedy);
            }
        }
    }
    Ok(if sound { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn checks(health: &Health) -> Vec<Check> {
    let mb = |bytes: u64| bytes / 1_000_000;
    let (dead, alive): (Vec<_>, Vec<_>) = health.runs.iter().partition(|run| !run.alive);
    let shm = match &health.shm {
        None => (false, "there is no /dev/shm".to_owned()),
        Some(shm) => (
            shm.writable && shm.free_bytes >= SHM_NEEDED,
            format!(
                "{}, {} MB free of {}",
                if shm.writable { "writable" } else { "not writable" },
                mb(shm.free_bytes),
                mb(shm.total_bytes)
            ),
        ),
    };
    let (used, period) = health.realtime_budget.unwrap_or((1, 1));
    vec![
        Check {
            what: "shared memory",
            optional: false,
            good: shm.0,
            finding: shm.1,
            remedy: "mount a writable tmpfs with at least 64 MB on /dev/shm (containers: --shm-size=256m)",
        },
        Check {
            what: "cores",
            optional: true,
            good: health.cores.len() >= 2,
            finding: format!("{} usable: {:?}", health.cores.len(), health.cores),
            remedy: "with two cores or more the recorder does not disturb the control chain",
        },
        Check {
            what: "FIFO scheduling",
            optional: true,
            good: health.rights.fifo(),
            finding: if health.rights.fifo() {
                "allowed".to_owned()
            } else {
                format!("not allowed (RLIMIT_RTPRIO {:?})", health.rights.rtprio_limit)
            },
            remedy: "for --mode realtime: ulimit -r 90, or `@realtime - rtprio 90` in /etc/security/limits.conf",
        },
        Check {
            what: "locked memory",
            optional: true,
            good: health.rights.lock_memory(),
            finding: if health.rights.lock_memory() {
                "allowed".to_owned()
            } else {
                format!("limited to {:?} bytes", health.rights.memlock_limit)
            },
            remedy: "for --mode realtime: ulimit -l unlimited",
        },
        Check {
            what: "real-time share",
            optional: true,
            good: used >= period,
            finding: if used >= period { "unlimited".to_owned() } else { format!("{used} of {period} µs") },
            remedy: "only processes that spin under FIFO notice it; armplane's block instead",
        },
        Check {
            what: "kernel",
            optional: true,
            good: health.preempt_rt,
            finding: format!("{}, {}", health.kernel, if health.preempt_rt { "PREEMPT_RT" } else { "not PREEMPT_RT" }),
            remedy: "a PREEMPT_RT kernel bounds the worst latency; the median is the same without",
        },
        Check {
            what: "clock source",
            optional: true,
            good: health.clock_source == "tsc",
            finding: health.clock_source.clone(),
            remedy: "with `tsc` reading the time costs 20 ns instead of a system call",
        },
        Check {
            what: "leftovers",
            optional: true,
            good: dead.is_empty(),
            finding: format!("{} of dead runs; {} runs alive", dead.len(), alive.len()),
            remedy: "armplane clean",
        },
    ]
}
