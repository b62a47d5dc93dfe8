//! The rhythm of the process that makes the ticks (the plant).

use std::rc::Rc;

use crate::clock::{now_ns, sleep_until};
use crate::context::Context;
use crate::control_page::{Count, State, Stop};
use crate::realtime::Usage;
use crate::wait::Interrupted;

/// Ticks between two reads of the kernel's counters: reading them at each tick would cost a system
/// call.
const USAGE_EVERY: u64 = 64;

/// In real time, the longest that the end of a run waits for a recorder, or its replacement, to read the last ticks; ns. Less than a process waits for a message.
const LONGEST_NS: u64 = 6_000_000_000;

/// Gives out one tick after the other.
///
/// In lockstep each at once, unless the recorder lags too far. In real time on absolute deadlines t₀ + k·T: after an overrun the phase
/// is kept, the grid points that have passed are counted as skipped, and the next tick waits for the next grid point.
pub struct TickSource {
    context: Rc<Context>,
    next_tick: u64,
    /// Grid point at which the tick in hand began; 0 before the first one.
    grid_ns: u64,
    usage: Usage,
    incarnations: u32,
    /// Before this tick, faults that were requested have a tick.
    adopted: u64,
}

impl TickSource {
    pub(crate) fn new(context: Rc<Context>, first: u64) -> Self {
        Self {
            context,
            next_tick: first,
            grid_ns: 0,
            usage: Usage::default(),
            incarnations: 0,
            adopted: 0,
        }
    }

    /// Waits for the next tick's time; `None` when the run stops.
    ///
    /// # Errors
    /// When in lockstep the recorder takes nothing in within the limit, or the run does not start.
    #[allow(
        clippy::should_implement_trait,
        reason = "it can fail; `while let Some(tick) = tick_source.next()?`"
    )]
    pub fn next(&mut self) -> Result<Option<u64>, Interrupted> {
        self.next_after(|source| match source.context.is_lockstep() {
            true => source.context.wait_for_others(source.next_tick),
            false => {
                source.wait_for_grid();
                Ok(true)
            }
        })
    }

    /// Begins the next tick when `wait` has returned: `false` when the run stops meanwhile.
    fn next_after(
        &mut self,
        wait: impl FnOnce(&mut Self) -> Result<bool, Interrupted>,
    ) -> Result<Option<u64>, Interrupted> {
        if !self.begin()? {
            return Ok(None);
        }
        if self.context.control_page.stop() == Stop::Ticks {
            self.finish()?;
            return Ok(None);
        }
        let tick = self.coming();
        if !wait(self)? || self.context.is_stopping() {
            return Ok(None);
        }
        self.next_tick += 1;
        self.context.tick.set(tick);
        // The arm's time is its own: where the plant stood still, no tick has passed.
        self.context.attend(tick);
        Ok(Some(tick))
    }

    /// The tick that comes next. From here on no fault that is requested takes effect at it: its messages can be made.
    pub fn coming(&mut self) -> u64 {
        let tick = self.next_tick;
        if tick >= self.adopted {
            self.context.control_page.fault_table().adopt(tick);
            self.adopted = tick + 1;
        }
        tick
    }

    /// Waits until every process is ready for the first tick; `false` when the run stops before.
    ///
    /// # Errors
    /// When the run does not start within the limit.
    pub fn begin(&mut self) -> Result<bool, Interrupted> {
        self.context.start()
    }

    /// Begins the next tick at once, for a plant whose own clock paces the run in real time. `passed`: periods of that clock since the tick before; all
    /// but one are counted as skipped. `None` when the run stops.
    ///
    /// # Errors
    /// When the run does not start within the limit.
    pub fn next_by(&mut self, passed: u64) -> Result<Option<u64>, Interrupted> {
        self.next_after(|source| {
            source.count_skipped(passed.saturating_sub(1));
            source.grid_ns = now_ns();
            source.context.stamping.set_due(source.grid_ns);
            Ok(true)
        })
    }

    /// Ends the run: without this, the end of the process that makes the ticks is a death. Waits until every process outside the loop has closed the ticks
    /// given out, so that none is stopped in the middle of them; in real time only for the recorder, which could not read later what it has not read yet.
    ///
    /// # Errors
    /// In lockstep, when one of them closes nothing within the limit.
    pub fn finish(&self) -> Result<(), Interrupted> {
        let context = &self.context;
        match context.is_lockstep() {
            true => context.wait_for_end(self.next_tick)?,
            false => context.wait_for_record(self.next_tick, now_ns() + LONGEST_NS)?,
        }
        context.entry().set_state(State::Done);
        Ok(())
    }

    /// Until when a tick's torque is waited for, on `CLOCK_MONOTONIC`; in lockstep without limit.
    ///
    /// A tenth of a period, at most 100 µs, before the next tick: a wait without a message still ends in time for the next grid point.
    pub fn deadline_ns(&self) -> Option<u64> {
        let period = self.context.manifest.period_ns();
        (!self.context.is_lockstep()).then(|| self.grid_ns + period - (period / 10).min(100_000))
    }

    fn wait_for_grid(&mut self) {
        let period = self.context.manifest.period_ns();
        let now = now_ns();
        if self.grid_ns == 0 {
            let origin = self.context.control_page.grid_origin(now + period);
            // A replacement joins on a grid point that lies ahead.
            self.grid_ns = origin + now.saturating_sub(origin).div_ceil(period) * period;
        } else {
            let skipped = now.saturating_sub(self.grid_ns) / period;
            self.count_skipped(skipped);
            self.grid_ns += (skipped + 1) * period;
        }
        self.context.stamping.set_due(self.grid_ns);
        while now_ns() < self.grid_ns && !self.context.is_stopping() {
            sleep_until(self.grid_ns);
        }
    }

    /// Counts the periods without a tick, with their cause as far as the kernel's counters of the
    /// last few ticks show it: rarer and costlier causes first.
    fn count_skipped(&mut self, skipped: u64) {
        let (incarnations, tick) = (self.incarnations_of_all(), self.next_tick);
        if skipped > 0 || tick.is_multiple_of(USAGE_EVERY) {
            let (before, usage) = (self.usage, Usage::now());
            let cause = if usage.major_faults > before.major_faults {
                Count::SkippedMajorFault
            } else if incarnations != self.incarnations {
                Count::SkippedPeerRestart
            } else if usage.preemptions > before.preemptions {
                Count::SkippedPreempted
            } else {
                Count::SkippedOverrun
            };
            if tick > 0 {
                self.context.entry().add(cause, skipped);
            }
            self.usage = usage;
        }
        self.incarnations = incarnations;
    }

    fn incarnations_of_all(&self) -> u32 {
        (0..self.context.manifest.processes.len())
            .map(|index| self.context.control_page.process(index).incarnation())
            .sum()
    }
}
