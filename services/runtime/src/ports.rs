//! Typed ends of topics.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;

use bytemuck::bytes_of;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample;
use shared_types::Message;
use shared_types::fault::{Kind, MOST_DELAY_TICKS, shaped_topic};

use crate::bus::topic::{Publishing, Subscribing, TopicError, Wire};
use crate::clock::now_ns;
use crate::control_page::Count;
use crate::fate::Outlet;
use crate::memory::{Memory, RING};
use crate::realtime::Usage;
use crate::shell::{Interrupted, Shared, Wait, Waited};
use crate::tick_source::{USAGE_EVERY, cause};
use crate::validation::{Fence, first_not_finite, happens, random, spoil};

/// A port that can connect to its counterparts at a time of the shell's choosing, not in the first tick.
pub(crate) trait Connect {
    fn connect(&self, shared: &Shared) -> Result<(), Interrupted>;
}

impl<M: Message> Connect for Subscribing<M> {
    fn connect(&self, shared: &Shared) -> Result<(), Interrupted> {
        self.update_connections().map_err(|error| shared.port_failed(M::TOPIC, error))
    }
}

impl<M: Message> Connect for Publishing<M> {
    fn connect(&self, shared: &Shared) -> Result<(), Interrupted> {
        self.update_connections().map_err(|error| shared.port_failed(M::TOPIC, error))
    }
}

/// Reads a topic, one message at a time.
///
/// In lockstep a process works through tick after tick. A tick is over for a reader when its message has come, or when its writer has closed
/// the tick and nothing of it is on the way: the writer is down, or what it sent was lost. Then this process closes the tick too, and
/// so a fault anywhere in the chain is a tick without torque at its end, not a wait for what will never come.
pub struct Reader<M: Message> {
    shared: Rc<Shared>,
    inlet: Inlet<M>,
    bit: u32,
    /// The message handed out last.
    current: M,
    /// The tick of that message.
    last: Option<u64>,
    /// A message that came before its time.
    ahead: Option<M>,
}

/// What a reader waits for, and from whom.
fn expected<M: Message>(shared: &Shared, tick: Option<u64>) -> Wait {
    Wait {
        what: match tick {
            Some(tick) => format!("tick {tick} of topic {:?}", M::TOPIC),
            None => format!("a first message on topic {:?}", M::TOPIC),
        },
        from: shared.manifest.writer_of(M::TOPIC).map_or("its writer".into(), |w| shared.manifest.processes[w].name.clone()),
    }
}

/// What a look into the buffer shows.
#[derive(Clone, Copy)]
enum Found {
    /// The message is now the current one.
    Current,
    /// What was looked for will not come.
    Nothing,
}

impl<M: Message> Reader<M> {
    pub(crate) fn new(shared: Rc<Shared>, subscriber: Rc<Subscribing<M>>) -> Self {
        let bit = shared.topic_bit(M::TOPIC);
        let inlet = Inlet::new(Rc::clone(&shared), subscriber, Admission::OfTheLiving);
        // What was sent while this process was down is not for its replacement.
        let last = shared.returns_at().checked_sub(1);
        Self { shared, inlet, bit, current: M::zeroed(), last, ahead: None }
    }

