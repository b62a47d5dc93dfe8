//! The reading end of a topic for a process of the chain: one borrowed message per tick.

use std::marker::PhantomData;
use std::rc::Rc;

use bytemuck::try_from_bytes;
use shared_types::{Message, TorqueCommand};

use crate::bus::inlet::Inlet;
use crate::bus::port::{Incoming, Receiver};
use crate::context::Context;
use crate::control_page::Count;
use crate::wait::{Interrupted, Wait, Waited};

/// Reads a topic, one message at a time.
///
/// In lockstep a process works through tick after tick. A tick is over for a reader when its
/// message has come, or when its writer has closed the tick and no message of it is under way: the
/// writer is down, or its message was lost. Then this process closes the tick too, and so a fault
/// anywhere in the chain is a tick without torque at its end, not a wait for what will never come.
pub struct Reader<M: Message>(Ticks, PhantomData<fn(&M)>);

impl<M: Message> Reader<M> {
    pub(crate) fn new(ticks: Ticks) -> Self {
        Self(ticks, PhantomData)
    }

    /// The next message: in lockstep that of the next tick that has one, in real time the newest one not yet seen. Waits for it.
    ///
    /// `None` when the run stops. In real time the ticks passed over are counted as lost.
    ///
    /// # Errors
    /// When nothing comes within the limit, or in lockstep a tick was skipped that no fault accounts for.
    #[allow(
        clippy::should_implement_trait,
        reason = "it lends from itself and can fail; `while let Some(m) = reader.next()?`"
    )]
    pub fn next(&mut self) -> Result<Option<&M>, Interrupted> {
        Ok(self.0.next()?.and_then(typed))
    }

    /// The message of one tick that another input has named. Waits for it.
    ///
    /// `None` when the run stops, or when this message will not come: a later one is there, or in lockstep its writer has closed the tick.
    ///
    /// # Errors
    /// See [`Reader::next`].
    pub fn at(&mut self, tick: u64) -> Result<Option<&M>, Interrupted> {
        Ok(self.0.at(tick)?.and_then(typed))
    }

    /// The newest message that arrives in the tick a [`TickSource`](crate::TickSource) has given out, for the process that makes the ticks: in
    /// lockstep when its writer has closed the tick, in real time by `deadline_ns` on `CLOCK_MONOTONIC`, or as soon as that tick's own is there.
    ///
    /// `None` when none came that is newer than the last, or the run stops. It may be older than `tick`; its header gives its own. Of torque each tick
    /// is counted as in time, late or without, and a missed deadline also for the process that was silent.
    ///
    /// # Errors
    /// See [`Reader::next`].
    pub fn arriving(
        &mut self,
        tick: u64,
        deadline_ns: Option<u64>,
    ) -> Result<Option<&M>, Interrupted> {
        Ok(self.0.arriving(tick, deadline_ns)?.and_then(typed))
    }
}

/// A message of the topic, in place. Its type is the one that the topic was opened with.
#[inline]
fn typed<M: Message>(message: &Incoming) -> Option<&M> {
    try_from_bytes(message).ok()
}

/// The reading end of a topic, message by message, whatever their type: see [`Reader`].
pub(crate) struct Ticks {
    shared: Rc<Context>,
    inlet: Inlet,
    topic: &'static str,
    bit: u32,
    /// The message lent last, borrowed from shared memory until the next one is.
    current: Option<Incoming>,
    /// The tick of that message.
    last: Option<u64>,
    /// A message that came before its time.
    ahead: Option<Incoming>,
    /// The tick that the process has in hand: given by `next`, and not asked beyond.
    in_hand: Option<u64>,
    /// The process is, or has been, absent before this tick.
    absent_until: u64,
    /// Of torque, at the process that makes the ticks: whose message of which topic it waits for, in the order of the data.
    chain: Vec<(usize, usize)>,
}

