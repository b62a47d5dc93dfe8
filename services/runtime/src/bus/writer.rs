//! The writing end of a topic: messages are filled in place, in loaned shared memory.

use std::cell::RefCell;
use std::marker::PhantomData;
use std::rc::Rc;

use bytemuck::from_bytes_mut;
use process::{Packed, Shaper};
use shared_types::Message;
use shared_types::fault::{corrupted_topic, shaped_topic};
use shared_types::topics::TOPICS;
use shared_types::wire::Header;

use crate::bus::port::{Outgoing, Sender};
use crate::context::{Connect, Context};
use crate::control_page::Count;
use crate::control_page::latest::{Part, shown};
use crate::wait::Interrupted;

/// Why a message was not sent.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SendError {
    /// A number in it is not finite; it does not leave the process.
    #[error("{process} refused its own {topic:?} of tick {tick}: {field} is not finite")]
    NotFinite {
        /// The writing process.
        process: String,
        /// Which topic.
        topic: &'static str,
        /// The message's tick.
        tick: u64,
        /// The first field that is not finite.
        field: &'static str,
    },
    /// iceoryx2 failed.
    #[error("{process} cannot send topic {topic:?}: {reason}")]
    Port {
        /// The writing process.
        process: String,
        /// Which topic.
        topic: &'static str,
        /// iceoryx2's own error.
        reason: String,
    },
}

/// Writes a topic.
pub struct Writer<M: Message>(Outlet, PhantomData<fn(&M)>);

/// The writing end of a topic, whatever its messages.
pub(crate) struct Outlet {
    sending: Rc<Sending>,
    /// The message on loan. It stays here until it is sent: a move costs some 10 ns.
    loaned: Option<Outgoing>,
}

/// The exit for messages of the process, with the faults that affect them.
pub(crate) struct Sending {
    shared: Rc<Context>,
    /// Its place among the process's outputs.
    output: usize,
    sender: Rc<Sender>,
    bit: u32,
    /// The topic's line on the control page.
    topic: usize,
    /// Its place in the list of topics, and the parts of its messages that the control page shows there; of others there are none.
    shown: (usize, &'static [Part]),
    readers: Vec<usize>,
    /// The messages that faults hold back or repeat.
    shaper: RefCell<Shaper>,
}

impl Outlet {
    pub(crate) fn new(shared: &Rc<Context>, sender: Rc<Sender>) -> Self {
        let name = sender.format.topic;
        let topic = shared.manifest.topic_index(name);
        shared.control_page.topic(topic).begin_writer();
        let (writes, listed) = (
            &shared.own().writes,
            TOPICS.iter().position(|one| *one == name),
        );
        let sending = Rc::new(Sending {
            shared: Rc::clone(shared),
            sender,
            output: writes.iter().position(|one| one == name).unwrap_or(0),
            bit: 1 << topic,
            topic,
            shown: (listed.unwrap_or(0), shown(name)),
            readers: shared.manifest.woken_by(name).collect(),
            shaper: RefCell::new(Shaper::new(corrupted_topic(writes) == Some(name))),
        });
        shared
            .attached
            .outlets
            .borrow_mut()
            .push(Rc::clone(&sending));
        Self {
            sending,
            loaned: None,
        }
    }

    /// Loans shared memory for one message, still filled with an earlier one.
    #[inline]
    pub(crate) fn loan(&mut self) -> Result<&mut Outgoing, SendError> {
        // One message is on loan at a time.
        self.loaned = None;
        let loaned = self.sending.sender.loan();
        let loaned = loaned.map_err(|error| self.sending.failed(error))?;
        Ok(self.loaned.insert(loaned))
    }

    /// The header of the message on loan.
    #[inline]
    pub(crate) fn header(&mut self) -> Option<&mut Header> {
        self.loaned.as_mut().map(Outgoing::header)
    }

