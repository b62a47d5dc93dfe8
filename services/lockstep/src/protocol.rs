//! The lockstep protocol, as pure decisions on a view of the run: closed ticks, waiting processes,
//! and the effects of deaths.
//!
//! ```text
//! tick k of a process     its messages of k are sent, or it is down at k; then k is closed and its tick count is k + 1
//! a reader at k           takes the message of k, or closes k as well once the writer has closed k without one
//! the tick source at k    begins k when no process lags by more than its buffers hold and every process due back by k is back; with faults, when
//!                         every process has closed k − 1
//! ```
//!
//! So a fault anywhere in the chain leads to a tick without torque, never to a wait for a message
//! that cannot come. All decisions follow from the outages in the fault table, the tick counts and
//! the states of the processes; none depends on a clock.

use shared_types::fault::ScheduledFault;

/// The constants of a process in the protocol.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Role {
    /// It makes the ticks: while it is stopped, there are none.
    pub makes_ticks: bool,
    /// It collects messages in rounds (the recorder); it closes no ticks for others.
    pub polled: bool,
}

/// Progress of a process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Progress {
    /// Ticks closed. The tick source counts a tick when its messages are sent, the others when they have answered.
    pub ticks: u64,
    /// How often it has been started.
    pub incarnation: u32,
    /// It works: started, connected, neither dead nor stopped.
    pub is_running: bool,
    /// It waits for the progress of the others.
    pub awaits_progress: bool,
}

/// A fault that takes a process down for some ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Outage {
    /// Place in the fault table.
    pub place: usize,
    /// Which process.
    pub process: usize,
    /// First tick without an answer.
    pub at: u64,
    /// First tick at which the process answers again.
    pub until: u64,
    /// It has taken effect.
    pub has_struck: bool,
    /// The process ends; otherwise it is paused and continues.
    pub is_death: bool,
    /// No plan had it: detected when it had happened.
    pub is_unplanned: bool,
    /// Outputs of the first tick that leave before the process ends.
    pub after_outputs: u32,
}

impl Outage {
    /// The one that a fault at a place of the table means; `None` for a fault that takes no process down.
    pub fn of(
        fault: &ScheduledFault,
        place: usize,
        has_struck: bool,
        is_unplanned: bool,
    ) -> Option<Self> {
        let kind = fault.kind().filter(|kind| kind.takes_down())?;
        Some(Self {
            place,
            process: fault.process as usize,
            at: fault.at,
            until: fault.until,
            has_struck,
            is_death: kind.ends_process(fault.way()),
            is_unplanned,
            after_outputs: fault.after_outputs(),
        })
    }

    fn covers(&self, tick: u64) -> bool {
        (self.at..self.until).contains(&tick)
    }

    /// Whether it comes between the outputs of a tick and has not come yet: the tick is not over before.
    fn is_due_within(&self, tick: u64) -> bool {
        self.after_outputs > 0 && self.at == tick && !self.has_struck
    }
}

/// The run at a moment, as one process sees it.
pub trait View {
    /// How many processes there are.
    fn processes(&self) -> usize;
    /// The role of a process.
    fn role(&self, process: usize) -> Role;
    /// How far a process has come.
    fn progress(&self, process: usize) -> Progress;
    /// Whether the run has faults of any kind. Without faults, every decision is that of a normal
    /// run.
    fn has_faults(&self) -> bool;
    /// All outages known, in the order of the fault table.
    fn outages(&self) -> impl Iterator<Item = Outage>;
    /// Whether ticks wait for all (lockstep), or pass by the clock (real time).
    fn is_lockstep(&self) -> bool;
    /// Ticks that the source may be ahead of a polled process: at most [`RECORDER_LAG`], less where messages are so large that fewer are kept.
    fn recorder_lag(&self) -> u64 {
        RECORDER_LAG
    }
    /// Ticks that the source may be ahead of any other process.
    fn chain_lag(&self) -> u64 {
        CHAIN_LAG
    }
}

