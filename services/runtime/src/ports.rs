//! Typed ends of topics.

use std::rc::Rc;

use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample;
use shared_types::Message;

use crate::board::Count;
use crate::edge::{Fence, first_not_finite};
use crate::pace::{USAGE_EVERY, cause};
use crate::realtime::Usage;
use crate::shell::{Interrupted, Shared, Wait, Waited};
use crate::topics::{Publishing, Subscribing, Wire};

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

/// What a look into the buffer shows.
#[derive(Clone, Copy)]
enum Found {
    /// The message is now the current one.
    Current,
    /// The tick looked for will not come: a later one is there.
    Passed,
}

impl<M: Message> Reader<M> {
    pub(crate) fn new(shared: Rc<Shared>, subscriber: Rc<Subscribing<M>>) -> Self {
        let bit = shared.topic_bit(M::TOPIC);
        let inlet = Inlet::new(Rc::clone(&shared), subscriber);
        Self { shared, inlet, bit, current: M::zeroed(), last: None, ahead: None }
    }

    /// The next message: in lockstep that of exactly the next tick, in real time the newest one not yet seen. Waits for it.
    ///
    /// `None` when the run stops. In real time the ticks passed over are counted as lost.
    ///
    /// # Errors
    /// When nothing comes within the limit, or in lockstep a tick was skipped.
    #[allow(clippy::should_implement_trait, reason = "it lends from itself and can fail; `while let Some(m) = reader.next()?`")]
    pub fn next(&mut self) -> Result<Option<&M>, Interrupted> {
        let expected = self.last.map(|last| last + 1);
        if self.shared.is_lockstep() { self.take(expected, true, None) } else { self.take(expected, false, None) }
    }

    /// The message of one tick. Waits for it.
    ///
    /// `None` when the run stops, or in real time when a later tick is there already and this one will not come.
    ///
    /// # Errors
    /// As [`Reader::next`].
    pub fn at(&mut self, tick: u64) -> Result<Option<&M>, Interrupted> {
        self.take(Some(tick), true, None)
    }

    /// The message of one tick, if it comes before a deadline on `CLOCK_MONOTONIC` ([`Pace::deadline_ns`](crate::Pace::deadline_ns)).
    ///
    /// `None` when it did not, or the run stops. Without a deadline it is [`Reader::at`].
    ///
    /// # Errors
    /// As [`Reader::next`].
    pub fn at_until(&mut self, tick: u64, deadline_ns: Option<u64>) -> Result<Option<&M>, Interrupted> {
        self.take(Some(tick), true, deadline_ns)
    }

    /// `expected` is the earliest tick of interest; `exactly`: only that one, else the newest.
    fn take(&mut self, expected: Option<u64>, exactly: bool, deadline_ns: Option<u64>) -> Result<Option<&M>, Interrupted> {
        let shared = Rc::clone(&self.shared);
        if matches!(shared.start()?, Waited::Stopped) {
            return Ok(None);
        }
        shared.pause();
        let describe = || Wait {
            what: match expected {
                Some(tick) => format!("tick {tick} of topic {:?}", M::TOPIC),
                None => format!("a first message on topic {:?}", M::TOPIC),
            },
            from: shared.manifest.writer_of(M::TOPIC).map_or("its writer".into(), |w| shared.manifest.processes[w].name.clone()),
        };
        match shared.wait(self.bit, deadline_ns, describe, || self.look(expected, exactly))? {
            Waited::Ready(Found::Current) => Ok(Some(self.accept(expected))),
            Waited::Ready(Found::Passed) => self.passed(expected),
            Waited::Late | Waited::Stopped => Ok(None),
        }
    }

    /// Takes messages out of the buffer until the wanted one is there.
    fn look(&mut self, expected: Option<u64>, exactly: bool) -> Result<Option<Found>, Interrupted> {
        let mut found = None;
        if let Some(message) = self.ahead.take() {
            found = self.place(&message, expected, exactly);
        }
        while !(exactly && found.is_some()) {
            let Some(sample) = self.inlet.receive()? else { break };
            found = self.place(&sample.payload().0, expected, exactly).or(found);
        }
        let has_the_tick_before = || expected.is_some_and(|tick| tick > 0 && self.last == Some(tick - 1));
        if found.is_none() && exactly && self.shared.is_unordered() && has_the_tick_before() {
            found = Some(Found::Current);
        }
        Ok(found)
    }

    /// Copies a message to where it belongs: what the process computes with can change no more under its hands.
    fn place(&mut self, message: &M, expected: Option<u64>, exactly: bool) -> Option<Found> {
        let tick = message.header().tick;
        match expected {
            Some(expected) if tick < expected => {
                self.shared.line().add(Count::Repeated, 1);
                None
            }
            Some(expected) if exactly && tick > expected => {
                self.ahead = Some(*message);
                Some(Found::Passed)
            }
            _ => {
                self.current = *message;
                Some(Found::Current)
            }
        }
    }

    fn accept(&mut self, expected: Option<u64>) -> &M {
        let header = self.current.header();
        let skipped = header.tick - expected.unwrap_or(header.tick).min(header.tick);
        if skipped > 0 {
            self.shared.line().add(Count::Lost, skipped);
        }
        self.last = Some(header.tick);
        self.shared.note_input(header);
        &self.current
    }

