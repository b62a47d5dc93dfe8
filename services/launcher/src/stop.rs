//! Ends a run: asks processes to stop, then sends SIGTERM, then SIGKILL; polled processes come
//! last.

use std::time::{Duration, Instant};

use runtime::{Exit, Mode, State, Stop};
use rustix::process::Signal;

use crate::child::Child;
use crate::delay::Delay;
use crate::launch::Halt;
use crate::outcome::{End, Failure};
use crate::plan::{Event, Report};
use crate::signals::Interrupts;
use crate::spawn::{BEAT, Slot, Supervised};

/// A program that has not joined the run by then is stopped by signals.
const TO_JOIN: Duration = Duration::from_secs(1);

/// The ends of a process by the launcher's own hand.
const KILLED: Exit = Exit::Signal(Signal::KILL.as_raw());
const TERMINATED: Exit = Exit::Signal(Signal::TERM.as_raw());

impl Supervised {
    /// Stops all processes of a run that has ended so; in lockstep that may be the beginning of another start.
    pub(crate) fn stop_all(
        &mut self,
        end: End,
        signals: &mut Interrupts,
        report: Report<'_>,
    ) -> Halt {
        let late_failure = self.stop(end == End::Completed, signals, report);
        report(Event::Stopped);
        let is_polled = |index: usize| self.plan.children[index].process.is_polled();
        let lacks_record = self.fallen.iter().any(|one| is_polled(one.index));
        match (end, late_failure) {
            (End::Completed, Some(failure)) => Halt::End(End::Failed(failure)),
            (End::Completed | End::Interrupted { .. }, None) if lacks_record => Halt::RollBack,
            (end, _) => Halt::End(end),
        }
    }

    /// Stops the chain, then the polled processes; returns the first thing that went wrong meanwhile.
    ///
    /// A complete run has all its messages: of the chain nothing more is missing. Where a polled
    /// process has died, or dies now, all processes start again in lockstep; in real time the record
    /// ends with it.
    fn stop(
        &mut self,
        is_complete: bool,
        signals: &mut Interrupts,
        report: Report<'_>,
    ) -> Option<Failure> {
        self.control_page.request_stop(Stop::Chain);
        let chain = self.stop_those(false, is_complete, signals, report);
        // No process is replaced any more.
        self.slots.iter_mut().for_each(|slot| slot.due = None);
        self.control_page.request_stop(if is_complete {
            Stop::Everything
        } else {
            Stop::Early
        });
        let polled = self.stop_those(true, is_complete, signals, report);
        chain.or(polled)
    }

    /// Whether the unrequested end of a process at the end of a run is not its failure: the run is
    /// complete and it had nothing more to do, or it is a polled process, killed by a signal that the
    /// launcher did not send; `insists`: the launcher sent one, by which a process of the chain that was slow to end may do so.
    fn is_excused(&mut self, index: usize, is_complete: bool, insists: bool) -> bool {
        let (exit, child) = (self.slots[index].exit, &self.plan.children[index]);
        let (is_polled, is_killed) = (
            child.process.is_polled(),
            matches!(exit, Some(Exit::Signal(_))),
        );
        if is_complete && insists && !is_polled && exit == Some(TERMINATED) {
            return true;
        }
        if self.plan.mode == Mode::Lockstep {
            let is_excused =
                !insists && (is_complete && is_polled || is_killed && (is_complete || is_polled));
            if is_excused {
                self.fall(index);
            }
            return is_excused;
        }
        match is_polled {
            true => is_killed && (is_complete || !insists),
            false => is_complete && exit == Some(KILLED) && child.most_restarts > 0,
        }
    }

    /// Notes the end of a process as the failure of the run, if it is the first that is not excused.
    fn judge_end(
        &mut self,
        index: usize,
        is_complete: bool,
        insists: bool,
        failure: &mut Option<Failure>,
    ) {
        let is_success = self.slots[index].exit.is_some_and(Exit::is_success);
        if !is_success && !self.is_excused(index, is_complete, insists) && failure.is_none() {
            *failure = Some(self.died(index, 0));
        }
    }

