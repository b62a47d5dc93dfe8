//! The start of all processes of a run together.

use std::time::{Duration, Instant};

use runtime::{
    ControlPage, Exit, FaultTable, Hub, Manifest, Mode, Origin, Phase, RunDir, State, now_ns,
};

use crate::child::Child;
use crate::delay::Delay;
use crate::launch::Halt;
use crate::outcome::{End, Failure, LaunchError};
use crate::plan::{Commands, Plan, Report};
use crate::signals::Interrupts;
use crate::spawn::{Slot, Supervised};
use crate::unfinished::Sweeper;

/// Leaves to all processes what they go on from.
fn leave(plan: &Plan, run: &RunDir, page: &ControlPage) -> Result<(), LaunchError> {
    for (process, saved) in &plan.begin.saved {
        runtime::leave(run.path(), process, saved).map_err(LaunchError::Cut)?;
    }
    for index in 0..plan.children.len() {
        page.process(index).close_before(plan.begin.tick);
    }
    Ok(())
}

impl Supervised {
    /// Makes the run's directory with all that the processes need. `earlier`: the faults of an earlier start, for which no process is left.
    pub(crate) fn prepare(plan: Plan, earlier: Option<&FaultTable>) -> Result<Self, LaunchError> {
        RunDir::has_room()?;
        let run = RunDir::create()?;
        let manifest = Manifest {
            mode: plan.mode,
            rate_hz: plan.rate_hz,
            wait_limit: plan.limits.wait,
            processes: plan
                .children
                .iter()
                .map(|child| child.process.clone())
                .collect(),
            messages: plan.messages.clone(),
            from: plan.begin.tick,
        };
        manifest.write(&run)?;
        let control_page = ControlPage::create(&run)?;
        leave(&plan, &run, &control_page)?;
        let table = control_page.fault_table();
        match earlier {
            Some(earlier) => table.take_over(earlier),
            None => {
                let enter = |fault| table.enter(fault, Origin::Planned);
                if plan.faults.iter().map(enter).any(|place| place.is_none()) {
                    return Err(LaunchError::TooManyFaults {
                        count: plan.faults.len(),
                    });
                }
                // A death before the first tick has happened.
                for (place, fault) in plan.faults.iter().enumerate() {
                    if fault.ends_process() && fault.at < plan.begin.tick {
                        table.mark_injected(place, now_ns());
                    }
                }
            }
        }
        let hub = Hub::create(&run, &manifest)?;
        let slots = plan.children.iter().map(|_| Slot::default()).collect();
        let sweeper = Sweeper::start(&run)?;
        let count = plan.children.len();
        let mut started = Self {
            slots,
            hub,
            sweeper,
            control_page,
            run,
            plan,
            fallen: Vec::new(),
            planned_ends: vec![0; count],
            stops_at: None,
            last_lines: Vec::new(),
        };
        started.planned_ends = (0..count)
            .map(|index| started.planned_ends(index))
            .collect();
        Ok(started)
    }

    /// Removes the run's directory; the plan, and the control page, whose file is gone.
    pub(crate) fn dismantle(self) -> (Plan, ControlPage) {
        let Self {
            slots,
            hub,
            sweeper,
            control_page,
            run,
            plan,
            ..
        } = self;
        // The topics before the sweeper: to remove what dead processes left may mean to wait for an unfinished segment.
        drop((slots, hub));
        drop(sweeper);
        // The outcome stands, whatever is left.
        if let Err(error) = run.remove() {
            tracing::warn!(
                "the processes have ended, but their shared memory could not be removed: {error}"
            );
        }
        (plan, control_page)
    }

    /// Waits until all processes have connected their ports. Returns the end if it comes before.
    pub(crate) fn await_beginning(
        &mut self,
        commands: Commands<'_>,
        signals: &mut Interrupts,
        report: Report<'_>,
    ) -> Result<Option<Halt>, LaunchError> {
        let until = self.plan.limits.start.map(|limit| Instant::now() + limit);
        for (state, next) in [
            (State::Ready, Phase::Connect),
            (State::Connected, Phase::Work),
        ] {
            if let Err(halt) = self.await_all(state, until, commands, signals, report) {
                return Ok(Some(halt));
            }
            if next == Phase::Work {
                // Nothing is larger from here on but for replacements.
                self.run.reserve()?;
            }
            self.control_page.begin(next);
        }
        Ok(None)
    }

    fn await_all(
        &mut self,
        state: State,
        until: Option<Instant>,
        commands: Commands<'_>,
        signals: &mut Interrupts,
        report: Report<'_>,
    ) -> Result<(), Halt> {
        let failed = |failure| Halt::End(End::Failed(failure));
        loop {
            self.rest(Duration::from_millis(2));
            self.pass_lines_on(report);
            for index in self.take_in_exits(report) {
                self.ends_early(index).map_err(failed)?;
            }
            if !self.fallen.is_empty() {
                return Err(Halt::RollBack);
            }
            if let Some(failure) = self.start_again(commands, report) {
                return Err(failed(failure));
            }
            if let Some(signal) = signals.pending() {
                return Err(Halt::End(End::Interrupted { signal }));
            }
            let has_come = |index: usize| {
                let found = self.control_page.process(index).state();
                found == state || matches!(found, State::Connected | State::Running)
            };
            let laggard = (0..self.plan.children.len()).find(|&index| !has_come(index));
            match laggard {
                None => return Ok(()),
                Some(index) if until.is_some_and(|until| Instant::now() > until) => {
                    let limit = self.plan.limits.start.unwrap_or_default();
                    return Err(failed(Failure::Slow {
                        process: self.name(index).to_owned(),
                        limit,
                    }));
                }
                Some(index) => {
                    let halted = self.slots[index].child.as_ref().and_then(Child::halted);
                    self.note_delay(index, Some(halted.unwrap_or(Delay::NotReady)), report);
                }
            }
        }
    }

    /// A process has ended before the first tick. One that was killed is started again, in lockstep with all others; one that has ended by itself says
    /// why it cannot begin.
    fn ends_early(&mut self, index: usize) -> Result<(), Failure> {
        let is_signal = self.slots[index].exit.and_then(Exit::signal).is_some();
        if self.plan.mode == Mode::Lockstep {
            self.fall(index);
        }
        match self.plan.mode {
            _ if !is_signal => Err(self.died(index, 0)),
            Mode::Lockstep => Ok(()),
            Mode::Realtime => self.plan_restart(index),
        }
    }
}
