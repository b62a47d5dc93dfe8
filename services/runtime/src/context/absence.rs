//! Faults that end or stop this process: it dies or stops once, and is absent for their ticks.
//!
//! An absent process follows the ticks and closes each without a step, so what the others receive
//! depends on the plan alone. The death itself changes no message: the launcher starts all processes
//! again from before it, and the fault table knows that it has happened.

use process::absence;
use shared_types::fault::{Kind, ScheduledFault, Way};

use super::Context;
use crate::clock::now_ns;
use crate::control_page::State;
use crate::fault::process::{kill_self, stop_self};

impl Context {
    /// Applies the faults of this process at a tick, with the tick's first input in hand. Returns the tick at which it takes part again: `tick` unless
    /// it is absent.
    #[inline]
    pub(crate) fn attend(&self, tick: u64) -> u64 {
        self.learn();
        if self.is_unharmed() {
            tick
        } else {
            self.attend_under_faults(tick)
        }
    }

    #[cold]
    fn attend_under_faults(&self, tick: u64) -> u64 {
        while let Some((place, fault)) = self.due(tick) {
            self.mark_injected(place);
            self.fall(&fault, tick);
        }
        let (deaths, returns) = {
            let known = self.faults.known.borrow();
            absence(known.downs(self.me).map(|(_, fault)| fault), tick)
        };
        // In lockstep the process is another incarnation after a planned death, and what its predecessor held back is gone.
        if self.is_lockstep() && self.incarnation.replace(1 + deaths) != 1 + deaths {
            let outlets = self.attached.outlets.borrow();
            outlets.iter().for_each(|outlet| outlet.forget());
        }
        let returns = if self.is_timeless() { tick } else { returns };
        if returns == tick {
            self.control_page
                .fault_table()
                .mark_recovered(self.me, tick, now_ns());
        }
        returns
    }

    /// Whether no tick passes while this process is down: the others wait for it.
    fn is_timeless(&self) -> bool {
        self.own().makes_ticks || self.own().is_polled()
    }

    /// A fault that is to end or stop this process at a tick, and has not yet.
    fn due(&self, tick: u64) -> Option<(usize, ScheduledFault)> {
        let known = self.faults.known.borrow();
        let mut due = known
            .downs(self.me)
            .filter(|(_, fault)| fault.at <= tick && (tick < fault.until || self.is_timeless()));
        let table = self.control_page.fault_table();
        let is_new = |place| table.record(place).is_some_and(|one| one.injected_ns == 0);
        due.find(|(place, _)| is_new(*place))
            .map(|(place, fault)| (place, *fault))
    }

    fn fall(&self, fault: &ScheduledFault, tick: u64) {
        match fault.kind() {
            Some(Kind::Kill) => {
                self.leave(State::Gone);
                kill_self();
            }
            Some(Kind::Crash) => {
                self.leave(State::Gone);
                panic!(
                    "{} crashes at tick {tick}, as the fault plan says",
                    self.name()
                );
            }
            _ => self.stand_still(fault),
        }
    }

    /// The others are informed before, so that none waits for a message that cannot come.
    fn leave(&self, state: State) {
        self.entry().set_state(state);
        self.control_page.ring_all();
    }

    fn stand_still(&self, fault: &ScheduledFault) {
        self.leave(State::Stopped);
        stop_self();
        // A process that is not continued (`Way::ForEver`) is killed and never comes here; a stray SIGCONT changes nothing about it.
        while fault.way() == Some(Way::ForEver) && !self.is_stopping() {
            stop_self();
        }
        self.entry().set_state(State::Running);
        self.control_page.ring_all();
    }
}
