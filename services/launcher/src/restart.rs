//! The consequence of the unasked end of a process: in real time its replacement, in lockstep a new
//! start of all.

use std::time::{Duration, Instant};

use runtime::{Exit, FaultRecord, Mode, Origin, now_ns};
use shared_types::fault::ScheduledFault;

use crate::launch::Fallen;
use crate::outcome::{Death, Failure};
use crate::plan::{Commands, Event, Report};
use crate::spawn::Supervised;

/// The pause before a process is started again for the first time; it doubles each time.
const BACK_OFF: Duration = Duration::from_millis(10);

impl Supervised {
    /// In lockstep: a process has ended unasked. Nothing follows it in this start, so that it is noted once.
    pub(crate) fn fall(&mut self, index: usize) {
        if self.fallen.iter().any(|one| one.index == index) {
            return;
        }
        let is_planned = self.planned_ends(index) > self.planned_ends[index];
        let slot = &self.slots[index];
        let death = Death {
            process: self.name(index).to_owned(),
            tick: self.tick_of_end(index),
            exit: slot.exit.unwrap_or(Exit::Code(0)),
            last_line: slot.last_words.last().cloned(),
            again: None,
        };
        self.fallen.push(Fallen {
            index,
            is_planned,
            death,
        });
    }

    /// Faults that have ended a process, in this start or an earlier one.
    pub(crate) fn planned_ends(&self, index: usize) -> usize {
        self.ends(index)
            .filter(|account| account.origin != Origin::Detected)
            .count()
    }

    fn ends(&self, index: usize) -> impl Iterator<Item = FaultRecord> {
        self.control_page
            .fault_table()
            .records()
            .map(|(_, account)| account)
            .filter(move |account| {
                account.scheduled.process as usize == index
                    && account.scheduled.ends_process()
                    && account.injected_ns != 0
            })
    }

    /// In real time: plans the replacement of a process that has ended, as its budget allows.
    pub(crate) fn plan_restart(&mut self, index: usize) -> Result<(), Failure> {
        let slot = &mut self.slots[index];
        if slot.restarts >= self.plan.children[index].most_restarts {
            return Err(self.died(index, 0));
        }
        slot.due = Some(Instant::now() + BACK_OFF * 2_u32.saturating_pow(slot.restarts));
        self.enter_death(index)
    }

    /// A death that a fault explains is detected; an unplanned one is entered, for its account.
    fn enter_death(&mut self, index: usize) -> Result<(), Failure> {
        let table = self.control_page.fault_table();
        if self.listed_end(index).is_none() {
            let tick = self.control_page.process(index).end_tick();
            let death = ScheduledFault::death(index as u32, tick, self.plan.rate_hz);
            let Some(place) = table.enter(&death, Origin::Detected) else {
                return Err(Failure::NoRoom {
                    process: self.name(index).to_owned(),
                    tick,
                });
            };
            // Before the others learn of it: their words say how it ended.
            self.slots[index]
                .exit
                .into_iter()
                .for_each(|exit| table.mark_exit(index, exit));
            let since_ns = self.duration_ns(self.ticks().saturating_sub(tick));
            table.mark_injected(place, now_ns().saturating_sub(since_ns));
        }
        table.mark_detected(index, self.ticks(), now_ns());
        self.control_page.ring_all();
        if let Some(line) = self.slots[index].last_words.last() {
            let unplanned = self.ends(index);
            let last = unplanned
                .filter(|account| account.origin == Origin::Detected)
                .last();
            self.last_lines
                .extend(last.map(|account| (index, account.scheduled.at, line.clone())));
        }
        Ok(())
    }

    /// Enters the death that has ended the run, which no replacement follows. After the stop: until then the others would go on without the dead process.
    pub(crate) fn enter_last_death(&mut self, process: &str) {
        let index = (0..self.plan.children.len()).find(|&index| self.name(index) == process);
        // One that was to be replaced has been entered.
        if let Some(index) = index.filter(|&index| self.slots[index].due.is_none()) {
            // A full table leaves the failure of the run, which has the same words.
            let _ = self.enter_death(index);
        }
    }

    /// The end of a process as that of the run, after so many new starts of all processes.
    pub(crate) fn died(&self, index: usize, roll_backs: u32) -> Failure {
        let slot = &self.slots[index];
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
            roll_backs,
            suspect: suspect.map(|other| self.name(other).to_owned()),
            last_words: slot.last_words.clone(),
        }
    }

    /// The first tick that a process which has ended did not answer, as the fault table has it or will have it.
    fn tick_of_end(&self, index: usize) -> u64 {
        self.listed_end(index)
            .unwrap_or_else(|| self.control_page.process(index).end_tick())
    }

    /// The tick at which the fault table has the death of a process's last incarnation, if any.
    ///
    /// In real time each fault that ends its process has ended one incarnation. Where more have ended, the last one was killed from outside.
    fn listed_end(&self, index: usize) -> Option<u64> {
        let is_listed = match self.plan.mode {
            Mode::Lockstep => self.planned_ends(index) > self.planned_ends[index],
            Mode::Realtime => {
                let incarnation = self.control_page.process(index).incarnation();
                self.ends(index).count() >= incarnation as usize
            }
        };
        // The table has the planned ones first, and in the order of the plan: the last end is the one that has come about last.
        is_listed.then(|| {
            self.ends(index)
                .max_by_key(|account| account.injected_ns)
                .map_or(0, |account| account.scheduled.at)
        })
    }

    /// Starts those again whose pause is over.
    pub(crate) fn start_again(
        &mut self,
        commands: Commands<'_>,
        report: Report<'_>,
    ) -> Option<Failure> {
        for index in 0..self.plan.children.len() {
            let slot = &self.slots[index];
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
                self.slots[index].exit = Some(exit);
                return Some(self.died(index, 0));
            }
            self.slots[index].restarts += 1;
            report(Event::Restarted {
                process: self.name(index),
                exit,
                pid: self.slots[index].pid,
                incarnation: self.control_page.process(index).incarnation(),
            });
        }
        None
    }
}
