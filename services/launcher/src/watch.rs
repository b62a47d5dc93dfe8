//! The life of a run between its first tick and its end: deaths and silences.

use std::time::{Duration, Instant};

use runtime::{Exit, FaultRecord, Mode, State, Stop, now_ns};
use rustix::process::Signal;
use shared_types::fault::{Kind, Way};

use crate::delay::Delay;
use crate::launch::Halt;
use crate::outcome::{End, Failure};
use crate::plan::{Commands, Event, Report};
use crate::signals::Interrupts;
use crate::spawn::{BEAT, Supervised};

/// The run has waited for a process so long that a person notices: it is reported.
const NOTICED: Duration = Duration::from_secs(1);

/// The same for a process that is slow, which on a loaded machine is nothing unusual.
const NOTICED_SLOW: Duration = Duration::from_secs(5);

/// The longest real pause of a process that a fault pauses in lockstep.
const PAUSE_NS: u64 = 100_000_000;

/// Whether a fault has stopped its process in this way, and the process has not continued yet. The kind is
/// looked at too: a way is a number, 0 if a kind has none.
fn hangs(account: &FaultRecord, way: Way) -> bool {
    let fault = &account.scheduled;
    let is_in_force = account.injected_ns != 0 && account.recovered_ns == 0;
    fault.kind() == Some(Kind::Hang) && fault.way() == Some(way) && is_in_force
}

