//! The circumstances of a run: where its processes are, what disturbs them, and whether they record.

use std::time::Duration;

use launcher::Plan;
use runtime::{Disturbance, random, realtime};

/// Longest delay of a process at its start.
const LONGEST_DELAY_MS: u64 = 300;

/// Where the processes run.
#[derive(Clone, Copy)]
pub(super) enum Placement {
    /// The graph's own order.
    Graph,
    /// All on one core.
    Together(usize),
    /// One after the other on the next core.
    Split,
    /// Wherever the kernel likes.
    Free,
}

/// The circumstances of one run.
#[derive(Clone, Copy)]
pub(super) struct Condition {
    /// Cores of the two ends.
    pub placement: Placement,
    pub nice: bool,
    pub delays: bool,
    pub pauses: bool,
    /// Processes are stopped (SIGSTOP) for 50 to 500 ms, one after the other.
    pub stops: bool,
    pub cpu_load: bool,
    pub record: bool,
}

/// The conditions of the runs in turn, each time with other random numbers.
pub(super) const CONDITIONS: [Condition; 6] = [
    Condition {
        placement: Placement::Graph,
        nice: false,
        delays: false,
        pauses: false,
        stops: false,
        cpu_load: false,
        record: true,
    },
    Condition {
        placement: Placement::Free,
        nice: true,
        delays: true,
        pauses: true,
        stops: true,
        cpu_load: false,
        record: false,
    },
    Condition {
        placement: Placement::Split,
        nice: false,
        delays: true,
        pauses: false,
        stops: false,
        cpu_load: true,
        record: true,
    },
    Condition {
        placement: Placement::Together(0),
        nice: true,
        delays: false,
        pauses: true,
        stops: false,
        cpu_load: true,
        record: false,
    },
    Condition {
        placement: Placement::Together(1),
        nice: false,
        delays: true,
        pauses: true,
        stops: true,
        cpu_load: false,
        record: true,
    },
    Condition {
        placement: Placement::Free,
        nice: false,
        delays: false,
        pauses: false,
        stops: false,
        cpu_load: true,
        record: false,
    },
];

impl std::fmt::Display for Condition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.placement {
            Placement::Graph => write!(f, "cores of the graph")?,
            Placement::Together(core) => write!(f, "all on core {core}")?,
            Placement::Split => write!(f, "alternating cores")?,
            Placement::Free => write!(f, "not pinned")?,
        }
        for (is_so, words) in [
            (self.nice, "nice"),
            (self.delays, "late starts"),
            (self.pauses, "pauses"),
            (self.stops, "stopped for 50 to 500 ms"),
            (self.cpu_load, "busy cores"),
        ] {
            if is_so {
                write!(f, ", {words}")?;
            }
        }
        write!(
            f,
            ", {}",
            if self.record {
                "recording"
            } else {
                "no recording"
            }
        )
    }
}

impl Condition {
    /// Lays the condition over a plan.
    pub(super) fn disturb(&self, plan: &mut Plan, seed: u64, unordered: bool) {
        let cores = realtime::allowed_cores();
        let core = |index: usize| (!cores.is_empty()).then(|| cores[index % cores.len()]);
        for (index, child) in plan.children.iter_mut().enumerate() {
            let process = &mut child.process;
            process.core = match self.placement {
                Placement::Graph => process.core,
                Placement::Together(which) => core(which),
                Placement::Split => core(index),
                Placement::Free => None,
            };
            let draw = |what: u64| random(seed, 8 * index as u64 + what);
            process.disturbance = Disturbance {
                start_delay: if self.delays {
                    Duration::from_millis(draw(0) % LONGEST_DELAY_MS)
                } else {
                    Duration::ZERO
                },
                nice: if self.nice { (draw(1) % 16) as i32 } else { 0 },
                pauses: self.pauses.then(|| draw(2)),
                unordered: unordered && child.ends_run,
                unfenced: false,
            };
        }
    }
}
