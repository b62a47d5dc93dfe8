//! The rounds of a polled process.

use std::cell::Cell;
use std::time::Duration;

use crate::clock::now_ns;
use crate::context::Context;
use crate::control_page::{ANYTHING, PROGRESS, ProcessEntry};
use crate::wait::{Interrupted, Waited};

/// State of a polled process's rounds.
#[derive(Debug, Default)]
pub(crate) struct Rounds {
    round: Cell<Round>,
    /// When the round in hand began.
    began_ns: Cell<u64>,
}

/// State of a polled process between two rounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Round {
    #[default]
    Before,
    /// In a round that began when the run had done so many ticks.
    From(u64),
    /// In the round after which nothing more can come.
    Last,
}

impl Rounds {
    /// See [`Shell::poll`](crate::Shell::poll).
    pub(crate) fn poll(&self, shared: &Context, every: Duration) -> Result<bool, Interrupted> {
        match self.round.get() {
            Round::Last => return Ok(false),
            Round::From(ticks) => {
                report(shared, ticks);
                shared.tick.set(shared.entry().ticks());
                shared.attend(shared.tick.get());
            }
            Round::Before => {
                if matches!(shared.start()?, Waited::Stopped) {
                    self.round.set(Round::Last);
                    return Ok(true);
                }
            }
        }
        let is_awaited = Cell::new(false);
        each_other(shared, |line| {
            is_awaited.set(is_awaited.get() || line.doorbell().is_armed_for(PROGRESS))
        });
        if !is_awaited.get() && !shared.is_stopping() {
            let doorbell = shared.entry().doorbell();
            let seen = doorbell.rings();
            // Not for the progress of others: whoever sleeps for that is awaiting this process, which then goes on without a sleep.
            doorbell.arm(ANYTHING & !PROGRESS);
            if !shared.is_stopping() {
                let most = shared
                    .recorder_lag
                    .saturating_mul(shared.manifest.period_ns());
                let worked = now_ns().saturating_sub(self.began_ns.get());
                if let left @ 1.. = (every.as_nanos() as u64).min(most).saturating_sub(worked) {
                    doorbell.sleep(seen, Some(left));
                }
            }
            doorbell.disarm();
        }
        self.began_ns.set(now_ns());
        // Read before the round: everything of these ticks is in the buffers now.
        let last = shared.is_stopping();
        shared.apply_volume_faults(shared.entry().ticks(), last);
        self.round.set(if last {
            Round::Last
        } else {
            Round::From(ticks_made(shared))
        });
        Ok(true)
    }

    /// See [`Shell::has_taken_in`](crate::Shell::has_taken_in).
    pub(crate) fn have_taken_in(&self, shared: &Context) {
        shared.learn();
        if let Round::From(ticks) = self.round.get()
            && shared.is_unharmed()
        {
            report(shared, ticks);
        }
    }
}

/// Tells all others that everything before so many ticks is taken in.
fn report(shared: &Context, ticks: u64) {
    if ticks > shared.entry().ticks() {
        shared.entry().set_ticks(ticks);
        each_other(shared, |line| line.doorbell().ring(PROGRESS));
    }
}

/// Ticks that have begun: those of the process that makes them.
fn ticks_made(shared: &Context) -> u64 {
    let ticks = |index: usize| shared.control_page.process(index).ticks();
    let processes = &shared.manifest.processes;
    match processes.iter().position(|process| process.makes_ticks) {
        Some(source) => ticks(source),
        None => (0..processes.len())
            .filter(|&index| index != shared.me)
            .map(ticks)
            .max()
            .unwrap_or(0),
    }
}

fn each_other(shared: &Context, act: impl Fn(&ProcessEntry)) {
    let me = shared.me;
    (0..shared.manifest.processes.len())
        .filter(|&index| index != me)
        .for_each(|i| act(shared.control_page.process(i)));
}
