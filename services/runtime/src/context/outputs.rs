//! Outputs that the graph declares for a process. The last one closes a tick.

use crate::context::Context;

/// A tick that need not be answered, because an input of it has not come; beside the bits of the outputs sent.
const EXCUSED: u32 = 1 << 31;

impl Context {
    /// Notes that an output of a tick is about to leave; whether it is the last of those that the graph declares.
    #[inline]
    pub(crate) fn is_last_output(&self, tick: u64, output: usize) -> bool {
        let sent = self.sent_of(tick) | 1 << output;
        self.attached.outputs_sent.set((tick, sent));
        (sent & !EXCUSED).count_ones() as usize >= self.own().writes.len()
    }

    /// Notes that an input of a tick will not come: the process may pass the tick over.
    pub(crate) fn excuse(&self, tick: u64) {
        self.attached
            .outputs_sent
            .set((tick, self.sent_of(tick) | EXCUSED));
    }

    /// For a process that asks for more after it has been given an input of a tick in lockstep: an output of the tick that it has not sent, so that the
    /// tick would stay open for ever, and every process wait for it.
    pub(crate) fn unsent(&self, tick: u64) -> Option<&str> {
        let (of, sent) = (self.attached.outputs_sent.get().0, self.sent_of(tick));
        if !self.is_lockstep() || of > tick || sent & EXCUSED != 0 {
            return None;
        }
        let mut writes = self.own().writes.iter().enumerate();
        let unsent = writes.find(|(output, _)| sent & 1 << output == 0);
        unsent.map(|(_, topic)| topic.as_str())
    }

    /// The outputs of a tick that have left, one bit each.
    fn sent_of(&self, tick: u64) -> u32 {
        let (of, sent) = self.attached.outputs_sent.get();
        if of == tick { sent } else { 0 }
    }
}