    /// The next message: in lockstep that of the next tick that has one, in real time the newest one not yet seen. Waits for it.
    ///
    /// `None` when the run stops. In real time the ticks passed over are counted as lost.
    ///
    /// # Errors
    /// When nothing comes within the limit, or in lockstep a tick was skipped that no fault accounts for.
    #[allow(clippy::should_implement_trait, reason = "it lends from itself and can fail; `while let Some(m) = reader.next()?`")]
    pub fn next(&mut self) -> Result<Option<&M>, Interrupted> {
        let shared = Rc::clone(&self.shared);
        if matches!(shared.start()?, Waited::Stopped) {
            return Ok(None);
        }
        shared.pause();
        loop {
            let (tick, last) = (shared.tick.get(), self.last);
            let found = shared.wait(
                self.bit,
                None,
                || expected::<M>(&shared, last.map(|last| last + 1)),
                || {
                    if shared.is_lockstep() { self.look_for_next(tick) } else { self.look_for_newest() }
                },
            )?;
            let Waited::Ready(found) = found else { return Ok(None) };
            // The tick in hand: in real time it is the message's.
            let tick = if shared.is_lockstep() { tick } else { self.current.header().tick };
            shared.tick.set(tick);
            let goes_on = shared.meet_fate(tick);
            if goes_on > tick {
                // It stood still: what came meanwhile is not for it.
                shared.tick.set(goes_on);
                self.last = Some(goes_on - 1);
            } else if matches!(found, Found::Current) {
                return self.accept();
            } else if shared.is_unharmed() {
                return Err(self.lost(tick, tick + 1));
            } else {
                shared.close(tick);
                shared.tick.set(tick + 1);
            }
        }
    }

    /// The message of one tick that another input has named. Waits for it.
    ///
    /// `None` when the run stops, or when this message will not come: a later one is there, or in lockstep its writer has closed the tick.
    ///
    /// # Errors
    /// As [`Reader::next`].
    pub fn at(&mut self, tick: u64) -> Result<Option<&M>, Interrupted> {
        let shared = Rc::clone(&self.shared);
        if matches!(shared.start()?, Waited::Stopped) {
            return Ok(None);
        }
        shared.pause();
        let found = shared.wait(self.bit, None, || expected::<M>(&shared, Some(tick)), || self.look_for(tick))?;
        match found {
            Waited::Ready(Found::Current) => {
                self.last = Some(tick);
                self.shared.note_input(self.current.header());
                Ok(Some(&self.current))
            }
            Waited::Ready(Found::Nothing) => {
                self.shared.entry().add(Count::Lost, 1);
                if self.shared.is_lockstep() && self.shared.is_unharmed() {
                    return Err(self.lost(tick, self.ahead.map_or(tick + 1, |ahead| ahead.header().tick)));
                }
                Ok(None)
            }
            Waited::Late | Waited::Stopped => Ok(None),
        }
    }

    /// The newest message that arrives in the tick a [`TickSource`](crate::TickSource) has given out, for the process that makes the ticks: in
    /// lockstep when its writer has closed the tick, in real time by `deadline_ns` on `CLOCK_MONOTONIC`, or as soon as that tick's own is there.
    ///
    /// `None` when none came that is newer than the last, or the run stops. It may be older than `tick`; its header says.
    ///
    /// # Errors
    /// As [`Reader::next`].
    pub fn arriving(&mut self, tick: u64, deadline_ns: Option<u64>) -> Result<Option<&M>, Interrupted> {
        let shared = Rc::clone(&self.shared);
        if matches!(shared.start()?, Waited::Stopped) {
            return Ok(None);
        }
        shared.pause();
        let is_shaped = shared.is_shaped();
        if is_shaped && shared.is_lockstep() {
            shared.close(tick);
        }
        let (before, mut newest) = (self.last, self.last);
        let found = shared.wait(
            self.bit,
            deadline_ns,
            || expected::<M>(&shared, Some(tick)),
            || {
                loop {
                    while let Some(message) = self.inlet.receive()? {
                        let came = message.header().tick;
                        if newest.is_some_and(|newest| came <= newest) {
                            shared.entry().add(Count::Repeated, 1);
                            shared.message_fault_detected();
                            continue;
                        }
                        self.current = *message;
                        newest = Some(came);
                        if came == tick && !(is_shaped && shared.is_lockstep()) {
                            return Ok(Some(()));
                        }
                    }
                    if shared.is_unordered() && tick > 0 && before == Some(tick - 1) {
                        return Ok(Some(()));
                    }
                    // What came between the last look and the closing is still to be taken in: look once more.
                    match shared.is_lockstep() && self.inlet.is_over(tick) {
                        true if self.inlet.has_more()? => {}
                        true => return Ok(Some(())),
                        false => return Ok(None),
                    }
                }
            },
        )?;
        if matches!(found, Waited::Stopped) {
            return Ok(None);
        }
        self.last = newest;
        if newest == before {
            if shared.is_unordered() && before.is_some() {
                return Ok(Some(&self.current));
            }
            if shared.is_lockstep() && shared.is_unharmed() {
                return Err(self.lost(tick, tick + 1));
            }
            shared.message_fault_detected();
            return Ok(None);
        }
        shared.note_input(self.current.header());
        Ok(Some(&self.current))
    }

