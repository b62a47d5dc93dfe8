//! Messages of a topic that no living reader has: undelivered, or received by a process that has
//! died since.

/// Messages in the order in which they were sent, numbered from 0; the last of them are there. The last [`length`](Ring::length) is about to be
/// overwritten.
pub trait Ring {
    /// One of them.
    type Message: PartialEq;

    /// Messages put in.
    fn count(&self) -> u64;

    /// Messages kept.
    fn length(&self) -> u64;

    /// One of them; `None` if it has not arrived yet, or is no longer there.
    fn get(&self, number: u64) -> Option<Self::Message>;

    /// Those that are there.
    fn newest_first(&self) -> impl Iterator<Item = Self::Message> {
        let count = self.count();
        let numbers = count.saturating_sub(self.length())..count;
        numbers.rev().map_while(|number| self.get(number))
    }
}

/// Takes the messages that the retainer of a topic has handed over, each once, until everything comes by their topic again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Recall {
    /// Number of the next one to take from the file.
    next: u64,
    /// Below it all are known to have come by their topic too.
    known: u64,
    /// A message taken from the file has arrived on its topic, too. From then on its writer is
    /// connected, and all later messages arrive.
    is_connected: bool,
}

impl Recall {
    /// Goes on behind the last message that its predecessor has left in its files; from the oldest on, where that one is gone.
    pub fn after<R: Ring>(ring: &R, last: Option<&R::Message>) -> Self {
        let (count, oldest) = (ring.count(), oldest(ring));
        let is_last = |number: &u64| {
            ring.get(*number)
                .is_some_and(|one| last.is_some_and(|last| one == *last))
        };
        let next = (oldest..count)
            .rev()
            .find(is_last)
            .map_or(oldest, |number| number + 1);
        Self {
            next,
            known: next,
            is_connected: false,
        }
    }

    /// The next one that has not been taken.
    pub fn take<R: Ring>(&mut self, ring: &R) -> Option<R::Message> {
        loop {
            // Messages overwritten meanwhile are lost, and the gap is counted.
            self.next = self.next.max(oldest(ring));
            if self.next >= ring.count() {
                return None;
            }
            self.next += 1;
            if let Some(message) = ring.get(self.next - 1) {
                return Some(message);
            }
        }
    }

    /// The next one before the message at `place`.
    pub fn take_before<R: Ring>(&mut self, ring: &R, place: u64) -> Option<R::Message> {
        (self.next < place).then(|| self.take(ring)).flatten()
    }

    /// The number of a message that has not been taken, if the retainer has handed it over.
    pub fn place_ahead<R: Ring>(
        &self,
        ring: &R,
        is_it: impl Fn(&R::Message) -> bool,
    ) -> Option<u64> {
        place_of(ring, self.next..ring.count(), is_it)
    }

    /// Whether a message that arrived on its topic was taken from the file before.
    pub fn knows<R: Ring>(&mut self, ring: &R, is_it: impl Fn(&R::Message) -> bool) -> bool {
        let place = place_of(ring, self.known..self.next, is_it);
        self.known = place.map_or(self.known, |number| number + 1);
        self.is_connected |= place.is_some();
        place.is_some()
    }

    /// All messages taken from the file have arrived on the topic, too: from here on, none can be
    /// missed.
    pub fn is_in_step(&self) -> bool {
        self.is_connected && self.known == self.next
    }
}

fn place_of<R: Ring>(
    ring: &R,
    mut range: std::ops::Range<u64>,
    is_it: impl Fn(&R::Message) -> bool,
) -> Option<u64> {
    range.find(|number| ring.get(*number).is_some_and(|one| is_it(&one)))
}

/// The oldest number that is there for long enough to be read: the very oldest is the next to be overwritten.
fn oldest(ring: &impl Ring) -> u64 {
    ring.count().saturating_sub(ring.length() - 1)
}

/// The oldest message that a dead writer has sent and that a reader has not: of the ticks from `next` on and before another.
pub fn oldest_missed<M>(
    newest_first: impl Iterator<Item = M>,
    next: u64,
    before: u64,
    tick: impl Fn(&M) -> u64,
) -> Option<M> {
    newest_first
        .take_while(|message| tick(message) >= next)
        .filter(|message| tick(message) < before)
        .last()
}
