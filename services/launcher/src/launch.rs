//! A run from its preparation to its outcome, over all starts of its processes.

use std::path::Path;
use std::time::Instant;

use runtime::{Mode, Stop};

use crate::limits;
use crate::outcome::{Death, End, Failure, LaunchError, Outcome};
use crate::plan::{Begin, Commands, Event, Newest, Plan, Report};
use crate::signals::{Interrupts, Urgency};
use crate::spawn::Supervised;

/// Most deaths without a plan for which the processes start again from the same cut.
const MOST_ROLL_BACKS: u32 = 5;

/// A prepared start of a run: its directory, control page and topics exist, and no process yet.
///
/// It must be run on the thread that stays: the kernel kills the children when the thread that started them ends.
#[derive(Debug)]
pub struct Launcher {
    started: Supervised,
    course: Course,
}

/// The part of a run that outlives each start of its processes.
#[derive(Debug)]
struct Course {
    signals: Interrupts,
    /// Unplanned deaths in lockstep.
    deaths: Vec<Death>,
    /// The place at which the first start began.
    first: Begin,
    /// Starts from the same cut after the first one, but for planned deaths.
    roll_backs: u32,
    /// By process: starts that its death has ended, and lines that nobody was given.
    restarts: Vec<(u32, u64)>,
    /// The signal that has ended the run and the ticks it had done, where the recorder was killed after that.
    interrupted: Option<(&'static str, u64)>,
}

/// The end of a start of the processes.
#[derive(Debug)]
pub enum Ran {
    /// It is that of the run.
    Ended(Box<Outcome>),
    /// A death in lockstep: all processes start again, and the bytes are those of a run without it.
    RolledBack(Box<Launcher>),
}

/// How watching ends.
pub(crate) enum Halt {
    /// The run ends.
    End(End),
    /// All processes start again.
    RollBack,
}

/// A process that has ended unasked in lockstep.
#[derive(Debug)]
pub(crate) struct Fallen {
    pub(crate) index: usize,
    pub(crate) is_planned: bool,
    pub(crate) death: Death,
}

impl Launcher {
    /// Makes the run's directory, manifest, control page and topics.
    ///
    /// # Errors
    /// When shared memory cannot be used or the graph contradicts itself; nothing is left then.
    pub fn prepare(plan: Plan) -> Result<Self, LaunchError> {
        limits::raise_open_files();
        let course = Course {
            signals: Interrupts::catch()?,
            deaths: Vec::new(),
            first: plan.begin.clone(),
            roll_backs: 0,
            restarts: vec![(0, 0); plan.children.len()],
            interrupted: None,
        };
        let started = Supervised::prepare(plan, None)?;
        Ok(Self { started, course })
    }

    /// The run's directory, for files that the processes shall find there (the scenario).
    pub fn run_dir(&self) -> &Path {
        self.started.run.path()
    }

    /// The place at which the processes begin.
    pub fn begin(&self) -> &Begin {
        &self.started.plan.begin
    }

    /// The deaths in lockstep so far, but for planned ones.
    pub fn deaths(&self) -> &[Death] {
        &self.course.deaths
    }

    /// Starts all processes, watches them to the end, stops them and removes the run's directory.
    ///
    /// # Errors
    /// When a process cannot be started or is not ready in time, or the run's files cannot be removed. A failure after the first tick
    /// is part of the [`Outcome`].
    pub fn run(
        mut self,
        commands: Commands<'_>,
        newest: Newest<'_>,
        report: Report<'_>,
    ) -> Result<Ran, LaunchError> {
        let began = Instant::now();
        let _urgency = (self.started.plan.mode == Mode::Realtime).then(Urgency::begin);
        let (started, course) = (&mut self.started, &mut self.course);
        for index in 0..started.plan.children.len() {
            started.start(index, commands)?;
        }
        started.stops_at = course.interrupted;
        let mut halt = match started.await_beginning(commands, &mut course.signals, report)? {
            Some(halt) => halt,
            None => started.watch(commands, &mut course.signals, report),
        };
        if let Halt::End(end) = halt {
            let signal = match end {
                End::Interrupted { signal } => Some(signal),
                _ => None,
            };
            halt = started.stop_all(end, &mut course.signals, report);
            course.interrupted = signal.map(|signal| (signal, started.ticks()));
        }
        match halt {
            Halt::RollBack => self.roll_back(began, newest, report),
            Halt::End(end) => Ok(Ran::Ended(Box::new(self.finish(end)))),
        }
    }

