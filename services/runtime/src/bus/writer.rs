//! The writing end of a topic: messages are filled in place, in loaned shared memory.

use std::cell::RefCell;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::rc::Rc;
use std::slice::from_raw_parts;

use process::{Packed, Shaper};
use shared_types::Message;
use shared_types::fault::{corrupted_topic, shaped_topic};
use shared_types::wire::Header;

use crate::bus::format::Format;
use crate::bus::port::{Outgoing, Sender};
use crate::clock::now_ns;
use crate::context::Context;
use crate::control_page::Count;
use crate::control_page::live_statistics::{Note, note_of};

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
    /// The message on loan. It lies here and not in the [`Loan`], so that it is not moved with that: a move costs some 10 ns.
    loaned: Option<Outgoing>,
}

/// The exit for messages of the process, with the faults that affect them.
pub(crate) struct Sending {
    shared: Rc<Context>,
    format: Format,
    /// Its place among the process's outputs.
    output: usize,
    sender: Rc<Sender>,
    bit: u32,
    /// The topic's line on the control page.
    topic: usize,
    /// Keeps what `armplane status` shows of a message.
    note: Note,
    readers: Vec<usize>,
    /// The messages that faults hold back or repeat.
    shaper: RefCell<Shaper>,
}

impl Outlet {
    pub(crate) fn new(shared: &Rc<Context>, format: Format, sender: Rc<Sender>) -> Self {
        let name = format.topic;
        let topic = shared.topic_index(name);
        shared.control_page.topic(topic).begin_writer();
        let writes = &shared.manifest.processes[shared.me].writes;
        let sending = Rc::new(Sending {
            shared: Rc::clone(shared),
            format,
            sender,
            output: writes.iter().position(|one| one == name).unwrap_or(0),
            bit: shared.topic_bit(name),
            topic,
            note: note_of(name),
            readers: shared.manifest.woken_by(name).collect(),
            shaper: RefCell::new(Shaper::new(corrupted_topic(writes) == Some(name))),
        });
        shared.add_outlet(Rc::clone(&sending));
        Self {
            sending,
            loaned: None,
        }
    }

    /// Loans shared memory for one message, still filled with an earlier one: where its bytes begin.
    #[inline]
    pub(crate) fn loan(&mut self) -> Result<*mut u8, SendError> {
        let loaned = self.sending.sender.loan_into(&mut self.loaned);
        loaned.map_err(|error| self.sending.failed(error))
    }

    /// The message on loan, to be filled; `None` where there is none.
    #[inline]
    pub(crate) fn on_loan(&mut self) -> Option<&mut [u8]> {
        let payload = self.loaned.as_ref()?.payload();
        // SAFETY: on loan from the sender, for as long as `self` is borrowed; the topic's messages have this size.
        Some(unsafe { std::slice::from_raw_parts_mut(payload, self.sending.format.bytes) })
    }

    /// The header of the message on loan.
    #[inline]
    pub(crate) fn header(&mut self) -> Option<&mut Header> {
        let message = self.on_loan()?;
        bytemuck::try_from_bytes_mut(&mut message[..size_of::<Header>()]).ok()
    }

    /// Sends the message on loan; see [`Loan::send`].
    #[inline]
    pub(crate) fn send(&mut self) -> Result<(), SendError> {
        let Self { sending, loaned } = self;
        let Some(message) = loaned.take() else {
            return Ok(());
        };
        let shared = &sending.shared;
        // SAFETY: on loan from the sender; the topic's messages have this size.
        let bytes = unsafe { from_raw_parts(message.payload(), sending.format.bytes) };
        // SAFETY: likewise; a message is aligned to 8, and begins with its header.
        let header: &mut Header = unsafe { &mut *message.payload().cast() };
        let tick = header.tick;
        if let Some(field) = (sending.format.not_finite)(bytes) {
            shared.entry().add(Count::NotFinite, 1);
            let error = SendError::NotFinite {
                process: shared.name().to_owned(),
                topic: sending.format.topic,
                tick,
                field,
            };
            tracing::error!("{error}");
            return Err(error);
        }
        shared.stamp(header);
        (sending.note)(shared.control_page.live_state_cells(), bytes);
        let is_last = shared.is_last_output(tick, sending.output);
        if is_last {
            shared.commit();
        }
        if shared.is_shaped() && shaped_topic(sending.format.topic) {
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

    /// Loans shared memory for the message of a tick, zero except for the tick, to be filled in
    /// place.
    ///
    /// A loan that is dropped is not sent. One message of a topic is on loan at a time.
    ///
    /// # Errors
    /// When iceoryx2 has no memory left.
    pub fn loan(&mut self, tick: u64) -> Result<Loan<'_, M>, SendError> {
        // SAFETY: the pointer is that of a loan of one message, and zeros are a message, for it is `Pod`.
        let mut loan = self.loan_with(|payload| unsafe { payload.write_bytes(0, 1) })?;
        loan.header_mut().tick = tick;
        Ok(loan)
    }

    /// Loans shared memory still filled with an earlier message, for large messages whose relevant
    /// part is overwritten anyway.
    ///
    /// # Errors
    /// See [`Writer::loan`].
    pub fn loan_as_is(&mut self, tick: u64) -> Result<Loan<'_, M>, SendError> {
        let mut loan = self.loan_with(|_| {})?;
        *loan.header_mut() = Header {
            tick,
            ..Header::default()
        };
        Ok(loan)
    }