    fn lost(&self, expected: u64, found: u64) -> Interrupted {
        Interrupted::Lost { process: self.shared.name().to_owned(), topic: M::TOPIC, expected, found }
    }

    /// The next message in order; or nothing, when the tick is over without one.
    fn look_for_next(&mut self, tick: u64) -> Result<Option<Found>, Interrupted> {
        if self.take_up_ahead() {
            return Ok(Some(Found::Current));
        }
        loop {
            while let Some(message) = self.inlet.receive()? {
                if self.last.is_some_and(|last| message.header().tick <= last) {
                    self.shared.entry().add(Count::Repeated, 1);
                    self.shared.message_fault_detected();
                    continue;
                }
                self.current = *message;
                return Ok(Some(Found::Current));
            }
            match self.inlet.is_over(tick) {
                true if self.inlet.has_more()? => {}
                true => return Ok(Some(Found::Nothing)),
                false => return Ok(None),
            }
        }
    }

    fn take_up_ahead(&mut self) -> bool {
        let ahead = self.ahead.take().filter(|message| self.last.is_none_or(|last| message.header().tick > last));
        self.current = ahead.unwrap_or(self.current);
        ahead.is_some()
    }

    fn look_for_newest(&mut self) -> Result<Option<Found>, Interrupted> {
        let mut found = self.take_up_ahead().then_some(Found::Current);
        while let Some(message) = self.inlet.receive()? {
            if self.last.is_some_and(|last| message.header().tick <= last) {
                self.shared.entry().add(Count::Repeated, 1);
                self.shared.message_fault_detected();
                continue;
            }
            self.current = *message;
            found = Some(Found::Current);
        }
        Ok(found)
    }

    fn look_for(&mut self, tick: u64) -> Result<Option<Found>, Interrupted> {
        let mut over = false;
        loop {
            let message = match self.ahead.take() {
                Some(message) => Some(message),
                None => self.inlet.receive()?.map(|message| *message),
            };
            match message {
                Some(message) if message.header().tick == tick => {
                    self.current = message;
                    return Ok(Some(Found::Current));
                }
                Some(message) if message.header().tick > tick => {
                    self.ahead = Some(message);
                    return Ok(Some(Found::Nothing));
                }
                Some(_) => self.shared.entry().add(Count::Repeated, 1),
                None if over => return Ok(Some(Found::Nothing)),
                None if self.shared.is_lockstep() && self.inlet.is_over(self.shared.tick.get()) => over = true,
                None => return Ok(None),
            }
        }
    }

    fn accept(&mut self) -> Result<Option<&M>, Interrupted> {
        let tick = self.current.header().tick;
        let expected = self.last.map_or(tick, |last| last + 1);
        if tick > expected {
            self.shared.entry().add(Count::Lost, tick - expected);
            if self.shared.is_lockstep() && self.shared.is_unharmed() {
                // What came too early is not lost by having been looked at.
                self.ahead = Some(self.current);
                return Err(self.lost(expected, tick));
            }
        }
        self.last = Some(tick);
        self.shared.note_input(self.current.header());
        Ok(Some(&self.current))
    }
}

