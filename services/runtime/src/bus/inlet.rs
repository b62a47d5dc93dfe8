//! The entrance for messages into a process: connection, fence and validation, the same for all
//! readers.

use std::rc::Rc;

use process::Fence;

use crate::bus::port::{Incoming, Receiver};
use crate::context::Context;
use crate::control_page::Count;
use crate::wait::Interrupted;

/// The entrance for messages into the process.
pub(crate) struct Inlet {
    pub(crate) shared: Rc<Context>,
    receiver: Rc<Receiver>,
    writer: Option<usize>,
    /// The topic's line on the control page.
    pub(super) topic: usize,
    /// How many messages the topic had seen, as its writers count them, when the buffer was empty but for what has been received since.
    empty_at: Option<u64>,
    /// Messages sent before this reader joined may still come, the last to a replacement in real time: those received are not those counted since.
    has_history: bool,
    fence: Fence,
    /// In real time: only messages of the living incarnation of this process count, for no process acts on those of a dead one.
    pub(super) living: Option<usize>,
}

impl Inlet {
    pub(crate) fn new(shared: Rc<Context>, receiver: Rc<Receiver>) -> Self {
        let topic = receiver.format.topic;
        let (writer, topic) = (
            shared.manifest.writer_of(topic),
            shared.manifest.topic_index(topic),
        );
        let is_lockstep = shared.is_lockstep();
        let has_history = !is_lockstep && shared.entry().incarnation() > 1;
        Self {
            shared,
            receiver,
            writer,
            topic,
            empty_at: None,
            has_history,
            fence: Fence::default(),
            living: writer.filter(|_| !is_lockstep),
        }
    }

    /// The next message, whether it counts or not.
    #[inline(always)]
    pub(crate) fn receive_any(&self) -> Result<Option<Incoming>, Interrupted> {
        self.receiver
            .receive()
            .map_err(|error| self.shared.port_failed(self.receiver.format.topic, error))
    }

    /// The next message that counts, in shared memory still: of a living incarnation, and all its numbers finite.
    ///
    /// If the writer has sent nothing since the buffer was empty, iceoryx2 is not asked: this check
    /// costs one load.
    // Inlined with all its parts: each call between the buffer and the loop that waits would move the message once more.
    #[inline(always)]
    pub(crate) fn receive(&mut self) -> Result<Option<Incoming>, Interrupted> {
        // Read before the look: what is delivered later is counted later.
        let sent = self.shared.control_page.topic(self.topic).sent();
        if self.empty_at == Some(sent) {
            return Ok(None);
        }
        loop {
            let Some(message) = self.receive_any()? else {
                self.empty_at = (sent > 0).then_some(sent);
                return Ok(None);
            };
            self.empty_at = match self.has_history {
                true => None,
                false => self.empty_at.map(|count| count + 1),
            };
            if self.admits(&message) {
                return Ok(Some(message));
            }
        }
    }

    /// Whether a message is valid. Invalid ones are counted by kind, except those that a fault
    /// hides from this reader alone.
    #[inline]
    pub(crate) fn admits(&mut self, message: &Incoming) -> bool {
        let incarnation = |writer| self.shared.control_page.process(writer).incarnation();
        let living = self.living.map(incarnation);
        let (format, header) = (&self.receiver.format, message.header());
        if self.shared.is_cut(format.topic, header.tick) {
            return false;
        }
        let refused =
            if !self.fence.admits(header.incarnation, living) && !self.shared.is_unfenced() {
                Count::Fenced
            } else if (format.not_finite)(message).is_some() {
                Count::Refused
            } else {
                return true;
            };
        self.refuse(refused);
        false
    }

    #[cold]
    fn refuse(&self, refused: Count) {
        self.shared.entry().add(refused, 1);
        self.shared.message_fault_detected();
    }

    /// In lockstep: whether the writer sends nothing more at a tick.
    #[inline(always)]
    pub(crate) fn is_over(&self, tick: u64) -> bool {
        self.shared.learn();
        self.shared.has_closed(self.writer, tick)
    }

    /// Whether there is something to receive, counted by its writer or not: a writer that was killed between the two has not.
    pub(crate) fn has_more(&mut self) -> Result<bool, Interrupted> {
        let has_samples = self
            .receiver
            .has_samples()
            .map_err(|error| self.shared.port_failed(self.receiver.format.topic, error))?;
        if has_samples {
            self.empty_at = None;
        }
        Ok(has_samples)
    }
}