impl Supervised {
    /// Until the run is over for one reason or another.
    ///
    /// A signal ends it with the tick in hand, so that in lockstep every topic ends there and the run can be repeated to its last tick; after a second
    /// signal, or where that takes long, it ends at once.
    pub(crate) fn watch(
        &mut self,
        commands: Commands<'_>,
        signals: &mut Interrupts,
        report: Report<'_>,
    ) -> Halt {
        let mut ending: Option<(&'static str, Instant)> = None;
        let interrupted = |signal| Halt::End(End::Interrupted { signal });
        loop {
            self.rest(BEAT);
            self.pass_lines_on(report);
            let ticks = self.ticks();
            report(Event::Progress { ticks });
            if !self.run.path().exists() {
                return Halt::End(End::Failed(Failure::Emptied { tick: ticks }));
            }
            let again = self
                .stops_at
                .filter(|(_, at)| ticks >= *at && ending.is_none());
            match (
                again.map_or_else(|| signals.pending(), |(signal, _)| Some(signal)),
                ending,
            ) {
                (Some(signal), None) => {
                    self.control_page.request_stop(Stop::Ticks);
                    ending = Some((signal, Instant::now()));
                }
                (Some(signal), _) => return interrupted(signal),
                (None, Some((signal, since))) if since.elapsed() > self.plan.limits.stop => {
                    return interrupted(signal);
                }
                (None, _) => {}
            }
            if let Some(halt) = self.halt_of_ends(report) {
                return match (halt, ending) {
                    (Halt::End(End::Completed) | Halt::RollBack, Some((signal, _))) => {
                        interrupted(signal)
                    }
                    (halt, _) => halt,
                };
            }
            self.continue_paused();
            self.end_silence(report);
            if let Some(failure) = self.start_again(commands, report) {
                return Halt::End(End::Failed(failure));
            }
        }
    }

    /// The consequence of the processes that have ended since the last look.
    fn halt_of_ends(&mut self, report: Report<'_>) -> Option<Halt> {
        let ended = self.take_in_exits(report);
        let is_end = |index: &usize| {
            let slot = &self.slots[*index];
            let is_well = slot.is_done && slot.exit.is_some_and(Exit::is_success);
            self.plan.children[*index].ends_run && is_well
        };
        let end = ended.iter().copied().find(is_end);
        for index in ended.into_iter().filter(|index| Some(*index) != end) {
            if self.plan.mode == Mode::Lockstep {
                self.fall(index);
            } else if let Err(failure) = self.plan_restart(index) {
                return Some(Halt::End(End::Failed(failure)));
            }
        }
        if end.is_some() {
            return Some(Halt::End(End::Completed));
        }
        (!self.fallen.is_empty()).then_some(Halt::RollBack)
    }

    /// The time that so many ticks take, ns.
    pub(crate) fn duration_ns(&self, ticks: u64) -> u64 {
        ticks.saturating_mul(1_000_000_000 / u64::from(self.plan.rate_hz.max(1)))
    }

    /// Continues those that a fault has stopped for a time.
    fn continue_paused(&self) {
        for (_, account) in self.control_page.fault_table().records() {
            let FaultRecord {
                scheduled,
                injected_ns,
                ..
            } = account;
            if !hangs(&account, Way::Paused) {
                continue;
            }
            let passed_ns = self.duration_ns(scheduled.until.saturating_sub(scheduled.at));
            // In lockstep all others wait: the ticks of its absence come afterwards.
            let most_ns = match self.plan.mode {
                Mode::Lockstep => PAUSE_NS,
                Mode::Realtime => u64::MAX,
            };
            let since_ns = now_ns().saturating_sub(injected_ns);
            if (self.ticks() >= scheduled.until || since_ns >= passed_ns.min(most_ns))
                && let Some(child) = self
                    .slots
                    .get(scheduled.process as usize)
                    .and_then(|slot| slot.child.as_ref())
            {
                child.signal(Signal::CONT);
            }
        }
    }

    /// Whether a fault of the run has stopped a process in this way: for a time, or for ever, so that it is to be replaced.
    fn is_hung(&self, index: usize, way: Way) -> bool {
        let mut records = self.control_page.fault_table().records();
        records.any(|(_, record)| record.scheduled.process as usize == index && hangs(&record, way))
    }

    /// Kills processes that a fault has stopped for ever. If there is a time limit, also kills
    /// those that are silent for longer, because they are stopped from outside or stuck. The others
    /// are waited for, and that is reported.
    fn end_silence(&mut self, report: Report<'_>) {
        let source = self.ticks();
        let behind = self.stood_still();
        for index in 0..self.plan.children.len() {
            let (line, plan) = (self.control_page.process(index), &self.plan.children[index]);
            let slot = &mut self.slots[index];
            let Some(child) = slot.child.as_ref() else {
                continue;
            };
            let (ticks, now) = (line.ticks(), Instant::now());
            // A process that waits for a silent one is not silent itself.
            let signs = (ticks, line.looks());
            let since = match slot.seen {
                Some((seen, since)) if seen == signs => since,
                _ => {
                    (slot.seen, slot.delay) = (Some((signs, now)), None);
                    continue;
                }
            };
            let (silent, halted) = (now - since, child.halted());
            let is_stopped = halted == Some(Delay::Stopped);
            let faults = self.control_page.fault_table();
            if is_stopped {
                faults.mark_detected(index, source, now_ns());
            }
            let is_paused = self.is_hung(index, Way::Paused);
            let is_late = is_stopped
                || (ticks < source && !plan.process.is_polled() && line.state() == State::Running);
            let is_replaced = self.plan.mode == Mode::Lockstep
                || plan.process.makes_ticks
                || plan.most_restarts > 0;
            let limit = if is_stopped {
                self.plan.limits.stopped.or(plan.longest_stop)
            } else {
                self.plan.limits.silent
            };
            let is_over =
                limit.is_some_and(|limit| silent > limit) && is_late && is_replaced && !is_paused;
            let is_lost = line.state() == State::Stopped && self.is_hung(index, Way::ForEver);
            if is_over || is_stopped && is_lost {
                let slot = &mut self.slots[index];
                slot.child
                    .iter()
                    .for_each(|child| child.signal(Signal::KILL));
                slot.seen = None;
                faults.mark_detected(index, source, now_ns());
                let process = &self.plan.children[index].process;
                report(Event::Silenced {
                    process: &process.name,
                    silent,
                    tick: ticks,
                    writes: &process.writes,
                });
            } else if !is_paused {
                let is_behind = is_late && behind == Some(index);
                self.note_delay(index, halted.or(is_behind.then_some(Delay::Behind)), report);
            }
        }
    }

    /// Reports once that the run waits for a process, when that has lasted.
    pub(crate) fn note_delay(&mut self, index: usize, delay: Option<Delay>, report: Report<'_>) {
        let slot = &mut self.slots[index];
        let since = |delay| {
            slot.delay
                .filter(|(seen, ..)| *seen == delay)
                .unwrap_or((delay, Instant::now(), false))
        };
        slot.delay = delay.map(since);
        let Some((delay, since, false)) = slot.delay else {
            return;
        };
        let noticed = if matches!(delay, Delay::Stopped | Delay::Traced) {
            NOTICED
        } else {
            NOTICED_SLOW
        };
        if since.elapsed() >= noticed {
            slot.delay = Some((delay, since, true));
            let process = &self.plan.children[index].process;
            let tick = self.control_page.process(index).ticks();
            report(Event::Waiting {
                process: &process.name,
                reason: delay,
                tick,
                writes: &process.writes,
            });
        }
    }
}