/// Ticks that the source may be ahead of a polled process.
///
/// Far less than the messages that stay available to its replacement, also where faults make several messages of one tick, and with what a block
/// of a message log holds.
pub const RECORDER_LAG: u64 = 256;

/// Ticks that the source may be ahead of a process that is not polled: the buffer of a reader holds twice as many.
///
/// Whether the loop waits for a process is not in the graph: a program may declare that it reads a topic and never open it.
pub const CHAIN_LAG: u64 = 32;

/// The end of a process that no plan had, from a tick on of which so many messages have left.
///
/// It lasts longer than the source may be ahead of the process: when the replacement returns, none of its messages has been sent before it was connected.
pub fn unplanned_death(
    process: usize,
    at: u64,
    after_outputs: u32,
    rate_hz: u32,
) -> ScheduledFault {
    let death = ScheduledFault::death(process as u32, at, after_outputs, rate_hz);
    ScheduledFault {
        until: death.until.max(at.saturating_add(CHAIN_LAG + 2)),
        ..death
    }
}

/// To whom a process reports that it has closed a tick, beyond the readers of its messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Report {
    /// No process waits for anything but messages.
    Unneeded,
    /// The tick source waits for each process that it is too far ahead of.
    Source(usize),
    /// Everybody: readers of a dead writer wait for the beginning of a tick.
    Everybody,
}

/// The decisions of one process.
#[derive(Clone, Copy, Debug)]
pub struct Protocol<'a, V> {
    view: &'a V,
    me: usize,
}

impl<'a, V: View> Protocol<'a, V> {
    /// Those of process `me`, as it sees the run.
    pub fn new(view: &'a V, me: usize) -> Self {
        Self { view, me }
    }

    /// For a process that has been started again: whether the state committed for a tick may be the one from which it goes on, the newest such.
    /// None is in a first incarnation.
    ///
    /// A state that was committed for a tick of a death, this one or an earlier one, belongs to a message that never left.
    pub fn may_resume_from(&self, tick: u64) -> bool {
        let Progress {
            ticks: closed,
            incarnation,
            ..
        } = self.view.progress(self.me);
        if incarnation < 2 || !self.view.is_lockstep() {
            return incarnation >= 2;
        }
        let last = self
            .view
            .outages()
            .filter(|outage| {
                outage.process == self.me && (outage.at <= closed || outage.has_struck)
            })
            .last();
        last.is_none_or(|outage| tick < outage.at.max(closed)) && !self.is_down(self.me, tick)
    }

    fn processes(&self) -> std::ops::Range<usize> {
        0..self.view.processes()
    }

    fn source(&self) -> Option<usize> {
        self.processes()
            .find(|&process| self.view.role(process).makes_ticks)
    }

    /// Whether a process is dead or stopped at a tick.
    pub fn is_down(&self, process: usize, tick: u64) -> bool {
        let covers = |outage: Outage| {
            outage.process == process && outage.covers(tick) && !outage.is_due_within(tick)
        };
        self.view.has_faults() && self.view.outages().any(covers)
    }

    /// Whether a writer sends nothing more at a tick: it has closed the tick, or it is down and the tick has begun.
    pub fn has_closed(&self, writer: Option<usize>, tick: u64) -> bool {
        let Some(writer) = writer else { return false };
        // Where the tick source stands still there are no ticks: none is passed over. And no process runs ahead of it: what leaves late would
        // arrive in a tick of its own choosing.
        let has_begun = || {
            self.source()
                .is_none_or(|source| source != writer && self.view.progress(source).ticks > tick)
        };
        self.view.progress(writer).ticks > tick || (self.is_down(writer, tick) && has_begun())
    }

    /// For the tick source, before it begins a tick: a process for which it must wait.
    pub fn holds_back(&self, tick: u64) -> Option<usize> {
        self.lags(tick)
            .or_else(|| self.awaited(tick))
            .or_else(|| self.straggler(tick))
    }