/// Whose messages count.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Admission {
    /// In real time those of the living: nobody acts on the word of the dead.
    OfTheLiving,
    /// All, as long as they come in order: what the dead have sent is part of the record.
    InOrder,
}

/// Where messages enter the process.
struct Inlet<M: Message> {
    shared: Rc<Shared>,
    subscriber: Rc<Subscribing<M>>,
    writer: Option<usize>,
    fence: Fence,
    admission: Admission,
}

impl<M: Message> Inlet<M> {
    fn new(shared: Rc<Shared>, subscriber: Rc<Subscribing<M>>, admission: Admission) -> Self {
        let writer = shared.manifest.writer_of(M::TOPIC);
        Self { shared, subscriber, writer, fence: Fence::default(), admission }
    }

    /// The next message that counts, in shared memory still: of a living incarnation, and all its numbers finite.
    fn receive(&mut self) -> Result<Option<Incoming<M>>, Interrupted> {
        loop {
            let sample = self.subscriber.receive().map_err(|error| self.shared.port_failed(M::TOPIC, error))?;
            let Some(message) = sample.map(Incoming) else { return Ok(None) };
            if self.admits(&message) {
                return Ok(Some(message));
            }
        }
    }

    /// Whether a message counts; one that does not is counted as what it is.
    fn admits(&mut self, message: &M) -> bool {
        let living = match (self.shared.is_lockstep() || self.admission == Admission::InOrder, self.writer) {
            (false, Some(writer)) => Some(self.shared.control_page.process(writer).incarnation()),
            _ => None,
        };
        let refused = if !self.fence.admits(message.header(), living) {
            Count::Fenced
        } else if !message.is_finite() {
            Count::Refused
        } else {
            return true;
        };
        self.shared.entry().add(refused, 1);
        self.shared.message_fault_detected();
        false
    }

    /// In lockstep: whether the writer sends nothing more at a tick.
    fn is_over(&self, tick: u64) -> bool {
        self.shared.learn();
        self.shared.protocol().has_closed(self.writer, tick)
    }

    /// Whether something has come since the last look.
    fn has_more(&self) -> Result<bool, Interrupted> {
        self.subscriber.has_samples().map_err(|error| self.shared.port_failed(M::TOPIC, error))
    }
}

/// A received message, in shared memory still.
struct Incoming<M: Message>(Sample<ipc::Service, Wire<M>, ()>);

impl<M: Message> std::ops::Deref for Incoming<M> {
    type Target = M;
    fn deref(&self) -> &M {
        &self.0.payload().0
    }
}

/// Reads everything of a topic, in order; never waits.
pub struct Collector<M: Message> {
    inlet: Inlet<M>,
    last: Option<u64>,
    lost: u64,
    /// In a replacement, until it is in step: what was on its way to its predecessor.
    recall: Option<Recall<M>>,
}

/// The messages that were delivered while nobody received them, and those that were received and died with who had them.
struct Recall<M: Message> {
    memory: Memory<M>,
    /// Number of the next one to take from the ring.
    next: u64,
    /// Below it all are known to have come by the usual way too.
    known: u64,
}

impl<M: Message> Recall<M> {
    /// Goes on behind the last message that its predecessor has left in its files; from the oldest on, where that one is gone.
    fn after(memory: Memory<M>, last: Option<&M>) -> Self {
        let count = memory.delivered_so_far();
        // One less than the ring holds: the oldest is the next to be overwritten.
        let oldest = count.saturating_sub(RING as u64 - 1);
        let is_last = |number: &u64| memory.delivered(*number).is_some_and(|one| last.is_some_and(|last| bytes_of(&one) == bytes_of(last)));
        let next = (oldest..count).rev().find(is_last).map_or(oldest, |number| number + 1);
        Self { memory, next, known: next }
    }

