//! The circumstances of a run: where its processes are, and what disturbs them.

use std::time::Duration;

use launcher::Plan;
use runtime::{ControlPage, Disturbance, State, random, realtime};
use rustix::process::{Signal, pidfd_send_signal};

use crate::signals::{Background, Over, child};

/// Longest delay of a process at its start.
const LONGEST_DELAY_MS: u64 = 300;

/// The shortest stop and the longest one, and the longest time between two stops; ms.
const STOP_MS: [u64; 2] = [50, 500];
const BETWEEN_MS: u64 = 60;

/// The fewest ticks between two stops. On a busy machine the time between two stops alone is not enough for a single tick, and the run would last for
/// minutes.
const BETWEEN_TICKS: u64 = 100;

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

/// What disturbs the processes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Trouble {
    Nice,
    LateStarts,
    Pauses,
    /// SIGSTOP for 50 to 500 ms, one process after the other.
    Stops,
    BusyCores,
}
use Trouble::{BusyCores, LateStarts, Nice, Pauses, Stops};

/// The circumstances of one run.
#[derive(Clone, Copy)]
pub(super) struct Condition {
    placement: Placement,
    troubles: &'static [Trouble],
}

const fn condition(placement: Placement, troubles: &'static [Trouble]) -> Condition {
    Condition {
        placement,
        troubles,
    }
}

/// The conditions of the runs, one after the other, each time with other random numbers.
pub(super) const CONDITIONS: [Condition; 6] = [
    condition(Placement::Graph, &[]),
    condition(Placement::Free, &[Nice, LateStarts, Pauses, Stops]),
    condition(Placement::Split, &[LateStarts, BusyCores]),
    condition(Placement::Together(0), &[Nice, Pauses, BusyCores]),
    condition(Placement::Together(1), &[LateStarts, Pauses, Stops]),
    condition(Placement::Free, &[BusyCores]),
];

impl std::fmt::Display for Condition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.placement {
            Placement::Graph => write!(f, "cores of the graph")?,
            Placement::Together(core) => write!(f, "all on core {core}")?,
            Placement::Split => write!(f, "alternating cores")?,
            Placement::Free => write!(f, "not pinned")?,
        }
        for trouble in self.troubles {
            f.write_str(match trouble {
                Nice => ", nice",
                LateStarts => ", late starts",
                Pauses => ", pauses",
                Stops => ", stopped for 50 to 500 ms",
                BusyCores => ", busy cores",
            })?;
        }
        Ok(())
    }
}

impl Condition {
    fn has(&self, trouble: Trouble) -> bool {
        self.troubles.contains(&trouble)
    }

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
            let delay_ms = if self.has(LateStarts) {
                draw(0) % LONGEST_DELAY_MS
            } else {
                0
            };
            process.disturbance = Disturbance {
                start_delay: Duration::from_millis(delay_ms),
                nice: if self.has(Nice) {
                    (draw(1) % 16) as i32
                } else {
                    0
                },
                pauses: self.has(Pauses).then(|| draw(2)),
                unordered: unordered && child.ends_run,
                unfenced: false,
            };
        }
    }

    /// What goes on beside a run of `count` processes.
    pub(super) fn beside(&self, page: ControlPage, count: usize, seed: u64) -> Vec<Background> {
        let mut work = if self.has(BusyCores) {
            Background::load()
        } else {
            Vec::new()
        };
        if self.has(Stops) {
            work.push(Background::start(move |over| {
                stop_one_after_the_other(&page, count, seed, over)
            }));
        }
        work
    }
}

/// Stops processes in a seeded order, for times at which a watchdog would call them dead.
fn stop_one_after_the_other(page: &ControlPage, count: usize, seed: u64, over: &Over) {
    let ticks = || {
        (0..count)
            .map(|index| page.process(index).ticks())
            .max()
            .unwrap_or(0)
    };
    let mut next = 0;
    for step in 0.. {
        let draw = |what: u64, most: u64| random(seed, 4 * step + what) % most;
        if !over.rest(Duration::from_millis(draw(0, BETWEEN_MS))) || !over.wait(|| ticks() >= next)
        {
            return;
        }
        next = ticks() + BETWEEN_TICKS;
        let entry = page.process(draw(1, count as u64) as usize);
        let process = child(entry.pid()).filter(|_| entry.state() == State::Running);
        if let Some(process) =
            process.filter(|process| pidfd_send_signal(process, Signal::STOP).is_ok())
        {
            over.rest(Duration::from_millis(
                STOP_MS[0] + draw(2, STOP_MS[1] - STOP_MS[0]),
            ));
            let _ = pidfd_send_signal(process, Signal::CONT);
        }
    }
}
