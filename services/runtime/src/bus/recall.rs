//! The messages of a topic that no living reader has received: delivered to none, or received by a process that has died since.

use crate::memory::HandedOver;

/// Takes the messages that the retainer of a topic has handed over, each once, until everything comes by their topic again.
pub(crate) struct Recall {
    handed_over: HandedOver,
    /// Number of the next one to take from the file.
    next: u64,
    /// Below it all are known to have come by their topic too.
    known: u64,
    /// One that was taken from the file has come by its topic too: from then on its writer is connected, and all that follows it comes.
    is_connected: bool,
}

impl Recall {
    /// Goes on behind the last message that its predecessor has left in its files; from the oldest on, where that one is gone.
    pub(crate) fn after(handed_over: HandedOver, last: Option<&[u8]>) -> Self {
        let (count, oldest) = (handed_over.count(), oldest(&handed_over));
        let is_last = |number: &u64| handed_over.get(*number).is_some_and(|one| last.is_some_and(|last| one == last));
        let next = (oldest..count).rev().find(is_last).map_or(oldest, |number| number + 1);
        Self { handed_over, next, known: next, is_connected: false }
    }

    /// The next one that has not been taken.
    pub(crate) fn take(&mut self) -> Option<Vec<u8>> {
        loop {
            // Messages overwritten meanwhile are lost, and the gap is counted.
            self.next = self.next.max(oldest(&self.handed_over));
            if self.next >= self.handed_over.count() {
                return None;
            }
            self.next += 1;
            if let Some(message) = self.handed_over.get(self.next - 1) {
                return Some(message);
            }
        }
    }

    /// The next one before the message at `place`.
    pub(crate) fn take_before(&mut self, place: u64) -> Option<Vec<u8>> {
        if self.next < place { self.take() } else { None }
    }

    /// The number of a message that has not been taken, if the retainer has handed it over.
    pub(crate) fn place_ahead(&self, message: &[u8]) -> Option<u64> {
        self.place_of(message, self.next..self.handed_over.count())
    }

    fn place_of(&self, message: &[u8], mut range: std::ops::Range<u64>) -> Option<u64> {
        range.find(|number| self.handed_over.get(*number).is_some_and(|one| one == message))
    }

    /// Whether a message that has come by its topic has been taken from the file before.
    pub(crate) fn knows(&mut self, message: &[u8]) -> bool {
        let place = self.place_of(message, self.known..self.next);
        self.known = place.map_or(self.known, |number| number + 1);
        self.is_connected |= place.is_some();
        place.is_some()
    }

    /// All that was taken from the file has come by its topic too: from here on nothing can be missed.
    pub(crate) fn is_in_step(&self) -> bool {
        self.is_connected && self.known == self.next
    }
}

/// The oldest number that is there for long enough to be read: the very oldest is the next to be overwritten.
fn oldest(handed_over: &HandedOver) -> u64 {
    handed_over.count().saturating_sub(handed_over.length() - 1)
}
