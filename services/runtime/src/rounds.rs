//! The rounds of a polled process.

use std::cell::Cell;
use std::time::Duration;

use crate::clock::now_ns;
use crate::context::Context;
use crate::control_page::{ANYTHING, PROGRESS, ProcessEntry};
use crate::shell::Shell;
use crate::wait::Interrupted;

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

impl Shell {
    /// A polled process's rhythm: ends a round, sleeps until `every` has passed since that began, begins the next; `false` after the round in which
    /// nothing more can come. It sleeps less where ticks are so quick, or messages so large, that more than a quarter of its buffers would be full by then.
    ///
    /// Messages drained in the round count as received: in lockstep the tick source may go on.
    ///
    /// # Errors
    /// When the run does not start within the limit.
    pub fn poll(&self, every: Duration) -> Result<bool, Interrupted> {
        let (shared, Rounds { round, began_ns }) = (&*self.shared, &self.rounds);
        match round.get() {
            Round::Last => return Ok(false),
            Round::From(ticks) => {
                report(shared, ticks);
                shared.tick.set(shared.entry().ticks());
                shared.attend(shared.tick.get());
            }
            Round::Before => {
                if !shared.start()? {
                    round.set(Round::Last);
                    return Ok(true);
                }
            }
        }
        let is_awaited = others(shared).any(|line| line.doorbell().is_armed_for(PROGRESS));
        if !is_awaited && !shared.is_stopping() {
            let doorbell = shared.entry().doorbell();
            let seen = doorbell.rings();
            // Not for the progress of others: whoever sleeps for that is awaiting this process, which then goes on without a sleep.
            doorbell.arm(ANYTHING & !PROGRESS);
            if !shared.is_stopping() {
                let most = shared
                    .recorder_lag
                    .saturating_mul(shared.manifest.period_ns());
                let worked = now_ns().saturating_sub(began_ns.get());
                if let left @ 1.. = (every.as_nanos() as u64).min(most).saturating_sub(worked) {
                    doorbell.sleep(seen, Some(left));
                }
            }
            doorbell.disarm();
        }
        began_ns.set(now_ns());
        // Read before the round: everything of these ticks is in the buffers now.
        let last = shared.is_stopping();
        shared.apply_volume_faults(shared.entry().ticks(), last);
        round.set(if last {
            Round::Last
        } else {
            Round::From(ticks_made(shared))
        });
        Ok(true)
    }

    /// For a polled process: it holds all messages of the round in hand itself, or their logs do. In lockstep the tick source may go on at once, not only
    /// at the end of the round, when all has been made of them; in a run with faults at the end.
    pub fn has_taken_in(&self) {
        let shared = &self.shared;
        shared.learn();
        if let Round::From(ticks) = self.rounds.round.get()
            && shared.is_unharmed()
        {
            report(shared, ticks);
        }
    }

    /// For a polled process: messages that were sent before the round in hand are still on their way to it, and the round does not count.
    pub fn has_missed(&self) {
        if matches!(self.rounds.round.get(), Round::From(_)) {
            self.rounds.round.set(Round::From(0));
        }
    }
}

/// Tells all others that everything before so many ticks is taken in.
fn report(shared: &Context, ticks: u64) {
    if ticks > shared.entry().ticks() {
        shared.entry().set_ticks(ticks);
        others(shared).for_each(|line| line.doorbell().ring(PROGRESS));
    }
}

/// Ticks that have begun: those of the process that makes them.
fn ticks_made(shared: &Context) -> u64 {
    match shared.source() {
        Some(source) => shared.control_page.process(source).ticks(),
        None => others(shared).map(ProcessEntry::ticks).max().unwrap_or(0),
    }
}

fn others(shared: &Context) -> impl Iterator<Item = &ProcessEntry> {
    let all = 0..shared.manifest.processes.len();
    all.filter(move |&index| index != shared.me)
        .map(move |index| shared.control_page.process(index))
}
