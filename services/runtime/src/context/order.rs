//! The order of ticks in lockstep: who has closed a tick, and who waits for whom.
//!
//! ```text
//! tick k of a process     its messages of k are sent, or it is absent; then k is closed and its tick count is k + 1
//! a reader at k           takes the message of k, or closes k as well once the writer has closed k without one
//! the tick source at k    begins k when no process lags by more than its buffers hold; with faults, when every process has closed k − 1
//! ```
//!
//! So a fault anywhere in the chain leads to a tick without torque, never to a wait for a message
//! that cannot come. All decisions follow from the tick counts; none depends on a clock.

use super::Context;
use crate::control_page::PROGRESS;
use crate::wait::{Interrupted, Wait, Waited};

/// Ticks that the source may be ahead of a polled process: a quarter of what its buffers hold, also where faults make several messages of one tick.
pub(crate) const RECORDER_LAG: u64 = 256;

/// Ticks that the source may be ahead of a process that is not polled: the buffer of a reader holds twice as many.
///
/// Whether the loop waits for a process is not in the graph: a program may declare that it reads a topic and never open it.
pub(crate) const CHAIN_LAG: u64 = 32;

impl Context {
    fn closed(&self, process: usize) -> u64 {
        self.control_page.process(process).ticks()
    }

    /// The process that makes the ticks.
    pub(crate) fn source(&self) -> Option<usize> {
        let mut processes = self.manifest.processes.iter();
        processes.position(|process| process.makes_ticks)
    }

    /// Whether a writer sends nothing more at a tick.
    #[inline]
    pub(crate) fn has_closed(&self, writer: Option<usize>, tick: u64) -> bool {
        writer.is_some_and(|writer| self.closed(writer) > tick)
    }

    /// A process for which the source waits before it begins a tick.
    fn holds_back(&self, tick: u64) -> Option<usize> {
        let lags = |index: &usize| {
            let process = &self.manifest.processes[*index];
            let most = if process.is_polled() {
                self.recorder_lag
            } else {
                CHAIN_LAG
            };
            !process.makes_ticks && tick > self.closed(*index).saturating_add(most)
        };
        let lagging = (0..self.manifest.processes.len()).find(lags);
        // Without a torque to wait for, the source would run ahead, and a message of a later tick would pass for the missing one of this tick.
        lagging.or_else(|| {
            (!self.is_unharmed())
                .then(|| self.unfinished(tick))
                .flatten()
        })
    }

    /// A process that has not closed all ticks before a tick; a polled one takes in the remaining messages later.
    fn unfinished(&self, tick: u64) -> Option<usize> {
        (0..self.manifest.processes.len()).find(|&index| {
            let is_polled = self.manifest.processes[index].is_polled();
            index != self.me && !is_polled && self.closed(index) < tick
        })
    }

    /// In lockstep: waits until no process lags so far that it could lose this tick; `false` when the run stops.
    pub(crate) fn wait_for_others(&self, tick: u64) -> Result<bool, Interrupted> {
        self.wait_until_none(
            || self.holds_back(tick),
            &format_args!("its turn to begin tick {tick}"),
            None,
        )
    }

    /// In lockstep: waits until all processes outside the loop have closed the ticks before this one.
    pub(crate) fn wait_for_end(&self, tick: u64) -> Result<(), Interrupted> {
        let last = tick.saturating_sub(1);
        let what = format_args!("the end of tick {last}");
        self.wait_until_none(|| self.unfinished(tick), &what, None)
            .map(drop)
    }

    /// In real time: waits until those that only read have taken in the ticks before this one, at most until a time. One that has died is replaced meanwhile.
    pub(crate) fn wait_for_record(&self, tick: u64, until_ns: u64) -> Result<(), Interrupted> {
        let has_unread = |index: &usize| {
            self.manifest.processes[*index].is_polled() && self.closed(*index) < tick
        };
        let laggard = || (0..self.manifest.processes.len()).find(has_unread);
        self.wait_until_none(laggard, &format_args!("the record"), Some(until_ns))
            .map(drop)
    }

    fn wait_until_none(
        &self,
        laggard: impl Fn() -> Option<usize>,
        what: &std::fmt::Arguments<'_>,
        until_ns: Option<u64>,
    ) -> Result<bool, Interrupted> {
        let describe = || Wait {
            what: what.to_string(),
            from: laggard().map_or("the others".into(), |index| {
                self.manifest.processes[index].name.clone()
            }),
        };
        let is_over = self.wait(PROGRESS, until_ns, describe, || {
            self.learn();
            Ok(laggard().is_none().then_some(()))
        })?;
        Ok(matches!(is_over, Waited::Ready(())))
    }

    /// Wakes processes that wait for the progress of others rather than for a message, because this
    /// process has closed a tick.
    #[inline]
    pub(crate) fn report_progress(&self) {
        // In real time without faults every process waits for messages alone.
        if self.is_unharmed() && !self.is_lockstep() {
            return;
        }
        match self.source() {
            Some(source) if source != self.me => {
                self.control_page.process(source).doorbell().ring(PROGRESS)
            }
            // Readers of a tick without a message wait for its end.
            Some(_) if !self.is_unharmed() => self.control_page.ring_all(),
            _ => {}
        }
    }
}