/// The topic and writers of a wait.
fn expected(shared: &Context, topic: &str, tick: Option<u64>) -> Wait {
    Wait {
        what: match tick {
            Some(tick) => format!("tick {tick} of topic {topic:?}"),
            None => format!("a first message on topic {topic:?}"),
        },
        from: shared
            .manifest
            .writer_of(topic)
            .map_or("its writer".into(), |w| {
                shared.manifest.processes[w].name.clone()
            }),
    }
}

/// The result of one poll of the buffer.
#[derive(Clone, Copy)]
enum Found {
    /// The message is now the current one.
    Current,
    /// The expected message will not come.
    Nothing,
}

impl Ticks {
    pub(crate) fn new(shared: Rc<Context>, receiver: Rc<Receiver>) -> Self {
        let topic = receiver.format.topic;
        let place = shared.manifest.topic_index(topic);
        let inlet = Inlet::new(Rc::clone(&shared), receiver);
        // A replacement does not answer again what its predecessor had.
        let last = if shared.entry().incarnation() > 1 {
            shared.control_page.topic(place).newest()
        } else {
            shared.manifest.from.checked_sub(1)
        };
        let is_answer = topic == TorqueCommand::TOPIC && shared.own().makes_ticks;
        let chain = match is_answer {
            true => shared.manifest.chain_to(topic),
            false => Vec::new(),
        };
        Self {
            shared,
            inlet,
            topic,
            bit: 1 << place,
            current: None,
            last,
            ahead: None,
            in_hand: None,
            absent_until: 0,
            chain,
        }
    }

