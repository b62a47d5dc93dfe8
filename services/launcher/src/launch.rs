//! A run from its preparation to its outcome.

use std::path::Path;
use std::time::{Duration, Instant};

use runtime::{ControlPage, Exit, Hub, Manifest, Mode, Origin, Phase, RunDir, State};

use crate::child::Child;
use crate::delay::Delay;
use crate::limits;
use crate::outcome::{End, Failure, LaunchError, Outcome};
use crate::plan::{Commands, Event, Plan, Report};
use crate::signals::{Interrupts, Urgency};
use crate::spawn::{Slot, Slots, Supervised};
use crate::unfinished::Sweeper;

/// A prepared run: its directory, control page and topics exist, and no process yet.
///
/// It must be run on the thread that stays: the kernel kills the children when the thread that started them ends.
#[derive(Debug)]
pub struct Launcher(Supervised);

impl Launcher {
    /// Makes the run's directory, manifest, control page and topics.
    ///
    /// # Errors
    /// When shared memory cannot be used or the graph contradicts itself; nothing is left then.
    pub fn prepare(plan: Plan) -> Result<Self, LaunchError> {
        let own: Vec<usize> = plan.messages.iter().map(|message| message.bytes).collect();
        limits::check_limits(plan.children.len(), &own)?;
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
        };
        manifest.write(&run)?;
        let control_page = ControlPage::create(&run)?;
        for fault in &plan.faults {
            if control_page
                .fault_table()
                .enter(fault, Origin::Planned)
                .is_none()
            {
                return Err(LaunchError::TooManyFaults {
                    count: plan.faults.len(),
                });
            }
        }
        let hub = Hub::create(&run, &manifest)?;
        let slots = plan.children.iter().map(|_| Slot::default()).collect();
        let _sweeper = Sweeper::start(&run)?;
        Ok(Self(Supervised {
            slots: Slots(slots),
            hub,
            _sweeper,
            control_page,
            run,
            plan,
            recalls_until: None,
            last_lines: Vec::new(),
        }))
    }

    /// The run's directory, for files that the processes shall find there (the scenario).
    pub fn run_dir(&self) -> &Path {
        self.0.run.path()
    }

    /// Starts all processes, watches them to the end, stops them and removes the run.
    ///
    /// # Errors
    /// When a process cannot be started or is not ready in time, or the run's files cannot be removed. A failure after the first tick
    /// is part of the [`Outcome`].
    pub fn run(self, commands: Commands<'_>, report: Report<'_>) -> Result<Outcome, LaunchError> {
        self.0.run_to_end(commands, report)
    }
}

impl Supervised {
    fn run_to_end(
        mut self,
        commands: Commands<'_>,
        report: Report<'_>,
    ) -> Result<Outcome, LaunchError> {
        let mut signals = Interrupts::catch().map_err(LaunchError::Signals)?;
        let _urgency = (self.plan.mode == Mode::Realtime).then(Urgency::begin);
        for index in 0..self.plan.children.len() {
            self.start(index, commands)?;
        }
        let mut has_begun = false;
        let end = match self.await_beginning(commands, &mut signals, report)? {
            Some(end) => end,
            None => {
                has_begun = true;
                report(Event::Go);
                self.watch(commands, &mut signals, report)
            }
        };
        report(Event::Stopping);
        let late_failure = self.stop(end == End::Completed, commands, &mut signals, report);
        report(Event::Stopped);
        let end = match (end, late_failure) {
            (End::Completed, Some(failure)) => End::Failed(failure),
            (end, _) => end,
        };
        if has_begun && let End::Failed(Failure::Died { process, .. }) = &end {
            self.enter_last_death(&process.clone());
        }
        let faults = self
            .control_page
            .fault_table()
            .records()
            .map(|(_, account)| account)
            .collect();
        let last_lines = std::mem::take(&mut self.last_lines);
        let outcome = Outcome {
            end,
            ticks: self.ticks(),
            processes: self.process_outcomes(),
            faults,
            guards: Vec::new(),
            last_lines,
        };
        let Self {
            slots,
            hub,
            control_page,
            run,
            ..
        } = self;
        drop((slots, hub, control_page));
        // The outcome stands, whatever is left.
        if let Err(error) = run.remove() {
            tracing::warn!(
                "the run has ended, but its shared memory could not be removed: {error}"
            );
        }
        Ok(outcome)
    }

    /// Waits until all processes have connected their ports. Returns the outcome if the run ends
    /// before.
    fn await_beginning(
        &mut self,
        commands: Commands<'_>,
        signals: &mut Interrupts,
        report: Report<'_>,
    ) -> Result<Option<End>, LaunchError> {
        let until = self.plan.limits.start.map(|limit| Instant::now() + limit);
        for (state, next) in [
            (State::Ready, Phase::Connect),
            (State::Connected, Phase::Work),
        ] {
            if let Err(end) = self.await_all(state, until, commands, signals, report) {
                return Ok(Some(end));
            }
            // The retainers too have their connections before the first message.
            self.hub.connect()?;
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
    ) -> Result<(), End> {
        loop {
            self.rest(Duration::from_millis(2));
            self.pass_lines_on(report);
            for index in self.take_in_exits(report) {
                // A process that was killed is replaced; one that has ended by itself says why it cannot begin.
                let is_killed = self.slots.0[index].exit.and_then(Exit::signal).is_some();
                let planned = if is_killed {
                    self.plan_restart(index)
                } else {
                    Err(self.died(index))
                };
                planned.map_err(End::Failed)?;
            }
            if let Some(failure) = self.start_again(commands, report) {
                return Err(End::Failed(failure));
            }
            if let Some(signal) = signals.pending() {
                return Err(End::Interrupted { signal });
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
                    return Err(End::Failed(Failure::Slow {
                        process: self.name(index).to_owned(),
                        limit,
                    }));
                }
                Some(index) => {
                    let halted = self.slots.0[index].child.as_ref().and_then(Child::halted);
                    self.note_delay(index, Some(halted.unwrap_or(Delay::NotReady)), report);
                }
            }
        }
    }
}