    /// The next one that nobody has taken.
    fn take(&mut self) -> Option<M> {
        loop {
            let count = self.memory.delivered_so_far();
            // What has been overwritten meanwhile is lost, and the gap is counted.
            self.next = self.next.max(count.saturating_sub(RING as u64 - 1));
            if self.next >= count {
                return None;
            }
            self.next += 1;
            if let Some(message) = self.memory.delivered(self.next - 1) {
                return Some(message);
            }
        }
    }

    /// Whether a message that has come by the usual way has been taken from the ring before.
    fn knows(&mut self, message: &M) -> bool {
        let same = |number: &u64| self.memory.delivered(*number).is_some_and(|one| bytes_of(&one) == bytes_of(message));
        let place = (self.known..self.next).find(same);
        self.known = place.map_or(self.known, |number| number + 1);
        place.is_some()
    }

    /// All that was taken from the ring has come by the usual way too: from here on nothing can be missed.
    fn is_in_step(&self) -> bool {
        self.known == self.next
    }
}

impl<M: Message> Collector<M> {
    pub(crate) fn new(shared: Rc<Shared>, subscriber: Rc<Subscribing<M>>) -> Self {
        Self { inlet: Inlet::new(shared, subscriber, Admission::InOrder), last: None, lost: 0, recall: None }
    }

    /// Hands over all messages that are there, oldest first.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn collect(&mut self, mut take: impl FnMut(&M)) -> Result<(), Interrupted> {
        if let Some(recall) = self.recall.take() {
            self.recall = self.catch_up(recall, &mut take)?;
        }
        while self.recall.is_none()
            && let Some(message) = self.inlet.receive()?
        {
            self.count(message.header().tick);
            take(&message);
        }
        Ok(())
    }

    /// What the ring has, then what has come since; answers with what is left to be recalled.
    fn catch_up(&mut self, mut recall: Recall<M>, take: &mut impl FnMut(&M)) -> Result<Option<Recall<M>>, Interrupted> {
        let mut hand_over = |this: &mut Self, message: &M| {
            if this.inlet.admits(message) {
                this.count(message.header().tick);
                take(message);
            }
        };
        while let Some(message) = recall.take() {
            hand_over(self, &message);
        }
        loop {
            let sample = self.inlet.subscriber.receive().map_err(|error| self.inlet.shared.port_failed(M::TOPIC, error))?;
            let Some(message) = sample.map(Incoming) else { break };
            if recall.knows(&message) {
                continue;
            }
            // It came after the ring was read, and with it what lies before it there: nothing after it can be missed.
            while let Some(before) = recall.take() {
                if bytes_of(&before) == bytes_of(&*message) {
                    break;
                }
                hand_over(self, &before);
            }
            hand_over(self, &message);
            return Ok(None);
        }
        Ok((!recall.is_in_step()).then_some(recall))
    }

    fn count(&mut self, tick: u64) {
        let expected = self.last.map_or(0, |last| last + 1);
        if tick > expected {
            self.lost += tick - expected;
            self.inlet.shared.entry().add(Count::Lost, tick - expected);
        } else if tick < expected {
            self.inlet.shared.entry().add(Count::Repeated, 1);
        }
        self.last = Some(tick.max(expected));
    }

    /// Goes on where an earlier reader of the topic had come to.
    pub fn resume(&mut self, last: Option<u64>, lost: u64) {
        (self.last, self.lost) = (last, lost);
    }

    /// Counts a message that an earlier reader has left in its files.
    pub fn recount(&mut self, message: &M) {
        self.count(message.header().tick);
    }

    /// Goes on behind the last message that an earlier reader has left in its files: what was on its way to it comes first.
    ///
    /// # Errors
    /// When the topic's memory cannot be mapped.
    pub fn recall(&mut self, last: Option<&M>) -> Result<(), TopicError> {
        let memory = Memory::open(&self.inlet.shared.run);
        let memory = memory.map_err(|error| TopicError::Memory { topic: M::TOPIC, reason: error.to_string() })?;
        self.recall = Some(Recall::after(memory, last));
        Ok(())
    }

    /// The last tick taken in.
    #[must_use]
    pub fn last(&self) -> Option<u64> {
        self.last
    }

    /// Ticks that never came: gaps between the ticks that did, from tick 0.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

