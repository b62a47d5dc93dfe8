//! Gathers every message of a topic in order, whether or not this program knows the type.

use std::rc::Rc;

use crate::bus::format::header;
use crate::bus::inlet::{Admission, Inlet};
use crate::bus::port::Receiver;
use crate::context::Context;
use crate::control_page::Count;
use crate::wait::Interrupted;

/// Gathers everything of a topic; never waits.
pub(crate) struct Gathering {
    inlet: Inlet,
    last: Option<u64>,
    lost: u64,
    /// Messages of earlier ticks were taken in by a predecessor.
    from: u64,
}

impl Gathering {
    pub(crate) fn new(shared: Rc<Context>, receiver: Rc<Receiver>) -> Self {
        let from = shared.manifest.from;
        let inlet = Inlet::new(shared, receiver, Admission::InOrder);
        Self {
            inlet,
            last: from.checked_sub(1),
            lost: 0,
            from,
        }
    }

    /// Hands over all messages that are there, oldest first.
    pub(crate) fn collect(&mut self, take: &mut dyn FnMut(&[u8])) -> Result<(), Interrupted> {
        while let Some(message) = self.inlet.receive_any()? {
            let tick = header(&message).tick;
            if tick >= self.from && self.inlet.admits(&message) {
                self.count(tick);
                take(&message);
            }
        }
        Ok(())
    }

    /// Counts a message of a tick.
    pub(crate) fn count(&mut self, tick: u64) {
        let expected = self.last.map_or(0, |last| last + 1);
        if tick > expected {
            self.lost += tick - expected;
            self.inlet.shared.entry().add(Count::Lost, tick - expected);
        } else if tick < expected {
            self.inlet.shared.entry().add(Count::Repeated, 1);
        }
        self.last = self.last.max(Some(tick));
    }

    pub(crate) fn resume(&mut self, last: Option<u64>, lost: u64) {
        (self.last, self.lost) = (last, lost);
    }

    /// Takes in nothing more of the ticks counted so far.
    pub(crate) fn go_on(&mut self) {
        self.from = self.last.map_or(0, |last| last + 1);
    }

    pub(crate) fn last(&self) -> Option<u64> {
        self.last
    }

    pub(crate) fn lost(&self) -> u64 {
        self.lost
    }
}