    /// Whether a process has fallen by an outage that covers a tick: from then on it takes in nothing. Before, a planned one has not happened yet.
    fn has_fallen(&self, process: usize, tick: u64) -> bool {
        let has = |outage: Outage| {
            outage.process == process
                && outage.has_struck
                && outage.covers(tick)
                && !outage.is_due_within(tick)
        };
        self.view.has_faults() && self.view.outages().any(has)
    }

    /// A process that has more to take in than stays available.
    fn lags(&self, tick: u64) -> Option<usize> {
        let lags = |process: &usize| {
            let (role, closed) = (self.view.role(*process), self.view.progress(*process).ticks);
            let most = if role.polled {
                self.view.recorder_lag()
            } else {
                self.view.chain_lag()
            };
            !role.makes_ticks
                && tick > closed.saturating_add(most)
                && (role.polled || !self.has_fallen(*process, closed))
        };
        self.processes().find(lags)
    }

    /// For the tick source, before it ends: a process that has not closed all ticks before a tick.
    /// A polled process takes in the remaining messages afterwards.
    pub fn unfinished(&self, tick: u64) -> Option<usize> {
        let is_behind = |process: &usize| {
            let closed = self.view.progress(*process).ticks;
            *process != self.me
                && !self.view.role(*process).polled
                && closed < tick
                && !self.is_down(*process, closed)
        };
        self.processes().find(is_behind)
    }

    /// A process that the fault table has back by a tick, and that is not back.
    fn awaited(&self, tick: u64) -> Option<usize> {
        if !self.view.has_faults() {
            return None;
        }
        let is_late = |outage: &Outage| {
            let (role, progress) = (
                self.view.role(outage.process),
                self.view.progress(outage.process),
            );
            if outage.process == self.me {
                false
            } else if role.polled {
                // Nothing may be lost: everything waits at the tick of its death until its replacement works.
                outage.at <= tick && !(outage.has_struck && progress.is_running)
            } else {
                // A process that is late may not have died yet: it is back when it has these ticks behind it.
                let is_back = progress.is_running && progress.ticks >= outage.until;
                outage.until <= tick && !is_back && !role.makes_ticks
            }
        };
        self.view
            .outages()
            .find(is_late)
            .map(|outage| outage.process)
    }

    /// With faults: a process that is not through with the ticks before a tick. Where there is no
    /// torque to wait for, the source would run ahead, and a message of a later tick would be
    /// mistaken for the missing one of this tick.
    fn straggler(&self, tick: u64) -> Option<usize> {
        if self.view.has_faults() {
            self.unfinished(tick)
        } else {
            None
        }
    }

    /// Whether nothing of the ticks before a tick is still to be sent: the tick source waits, and all others have come as far.
    pub fn is_settled(&self, tick: u64) -> bool {
        let has_come = |process: usize| {
            let (role, progress) = (self.view.role(process), self.view.progress(process));
            match role.makes_ticks {
                true => progress.awaits_progress,
                false => {
                    process == self.me
                        || role.polled
                        || progress.ticks >= tick
                        || self.is_down(process, progress.ticks)
                }
            }
        };
        !self.view.is_lockstep() || self.processes().all(has_come)
    }

    /// The first tick at which this process, started again, may answer: after its last outage. 0: none is known.
    ///
    /// In real time a death that no plan had has no length: the replacement answers as soon as it can.
    pub fn returns_at(&self) -> u64 {
        let Progress {
            ticks: closed,
            incarnation,
            ..
        } = self.view.progress(self.me);
        if incarnation < 2 {
            return 0;
        }
        // A process that died between sending a tick and closing it is down from the next one on.
        let is_behind = |outage: &Outage| {
            outage.process == self.me
                && (self.view.is_lockstep() || !outage.is_unplanned)
                && (outage.at <= closed || outage.has_struck)
        };
        self.view
            .outages()
            .filter(is_behind)
            .map(|outage| outage.until)
            .max()
            .unwrap_or(0)
    }