/// Why a message was not sent.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SendError {
    /// A number in it is not finite; it does not leave the process.
    #[error("{process} refused its own {topic:?} of tick {tick}: {field} is not finite")]
    NotFinite {
        /// Who sends.
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
        /// Who sends.
        process: String,
        /// Which topic.
        topic: &'static str,
        /// What iceoryx2 says.
        reason: String,
    },
}

/// Writes a topic.
pub struct Writer<M: Message> {
    outlet: Rc<Sending<M>>,
    usage: Usage,
    /// What this process sent last, before it was started again.
    legacy: Option<M>,
}

/// Where messages leave the process, and where the faults that concern them are.
struct Sending<M: Message> {
    shared: Rc<Shared>,
    publisher: Rc<Publishing<M>>,
    bit: u32,
    readers: Vec<usize>,
    /// The last messages, kept in shared memory for this process's replacement, and the recorder's.
    memory: Memory<M>,
    /// Messages that faults hold back, with the tick at which they leave.
    held: RefCell<VecDeque<(u64, M)>>,
    /// What a fault sends again and again.
    stale: Cell<Option<M>>,
}

impl<M: Message> Writer<M> {
    pub(crate) fn new(shared: &Rc<Shared>, publisher: Rc<Publishing<M>>) -> Result<Self, TopicError> {
        let memory = Memory::open(&shared.run).map_err(|error| TopicError::Memory { topic: M::TOPIC, reason: error.to_string() })?;
        let legacy = if shared.entry().incarnation() > 1 { memory.last() } else { None };
        let outlet = Rc::new(Sending {
            shared: Rc::clone(shared),
            publisher,
            bit: shared.topic_bit(M::TOPIC),
            readers: shared.manifest.woken_by(M::TOPIC).collect(),
            memory,
            held: RefCell::new(VecDeque::with_capacity(MOST_HELD)),
            stale: Cell::new(None),
        });
        shared.add_outlet(Rc::clone(&outlet) as Rc<dyn Outlet>);
        Ok(Self { outlet, usage: Usage::now(), legacy })
    }

    /// What the incarnation before this one sent last: all that a replacement knows of the past. `None` in a first incarnation.
    #[must_use]
    pub fn legacy(&self) -> Option<&M> {
        self.legacy.as_ref()
    }

    /// Sends a message of the tick in its header and wakes who waits for it; never blocks.
    ///
    /// Fills in the incarnation and the stamps: those of the inputs of the same tick, and this hop's own.
    ///
    /// # Errors
    /// When a number in it is not finite (counted; nothing is sent), or iceoryx2 fails.
    pub fn send(&mut self, mut message: M) -> Result<(), SendError> {
        let outlet = &*self.outlet;
        let shared = &outlet.shared;
        let tick = message.header().tick;
        if let Some(field) = first_not_finite(&message) {
            shared.entry().add(Count::NotFinite, 1);
            let error = SendError::NotFinite { process: shared.name().to_owned(), topic: M::TOPIC, tick, field };
            tracing::error!("{error}");
            return Err(error);
        }
        let sent_ns = shared.stamp(message.header_mut());
        shared.control_page.live_state_cells().note(&message);
        let failed = |reason| SendError::Port { process: shared.name().to_owned(), topic: M::TOPIC, reason };
        if shared.is_shaped() && shaped_topic(M::TOPIC) {
            outlet.memory.keep(&message);
            outlet.shape(&message).map_err(failed)?;
            if !shared.is_lockstep() {
                outlet.flush(shared.tick.get());
            }
        } else {
            outlet.deliver(&message).map_err(failed)?;
        }
        // With shaped messages in lockstep a tick is closed when its inputs are exhausted, for one message may be several or none.
        if !(shared.is_shaped() && shared.is_lockstep()) {
            shared.entry().set_ticks(tick + 1);
            if shared.is_lockstep() {
                shared.tick.set(tick + 1);
            }
            shared.report_progress();
        }
        shared.control_page.live_state_cells().note(&message);
        outlet.ring();
        count_lateness(&mut self.usage, shared, message.header(), sent_ns);
        Ok(())
    }
}