    fn passed(&mut self, expected: Option<u64>) -> Result<Option<&M>, Interrupted> {
        self.shared.line().add(Count::Lost, 1);
        match (self.shared.is_lockstep(), expected, &self.ahead) {
            (true, Some(expected), Some(ahead)) => {
                Err(Interrupted::Lost { process: self.shared.name().to_owned(), topic: M::TOPIC, expected, found: ahead.header().tick })
            }
            _ => Ok(None),
        }
    }
}

/// Where messages enter the process.
struct Inlet<M: Message> {
    shared: Rc<Shared>,
    subscriber: Rc<Subscribing<M>>,
    writer: Option<usize>,
    fence: Fence,
}

impl<M: Message> Inlet<M> {
    fn new(shared: Rc<Shared>, subscriber: Rc<Subscribing<M>>) -> Self {
        let writer = shared.manifest.writer_of(M::TOPIC);
        Self { shared, subscriber, writer, fence: Fence::default() }
    }

    /// The next message that the fence admits, in shared memory still.
    fn receive(&mut self) -> Result<Option<Sample<ipc::Service, Wire<M>, ()>>, Interrupted> {
        loop {
            let sample = self.subscriber.receive().map_err(|error| self.shared.port_failed(M::TOPIC, error))?;
            let Some(sample) = sample else { return Ok(None) };
            let living = match (self.shared.is_lockstep(), self.writer) {
                (false, Some(writer)) => Some(self.shared.board.line(writer).incarnation()),
                _ => None,
            };
            if self.fence.admits(sample.payload().0.header(), living) {
                return Ok(Some(sample));
            }
            self.shared.line().add(Count::Fenced, 1);
        }
    }
}

/// Reads everything of a topic, in order; never waits.
pub struct Drain<M: Message> {
    inlet: Inlet<M>,
    last: Option<u64>,
    lost: u64,
}

impl<M: Message> Drain<M> {
    pub(crate) fn new(shared: Rc<Shared>, subscriber: Rc<Subscribing<M>>) -> Self {
        Self { inlet: Inlet::new(shared, subscriber), last: None, lost: 0 }
    }

    /// Hands over all messages that are there, oldest first.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn drain(&mut self, mut take: impl FnMut(&M)) -> Result<(), Interrupted> {
        while let Some(sample) = self.inlet.receive()? {
            let message = &sample.payload().0;
            let tick = message.header().tick;
            let expected = self.last.map_or(0, |last| last + 1);
            if tick > expected {
                self.lost += tick - expected;
                self.inlet.shared.line().add(Count::Lost, tick - expected);
            } else if tick < expected {
                self.inlet.shared.line().add(Count::Repeated, 1);
            }
            self.last = Some(tick.max(expected));
            take(message);
        }
        Ok(())
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
    shared: Rc<Shared>,
    publisher: Rc<Publishing<M>>,
    bit: u32,
    readers: Vec<usize>,
    usage: Usage,
}

impl<M: Message> Writer<M> {
    pub(crate) fn new(shared: Rc<Shared>, publisher: Rc<Publishing<M>>) -> Self {
        let bit = shared.topic_bit(M::TOPIC);
        let readers = shared.manifest.woken_by(M::TOPIC).collect();
        Self { shared, publisher, bit, readers, usage: Usage::now() }
    }

    /// Sends a message of the tick in its header and wakes who waits for it; never blocks.
    ///
    /// Fills in the incarnation and the stamps: those of the inputs of the same tick, and this hop's own.
    ///
    /// # Errors
    /// When a number in it is not finite (counted; nothing is sent), or iceoryx2 fails.
    pub fn send(&mut self, mut message: M) -> Result<(), SendError> {
        let tick = message.header().tick;
        if let Some(field) = first_not_finite(&message) {
            self.shared.line().add(Count::NotFinite, 1);
            let error = SendError::NotFinite { process: self.shared.name().to_owned(), topic: M::TOPIC, tick, field };
            tracing::error!("{error}");
            return Err(error);
        }
        let sent_ns = self.shared.stamp(message.header_mut());
        self.count_lateness(message.header(), sent_ns);
        self.deliver(message).map_err(|reason| SendError::Port { process: self.shared.name().to_owned(), topic: M::TOPIC, reason })?;
        self.shared.board.glance().note(&message);
        self.shared.line().set_ticks(tick + 1);
        for &reader in &self.readers {
            self.shared.board.line(reader).bell().ring(self.bit);
        }
        Ok(())
    }

    fn deliver(&self, message: M) -> Result<(), String> {
        let sample = self.publisher.loan_uninit().map_err(|e| e.to_string())?;
        sample.write_payload(Wire(message)).send().map_err(|e| e.to_string())?;
        Ok(())
    }

    /// In real time an output is due one period after its tick was.
    fn count_lateness(&mut self, header: &shared_types::Header, sent_ns: u64) {
        let due_ns = header.stamps.origin_ns() + self.shared.manifest.period_ns();
        let is_late = header.stamps.origin_ns() > 0 && sent_ns > due_ns;
        if self.shared.is_lockstep() || !(is_late || header.tick.is_multiple_of(USAGE_EVERY)) {
            return;
        }
        let usage = Usage::now();
        let was_late_already = header.stamps.received_ns.iter().any(|&ns| ns > due_ns);
        if is_late {
            let cause = if was_late_already { Count::MissedLateInput } else { cause(self.usage, usage, false) };
            self.shared.line().add(cause, 1);
        }
        self.usage = usage;
    }
}
