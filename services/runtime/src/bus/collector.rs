//! The end of a topic that gathers every message in order, whether or not this program knows their type.

use std::rc::Rc;

use crate::bus::inlet::Inlet;
use crate::bus::port::Receiver;
use crate::context::Context;
use crate::control_page::Count;
use crate::wait::Interrupted;

/// Reads everything of a topic, in order, as bytes that begin with a header; never waits.
pub struct Collector {
    inlet: Inlet,
    last: Option<u64>,
    /// The latest tick of a message that has come, whether it counts or not.
    seen: Option<u64>,
    /// Messages of earlier ticks were taken in by a predecessor.
    from: u64,
}

impl Collector {
    pub(crate) fn new(shared: Rc<Context>, receiver: Rc<Receiver>) -> Self {
        let from = shared.manifest.from;
        let mut inlet = Inlet::new(shared, receiver);
        // Messages of dead processes belong into the record.
        inlet.living = None;
        Self {
            inlet,
            last: from.checked_sub(1),
            seen: None,
            from,
        }
    }

    /// Hands over all messages that are there, oldest first. `false`: not the newest that had been sent, for a writer has not met this reader yet.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn collect(&mut self, mut take: impl FnMut(&[u8])) -> Result<bool, Interrupted> {
        let Inlet { shared, topic, .. } = &self.inlet;
        let newest = shared.control_page.topic(*topic).newest();
        while let Some(message) = self.inlet.receive_any()? {
            let tick = message.tick();
            self.seen = self.seen.max(Some(tick));
            if tick >= self.from && self.inlet.admits(&message) {
                self.count(tick);
                take(&message);
            }
        }
        Ok(self.seen.max(self.last) >= newest)
    }

    /// Counts a message of a tick.
    fn count(&mut self, tick: u64) {
        let (expected, entry) = (self.next(), self.inlet.shared.entry());
        if tick > expected {
            entry.add(Count::Lost, tick - expected);
        } else if tick < expected {
            entry.add(Count::Repeated, 1);
        }
        self.last = self.last.max(Some(tick));
    }

    /// After the messages of an earlier reader: takes in nothing more of their ticks, which the topic's history has too.
    pub fn go_on(&mut self, last: Option<u64>) {
        self.last = last;
        self.from = self.next();
    }

    fn next(&self) -> u64 {
        self.last.map_or(0, |last| last + 1)
    }
}