/// In real time an output is due one period after its tick was.
fn count_lateness(usage: &mut Usage, shared: &Shared, header: &shared_types::Header, sent_ns: u64) {
    let origin_ns = header.stamps.origin_ns();
    let due_ns = origin_ns + shared.manifest.period_ns();
    let is_late = origin_ns > 0 && sent_ns > due_ns;
    if shared.is_lockstep() || !(is_late || header.tick.is_multiple_of(USAGE_EVERY)) {
        return;
    }
    let now = Usage::now();
    if is_late {
        let was_late_already = header.stamps.received_ns.iter().any(|&ns| ns > due_ns);
        shared.entry().add(if was_late_already { Count::MissedLateInput } else { cause(*usage, now, false) }, 1);
    }
    *usage = now;
}

/// Room for what a delay can hold back.
const MOST_HELD: usize = 2 * MOST_DELAY_TICKS as usize + 4;

impl<M: Message> Sending<M> {
    fn deliver(&self, message: &M) -> Result<(), String> {
        // Before it leaves: whoever has it finds it there.
        self.memory.deliver(message);
        let sample = self.publisher.loan_uninit().map_err(|e| e.to_string())?;
        sample.write_payload(Wire(*message)).send().map_err(|e| e.to_string())?;
        self.shared.entry().add(Count::Sent, 1);
        Ok(())
    }

    /// Does to a message what the faults of its tick say.
    fn shape(&self, message: &M) -> Result<(), String> {
        let (shared, tick) = (&self.shared, self.shared.tick.get());
        let (mut message, label) = (*message, message.header().tick);
        let (mut due, mut copies) = (tick, 1);
        let mut is_stale = false;
        for (place, strike, kind) in shared.fates.borrow().of(shared.me, tick) {
            if !kind.shapes_messages() || !happens(strike, label) {
                continue;
            }
            shared.control_page.fault_table().mark_injected(place, now_ns());
            match kind {
                Kind::Drop => copies = 0,
                Kind::Duplicate => copies *= 2,
                // It leaves after the next one: that one is delivered before what is due is flushed.
                Kind::Reorder => due += 1,
                Kind::Delay => due += strike.amount as u64 + random(strike.seed, label) % (strike.jitter + 1),
                Kind::Corrupt => spoil(&mut message, strike, shared.name()),
                _ => is_stale = true,
            }
        }
        if is_stale {
            // Its own old header with it: whoever reads ticks knows it again.
            let Some(old) = self.stale.get().or_else(|| self.memory.before(label)) else { return Ok(()) };
            self.stale.set(Some(old));
            message = old;
        } else {
            self.stale.set(None);
        }
        for _ in 0..copies {
            if due == tick {
                self.deliver(&message)?;
            } else if self.held.borrow().len() < MOST_HELD {
                self.held.borrow_mut().push_back((due, message));
            }
        }
        Ok(())
    }
}

impl<M: Message> Outlet for Sending<M> {
    fn flush(&self, tick: u64) {
        let mut held = self.held.borrow_mut();
        let mut place = 0;
        while let Some(&(due, message)) = held.get(place) {
            if due > tick {
                place += 1;
                continue;
            }
            held.remove(place);
            // It fails where no memory is left: then the message is lost, as messages that faults hold back may be.
            let _ = self.deliver(&message);
        }
    }

    fn ring(&self) {
        for &reader in &self.readers {
            self.shared.control_page.process(reader).bell().ring(self.bit);
        }
    }
}