    /// Sends the message on loan; see [`Writer::send`].
    #[inline]
    pub(crate) fn send(&mut self) -> Result<(), SendError> {
        let Self { sending, loaned } = self;
        let Some(mut message) = loaned.take() else {
            return Ok(());
        };
        let (shared, format) = (&sending.shared, &sending.sender.format);
        let tick = message.header().tick;
        if let Some(field) = (format.not_finite)(&message) {
            shared.entry().add(Count::NotFinite, 1);
            let error = SendError::NotFinite {
                process: shared.name().to_owned(),
                topic: format.topic,
                tick,
                field,
            };
            tracing::error!("{error}");
            return Err(error);
        }
        shared.stamp(message.header());
        let (place, shown) = sending.shown;
        let latest = shared.control_page.latest_of(place);
        latest.store(shown, &message);
        let is_last = shared.is_last_output(tick, sending.output);
        if is_last {
            shared.commit();
        }
        if shared.is_shaped() && shaped_topic(format.topic) {
            sending.send_shaped(message)?;
        } else {
            sending.deliver(message)?;
        }
        // With shaped messages in lockstep a tick is closed when its inputs are exhausted, for one message may be several or none.
        if is_last && !(shared.is_shaped() && shared.is_lockstep()) {
            shared.entry().set_ticks(tick + 1);
            if shared.is_lockstep() {
                shared.tick.set(tick + 1);
            }
            shared.report_progress();
        }
        sending.ring();
        Ok(())
    }
}

impl<M: Message> Writer<M> {
    pub(crate) fn new(outlet: Outlet) -> Self {
        Self(outlet, PhantomData)
    }

    /// Loans shared memory for the message of a tick, zero except for the tick, to be filled in place. What was on loan before is not sent.
    ///
    /// # Errors
    /// When iceoryx2 has no memory left.
    #[inline]
    pub fn loan(&mut self, tick: u64) -> Result<&mut M, SendError> {
        let place = self.0.loan()?;
        place.fill(0);
        let message: &mut M = from_bytes_mut(place);
        message.header_mut().tick = tick;
        Ok(message)
    }

    /// Sends the message on loan, if there is one, and wakes the readers that wait for it; never blocks.
    ///
    /// Fills in the incarnation and the stamps: those of the inputs of the same tick, and this hop's own. With the last output that the graph
    /// declares for this process the tick is closed, and the checkpoint of the tick is committed before.
    ///
    /// # Errors
    /// When a number in it is not finite (counted; nothing is sent), or iceoryx2 fails.
    pub fn send(&mut self) -> Result<(), SendError> {
        self.0.send()
    }
}

impl Connect for Sending {
    fn connect(&self, shared: &Context) -> Result<(), Interrupted> {
        self.sender.connect(shared)
    }
}

impl Sending {
    fn failed(&self, reason: impl std::fmt::Display) -> SendError {
        SendError::Port {
            process: self.shared.name().to_owned(),
            topic: self.topic(),
            reason: reason.to_string(),
        }
    }

    fn deliver(&self, mut message: Outgoing) -> Result<(), SendError> {
        let tick = message.header().tick;
        message.send().map_err(|error| self.failed(error))?;
        self.shared.control_page.topic(self.topic).count_sent(tick);
        self.shared.entry().add(Count::Sent, 1);
        Ok(())
    }

    /// Sends the message as changed by the faults of the tick in hand. Kept off the fault-free path.
    #[cold]
    #[inline(never)]
    fn send_shaped(&self, loaned: Outgoing) -> Result<(), SendError> {
        let message = Packed::of(&loaned);
        drop(loaned);
        let (shared, tick) = (&self.shared, self.shared.tick.get());
        let known = shared.faults.known.borrow();
        let (faults, injected) = (known.of(shared.me, tick), |place| {
            shared.mark_injected(place)
        });
        let deliver = |message: &[u8]| self.deliver_copy(message);
        self.shaper
            .borrow_mut()
            .shape(message.bytes(), tick, faults, injected, deliver)?;
        if !shared.is_lockstep() {
            self.flush(tick);
        }
        Ok(())
    }

    /// Delivers a message that a fault has held back, doubled or changed: a copy, for it is not the one that was on loan.
    fn deliver_copy(&self, message: &[u8]) -> Result<(), SendError> {
        let mut copy = self.sender.loan().map_err(|error| self.failed(error))?;
        copy.copy_from_slice(message);
        self.deliver(copy)
    }

    /// Its topic.
    pub(crate) fn topic(&self) -> &'static str {
        self.sender.format.topic
    }

    /// Sends the messages due at `tick` or before.
    pub(crate) fn flush(&self, tick: u64) {
        self.shaper.borrow_mut().flush(tick, |message| {
            // It fails where no memory is left: then the message is lost, as messages that faults hold back may be.
            let _ = self.deliver_copy(message);
        });
    }

    /// Drops the messages held back: the process has died as planned.
    pub(crate) fn forget(&self) {
        self.shaper.borrow_mut().die();
    }

    /// Wakes the readers.
    pub(crate) fn ring(&self) {
        for &reader in &self.readers {
            self.shared
                .control_page
                .process(reader)
                .doorbell()
                .ring(self.bit);
        }
    }
}