    #[inline]
    fn loan_with(&mut self, prepare: impl FnOnce(*mut M)) -> Result<Loan<'_, M>, SendError> {
        let payload = self.0.loan()?.cast();
        prepare(payload);
        Ok(Loan {
            payload,
            writer: self,
        })
    }

    /// Sends a message that was made elsewhere, for which it is copied once into shared memory; otherwise as [`Loan::send`].
    ///
    /// # Errors
    /// See [`Writer::loan`] and [`Loan::send`].
    pub fn send(&mut self, message: M) -> Result<(), SendError> {
        // SAFETY: the pointer is that of a loan of one message.
        self.loan_with(|payload| unsafe { payload.write(message) })?
            .send()
    }
}

/// A message in shared memory that has not been sent yet.
pub struct Loan<'a, M: Message> {
    /// That of the message on loan from the writer.
    payload: *mut M,
    writer: &'a mut Writer<M>,
}

impl<M: Message> Drop for Loan<'_, M> {
    #[inline]
    fn drop(&mut self) {
        self.writer.0.loaned = None;
    }
}

impl<M: Message> Deref for Loan<'_, M> {
    type Target = M;
    fn deref(&self) -> &M {
        // SAFETY: on loan from the sender of a topic of messages `M`, and `M` is `Pod`: every bit pattern is a message.
        unsafe { &*self.payload }
    }
}

impl<M: Message> DerefMut for Loan<'_, M> {
    fn deref_mut(&mut self) -> &mut M {
        // SAFETY: as above; the loan is held by `self` alone.
        unsafe { &mut *self.payload }
    }
}

impl<M: Message> Loan<'_, M> {
    /// Sends the message and wakes the readers that wait for it; never blocks.
    ///
    /// Fills in the incarnation and the stamps: those of the inputs of the same tick, and this hop's own. With the last output that the graph
    /// declares for this process the tick is closed, and the checkpoint of the tick is committed before.
    ///
    /// # Errors
    /// When a number in it is not finite (counted; nothing is sent), or iceoryx2 fails.
    pub fn send(self) -> Result<(), SendError> {
        self.writer.0.send()
    }
}

impl Sending {
    fn failed(&self, reason: impl std::fmt::Display) -> SendError {
        SendError::Port {
            process: self.shared.name().to_owned(),
            topic: self.format.topic,
            reason: reason.to_string(),
        }
    }

    fn deliver(&self, message: Outgoing) -> Result<(), SendError> {
        let tick = message.header().tick;
        message.send().map_err(|error| self.failed(error))?;
        self.shared.control_page.topic(self.topic).count_sent(tick);
        self.shared.entry().add(Count::Sent, 1);
        Ok(())
    }

    /// Sends the message as changed by faults. Kept off the fault-free path.
    #[cold]
    #[inline(never)]
    fn send_shaped(&self, loaned: Outgoing) -> Result<(), SendError> {
        // SAFETY: on loan from the sender; the topic's messages have this size.
        let message = Packed::of(unsafe { from_raw_parts(loaned.payload(), self.format.bytes) });
        drop(loaned);
        self.shape(&message)?;
        if !self.shared.is_lockstep() {
            self.flush(self.shared.tick.get());
        }
        Ok(())
    }

    /// Delivers a message that a fault has held back, doubled or changed: a copy, for it is not the one that was on loan.
    fn deliver_copy(&self, message: &[u8]) -> Result<(), SendError> {
        let copy = self.sender.loan().map_err(|error| self.failed(error))?;
        // SAFETY: on loan from the sender, of the size of the topic's messages, as `message` is.
        unsafe {
            copy.payload()
                .copy_from_nonoverlapping(message.as_ptr(), message.len())
        };
        self.deliver(copy)
    }

    /// Applies the faults of its tick to a message.
    fn shape(&self, message: &Packed) -> Result<(), SendError> {
        let (shared, tick) = (&self.shared, self.shared.tick.get());
        let injected = |place| {
            shared
                .control_page
                .fault_table()
                .mark_injected(place, now_ns())
        };
        let known = shared.faults.known.borrow();
        let faults = known.of(shared.me, tick);
        self.shaper
            .borrow_mut()
            .shape(message.bytes(), tick, faults, injected, |message| {
                self.deliver_copy(message)
            })
    }

    /// Its topic.
    pub(crate) fn topic(&self) -> &'static str {
        self.format.topic
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
