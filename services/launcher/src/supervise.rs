//! The life of a run, from the first child to the last file.

use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use runtime::{
    ControlPage, ControlPageError, FaultRecord, Hub, MOST_FAULTS, Manifest, ManifestError, Mode, Origin, Phase, Process, RunDir,
    RunDirError, State, Stop, TopicError, now_ns,
};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::Signal;
use rustix::time::Timespec;
use shared_types::fault::{Fault, Kind, ScheduledFault, Way};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use crate::child::{self, Exit};

/// How often progress is reported, and signals are looked at; an exit is noticed at once.
const BEAT: Duration = Duration::from_millis(40);

/// A process that does nothing for so long while it should is killed ...
const SILENCE: Duration = Duration::from_secs(2);

/// ... sooner where the kernel says that it is stopped.
const SILENCE_STOPPED: Duration = Duration::from_millis(100);

/// What to do when a process ends unasked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Restart {
    /// The run ends.
    Never,
    /// Start it again, up to so many times in the run, after a pause that doubles each time.
    Budget {
        /// How many times.
        times: u32,
        /// The first pause.
        back_off: Duration,
    },
}

/// A process to start.
#[derive(Clone, Debug)]
pub struct Child {
    /// As the others see it.
    pub process: Process,
    /// Its successful end is the end of the run (the plant has done all ticks).
    pub ends_run: bool,
    /// What to do when it ends unasked.
    pub restart: Restart,
}

/// How long the launcher is patient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Until all processes are ready.
    pub start: Duration,
    /// Until the asked have stopped, and again until the told have.
    pub stop: Duration,
    /// The same for the polled ones (the recorder has files to finish).
    pub stop_polled: Duration,
    /// The longest one process waits for another.
    pub wait: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        let seconds = Duration::from_secs;
        Self { start: seconds(20), stop: seconds(2), stop_polled: seconds(30), wait: seconds(10) }
    }
}

/// What to start, and how.
#[derive(Clone, Debug)]
pub struct Plan {
    /// How time passes.
    pub mode: Mode,
    /// Ticks per second of the arm's time.
    pub rate_hz: u32,
    /// The processes, in the order of the data: sources first.
    pub children: Vec<Child>,
    /// How long the launcher is patient.
    pub limits: Limits,
    /// What goes wrong, and when.
    pub faults: Vec<ScheduledFault>,
}

/// What happens while a run goes on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// All processes are ready: the first tick begins.
    Go,
    /// So many ticks are done; reported regularly.
    Progress {
        /// Ticks that the process whose end ends the run has begun.
        ticks: u64,
    },
    /// A process wrote a line to its standard error.
    Line {
        /// Which.
        process: &'a str,
        /// What.
        line: &'a str,
    },
    /// A process did nothing more and has been killed for it.
    Silenced {
        /// Which.
        process: &'a str,
        /// For how long it had done nothing.
        silent: Duration,
    },
    /// A process ended unasked and has been started again.
    Restarted {
        /// Which.
        process: &'a str,
        /// How it had ended.
        exit: Exit,
        /// Its new process id.
        pid: u32,
        /// How often it has been started by now.
        incarnation: u32,
    },
    /// The processes are asked to stop.
    Stopping,
    /// All processes have ended; the run's directory is about to be removed: the last moment to read what they left there.
    Stopped,
}

