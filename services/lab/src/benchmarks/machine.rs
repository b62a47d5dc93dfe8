//! The machine that is measured on.

use runtime::realtime::allowed_cores;
use serde_json::json;

/// The machine of a measurement.
pub fn machine() -> serde_json::Value {
    let (health, machine) = (launcher::doctor::examine(), session::machine());
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let load = read("/proc/loadavg")
        .split(' ')
        .take(3)
        .collect::<Vec<_>>()
        .join(" ");
    json!({
        "cpu": machine.cpu, "cores": health.cores.len(), "pinned_to": allowed_cores(), "kernel": health.kernel, "preempt_rt": health.preempt_rt,
        "clock_source": health.clock_source, "fifo": health.rights.fifo(), "locked_memory": health.rights.lock_memory(), "load": load,
    })
}

/// The same in one line, for people.
#[must_use]
pub fn machine_line(machine: &serde_json::Value) -> String {
    let text = |key: &str| machine[key].as_str().unwrap_or_default().to_owned();
    let rights = if machine["fifo"] == true {
        "SCHED_FIFO"
    } else {
        "without SCHED_FIFO"
    };
    format!(
        "{}, {}, {} cores, {rights}, load {}",
        text("cpu"),
        text("kernel"),
        machine["cores"],
        text("load")
    )
}
