//! Time stamps: when each hop received and sent, and how long its step took. They are for
//! measurements; no computation reads them.

use std::cell::{Cell, RefCell};

use shared_types::wire::{Header, MAX_HOPS, Stamps};

use crate::control_page::ProcessEntry;

/// The stamps of the tick in hand of one process.
#[derive(Debug, Default)]
pub(crate) struct Stamping {
    /// Its place in [`Stamps`], if it has one.
    hop: Option<usize>,
    /// The stamps of the inputs of the tick in hand.
    input: RefCell<Input>,
    /// When the source's tick in hand was due; 0 in lockstep.
    due_ns: Cell<u64>,
    /// The last tick of which something was sent.
    sent_tick: Cell<Option<u64>>,
    /// When the first of that was sent.
    pub(crate) sent_ns: Cell<u64>,
}

/// Part by part: as a whole they are copied by a call, or by way of the stack.
#[inline]
fn copy(from: &Stamps, to: &mut Stamps) {
    to.received_ns = from.received_ns;
    to.sent_ns = from.sent_ns;
    to.due_ns = from.due_ns;
}

#[derive(Clone, Copy, Debug, Default)]
struct Input {
    tick: u64,
    received_ns: u64,
    stamps: Stamps,
}

impl Stamping {
    pub(crate) fn at(hop: Option<usize>) -> Self {
        Self {
            hop: hop.filter(|hop| *hop < MAX_HOPS),
            ..Self::default()
        }
    }

    /// The tick source's tick in hand is due at this time.
    pub(crate) fn set_due(&self, due_ns: u64) {
        self.due_ns.set(due_ns);
    }

    /// A message is in the process's hands: notes when, and which way it came.
    #[inline]
    pub(crate) fn note_input(&self, header: &Header, now_ns: u64, entry: &ProcessEntry) {
        let mut input = self.input.borrow_mut();
        if input.tick != header.tick || input.received_ns == 0 {
            input.tick = header.tick;
            copy(&header.stamps, &mut input.stamps);
        } else {
            input.stamps.merge(&header.stamps);
        }
        input.received_ns = now_ns;
        if self.hop == Some(0) {
            // The answer to its own tick.
            entry.note_age(now_ns.saturating_sub(input.stamps.origin_ns()));
        }
    }

    /// Fills an output's header: the stamps of the inputs of the same tick, and this hop's own.
    #[inline]
    pub(crate) fn stamp(&self, header: &mut Header, now_ns: u64, entry: &ProcessEntry) {
        let input = self.input.borrow();
        if self.hop != Some(0) && input.tick == header.tick {
            copy(&input.stamps, &mut header.stamps);
        } else {
            header.stamps = Stamps::default();
        }
        if let Some(hop) = self.hop {
            if hop == 0 {
                header.stamps.due_ns = self.due_ns.get();
            }
            header.stamps.received_ns[hop] = input.received_ns;
            header.stamps.sent_ns[hop] = now_ns;
            self.note_times(hop, header, now_ns, entry);
        }
    }

    /// Shows on the control page how long the tick in hand took; once a tick, whatever is sent of it.
    #[inline]
    fn note_times(&self, hop: usize, header: &Header, now_ns: u64, entry: &ProcessEntry) {
        if self.sent_tick.replace(Some(header.tick)) == Some(header.tick) {
            return;
        }
        self.sent_ns.set(now_ns);
        let Stamps {
            received_ns,
            due_ns,
            ..
        } = header.stamps;
        let began_ns = if hop == 0 && due_ns > 0 {
            due_ns
        } else {
            received_ns[hop]
        };
        if began_ns > 0 {
            entry.note_step(now_ns.saturating_sub(began_ns));
        }
        if hop > 0 && header.stamps.origin_ns() > 0 {
            entry.note_age(now_ns.saturating_sub(header.stamps.origin_ns()));
        }
    }
}
