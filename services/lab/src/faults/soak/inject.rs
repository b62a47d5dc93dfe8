//! Requests faults of a running graph and sends signals to its processes, each at its time.

use std::collections::BTreeMap;
use std::os::fd::OwnedFd;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use runtime::{ControlPage, Stop, now_ns, random};
use rustix::process::{Pid, PidfdFlags, Signal as Posix, pidfd_open, pidfd_send_signal};
use shared_types::graph::Graph;

use super::draw::{Act, Planned, Signal};

/// Restarts that a round's planned may cost a process: the budget is five, and a stop can turn into one more death.
const MOST_RESTARTS: u32 = 4;

/// Entries of the fault table for planned; the rest is for deaths that the launcher detects.
const MOST_REQUESTS: usize = 48;

/// The outcome of a planned fault.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Done {
    /// Requested of the fault table, at this place of it.
    Requested(usize),
    /// The process got its signal.
    Signalled,
    /// It would have ended the run before its time, or there was no process to inject it into.
    LeftOut(&'static str),
}

/// A planned that has executed.
#[derive(Clone, Debug)]
pub(super) struct Executed {
    /// Faults planned.
    pub planned: Planned,
    /// On `CLOCK_MONOTONIC`.
    pub at_ns: u64,
    /// Ticks that had begun.
    pub tick: u64,
    pub done: Done,
}

/// The next action.
enum Todo {
    ScheduledFault(Box<Planned>),
    Continue(OwnedFd),
    KillAgain(usize),
    /// The round has lasted long enough.
    Stop,
}

/// One run, seen by the injector.
pub(super) struct Injector<'a> {
    pub control_page: &'a ControlPage,
    /// As on the control_page.
    pub graph: &'a Graph,
    /// Which of them makes the ticks.
    pub source: usize,
    /// Ticks per second.
    pub rate_hz: u32,
    /// Seed.
    pub seed: u64,
}

impl Injector<'_> {
    /// Injects from the first tick, which `going` tells by a word, to the end of the run, which it tells by closing; and stops the run after
    /// `most_s`.
    pub(super) fn inject(
        &self,
        planned: Vec<Planned>,
        most_s: f64,
        going: &Receiver<()>,
    ) -> Vec<Executed> {
        let mut executed = Vec::new();
        if going.recv().is_err() {
            return executed;
        }
        let began = Instant::now();
        // In the order of their times; things of one time in the order in which they came.
        let (mut agenda, mut count) = (BTreeMap::new(), 0);
        let mut plan = |agenda: &mut BTreeMap<_, _>, at: Instant, todo| {
            count += 1;
            agenda.insert((at, count), todo);
        };
        for planned in planned {
            plan(
                &mut agenda,
                began + Duration::from_secs_f64(planned.at_s),
                Todo::ScheduledFault(Box::new(planned)),
            );
        }
        plan(
            &mut agenda,
            began + Duration::from_secs_f64(most_s),
            Todo::Stop,
        );
        while let Some(((at, _), todo)) = agenda.pop_first() {
            match going.recv_timeout(at.saturating_duration_since(Instant::now())) {
                Err(RecvTimeoutError::Timeout) | Ok(()) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            match todo {
                Todo::ScheduledFault(planned) => {
                    let (at_ns, tick) = (now_ns(), self.control_page.process(self.source).ticks());
                    let (done, next) = self.deliver(&planned, executed.len() as u64);
                    if let Some((after, todo)) = next {
                        plan(&mut agenda, Instant::now() + after, todo);
                    }
                    executed.push(Executed {
                        planned: *planned,
                        at_ns,
                        tick,
                        done,
                    });
                }
                Todo::Continue(process) => drop(pidfd_send_signal(process, Posix::CONT)),
                Todo::KillAgain(index) => drop(self.send(index, Posix::KILL)),
                Todo::Stop => self.control_page.request_stop(Stop::Chain),
            }
        }
        executed
    }

    fn deliver(&self, planned: &Planned, number: u64) -> (Done, Option<(Duration, Todo)>) {
        let Some(target) = self.graph.target(planned.act.process()) else {
            return (Done::LeftOut("no such process"), None);
        };
        let index = target.index as usize;
        let restarts = self
            .control_page
            .process(index)
            .incarnation()
            .saturating_sub(1);
        if !planned.is_fatal
            && planned.act.deaths() > 0
            && restarts + planned.act.deaths() > MOST_RESTARTS
        {
            return (Done::LeftOut("its restarts are needed"), None);
        }
        let ms = |ms: u32| Duration::from_millis(u64::from(ms));
        let signal = match &planned.act {
            Act::Fault(fault) => {
                let fault_table = self.control_page.fault_table();
                let scheduled = fault.schedule(&target, self.rate_hz, random(self.seed, number));
                let is_full = !planned.is_fatal && fault_table.records().count() >= MOST_REQUESTS;
                let place = scheduled
                    .ok()
                    .filter(|_| !is_full)
                    .and_then(|scheduled| fault_table.request(&scheduled));
                return (
                    place.map_or(Done::LeftOut("the fault table is full"), Done::Requested),
                    None,
                );
            }
            Act::Signal(_, signal) => *signal,
        };
        let sent = self.send(
            index,
            if matches!(signal, Signal::Kill | Signal::KillTwice(_)) {
                Posix::KILL
            } else {
                Posix::STOP
            },
        );
        let Some(process) = sent else {
            return (Done::LeftOut("it was down"), None);
        };
        let next = match signal {
            Signal::StopFor(after) => Some((ms(after), Todo::Continue(process))),
            Signal::KillTwice(after) => Some((ms(after), Todo::KillAgain(index))),
            Signal::Kill | Signal::Stop => None,
        };
        (Done::Signalled, next)
    }

    /// Sends a signal to a process of the run, and to no other that may have got its number: only a child of ours is meant.
    fn send(&self, index: usize, signal: Posix) -> Option<OwnedFd> {
        let pid = self.control_page.process(index).pid();
        let process = pidfd_open(Pid::from_raw(pid.cast_signed())?, PidfdFlags::empty()).ok()?;
        let (state, parent) = state_and_parent(pid)?;
        let is_ours = parent == std::process::id() && state != 'Z';
        (is_ours && pidfd_send_signal(&process, signal).is_ok()).then_some(process)
    }
}

/// A process's state as the kernel writes it, and its parent.
pub(super) fn state_and_parent(pid: u32) -> Option<(char, u32)> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The second field is the command in parentheses and may contain anything: count from its end.
    let mut fields = stat.rsplit_once(") ")?.1.split(' ');
    Some((fields.next()?.chars().next()?, fields.next()?.parse().ok()?))
}
