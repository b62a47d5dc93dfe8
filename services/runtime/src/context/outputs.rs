//! The outputs that the graph declares for a process: all are open before its first tick, and the last one closes a tick.

use crate::context::Context;
use crate::wait::Interrupted;

impl Context {
    /// A tick closes with the last of the declared outputs: one without a writer would keep every tick open.
    pub(super) fn has_all_outputs(&self) -> Result<(), Interrupted> {
        let (writes, outlets) = (&self.manifest.processes[self.me].writes, self.attached.outlets.borrow());
        match writes.iter().find(|declared| !outlets.iter().any(|outlet| outlet.topic() == *declared)) {
            None => Ok(()),
            Some(topic) => Err(Interrupted::Unopened { process: self.name().to_owned(), topic: topic.clone() }),
        }
    }

    /// Notes that an output of a tick is about to leave; whether it is the last of those that the graph declares.
    #[inline]
    pub(crate) fn is_last_output(&self, tick: u64, output: usize) -> bool {
        let (of, sent) = self.attached.outputs_sent.get();
        let sent = if of == tick { sent } else { 0 } | 1 << output;
        self.attached.outputs_sent.set((tick, sent));
        sent.count_ones() as usize >= self.manifest.processes[self.me].writes.len()
    }
}