    pub(crate) fn next(&mut self) -> Result<Option<&Incoming>, Interrupted> {
        let shared = Rc::clone(&self.shared);
        if !shared.start()? {
            return Ok(None);
        }
        // A stop may have ended the wait for another input of the tick.
        if let Some(tick) = self.in_hand.take()
            && let Some(topic) = shared.unsent(tick)
            && !shared.is_stopping()
        {
            return Err(Interrupted::Unsent {
                process: shared.name().to_owned(),
                topic: topic.to_owned(),
                tick,
            });
        }
        shared.pause();
        loop {
            let (tick, topic, last) = (shared.tick.get(), self.topic, self.last);
            let found = shared.wait(
                self.bit,
                None,
                || expected(&shared, topic, last.map(|last| last + 1)),
                || {
                    if shared.is_lockstep() {
                        self.look_for_next(tick)
                    } else {
                        self.look_for_newest()
                    }
                },
            )?;
            let Waited::Ready(found) = found else {
                return Ok(None);
            };
            // The tick in hand: in real time it is the message's.
            let tick = if shared.is_lockstep() {
                tick
            } else {
                self.current.as_ref().map_or(tick, |message| message.tick())
            };
            shared.tick.set(tick);
            let returns = shared.attend(tick);
            if returns > tick {
                self.stay_absent(tick, returns, matches!(found, Found::Current));
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

    /// Passes the tick in hand over; with shaped messages it is over when its inputs are.
    fn stay_absent(&mut self, tick: u64, returns: u64, has_message: bool) {
        let shared = &self.shared;
        self.absent_until = returns;
        if let Some(message) = self.current.as_ref().filter(|_| has_message) {
            self.last = Some(message.tick());
        }
        if !shared.is_lockstep() {
            // Messages that come meanwhile are not for it.
            shared.tick.set(returns);
            self.last = Some(returns - 1);
        } else if !(has_message && shared.is_shaped()) {
            shared.pass(tick);
            shared.tick.set(tick + 1);
        }
    }

    pub(crate) fn at(&mut self, tick: u64) -> Result<Option<&Incoming>, Interrupted> {
        let shared = Rc::clone(&self.shared);
        if !shared.start()? {
            return Ok(None);
        }
        shared.pause();
        let topic = self.topic;
        let found = shared.wait(
            self.bit,
            None,
            || expected(&shared, topic, Some(tick)),
            || self.look_for(tick),
        )?;
        match found {
            Waited::Ready(Found::Current) => {
                self.last = Some(tick);
                Ok(self.lend())
            }
            Waited::Ready(Found::Nothing) => {
                self.shared.entry().add(Count::Lost, 1);
                self.shared.excuse(tick);
                if self.shared.is_lockstep() && self.shared.is_unharmed() {
                    return Err(self.lost(
                        tick,
                        self.ahead.as_ref().map_or(tick + 1, |ahead| ahead.tick()),
                    ));
                }
                Ok(None)
            }
            Waited::Late | Waited::Stopped => Ok(None),
        }
    }

    /// The message of one tick in lockstep, as [`Reader::at`]; in real time the newest that has come, however old, and nothing is waited for: for an
    /// input that the loop must not depend on.
    pub(crate) fn newest(&mut self, tick: u64) -> Result<Option<&Incoming>, Interrupted> {
        if self.shared.is_lockstep() {
            return self.at(tick);
        }
        if !self.shared.start()? {
            return Ok(None);
        }
        if self.look_for_newest()?.is_some() {
            self.last = self.current.as_ref().map(|message| message.tick());
            return Ok(self.lend());
        }
        Ok(self.current.as_ref())
    }

    pub(crate) fn arriving(
        &mut self,
        tick: u64,
        deadline_ns: Option<u64>,
    ) -> Result<Option<&Incoming>, Interrupted> {
        let shared = Rc::clone(&self.shared);
        if !shared.start()? {
            return Ok(None);
        }
        shared.pause();
        let is_shaped = shared.is_shaped() && shared.is_lockstep();
        if is_shaped {
            shared.close(tick);
        }
        let (topic, before, mut newest) = (self.topic, self.last, self.last);
        let found = shared.wait(
            self.bit,
            deadline_ns,
            || expected(&shared, topic, Some(tick)),
            || {
                loop {
                    while let Some(message) = self.receive_newer(newest)? {
                        let came = message.tick();
                        self.current = Some(message);
                        newest = Some(came);
                        if came < tick && !self.chain.is_empty() {
                            shared.entry().came_late();
                        }
                        if came == tick && !is_shaped {
                            return Ok(Some(()));
                        }
                    }
                    if shared.is_unordered() && tick > 0 && before == Some(tick - 1) {
                        return Ok(Some(()));
                    }
                    // Messages between the last poll and the closing are still to be read: poll once more.
                    let is_over = shared.is_lockstep() && self.inlet.is_over(tick);
                    if !(is_over && self.inlet.has_more()?) {
                        return Ok(is_over.then_some(()));
                    }
                }
            },
        )?;
        self.account(newest == Some(tick), tick, deadline_ns);
        if matches!(found, Waited::Stopped) {
            return Ok(None);
        }
        self.last = newest;
        if newest == before {
            if shared.is_unordered() && before.is_some() {
                return Ok(self.current.as_ref());
            }
            if shared.is_lockstep() && shared.is_unharmed() {
                return Err(self.lost(tick, tick + 1));
            }
            shared.message_fault_detected();
            return Ok(None);
        }
        Ok(self.lend())
    }

    /// Counts a tick's torque, and whom a missing one is due to.
    fn account(&self, is_in_time: bool, tick: u64, deadline_ns: Option<u64>) {
        let (shared, Some(&(_, closing))) = (&self.shared, self.chain.last()) else {
            return;
        };
        if is_in_time {
            return shared.entry().add(Count::InTime, 1);
        }
        shared.entry().add(Count::NoTorque, 1);
        let sent_ns = shared.stamping.sent_ns.get();
        let is_behind =
            |(topic, _): &&(usize, usize)| shared.control_page.topic(*topic).is_behind(tick);
        let silent = match self.chain.iter().find(is_behind) {
            _ if deadline_ns.is_some_and(|deadline| sent_ns > deadline) => shared.me,
            Some((_, process)) => *process,
            None => closing,
        };
        shared.control_page.process(silent).add(Count::Silent, 1);
    }

    /// The message lent last.
    pub(crate) fn current(&self) -> Option<&[u8]> {
        self.current.as_deref()
    }

    /// The message in hand, for as long as the tick lasts.
    fn lend(&self) -> Option<&Incoming> {
        let message = self.current.as_ref()?;
        self.shared.note_input(message.header());
        Some(message)
    }

    fn lost(&self, expected: u64, found: u64) -> Interrupted {
        Interrupted::Lost {
            process: self.shared.name().to_owned(),
            topic: self.topic,
            expected,
            found,
        }
    }

    /// The next message in order; or nothing, when the tick is over without one.
    fn look_for_next(&mut self, tick: u64) -> Result<Option<Found>, Interrupted> {
        if self.take_up_ahead() {
            return Ok(Some(Found::Current));
        }
        loop {
            if let Some(message) = self.receive_newer(self.last)? {
                self.current = Some(message);
                return Ok(Some(Found::Current));
            }
            let is_over = self.inlet.is_over(tick);
            if !(is_over && self.inlet.has_more()?) {
                return Ok(is_over.then_some(Found::Nothing));
            }
        }
    }

    /// The next message of the buffer that is newer than `last`; the others are repetitions, and counted.
    fn receive_newer(&mut self, last: Option<u64>) -> Result<Option<Incoming>, Interrupted> {
        while let Some(message) = self.inlet.receive()? {
            let is_new = last.is_none_or(|last| message.tick() > last);
            if message.tick() < self.absent_until {
                // A message sent while it was absent is not for it, even if it comes later.
                if is_new && self.shared.tick.get() < self.absent_until {
                    return Ok(Some(message));
                }
                continue;
            }
            if is_new {
                return Ok(Some(message));
            }
            self.shared.entry().add(Count::Repeated, 1);
            self.shared.message_fault_detected();
        }
        Ok(None)
    }

    fn take_up_ahead(&mut self) -> bool {
        let is_next = |ahead: &Incoming| self.last.is_none_or(|last| ahead.tick() > last);
        let ahead = self.ahead.take().filter(is_next);
        let is_taken = ahead.is_some();
        self.current = ahead.or(self.current.take());
        is_taken
    }

    fn look_for_newest(&mut self) -> Result<Option<Found>, Interrupted> {
        let mut found = self.take_up_ahead().then_some(Found::Current);
        while let Some(message) = self.receive_newer(self.last)? {
            self.current = Some(message);
            found = Some(Found::Current);
        }
        Ok(found)
    }

    fn look_for(&mut self, tick: u64) -> Result<Option<Found>, Interrupted> {
        let mut over = false;
        loop {
            let message = match self.ahead.take() {
                Some(message) => Some(message),
                None => self.inlet.receive()?,
            };
            match message {
                Some(message) if message.tick() == tick => {
                    self.current = Some(message);
                    return Ok(Some(Found::Current));
                }
                Some(message) if message.tick() > tick => {
                    self.ahead = Some(message);
                    return Ok(Some(Found::Nothing));
                }
                Some(_) => self.shared.entry().add(Count::Repeated, 1),
                None if over => return Ok(Some(Found::Nothing)),
                None if self.shared.is_lockstep() && self.inlet.is_over(self.shared.tick.get()) => {
                    over = true
                }
                None => return Ok(None),
            }
        }
    }

    fn accept(&mut self) -> Result<Option<&Incoming>, Interrupted> {
        let Some(tick) = self.current.as_ref().map(|message| message.tick()) else {
            return Ok(None);
        };
        let expected = self.last.map_or(tick, |last| last + 1);
        let expected = expected.max(self.absent_until);
        if tick > expected {
            self.shared.entry().add(Count::Lost, tick - expected);
            if self.shared.is_lockstep() && self.shared.is_unharmed() {
                // A message of a later tick stays in the buffer.
                self.ahead = self.current.take();
                return Err(self.lost(expected, tick));
            }
        }
        (self.last, self.in_hand) = (Some(tick), Some(tick));
        Ok(self.lend())
    }
}
