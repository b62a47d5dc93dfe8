//! Start of a process, phase by phase, together with all others.

use crate::clock::now_ns;
use crate::context::Context;
use crate::control_page::{Phase, State};
use crate::wait::{Interrupted, Wait, Waited};

impl Context {
    /// Goes with all others through the phases of the beginning; from here on nothing can be lost.
    ///
    /// `false`: the run stops before.
    #[inline]
    pub(crate) fn start(&self) -> Result<bool, Interrupted> {
        if self.has_started.get() {
            Ok(true)
        } else {
            self.begin()
        }
    }

    /// A tick closes with the last of the declared outputs: one without a writer would keep every tick open.
    fn has_all_outputs(&self) -> Result<(), Interrupted> {
        let outlets = self.attached.outlets.borrow();
        let is_open = |topic: &String| outlets.iter().any(|outlet| outlet.topic() == topic);
        match self.own().writes.iter().find(|topic| !is_open(topic)) {
            None => Ok(()),
            Some(topic) => Err(Interrupted::Unopened {
                process: self.name().to_owned(),
                topic: topic.clone(),
            }),
        }
    }

    #[cold]
    fn begin(&self) -> Result<bool, Interrupted> {
        self.has_all_outputs()?;
        self.entry().set_state(State::Ready);
        if !self.wait_for_phase(Phase::Connect)? {
            return Ok(false);
        }
        for port in self.attached.ports.take() {
            port.connect(self)?;
        }
        self.entry().set_state(State::Connected);
        if !self.wait_for_phase(Phase::Work)? {
            return Ok(false);
        }
        self.turns.begin();
        self.has_started.set(true);
        self.entry().set_state(State::Running);
        if self.entry().incarnation() > 1 {
            self.control_page
                .fault_table()
                .mark_recovered(self.me, u64::MAX, now_ns());
            self.control_page.ring_all();
        }
        Ok(true)
    }

    fn wait_for_phase(&self, phase: Phase) -> Result<bool, Interrupted> {
        let describe = || Wait {
            what: format!("the beginning of the run's phase \"{phase:?}\""),
            from: "the launcher".into(),
        };
        let begun = self.wait(0, None, describe, || {
            Ok(self.control_page.has_begun(phase).then_some(()))
        })?;
        Ok(matches!(begun, Waited::Ready(())))
    }
}
