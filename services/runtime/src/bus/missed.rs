//! Messages that reached the retainer of a topic, but not all readers, because their writer was
//! killed while sending.
//!
//! A writer sends to the retainer first, and the launcher saves the retained messages before it
//! enters a death in the fault table. So a reader that knows of the death and has emptied its
//! buffer takes the dead writer's last messages from the retainer's file.
//!
//! A planned death comes between two ticks, when all readers have all messages. But a reader
//! connects to a new writer only at its next check, and by then a short-lived writer may be gone.
//! So readers fill a gap at a planned death from the retainer, too.

use lockstep::{Ring, oldest_missed};

use crate::bus::format::header;
use crate::context::Context;
use crate::memory::HandedOver;

/// One reader's view of the retainer of its topic, in lockstep; in real time no process acts on messages of a dead one.
pub(crate) struct Missed {
    writer: Option<usize>,
    topic: &'static str,
    /// Bytes of a message.
    size: usize,
    /// Ticks below it have come, or are not for this reader.
    next: u64,
    /// The state of the fault table up to which nothing is missing.
    settled: u32,
}

impl Missed {
    pub(crate) fn new(context: &Context, topic: &'static str, size: usize) -> Self {
        let writer = context
            .manifest
            .writer_of(topic)
            .filter(|_| context.is_lockstep());
        Self {
            writer,
            topic,
            size,
            next: 0,
            settled: 0,
        }
    }

    /// Nothing before this tick is missed.
    #[inline]
    pub(crate) fn begin_at(&mut self, tick: u64) {
        self.next = self.next.max(tick);
    }

    /// Whether something may be missing: the fault table has changed since the last look.
    #[inline]
    pub(crate) fn is_open(&self, context: &Context) -> bool {
        self.writer.is_some() && self.settled != context.control_page.fault_table().changes()
    }

    /// The oldest missed message of a tick before `before`, the tick of the next message in the
    /// buffer (`u64::MAX` if empty).
    ///
    /// Requires that the buffer was looked at after the fault table was learnt.
    #[inline]
    pub(crate) fn take(&mut self, context: &Context, before: u64) -> Option<Vec<u8>> {
        if self.writer.is_none() || before <= self.next {
            return None;
        }
        let missed = if self.is_open(context) {
            self.look(context, before)
        } else {
            None
        };
        if missed.is_some() || before == u64::MAX {
            missed
        } else {
            self.look_back(context, before)
        }
    }

    /// After a gap in the ticks: messages sent in it by an incarnation whose death was planned.
    #[cold]
    fn look_back(&mut self, context: &Context, before: u64) -> Option<Vec<u8>> {
        let sent = context
            .protocol()
            .sent_before_planned_death(self.writer?, (self.next, before));
        if sent <= self.next {
            return None;
        }
        context.await_hand_over(self.topic).ok()?;
        let missed = self.oldest(context, sent);
        self.begin_at(
            missed
                .as_ref()
                .map_or(sent, |message| header(message).tick.saturating_add(1)),
        );
        missed
    }

    #[cold]
    fn look(&mut self, context: &Context, before: u64) -> Option<Vec<u8>> {
        let known = context.faults.known.borrow().changes();
        let sent = self
            .writer
            .map_or(0, |writer| context.protocol().sent_before_death(writer));
        let missed = if self.next < sent {
            self.oldest(context, before.min(sent))
        } else {
            None
        };
        match &missed {
            Some(message) => self.begin_at(header(message).tick.saturating_add(1)),
            None if before == u64::MAX || sent <= self.next => self.settled = known,
            None => {}
        }
        missed
    }

    /// The oldest message of the ticks from the next one on and before another in the file of the topic.
    fn oldest(&self, context: &Context, before: u64) -> Option<Vec<u8>> {
        let handed_over = HandedOver::open(&context.run, self.topic, self.size).ok()?;
        let tick = |message: &Vec<u8>| header(message).tick;
        oldest_missed(handed_over.newest_first(), self.next, before, tick)
    }
}