    /// Starts all processes again from the newest cut, unless that has no end.
    fn roll_back(
        mut self,
        began: Instant,
        newest: Newest<'_>,
        report: Report<'_>,
    ) -> Result<Ran, LaunchError> {
        let begin = newest(self.started.control_page.fault_table());
        let begin = begin.unwrap_or_else(|| self.course.first.clone());
        let (before, from) = (self.started.plan.begin.tick, begin.tick);
        if from > before {
            self.course.roll_backs = 0;
        }
        if let Some(failure) = self.course.end_of_patience(&self.started) {
            let end = End::Failed(failure);
            let (started, signals) = (&mut self.started, &mut self.course.signals);
            started.control_page.request_stop(Stop::Early);
            started.stop_all(end.clone(), signals, report);
            return Ok(Ran::Ended(Box::new(self.finish(end))));
        }
        self.started.end_by_force_all(report);
        let mut fallen = std::mem::take(&mut self.started.fallen);
        let done = self.started.ticks();
        let part = done.saturating_sub(from) as f64 / done.saturating_sub(before).max(1) as f64;
        let lost = began.elapsed().mul_f64(part.min(1.0));
        for one in &mut fallen {
            one.death.again = Some((from, lost));
        }
        let deaths: Vec<Death> = fallen.iter().map(|one| one.death.clone()).collect();
        report(Event::RolledBack {
            deaths: &deaths,
            from,
        });
        self.course.roll_backs += u32::from(fallen.iter().any(|one| !one.is_planned));
        for one in &fallen {
            self.course.restarts[one.index].0 += 1;
        }
        self.course.note(fallen);
        let Self {
            started,
            mut course,
        } = self;
        for (known, slot) in course.restarts.iter_mut().zip(&started.slots) {
            known.1 += slot.unheard();
        }
        let (plan, control_page) = started.dismantle();
        let plan = Plan { begin, ..plan };
        let started = Supervised::prepare(plan, Some(control_page.fault_table()))?;
        Ok(Ran::RolledBack(Box::new(Self { started, course })))
    }

    fn finish(mut self, end: End) -> Outcome {
        let (started, course) = (&mut self.started, &mut self.course);
        course.note(std::mem::take(&mut started.fallen));
        if started.plan.mode == Mode::Realtime
            && let End::Failed(Failure::Died { process, .. }) = &end
        {
            started.enter_last_death(process);
        }
        let outcome = course.outcome(end, started);
        self.started.dismantle();
        outcome
    }
}

/// Whether a process has ended for a reason of its own that would come again, after these earlier deaths, in a start from a tick on.
fn is_last(death: &Death, earlier: &[Death], begin: u64, most_restarts: u32) -> bool {
    let Death {
        process,
        tick,
        exit,
        ..
    } = death;
    let is_signal = exit.signal().is_some();
    let is_same = |one: &Death| (&one.process, one.tick, one.exit) == (process, *tick, *exit);
    // All that die before their first tick die at the same one, whenever and whatever for.
    let is_telling = !is_signal || *tick > begin;
    // A program that ends by itself before its first answer would read the same again.
    let is_sure = !is_signal && (most_restarts == 0 || *tick == 0);
    exit.is_own() && (is_sure || is_telling && earlier.iter().any(is_same))
}

impl Course {
    /// Why the deaths of a start are the end of the run: too many, or an error of its own that comes again, or whose process is not to be started again.
    fn end_of_patience(&self, started: &Supervised) -> Option<Failure> {
        let unplanned = || started.fallen.iter().filter(|one| !one.is_planned);
        let is_again = |one: &&Fallen| {
            let most = started.plan.children[one.index].most_restarts;
            is_last(&one.death, &self.deaths, started.plan.begin.tick, most)
        };
        let last = if self.roll_backs >= MOST_ROLL_BACKS {
            unplanned().next()
        } else {
            unplanned().find(is_again)
        };
        last.map(|one| started.died(one.index, self.roll_backs))
    }

    /// Keeps the deaths that no plan had.
    fn note(&mut self, fallen: Vec<Fallen>) {
        let unplanned = fallen.into_iter().filter(|one| !one.is_planned);
        self.deaths.extend(unplanned.map(|one| one.death));
    }

    fn outcome(&self, end: End, started: &Supervised) -> Outcome {
        let mut processes = started.process_outcomes();
        for (process, (restarts, unheard)) in processes.iter_mut().zip(&self.restarts) {
            process.restarts += restarts;
            process.lines_dropped += unheard;
        }
        let faults = started.control_page.fault_table().records();
        Outcome {
            end,
            ticks: started.ticks(),
            processes,
            faults: faults.map(|(_, account)| account).collect(),
            deaths: self.deaths.clone(),
            last_lines: started.last_lines.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use runtime::Exit;

    use super::*;

    #[test]
    fn an_error_that_comes_again_ends_the_run_and_a_crash_does_not_at_once() {
        let death = |tick, exit| Death {
            process: "plant".to_owned(),
            tick,
            exit,
            last_line: None,
            again: None,
        };
        let (crash, error, kill) = (Exit::Signal(11), Exit::Code(1), Exit::Signal(9));
        for (exit, tick, earlier, most_restarts, expected) in [
            (crash, 1420, None, 0, false),
            (crash, 1420, Some(1420), 0, true),
            (crash, 1420, Some(1420), 5, true),
            (crash, 1420, Some(1300), 5, false),
            (crash, 1000, Some(1000), 5, false),
            (error, 1000, Some(1000), 5, true),
            (error, 1420, None, 5, false),
            (error, 1420, None, 0, true),
            (kill, 1420, Some(1420), 0, false),
            (error, 0, None, 5, true),
            (crash, 0, None, 5, false),
        ] {
            let earlier: Vec<_> = earlier.map(|tick| death(tick, exit)).into_iter().collect();
            let found = is_last(&death(tick, exit), &earlier, 1000, most_restarts);
            assert_eq!(found, expected, "{exit} at {tick} after {earlier:?}");
        }
    }
}
