//! The machine that a run is made on.

use shared_types::summary::Machine;

/// Processor, cores and kernel of this machine, as far as it tells them.
pub fn machine() -> Machine {
    let health = launcher::doctor::examine();
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let cpu = text.lines().find_map(|line| {
        Some(
            line.strip_prefix("model name")?
                .split_once(':')?
                .1
                .trim()
                .to_owned(),
        )
    });
    Machine {
        cpu: cpu.unwrap_or_default(),
        cores: health.cores.len(),
        kernel: health.kernel,
    }
}
