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

/// Starts of all processes in which some are killed: one death more from the same tick would end the run.
const MOST_STARTS: u64 = 5;

/// The longest time from the beginning of a start until a process is killed in it; ms.
const LONGEST_START_MS: u64 = 60;

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
    /// SIGKILL of one process, several or all, at any moment of the run.
    Kills,
}
use Trouble::{BusyCores, Kills, LateStarts, Nice, Pauses, Stops};

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

/// Nothing disturbs the run.
pub(super) const UNDISTURBED: Condition = CONDITIONS[0];

/// Processes die.
pub(super) const KILLS: Condition = condition(Placement::Graph, &[Kills]);

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
                Kills => ", killed",
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
            let draw = |trouble: Trouble, what: u64| {
                let is_so = self.has(trouble);
                is_so.then(|| random(seed, 8 * index as u64 + what))
            };
            let late = draw(LateStarts, 0).unwrap_or_default() % LONGEST_DELAY_MS;
            let nice = draw(Nice, 1).unwrap_or_default() % 16;
            process.disturbance = Disturbance {
                start_delay: Duration::from_millis(late),
                nice: nice as i32,
                pauses: draw(Pauses, 2),
                unordered: unordered && child.ends_run,
                unfenced: false,
            };
        }
    }

    /// The disturbance beside a start of all processes, the first or a later one, for which the seed is another.
    pub(super) fn beside(
        &self,
        page: ControlPage,
        subject: Subject,
        start: u64,
        seed: u64,
    ) -> Vec<Background> {
        let mut work = Vec::new();
        if self.has(BusyCores) {
            work = Background::load();
        }
        let kills = self.has(Kills) && start <= MOST_STARTS;
        if kills || self.has(Stops) {
            work.push(Background::start(move |over| match kills {
                true => kill_some(&page, subject, random(seed, start), over),
                false => stop_one_after_the_other(&page, subject.count, seed, over),
            }));
        }
        work
    }
}

/// The run that is disturbed.
#[derive(Clone, Copy)]
pub(super) struct Subject {
    /// How many processes it has.
    pub(super) count: usize,
    /// The place of that which makes the ticks.
    pub(super) source: usize,
    /// Ticks of the scenario.
    pub(super) length: u64,
}

/// Kills processes at one moment of a start, or at none; the run may be over before it comes.
fn kill_some(page: &ControlPage, subject: Subject, seed: u64, over: &Over) {
    let mut drawn = 0;
    let mut draw = |most: u64| {
        drawn += 1;
        random(seed, drawn) % most.max(1)
    };
    if draw(3) == 0 {
        return;
    }
    let source = page.process(subject.source);
    let has_come = match draw(6) {
        // While the processes start, perhaps for the second time.
        0 => over.rest(Duration::from_micros(draw(1_000 * LONGEST_START_MS))),
        1 => {
            over.wait(|| source.state() == State::Gone)
                && over.rest(Duration::from_micros(draw(20_000)))
        }
        _ => {
            let tick = draw(subject.length);
            over.wait(|| source.ticks() > tick)
        }
    };
    let most = subject.count as u64;
    let victims = match draw(3) {
        0 => 1 + draw(most),
        1 => most,
        _ => 1,
    };
    let first = draw(most);
    let mut victims = (first..first + victims).map(|place| (place % most) as usize);
    let _ = has_come
        && victims.all(|victim| {
            if let Some(child) = child(page.process(victim).pid()) {
                // It fails if the process has just ended.
                let _ = pidfd_send_signal(&child, Signal::KILL);
            }
            // All within two milliseconds.
            over.rest(Duration::from_micros(draw(2_000 / most)))
        });
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