    /// The fault that takes this process down at a tick. The tick source and a polled process are down at no tick but the first of an outage, because no
    /// tick passes meanwhile: each falls once. In real time every process does: a replacement that is there early does not fall again.
    pub fn downfall(&self, tick: u64) -> Option<Outage> {
        let role = self.view.role(self.me);
        let falls_once = role.polled || role.makes_ticks || !self.view.is_lockstep();
        let is_due = |outage: &Outage| {
            outage.covers(tick) && !outage.is_due_within(tick) && !(falls_once && outage.has_struck)
        };
        self.view
            .outages()
            .find(|outage| outage.process == self.me && is_due(outage))
    }

    /// The outage that takes this process down when so many of its outputs of a tick have left.
    pub fn downfall_after(&self, tick: u64, outputs: u32) -> Option<Outage> {
        let is_it = |outage: &Outage| {
            outage.process == self.me
                && outage.is_due_within(tick)
                && outage.after_outputs == outputs
        };
        self.view.outages().find(is_it)
    }

    /// The first tick of which a process has sent nothing more when it died without a plan: 0 if it has not. A message of an earlier tick may
    /// have reached the retainer of its topic and not all of its readers.
    pub fn sent_before_death(&self, process: usize) -> u64 {
        self.deaths(process)
            .filter(|(death, _)| death.is_unplanned)
            .map(|(_, end)| end)
            .max()
            .unwrap_or(0)
    }

    /// Likewise for its planned deaths between two ticks: of ticks from `from` on and below this one it has sent messages, and a reader that was not
    /// yet connected to an incarnation of few ticks has not received them.
    pub fn sent_before_planned_death(&self, process: usize, (from, before): (u64, u64)) -> u64 {
        let is_it =
            |(death, end): &(Outage, u64)| !death.is_unplanned && death.at < before && *end > from;
        self.deaths(process)
            .filter(is_it)
            .map(|(_, end)| end)
            .max()
            .unwrap_or(0)
    }

    /// The deaths of a process, each with the first tick of which the process has sent nothing.
    fn deaths(&self, process: usize) -> impl Iterator<Item = (Outage, u64)> {
        let is_it = move |outage: &Outage| outage.process == process && outage.is_death;
        self.view
            .outages()
            .filter(is_it)
            .map(|death| (death, death.at + u64::from(death.after_outputs > 0)))
    }

    /// For a process that has been started again: a death that came to its predecessor's replacement before that could answer. It must come again,
    /// so that the incarnations are those of the run that is repeated.
    pub fn downfall_at_start(&self) -> Option<Outage> {
        let (role, incarnation) = (
            self.view.role(self.me),
            self.view.progress(self.me).incarnation,
        );
        let returns_at = self.returns_at();
        if !self.view.is_lockstep() || role.polled || role.makes_ticks || returns_at == 0 {
            return None;
        }
        let before = |outage: &Outage| {
            outage.process == self.me && outage.is_death && outage.at < returns_at
        };
        let deaths = self.view.outages().filter(before).count();
        let is_next = |outage: &Outage| before(outage) && !outage.has_struck;
        if (incarnation as usize) <= deaths {
            self.view.outages().find(is_next)
        } else {
            None
        }
    }

    /// The tick count that this process takes on when nothing before `tick` will come of it any more; `None`: it stays.
    pub fn skips_to(&self, tick: u64) -> Option<u64> {
        let role = self.view.role(self.me);
        let closed = self.view.progress(self.me).ticks;
        (self.view.is_lockstep() && !role.polled && !role.makes_ticks && tick > closed)
            .then_some(tick)
    }

    /// The processes to inform that this process has closed a tick.
    pub fn reports_to(&self) -> Report {
        match self.source() {
            Some(source) if self.view.has_faults() => {
                if source == self.me {
                    Report::Everybody
                } else {
                    Report::Source(source)
                }
            }
            Some(source) if source != self.me && self.view.is_lockstep() => Report::Source(source),
            _ => Report::Unneeded,
        }
    }
}

#[cfg(test)]
#[path = "protocol_tests.rs"]
mod tests;
