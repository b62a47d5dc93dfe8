//! The life of a run between its first tick and its end: deaths, silences, restarts.

use std::time::{Duration, Instant};

use runtime::{Exit, FaultRecord, Mode, Origin, State, Stop, now_ns, unplanned_death};
use rustix::process::Signal;
use shared_types::fault::{Kind, Way};

use crate::delay::Delay;
use crate::outcome::{End, Failure};
use crate::plan::{Commands, Event, Report, Restart};
use crate::signals::Interrupts;
use crate::spawn::{BEAT, Supervised};

/// The run has waited for a process so long that a person notices: it is reported.
const NOTICED: Duration = Duration::from_secs(1);

/// The same for a process that is slow, which on a loaded machine is nothing unusual.
const NOTICED_SLOW: Duration = Duration::from_secs(5);

/// Whether a fault has paused its process, and the process has not continued yet. The kind is
/// looked at too: a way is a number, 0 if a kind has none.
fn is_paused(account: &FaultRecord) -> bool {
    let FaultRecord {
        scheduled,
        injected_ns,
        recovered_ns,
        ..
    } = account;
    scheduled.kind() == Some(Kind::Hang)
        && scheduled.way() == Some(Way::Paused)
        && *injected_ns != 0
        && *recovered_ns == 0
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
    ) -> End {
        let mut ending: Option<(&'static str, Instant)> = None;
        loop {
            self.rest(BEAT);
            self.pass_lines_on(report);
            report(Event::Progress {
                ticks: self.ticks(),
            });
            match (signals.pending(), ending) {
                (Some(signal), None) => {
                    self.control_page.request_stop(Stop::Ticks);
                    ending = Some((signal, Instant::now()));
                }
                (Some(signal), _) => return End::Interrupted { signal },
                (None, Some((signal, since))) if since.elapsed() > self.plan.limits.stop => {
                    return End::Interrupted { signal };
                }
                (None, _) => {}
            }
            for index in self.take_in_exits(report) {
                let (child, exit) = (&self.plan.children[index], self.slots.0[index].exit);
                if child.ends_run && exit.is_some_and(Exit::is_success) {
                    return ending
                        .map_or(End::Completed, |(signal, _)| End::Interrupted { signal });
                }
                if let Err(failure) = self.plan_restart(index) {
                    return End::Failed(failure);
                }
            }
            self.continue_paused();
            self.end_silence(report);
            if let Some(failure) = self.start_again(commands, report) {
                return End::Failed(failure);
            }
        }
    }

    /// Plans the replacement of a process that has ended, as its budget allows.
    pub(crate) fn plan_restart(&mut self, index: usize) -> Result<(), Failure> {
        let slot = &mut self.slots.0[index];
        match self.plan.children[index].restart {
            Restart::Budget { times, back_off } if slot.restarts < times => {
                slot.due = Some(Instant::now() + back_off * 2_u32.saturating_pow(slot.restarts));
                self.enter_death(index)
            }
            _ => Err(self.died(index)),
        }
    }

    /// A death that a fault explains is detected; an unplanned one becomes a fault, so that no process waits for the dead one, and
    /// so that the run can be repeated.
    fn enter_death(&mut self, index: usize) -> Result<(), Failure> {
        let table = self.control_page.fault_table();
        if self.listed_end(index).is_none() {
            let (tick, sent) = self.left_off(index);
            let death = unplanned_death(index, tick, sent, self.plan.rate_hz);
            let Some(place) = table.enter(&death, Origin::Detected) else {
                return Err(Failure::NoRoom {
                    process: self.name(index).to_owned(),
                    tick,
                });
            };
            // Before the others learn of it: their words say how it ended.
            self.slots.0[index]
                .exit
                .into_iter()
                .for_each(|exit| table.mark_exit(index, exit));
            table.mark_injected(place, now_ns().saturating_sub(self.since_ns(tick)));
            // After the entry: a reader that finds the tick closed looks for its messages in the retainers' files.
            self.control_page.process(index).close_before(tick);
        }
        table.mark_detected(index, self.ticks(), now_ns());
        self.control_page.ring_all();
        if let Some(line) = self.slots.0[index].last_words.last() {
            let unplanned = table
                .records()
                .filter(|(_, account)| account.origin == Origin::Detected);
            let last = unplanned
                .filter(|(_, account)| account.scheduled.process as usize == index)
                .last();
            self.last_lines
                .extend(last.map(|(_, account)| (index, account.scheduled.at, line.clone())));
        }
        Ok(())
    }

    /// The time since a tick in real time, ns: so long ago a process died that did not answer it. In lockstep the others wait for it.
    fn since_ns(&self, tick: u64) -> u64 {
        match self.plan.mode {
            Mode::Realtime => self.duration_ns(self.ticks().saturating_sub(tick)),
            Mode::Lockstep => 0,
        }
    }

    /// The time that so many ticks take, ns.
    fn duration_ns(&self, ticks: u64) -> u64 {
        ticks.saturating_mul(1_000_000_000 / u64::from(self.plan.rate_hz.max(1)))
    }

    /// Enters the death that has ended the run, which no replacement follows. After the stop: until then the others would go on without the dead process.
    pub(crate) fn enter_last_death(&mut self, process: &str) {
        let index = (0..self.plan.children.len()).find(|&index| self.name(index) == process);
        // One that was to be replaced has been entered.
        if let Some(index) = index.filter(|&index| self.slots.0[index].due.is_none()) {
            // A full table leaves the failure of the run, which has the same words.
            let _ = self.enter_death(index);
        }
    }

    pub(crate) fn died(&self, index: usize) -> Failure {
        let slot = &self.slots.0[index];
        let exit = slot.exit.unwrap_or(Exit::Code(0));
        // A process that gave up a wait ends by itself; of a signal the others are innocent.
        let suspect = self
            .stood_still()
            .filter(|&other| other != index && matches!(exit, Exit::Code(_)));
        Failure::Died {
            process: self.name(index).to_owned(),
            pid: slot.pid,
            exit,
            tick: self.tick_of_end(index),
            restarts: slot.restarts,
            suspect: suspect.map(|other| self.name(other).to_owned()),
            last_words: slot.last_words.clone(),
        }
    }

    /// The first tick that a process which has ended did not answer, as the fault table has it or will have it.
    fn tick_of_end(&self, index: usize) -> u64 {
        self.listed_end(index)
            .unwrap_or_else(|| self.left_off(index).0)
    }

    /// The tick at which the fault table has the death of a process's last incarnation, if any.
    ///
    /// Each fault that ends its process has ended one incarnation. Where more have ended, the last one was killed from outside, perhaps before it could
    /// take the place of one that a fault had ended.
    fn listed_end(&self, index: usize) -> Option<u64> {
        let has_ended = |account: &FaultRecord| {
            account.scheduled.process as usize == index
                && account.scheduled.ends_process()
                && account.injected_ns != 0
        };
        let ends = || {
            self.control_page
                .fault_table()
                .records()
                .map(|(_, account)| account)
                .filter(has_ended)
        };
        let is_listed = ends().count() >= self.control_page.process(index).incarnation() as usize;
        // The table has the planned ones first, and in the order of the plan: the last end is the one that has come about last.
        if is_listed {
            ends()
                .max_by_key(|account| account.injected_ns)
                .map(|account| account.scheduled.at)
        } else {
            None
        }
    }

    /// State of a dead process's outputs: the first incomplete tick, and the number of its messages
    /// that were sent.
    ///
    /// A process may die between sending and closing a tick, or between two messages of one tick. The retainers of its topics show which; the ticks
    /// that its readers have closed do not, because a tick closes without a message too. In real time no reader waits.
    fn left_off(&self, index: usize) -> (u64, u32) {
        let closed = self.control_page.process(index).ticks();
        let process = &self.plan.children[index].process;
        if self.plan.mode == Mode::Realtime || process.writes.is_empty() {
            return (closed, 0);
        }
        let sent = self
            .hub
            .outputs_sent(&process.writes, closed)
            .unwrap_or_else(|error| {
                tracing::warn!("{error}");
                0
            });
        // The tick source closes a tick when its messages have left, the others when they have answered: both after the last of them.
        if sent as usize >= process.writes.len() {
            (closed + 1, 0)
        } else {
            (closed, sent)
        }
    }

    /// Continues those that a fault has stopped for a time.
    fn continue_paused(&self) {
        for (_, account) in self.control_page.fault_table().records() {
            let FaultRecord {
                scheduled,
                injected_ns,
                ..
            } = account;
            if !is_paused(&account) {
                continue;
            }
            let passed_ns = self.duration_ns(scheduled.until.saturating_sub(scheduled.at));
            if (self.ticks() >= scheduled.until
                || now_ns() >= injected_ns.saturating_add(passed_ns))
                && let Some(child) = self
                    .slots
                    .0
                    .get(scheduled.process as usize)
                    .and_then(|slot| slot.child.as_ref())
            {
                child.signal(Signal::CONT);
            }
        }
    }

    /// Whether a fault of the run has stopped a process for ever: it is to be replaced.
    fn is_hung_by_fault(&self, index: usize) -> bool {
        let hangs = |record: &FaultRecord| {
            let fault = &record.scheduled;
            fault.process as usize == index
                && fault.kind() == Some(Kind::Hang)
                && fault.way() == Some(Way::ForEver)
        };
        let is_in_force =
            |record: &FaultRecord| record.injected_ns != 0 && record.recovered_ns == 0;
        self.control_page.process(index).state() == State::Stopped
            && self
                .control_page
                .fault_table()
                .records()
                .any(|(_, record)| hangs(&record) && is_in_force(&record))
    }

    /// Kills processes that a fault has stopped for ever. If there is a time limit, also kills
    /// those that are silent for longer, because they are stopped from outside or stuck. The others
    /// are waited for, and that is reported.
    fn end_silence(&mut self, report: Report<'_>) {
        let source = self.ticks();
        let behind = self.stood_still();
        for index in 0..self.plan.children.len() {
            let (line, plan) = (self.control_page.process(index), &self.plan.children[index]);
            let slot = &mut self.slots.0[index];
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
            let is_paused = faults.records().any(|(_, account)| {
                account.scheduled.process as usize == index && is_paused(&account)
            });
            let is_late = is_stopped
                || (ticks < source && !plan.process.polled && line.state() == State::Running);
            let is_replaced = plan.process.makes_ticks || plan.restart != Restart::Never;
            let limit = if is_stopped {
                self.plan.limits.stopped
            } else {
                self.plan.limits.silent
            };
            let is_over =
                limit.is_some_and(|limit| silent > limit) && is_late && is_replaced && !is_paused;
            if is_over || is_stopped && self.is_hung_by_fault(index) {
                let slot = &mut self.slots.0[index];
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
        let slot = &mut self.slots.0[index];
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

    /// Starts those again whose pause is over.
    pub(crate) fn start_again(
        &mut self,
        commands: Commands<'_>,
        report: Report<'_>,
    ) -> Option<Failure> {
        for index in 0..self.plan.children.len() {
            let slot = &self.slots.0[index];
            let (Some(due), Some(exit)) = (slot.due, slot.exit) else {
                continue;
            };
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
                self.slots.0[index].exit = Some(exit);
                return Some(self.died(index));
            }
            self.slots.0[index].restarts += 1;
            let (pid, incarnation) = (
                self.slots.0[index].pid,
                self.control_page.process(index).incarnation(),
            );
            report(Event::Restarted {
                process: self.name(index),
                exit,
                pid,
                incarnation,
            });
        }
        None
    }
}
