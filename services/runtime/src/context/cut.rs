//! Faults of one edge of the graph: one reader does not get a topic's messages.

use process::is_cut;

use super::Context;

impl Context {
    /// Whether a fault keeps the message of a tick on one of this process's topics from it.
    #[inline]
    pub(crate) fn is_cut(&self, topic: &str, tick: u64) -> bool {
        !self.is_unharmed() && self.is_cut_by_fault(topic, tick)
    }

    #[cold]
    fn is_cut_by_fault(&self, topic: &str, tick: u64) -> bool {
        let read = self.own().reads.iter().position(|read| read == topic);
        let known = self.faults.known.borrow();
        let cut = read.and_then(|read| is_cut(known.of(self.me, tick), read, tick));
        cut.into_iter().for_each(|place| self.mark_injected(place));
        cut.is_some()
    }
}
