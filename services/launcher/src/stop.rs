//! The end of a run: processes are asked to stop, then get SIGTERM, then SIGKILL; the polled ones last.

use std::time::{Duration, Instant};

use runtime::Stop;
use rustix::process::Signal;

use crate::child::Exit;
use crate::delay::Delay;
use crate::outcome::Failure;
use crate::plan::{Limits, Report};
use crate::signals::Interrupts;
use crate::spawn::{BEAT, Supervised};

impl Supervised {
    /// Stops the chain, then the polled processes; returns the first thing that went wrong meanwhile.
    pub(crate) fn stop(&mut self, is_complete: bool, signals: &mut Interrupts, report: Report<'_>) -> Option<Failure> {
        let Limits { stop, stop_polled, kills_at_end, .. } = self.plan.limits;
        let is_patient = is_complete && !kills_at_end;
        self.control_page.request_stop(Stop::Chain);
        let chain = self.stop_those(false, stop, is_patient, signals, report);
        self.control_page.request_stop(Stop::Everything);
        let polled = self.stop_those(true, stop_polled, is_patient, signals, report);
        chain.or(polled)
    }

    fn stop_those(
        &mut self,
        polled: bool,
        limit: Duration,
        is_patient: bool,
        signals: &mut Interrupts,
        report: Report<'_>,
    ) -> Option<Failure> {
        let mut failure = None;
        let concerned: Vec<usize> =
            (0..self.plan.children.len()).filter(|&index| self.plan.children[index].process.polled == polled).collect();
        // A process that somebody has stopped cannot end.
        self.signal(&concerned, Signal::CONT);
        for insist in [None, Some(Signal::TERM)] {
            if let Some(signal) = insist {
                self.signal(&concerned, signal);
            }
            let until = Instant::now() + limit;
            let is_last = insist.is_some();
            while self.any_lives(&concerned) && (Instant::now() < until || is_patient && is_last) {
                for &index in concerned.iter().filter(|_| is_last) {
                    let halted = self.slots.0[index].child.as_ref().map(|child| child.halted().unwrap_or(Delay::NotStopped));
                    self.note_delay(index, halted, report);
                }
                self.rest(BEAT);
                self.pass_lines_on(report);
                for index in self.take_in_exits(report) {
                    if !self.slots.0[index].exit.is_some_and(Exit::is_success) && failure.is_none() {
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
            if let Some(child) = self.slots.0[index].child.as_mut() {
                child.kill_and_wait();
                let did_not_stop = Failure::DidNotStop { process: self.name(index).to_owned(), pid: self.slots.0[index].pid, limit };
                failure.get_or_insert(did_not_stop);
            }
        }
        self.take_in_exits(report);
        failure
    }

    fn signal(&self, concerned: &[usize], signal: Signal) {
        concerned.iter().filter_map(|&index| self.slots.0[index].child.as_ref()).for_each(|child| child.signal(signal));
    }

    fn any_lives(&self, concerned: &[usize]) -> bool {
        concerned.iter().any(|&index| self.slots.0[index].child.is_some())
    }
}
