//! The outputs that the graph declares for a process: the last one closes a tick.

use crate::context::Context;

impl Context {
    /// Notes that an output of a tick is about to leave; whether it is the last of those that the graph declares.
    #[inline]
    pub(crate) fn is_last_output(&self, tick: u64, output: usize) -> bool {
        let (of, sent) = self.attached.outputs_sent.get();
        let sent = if of == tick { sent } else { 0 } | 1 << output;
        self.attached.outputs_sent.set((tick, sent));
        sent.count_ones() as usize >= self.manifest.processes[self.me].writes.len()
    }
}