/// Why a run could not be prepared; nothing of it is left.
#[derive(Debug, thiserror::Error)]
pub enum LaunchError {
    /// Its directory.
    #[error(transparent)]
    RunDir(#[from] RunDirError),
    /// Its manifest.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    /// Its control page.
    #[error(transparent)]
    ControlPage(#[from] ControlPageError),
    /// Its topics.
    #[error(transparent)]
    Topic(#[from] TopicError),
    /// A process.
    #[error("cannot start {process} ({command}): {source}")]
    Spawn {
        /// Which.
        process: String,
        /// The command.
        command: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// More faults than a run can have.
    #[error("{count} faults are planned, a run has room for {MOST_FAULTS}: take some out")]
    TooManyFaults {
        /// How many.
        count: usize,
    },
    /// A process that died before the first tick.
    #[error("{0}")]
    NotReady(Failure),
    /// Ctrl-C before the first tick.
    #[error("stopped by {signal} before the first tick")]
    Interrupted {
        /// Which signal.
        signal: &'static str,
    },
    /// Signals cannot be caught.
    #[error("cannot catch SIGINT, SIGTERM and SIGHUP: {0}")]
    Signals(io::Error),
    /// Its files cannot be removed.
    #[error("the run has ended but its files are left: {0}")]
    LeftBehind(RunDirError),
}

/// What went wrong in a run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// A process ended unasked.
    #[error("{process} (process {pid}) ended unexpectedly with {exit} at tick {tick}{}{}{}", spent(*restarts), hint(suspect), said(last_words))]
    Died {
        /// Which.
        process: String,
        /// Its process id.
        pid: u32,
        /// How.
        exit: Exit,
        /// Ticks it had done.
        tick: u64,
        /// How often it had been started again.
        restarts: u32,
        /// Another process that had fallen behind before, which may be the reason.
        suspect: Option<String>,
        /// The end of its standard error.
        last_words: Vec<String>,
    },
    /// A process did not get ready.
    #[error("{process} was not ready for the first tick within {limit:?}")]
    Slow {
        /// Which.
        process: String,
        /// The limit.
        limit: Duration,
    },
    /// A process did not stop when asked and told to.
    #[error("{process} (process {pid}) did not stop within {limit:?} and was killed")]
    DidNotStop {
        /// Which.
        process: String,
        /// Its process id.
        pid: u32,
        /// The limit.
        limit: Duration,
    },
}

fn spent(restarts: u32) -> String {
    if restarts == 0 { String::new() } else { format!(" after {restarts} restarts, all that its budget allows") }
}

fn hint(suspect: &Option<String>) -> String {
    suspect.as_ref().map(|name| format!(" ({name} had stood still before)")).unwrap_or_default()
}

fn said(last_words: &[String]) -> String {
    if last_words.is_empty() { String::new() } else { format!("; it said:\n  {}", last_words.join("\n  ")) }
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// All ticks are done.
    Completed,
    /// By a signal to the launcher.
    Interrupted {
        /// Which signal.
        signal: &'static str,
    },
    /// Something went wrong.
    Failed(Failure),
}

/// What became of one process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessOutcome {
    /// Its name.
    pub name: String,
    /// The process id of its last incarnation.
    pub pid: u32,
    /// How often it was started again.
    pub restarts: u32,
    /// How its last incarnation ended.
    pub exit: Exit,
    /// Everything it counted, by name: missed deadlines by cause, refused, lost and repeated messages.
    pub counts: runtime::Counts,
}

/// What became of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// How it ended.
    pub end: End,
    /// Ticks done.
    pub ticks: u64,
    /// Its processes, in the order of the plan.
    pub processes: Vec<ProcessOutcome>,
    /// Its faults, planned and live, in the order in which they were known.
    pub faults: Vec<FaultRecord>,
}

/// The usual command for a process: this same program again, `armplane NAME --run DIR`.
///
/// # Errors
/// When the operating system does not say where this program lies.
pub fn reexec(process: &str, run: &Path) -> io::Result<Command> {
    let mut command = Command::new(std::env::current_exe()?);
    command.arg(process).arg("--run").arg(run);
    Ok(command)
}

/// Whether a fault has stopped its process for a time, and it has not gone on yet. The kind is looked at too: a way is a number, 0 where a kind
/// has none.
fn is_paused(account: &FaultRecord) -> bool {
    let FaultRecord { scheduled: strike, injected_ns, recovered_ns, .. } = account;
    strike.kind() == Some(Kind::Hang) && strike.way() == Some(Way::Paused) && *injected_ns != 0 && *recovered_ns == 0
}

/// Whether a fault ends its process, by itself or through the launcher.
fn ends_process(fault: &ScheduledFault) -> bool {
    match fault.kind() {
        Some(Kind::Kill | Kind::Crash) => true,
        Some(Kind::Hang) => fault.way() == Some(Way::ForEver),
        _ => false,
    }
}

/// A prepared run: its directory, control page and topics exist, and no process yet.
///
/// It must be run on the thread that stays: the kernel kills the children when the thread that started them ends.
#[derive(Debug)]
pub struct Launcher {
    // Dropped in this order: no child may live without the control page, no file may outlive the directory.
    nursery: Nursery,
    hub: Hub,
    control_page: ControlPage,
    run: RunDir,
    plan: Plan,
}

#[derive(Debug, Default)]
struct Nursery(Vec<Slot>);

impl Drop for Nursery {
    fn drop(&mut self) {
        for child in self.0.iter_mut().filter_map(|slot| slot.child.as_mut()) {
            child.kill_and_wait();
        }
    }
}

/// One process over all its incarnations.
#[derive(Default)]
struct Slot {
    child: Option<child::Child>,
    pid: u32,
    restarts: u32,
    exit: Option<Exit>,
    /// The end of its standard error.
    last_words: Vec<String>,
    /// When to start it again.
    due: Option<Instant>,
    /// The ticks it had done and how often it had looked for more, and when that was first seen: how long it has been silent.
    seen: Option<((u64, u32), Instant)>,
}

impl std::fmt::Debug for Slot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "process {} ({} restarts, {:?})", self.pid, self.restarts, self.exit)
    }
}