    /// Stops the processes that are polled, or the others; the first thing that went wrong meanwhile. `is_complete`: the run has all its ticks.
    fn stop_those(
        &mut self,
        polled: bool,
        is_complete: bool,
        signals: &mut Interrupts,
        report: Report<'_>,
    ) -> Option<Failure> {
        let limits = self.plan.limits;
        let limit = if polled {
            limits.stop_polled
        } else {
            limits.stop
        };
        let is_patient = is_complete && !limits.kills_at_end;
        let mut failure = None;
        let concerned: Vec<usize> = (0..self.plan.children.len())
            .filter(|&index| self.plan.children[index].process.is_polled() == polled)
            .collect();
        // Ends that came with the one which ended the run, or between two of these stops.
        let ended = |slot: &Slot| slot.child.is_none() && slot.due.is_none() && slot.exit.is_some();
        for &index in &concerned {
            if ended(&self.slots[index]) {
                self.judge_end(index, is_complete, false, &mut failure);
            }
        }
        // A stopped process cannot end: first it goes on.
        for signal in [Signal::CONT, Signal::TERM] {
            self.living_of(&concerned)
                .for_each(|(_, child)| child.signal(signal));
            let (begun, is_last) = (Instant::now(), signal == Signal::TERM);
            while self.living_of(&concerned).next().is_some()
                && (begun.elapsed() < limit || is_patient && is_last)
                && !(begun.elapsed() > TO_JOIN && self.only_strangers_live(&concerned))
            {
                for &index in concerned.iter().filter(|_| is_last) {
                    let child = self.slots[index].child.as_ref();
                    let halted = child.map(|child| child.halted().unwrap_or(Delay::NotStopped));
                    self.note_delay(index, halted, report);
                }
                self.rest(BEAT);
                self.pass_lines_on(report);
                for index in self.take_in_exits(report) {
                    self.judge_end(index, is_complete, is_last, &mut failure);
                }
                // A second Ctrl-C: no more patience.
                if signals.pending().is_some() {
                    break;
                }
            }
        }
        for &index in &concerned {
            self.end_by_force(index, limit, &mut failure);
        }
        self.take_in_exits(report);
        failure
    }

    /// Kills all that still live: they start again. Those that have died by themselves are noted before.
    ///
    /// Of a process that was killed by others after the last look nobody can say whose SIGKILL it died of: it is not noted, for the launcher's was on
    /// its way. One that has ended in another way did not end by the launcher's.
    pub(crate) fn end_by_force_all(&mut self, report: Report<'_>) {
        loop {
            self.note_ends(report, |_| true);
            if !self.living().any(Child::is_dying) {
                break;
            }
            self.rest(BEAT);
        }
        self.living().for_each(|child| child.signal(Signal::KILL));
        while self.living().next().is_some() {
            self.rest(BEAT);
            self.note_ends(report, |exit| exit != KILLED);
        }
    }

    /// Takes in the ends since the last look, and notes those that were deaths: not that of a plant after its last tick.
    fn note_ends(&mut self, report: Report<'_>, is_noted: impl Fn(Exit) -> bool) {
        for index in self.take_in_exits(report) {
            let slot = &self.slots[index];
            let is_over = |exit: Exit| slot.is_done && exit.is_success();
            if slot
                .exit
                .is_some_and(|exit| is_noted(exit) && !is_over(exit))
            {
                self.fall(index);
            }
        }
    }

    /// Kills a process that has not stopped within `limit`.
    fn end_by_force(&mut self, index: usize, limit: Duration, failure: &mut Option<Failure>) {
        let slot = &mut self.slots[index];
        let pid = slot.pid;
        if let Some(child) = slot.child.as_mut() {
            child.kill_and_wait();
            let process = self.name(index).to_owned();
            failure.get_or_insert(Failure::DidNotStop {
                process,
                pid,
                limit,
            });
        }
    }

    /// Those of these processes whose ends have not been taken in.
    fn living_of(&self, concerned: &[usize]) -> impl Iterator<Item = (usize, &Child)> {
        concerned
            .iter()
            .filter_map(move |&index| Some((index, self.slots[index].child.as_ref()?)))
    }

    /// Whether those that live have not joined the run, and so do not see the request. The replacement of a process that had joined will join, too.
    fn only_strangers_live(&self, concerned: &[usize]) -> bool {
        self.living_of(concerned).all(|(index, _)| {
            self.slots[index].restarts == 0
                && self.control_page.process(index).state() == State::Starting
        })
    }
}
