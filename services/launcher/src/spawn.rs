//! Starts the processes of a run, reads their output, and collects their exits.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use runtime::{ControlPage, Exit, Hub, PROCESS_VARIABLE, RUN_VARIABLE, RunDir, State, now_ns};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;

use crate::child::{Child, Ear};
use crate::delay::Delay;
use crate::launch::Fallen;
use crate::outcome::{LaunchError, ProcessOutcome};
use crate::plan::{Commands, Event, Plan, Report};
use crate::unfinished::Sweeper;

/// Interval of progress reports and checks for signals. An exit is detected at once.
pub(crate) const BEAT: Duration = Duration::from_millis(40);

/// A run and its processes.
#[derive(Debug)]
pub(crate) struct Supervised {
    // Dropped in this order: no child may outlive the control page, no file may outlive the directory.
    pub(crate) slots: Vec<Slot>,
    pub(crate) hub: Hub,
    /// Until the topics are gone: to remove what dead processes left may mean to wait for an unfinished segment.
    pub(crate) sweeper: Sweeper,
    pub(crate) control_page: ControlPage,
    pub(crate) run: RunDir,
    pub(crate) plan: Plan,
    /// Processes that have ended unasked in lockstep.
    pub(crate) fallen: Vec<Fallen>,
    /// By process: its planned ends before this start.
    pub(crate) planned_ends: Vec<usize>,
    /// An earlier start was ended by this signal at this tick: so is this one.
    pub(crate) stops_at: Option<(&'static str, u64)>,
    /// The last lines of processes that have ended unasked in real time, as in [`crate::Outcome`].
    pub(crate) last_lines: Vec<(usize, u64, String)>,
}

/// One process over all its incarnations.
#[derive(Debug, Default)]
pub(crate) struct Slot {
    pub(crate) child: Option<Child>,
    pub(crate) pid: u32,
    pub(crate) restarts: u32,
    pub(crate) exit: Option<Exit>,
    /// It has made all ticks before it ended.
    pub(crate) is_done: bool,
    /// The end of its standard error.
    pub(crate) last_words: Vec<String>,
    /// Listeners of ended processes: their later output goes nowhere.
    pub(crate) ears: Vec<Arc<Ear>>,
    /// When to start it again.
    pub(crate) due: Option<Instant>,
    /// The ticks it had done and how often it had looked for more, and when that was first seen: how long it has been silent.
    pub(crate) seen: Option<((u64, u32), Instant)>,
    /// For which reason the run waits for it, since when, and whether that has been reported.
    pub(crate) delay: Option<(Delay, Instant, bool)>,
}

impl Slot {
    /// Lines of its ended incarnations that nobody was given.
    pub(crate) fn unheard(&self) -> u64 {
        self.ears.iter().map(|ear| ear.unheard()).sum()
    }
}

impl Supervised {
    pub(crate) fn start(
        &mut self,
        index: usize,
        commands: Commands<'_>,
    ) -> Result<(), LaunchError> {
        let name = self.name(index).to_owned();
        let line = self.control_page.process(index);
        line.begin_incarnation();
        let (run, mut program) = (self.run.path(), PathBuf::new());
        let child = commands(&name, run).and_then(|mut command| {
            program = command.get_program().into();
            command.env(RUN_VARIABLE, run).env(PROCESS_VARIABLE, &name);
            Child::start(command)
        });
        let child = child.map_err(|source| LaunchError::Spawn {
            process: name,
            command: program,
            source,
        })?;
        line.set_pid(child.pid());
        let slot = &mut self.slots[index];
        (
            slot.pid, slot.exit, slot.due, slot.seen, slot.delay, slot.child,
        ) = (child.pid(), None, None, None, None, Some(child));
        Ok(())
    }

    /// The children whose ends have not been taken in.
    pub(crate) fn living(&self) -> impl Iterator<Item = &Child> {
        self.slots.iter().filter_map(|slot| slot.child.as_ref())
    }

    /// Sleeps until a child ends, a signal comes, or the time is over.
    pub(crate) fn rest(&self, limit: Duration) {
        let mut fds: Vec<PollFd<'_>> = self
            .living()
            .map(|child| PollFd::new(&child.pidfd, PollFlags::IN))
            .collect();
        let limit = Timespec {
            tv_sec: limit.as_secs() as i64,
            tv_nsec: i64::from(limit.subsec_nanos()),
        };
        // An error is an interruption by a signal, which the caller looks at anyway.
        let _ = poll(&mut fds, Some(&limit));
    }

    pub(crate) fn pass_lines_on(&mut self, report: Report<'_>) {
        for (slot, plan) in self.slots.iter().zip(&self.plan.children) {
            for line in slot.child.iter().flat_map(Child::new_lines) {
                report(Event::Line {
                    process: &plan.process.name,
                    line: &line,
                });
            }
        }
    }

    /// Processes that have ended since the last check.
    pub(crate) fn take_in_exits(&mut self, report: Report<'_>) -> Vec<usize> {
        let (ticks, mut ended) = (self.ticks(), Vec::new());
        for (index, slot) in self.slots.iter_mut().enumerate() {
            let Some(child) = slot.child.as_mut() else {
                continue;
            };
            let Some(exit) = child.try_wait() else {
                continue;
            };
            let (rest, last_words) = child.farewell();
            slot.ears.push(Arc::clone(&child.ear));
            for line in &rest {
                report(Event::Line {
                    process: &self.plan.children[index].process.name,
                    line,
                });
            }
            (slot.exit, slot.last_words, slot.child) = (Some(exit), last_words, None);
            let entry = self.control_page.process(index);
            slot.is_done = entry.state() == State::Done;
            entry.end();
            if !exit.is_success() {
                self.control_page
                    .fault_table()
                    .mark_detected(index, ticks, now_ns());
            }
            ended.push(index);
        }
        ended
    }

    /// The first process in the order of the data that is a tick behind its source and still runs: the others may have waited for it.
    pub(crate) fn stood_still(&self) -> Option<usize> {
        let ticks = |index: usize| self.control_page.process(index).ticks();
        let chain = (0..self.plan.children.len())
            .filter(|&index| !self.plan.children[index].process.is_polled());
        let ahead = chain.clone().map(ticks).max()?;
        let behind = chain.clone().find(|&index| ticks(index) < ahead)?;
        self.slots[behind].child.is_some().then_some(behind)
    }

    pub(crate) fn name(&self, index: usize) -> &str {
        &self.plan.children[index].process.name
    }

    pub(crate) fn ticks(&self) -> u64 {
        let mut children = self.plan.children.iter();
        let source = children.position(|child| child.ends_run);
        self.control_page.process(source.unwrap_or(0)).ticks()
    }

    pub(crate) fn process_outcomes(&self) -> Vec<ProcessOutcome> {
        let outcome = |(index, slot): (usize, &Slot)| ProcessOutcome {
            name: self.name(index).to_owned(),
            pid: slot.pid,
            restarts: slot.restarts,
            exit: slot
                .exit
                .unwrap_or(Exit::Signal(rustix::process::Signal::KILL.as_raw())),
            lines_dropped: slot.unheard(),
            counts: self.control_page.process(index).counts(),
        };
        self.slots.iter().enumerate().map(outcome).collect()
    }
}