type Commands<'a> = &'a dyn Fn(&str, &Path) -> io::Result<Command>;
type Report<'a> = &'a mut dyn FnMut(Event<'_>);

impl Launcher {
    /// Makes the run's directory, manifest, control page and topics.
    ///
    /// # Errors
    /// When shared memory cannot be used or the graph contradicts itself; nothing is left then.
    pub fn prepare(plan: Plan) -> Result<Self, LaunchError> {
        let run = RunDir::create()?;
        let manifest = Manifest {
            mode: plan.mode,
            rate_hz: plan.rate_hz,
            wait_limit: plan.limits.wait,
            processes: plan.children.iter().map(|child| child.process.clone()).collect(),
        };
        manifest.write(&run)?;
        let control_page = ControlPage::create(&run)?;
        for fault in &plan.faults {
            if control_page.fault_table().enter(fault, Origin::Planned).is_none() {
                return Err(LaunchError::TooManyFaults { count: plan.faults.len() });
            }
        }
        let hub = Hub::create(&run, &manifest)?;
        let slots = plan.children.iter().map(|_| Slot::default()).collect();
        Ok(Self { nursery: Nursery(slots), hub, control_page, run, plan })
    }

    /// The run's directory, for files that the processes shall find there (the scenario).
    #[must_use]
    pub fn run_dir(&self) -> &Path {
        self.run.path()
    }

    /// Starts all processes, watches them to the end, stops them and removes the run.
    ///
    /// # Errors
    /// When a process cannot be started or is not ready in time, or the run's files cannot be removed. What goes wrong after the first tick
    /// is part of the [`Outcome`].
    pub fn run(mut self, commands: Commands<'_>, report: Report<'_>) -> Result<Outcome, LaunchError> {
        let mut signals = Interrupts::catch().map_err(LaunchError::Signals)?;
        let _urgency = (self.plan.mode == Mode::Realtime).then(Urgency::begin);
        for index in 0..self.plan.children.len() {
            self.start(index, commands)?;
        }
        let until = Instant::now() + self.plan.limits.start;
        for (state, next) in [(State::Ready, Phase::Connect), (State::Connected, Phase::Work)] {
            self.await_all(state, until, &mut signals, report)?;
            self.control_page.begin(next);
        }
        report(Event::Go);
        let end = self.watch(commands, &mut signals, report);
        report(Event::Stopping);
        let late_failure = self.stop(&mut signals, report);
        report(Event::Stopped);
        let end = match (end, late_failure) {
            (End::Completed, Some(failure)) => End::Failed(failure),
            (end, _) => end,
        };
        let faults = self.control_page.fault_table().records().map(|(_, account)| account).collect();
        let outcome = Outcome { end, ticks: self.ticks(), processes: self.process_outcomes(), faults };
        let Self { nursery, hub, control_page, run, .. } = self;
        drop((nursery, hub, control_page));
        run.remove().map_err(LaunchError::LeftBehind)?;
        Ok(outcome)
    }

    fn start(&mut self, index: usize, commands: Commands<'_>) -> Result<(), LaunchError> {
        let name = self.name(index).to_owned();
        let line = self.control_page.process(index);
        line.begin_incarnation();
        let command = commands(&name, self.run.path());
        let program = command.as_ref().map(|c| PathBuf::from(c.get_program())).unwrap_or_default();
        let child = command.and_then(child::Child::start);
        let child = child.map_err(|source| LaunchError::Spawn { process: name, command: program, source })?;
        line.set_pid(child.pid());
        let slot = &mut self.nursery.0[index];
        (slot.pid, slot.exit, slot.due, slot.seen, slot.child) = (child.pid(), None, None, None, Some(child));
        Ok(())
    }

    fn await_all(&mut self, state: State, until: Instant, signals: &mut Interrupts, report: Report<'_>) -> Result<(), LaunchError> {
        loop {
            self.rest(Duration::from_millis(2));
            self.pass_lines_on(report);
            if let Some(&index) = self.take_in_exits(report).first() {
                return Err(LaunchError::NotReady(self.died(index)));
            }
            if let Some(signal) = signals.pending() {
                return Err(LaunchError::Interrupted { signal });
            }
            let laggard = (0..self.plan.children.len()).find(|&index| self.control_page.process(index).state() != state);
            match laggard {
                None => return Ok(()),
                Some(index) if Instant::now() > until => {
                    return Err(LaunchError::NotReady(Failure::Slow {
                        process: self.name(index).to_owned(),
                        limit: self.plan.limits.start,
                    }));
                }
                Some(_) => {}
            }
        }
    }

    /// Until the run is over for one reason or another.
    fn watch(&mut self, commands: Commands<'_>, signals: &mut Interrupts, report: Report<'_>) -> End {
        loop {
            self.rest(BEAT);
            self.pass_lines_on(report);
            report(Event::Progress { ticks: self.ticks() });
            if let Some(signal) = signals.pending() {
                return End::Interrupted { signal };
            }
            for index in self.take_in_exits(report) {
                let slot = &mut self.nursery.0[index];
                let (child, exit) = (&self.plan.children[index], slot.exit);
                if child.ends_run && exit.is_some_and(Exit::is_success) {
                    return End::Completed;
                }
                match child.restart {
                    Restart::Budget { times, back_off } if slot.restarts < times => {
                        let pause = back_off * 2_u32.saturating_pow(slot.restarts);
                        slot.due = Some(Instant::now() + pause);
                        self.enter_death(index);
                    }
                    _ => return End::Failed(self.died(index)),
                }
            }
            self.continue_paused();
            self.end_silence(report);
            if let Some(failure) = self.start_again(commands, report) {
                return End::Failed(failure);
            }
        }
    }

    /// A death that a fault explains has been noticed; one that nobody planned becomes a fault, so that nobody waits for the dead, and
    /// so that the run can be repeated.
    fn enter_death(&self, index: usize) {
        let table = self.control_page.fault_table();
        // Each fault that ends its process has ended one incarnation. Where more have ended, the last one was killed by somebody else, perhaps
        // before it could take the place of one that a fault had ended.
        let has_ended = |account: &FaultRecord| {
            account.scheduled.process as usize == index && ends_process(&account.scheduled) && account.injected_ns != 0
        };
        let explained = table.records().filter(|(_, account)| has_ended(account)).count();
        let is_known = explained >= self.control_page.process(index).incarnation() as usize;
        if !is_known {
            let fault = Fault { at_tick: Some(self.first_tick_missed(index)), ..Fault::new(self.name(index), Kind::Kill) };
            // A process that the vocabulary does not know cannot be waited for by its ticks either.
            if let Ok(strike) = fault.schedule(index as u32, self.plan.rate_hz, 0)
                && let Some(place) = table.enter(&strike, Origin::Detected)
            {
                table.mark_injected(place, now_ns());
            }
        }
        table.mark_detected(index, self.ticks(), now_ns());
        self.control_page.ring_all();
    }

    /// The first tick of which nothing has come from a dead process. In lockstep everybody waits for it by now, so that its readers say how
    /// far it came: it may have died between sending and saying so. In real time nobody waits.
    fn first_tick_missed(&self, index: usize) -> u64 {
        let closed = self.control_page.process(index).ticks();
        if self.plan.mode == Mode::Realtime {
            return closed;
        }
        let process = &self.plan.children[index].process;
        let reads = |other: &Process| !other.polled && process.writes.iter().any(|topic| other.reads.contains(topic));
        // A reader that was down at the tick has passed over it, whatever was sent.
        let has_missed = |other: usize| {
            let is_it = |fault: &ScheduledFault| fault.process as usize == other && fault.concerns(closed);
            let takes_down = |fault: &ScheduledFault| fault.kind().is_some_and(Kind::takes_down);
            self.control_page.fault_table().records().any(|(_, record)| is_it(&record.scheduled) && takes_down(&record.scheduled))
        };
        let has_got = |(other, child): (usize, &Child)| {
            // Who makes the ticks says when it begins one, the others when they end it.
            let head_start = u64::from(child.process.makes_ticks);
            reads(&child.process) && self.control_page.process(other).ticks() > closed + head_start && !has_missed(other)
        };
        closed + u64::from(self.plan.children.iter().enumerate().any(has_got))
    }

    /// Continues those that a fault has stopped for a time.
    fn continue_paused(&self) {
        for (_, account) in self.control_page.fault_table().records() {
            let FaultRecord { scheduled: strike, injected_ns, .. } = account;
            if !is_paused(&account) {
                continue;
            }
            let passed_ns = strike.until.saturating_sub(strike.at).saturating_mul(1_000_000_000 / u64::from(self.plan.rate_hz.max(1)));
            if (self.ticks() >= strike.until || now_ns() >= injected_ns.saturating_add(passed_ns))
                && let Some(child) = self.nursery.0.get(strike.process as usize).and_then(|slot| slot.child.as_ref())
            {
                child.signal(Signal::CONT);
            }
        }
    }

    /// Kills those that do nothing more: stopped by somebody, or stuck.
    fn end_silence(&mut self, report: Report<'_>) {
        let source = self.ticks();
        for index in 0..self.plan.children.len() {
            let (line, plan) = (self.control_page.process(index), &self.plan.children[index]);
            let slot = &mut self.nursery.0[index];
            let Some(child) = slot.child.as_ref() else { continue };
            let (ticks, now) = (line.ticks(), Instant::now());
            // Who waits for another one that is silent is not silent itself.
            let signs = (ticks, line.looks());
            let is_replaced = plan.process.makes_ticks || plan.restart != Restart::Never;
            let since = match slot.seen {
                Some((seen, since)) if seen == signs && is_replaced => since,
                _ => {
                    slot.seen = Some((signs, now));
                    continue;
                }
            };
            let silent = now - since;
            if child.is_stopped() {
                self.control_page.fault_table().mark_detected(index, source, now_ns());
            }
            let limit = if child.is_stopped() { SILENCE_STOPPED } else { SILENCE };
            let is_late = child.is_stopped() || (ticks < source && !plan.process.polled && line.state() == State::Running);
            let is_paused = self
                .control_page
                .fault_table()
                .records()
                .any(|(_, account)| account.scheduled.process as usize == index && is_paused(&account));
            if is_late && !is_paused && silent > limit {
                child.signal(Signal::KILL);
                slot.seen = None;
                self.control_page.fault_table().mark_detected(index, source, now_ns());
                report(Event::Silenced { process: &plan.process.name, silent });
            }
        }
    }

    /// Starts those again whose pause is over.
    fn start_again(&mut self, commands: Commands<'_>, report: Report<'_>) -> Option<Failure> {
        for index in 0..self.plan.children.len() {
            let slot = &self.nursery.0[index];
            let (Some(due), Some(exit)) = (slot.due, slot.exit) else { continue };
            if Instant::now() < due {
                continue;
            }
            if let Err(error) = self.hub.clear_dead() {
                // Never into a half-open service: what the dead one left is cleared away first, or at the next look.
                tracing::warn!("{error}");
                continue;
            }
            if let Err(error) = self.start(index, commands) {
                tracing::error!("{error}");
                self.nursery.0[index].exit = Some(exit);
                return Some(self.died(index));
            }
            self.nursery.0[index].restarts += 1;
            let (pid, incarnation) = (self.nursery.0[index].pid, self.control_page.process(index).incarnation());
            report(Event::Restarted { process: self.name(index), exit, pid, incarnation });
        }
        None
    }

    /// Stops the chain, then the polled processes; returns the first thing that went wrong meanwhile.
    fn stop(&mut self, signals: &mut Interrupts, report: Report<'_>) -> Option<Failure> {
        let Limits { stop, stop_polled, .. } = self.plan.limits;
        self.control_page.request_stop(Stop::Chain);
        let chain = self.stop_those(false, stop, signals, report);
        self.control_page.request_stop(Stop::Everything);
        let polled = self.stop_those(true, stop_polled, signals, report);
        chain.or(polled)
    }

    fn stop_those(&mut self, polled: bool, limit: Duration, signals: &mut Interrupts, report: Report<'_>) -> Option<Failure> {
        let mut failure = None;
        let concerned: Vec<usize> =
            (0..self.plan.children.len()).filter(|&index| self.plan.children[index].process.polled == polled).collect();
        // Who has been stopped cannot end.
        self.signal(&concerned, Signal::CONT);
        for insist in [None, Some(Signal::TERM)] {
            if let Some(signal) = insist {
                self.signal(&concerned, signal);
            }
            let until = Instant::now() + limit;
            while self.any_lives(&concerned) && Instant::now() < until {
                self.rest(BEAT);
                self.pass_lines_on(report);
                for index in self.take_in_exits(report) {
                    if !self.nursery.0[index].exit.is_some_and(Exit::is_success) && failure.is_none() {
                        failure = Some(self.died(index));
                    }
                }
                // A second Ctrl-C: no more patience.
                if signals.pending().is_some() {
                    break;
                }
            }
        }
        for &index in &concerned {
            if let Some(child) = self.nursery.0[index].child.as_mut() {
                child.kill_and_wait();
                let did_not_stop = Failure::DidNotStop { process: self.name(index).to_owned(), pid: self.nursery.0[index].pid, limit };
                failure.get_or_insert(did_not_stop);
            }
        }
        self.take_in_exits(report);
        failure
    }

    fn signal(&self, concerned: &[usize], signal: Signal) {
        concerned.iter().filter_map(|&index| self.nursery.0[index].child.as_ref()).for_each(|child| child.signal(signal));
    }

    fn any_lives(&self, concerned: &[usize]) -> bool {
        concerned.iter().any(|&index| self.nursery.0[index].child.is_some())
    }

    /// Sleeps until a child ends, a signal comes, or the time is over.
    fn rest(&self, limit: Duration) {
        let living = self.nursery.0.iter().filter_map(|slot| slot.child.as_ref());
        let mut fds: Vec<PollFd<'_>> = living.map(|child| PollFd::new(&child.pidfd, PollFlags::IN)).collect();
        let limit = Timespec { tv_sec: limit.as_secs() as i64, tv_nsec: i64::from(limit.subsec_nanos()) };
        // An error is an interruption by a signal, which the caller looks at anyway.
        let _ = poll(&mut fds, Some(&limit));
    }

    fn pass_lines_on(&mut self, report: Report<'_>) {
        for (slot, plan) in self.nursery.0.iter_mut().zip(&self.plan.children) {
            for line in slot.child.as_mut().map(child::Child::new_lines).unwrap_or_default() {
                report(Event::Line { process: &plan.process.name, line: &line });
            }
        }
    }

    /// Which processes have ended since the last look.
    fn take_in_exits(&mut self, report: Report<'_>) -> Vec<usize> {
        let (ticks, mut ended) = (self.ticks(), Vec::new());
        for (index, slot) in self.nursery.0.iter_mut().enumerate() {
            let Some(child) = slot.child.as_mut() else { continue };
            let Some(exit) = child.try_wait() else { continue };
            let (rest, last_words) = child.farewell();
            for line in &rest {
                report(Event::Line { process: &self.plan.children[index].process.name, line });
            }
            (slot.exit, slot.last_words, slot.child) = (Some(exit), last_words, None);
            self.control_page.process(index).end();
            if !exit.is_success() {
                self.control_page.fault_table().mark_detected(index, ticks, now_ns());
            }
            ended.push(index);
        }
        ended
    }

    fn died(&self, index: usize) -> Failure {
        let slot = &self.nursery.0[index];
        Failure::Died {
            process: self.name(index).to_owned(),
            pid: slot.pid,
            exit: slot.exit.unwrap_or(Exit::Code(0)),
            tick: self.control_page.process(index).ticks(),
            restarts: slot.restarts,
            suspect: self.stood_still().filter(|&other| other != index).map(|other| self.name(other).to_owned()),
            last_words: slot.last_words.clone(),
        }
    }

    /// The first process in the order of the data that is a tick behind its source and still lives: the others may have waited for it.
    fn stood_still(&self) -> Option<usize> {
        let ticks = |index: usize| self.control_page.process(index).ticks();
        let chain = (0..self.plan.children.len()).filter(|&index| !self.plan.children[index].process.polled);
        let ahead = chain.clone().map(ticks).max()?;
        let behind = chain.clone().find(|&index| ticks(index) < ahead)?;
        self.nursery.0[behind].child.is_some().then_some(behind)
    }

    fn name(&self, index: usize) -> &str {
        &self.plan.children[index].process.name
    }

    fn ticks(&self) -> u64 {
        let source = self.plan.children.iter().position(|child| child.ends_run).unwrap_or(0);
        if self.plan.children.is_empty() { 0 } else { self.control_page.process(source).ticks() }
    }

    fn process_outcomes(&self) -> Vec<ProcessOutcome> {
        let outcome = |(index, slot): (usize, &Slot)| ProcessOutcome {
            name: self.name(index).to_owned(),
            pid: slot.pid,
            restarts: slot.restarts,
            exit: slot.exit.unwrap_or(Exit::Signal(rustix::process::Signal::KILL.as_raw())),
            counts: self.control_page.process(index).counts(),
        };
        self.nursery.0.iter().enumerate().map(outcome).collect()
    }
}

/// In real time whoever mends a death comes before ordinary work: the launcher, and a process until it has a priority of its own. Children
/// inherit it.
struct Urgency {
    is_raised: bool,
}

impl Urgency {
    /// Below every process of the graph that has a priority.
    const PRIORITY: u8 = 5;

    /// For this thread, where the machine allows.
    fn begin() -> Self {
        let raised = runtime::realtime::set_fifo_priority(Self::PRIORITY);
        let is_raised = raised.inspect_err(|missing| tracing::info!("the launcher runs without {missing}")).is_ok();
        Self { is_raised }
    }
}

impl Drop for Urgency {
    fn drop(&mut self) {
        if self.is_raised {
            runtime::realtime::set_ordinary_scheduling();
        }
    }
}

/// SIGINT, SIGTERM and SIGHUP to this process, taken in as long as somebody holds this; otherwise they do what they always do.
///
/// A run holds one; who makes several runs and cleans up after the last holds one over all of them.
pub struct Interrupts(Signals);

static IDLE: OnceLock<Arc<AtomicBool>> = OnceLock::new();
/// How many are held.
static HELD: AtomicUsize = AtomicUsize::new(0);

impl Interrupts {
    /// Takes the signals in from now on.
    ///
    /// # Errors
    /// When the kernel refuses.
    pub fn catch() -> io::Result<Self> {
        let signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
        if IDLE.get().is_none() {
            let idle = Arc::new(AtomicBool::new(false));
            for signal in [SIGINT, SIGTERM, SIGHUP] {
                signal_hook::flag::register_conditional_default(signal, Arc::clone(&idle))?;
            }
            let _ = IDLE.set(idle);
        }
        HELD.fetch_add(1, Ordering::SeqCst);
        Self::tell();
        Ok(Self(signals))
    }

    /// The name of a signal that has come since the last look.
    pub fn pending(&mut self) -> Option<&'static str> {
        self.0.pending().next().map(|signal| signal_hook::low_level::signal_name(signal).unwrap_or("a signal"))
    }

    fn tell() {
        if let Some(flag) = IDLE.get() {
            flag.store(HELD.load(Ordering::SeqCst) == 0, Ordering::SeqCst);
        }
    }
}

impl Drop for Interrupts {
    fn drop(&mut self) {
        HELD.fetch_sub(1, Ordering::SeqCst);
        Self::tell();
    }
}
