//! The topics of a program in another language: inputs borrowed or copied, outputs in private memory until they are sent.

use std::mem::offset_of;

use process::{Packed, not_finite};
use shared_types::graph::{Graph, Process};
use shared_types::layout::MessageLayout;
use shared_types::wire::{Field, Header};
use shared_types::{Message, Target, TorqueCommand};

use super::past::HEADER;
use crate::bus::collector::Collector;
use crate::bus::format::Format;
use crate::bus::reader::Ticks;
use crate::bus::writer::Outlet;
use crate::shell::{ProcessError, Shell};
use crate::wait::Interrupted;

/// The name and layout of a topic's message.
pub(super) struct Kind {
    format: Format,
    layout: MessageLayout,
}

impl Kind {
    fn of(shell: &Shell, graph: &Graph, topic: &str) -> Result<Self, ProcessError> {
        let layout = graph.layout(topic);
        let missing = || ProcessError::setup(format_args!("there is no topic `{topic}`"));
        Ok(Self {
            format: Format::in_run(shell.manifest(), topic).ok_or_else(missing)?,
            layout: layout.ok_or_else(missing)?,
        })
    }
}

/// The source of an input.
pub(super) enum From {
    /// Message by message.
    Ticks(Box<Ticks>),
    /// All messages of a process that only reads.
    Collector(Collector),
}

/// A topic that the process reads.
pub struct Input {
    kind: Kind,
    pub(super) from: From,
    /// The message of the tick in hand where it is not in shared memory: of a process that only reads, one carried over a cut, one that comes again.
    held: Option<Packed>,
    /// A message of the tick in hand has come.
    is_fresh: bool,
    /// A copy that stays at its place, for who asks for one.
    copy: Option<Packed>,
}

/// A topic that the process writes.
pub struct Output {
    kind: Kind,
    outlet: Outlet,
    message: Packed,
    is_used: bool,
}

/// The ends of all topics of a process. The graph lists what closes the loop behind what is read.
pub(super) fn open(
    shell: &Shell,
    graph: &Graph,
    process: &Process,
) -> Result<(Vec<Input>, Vec<Output>), ProcessError> {
    let is_observer = process.writes.is_empty();
    let read = process.reads.iter().chain(&process.feedback);
    let input = |topic: &String| {
        let kind = Kind::of(shell, graph, topic)?;
        let from = match is_observer {
            true => From::Collector(shell.collector(topic)?),
            false => From::Ticks(Box::new(shell.inlet(kind.format)?)),
        };
        Ok(Input {
            kind,
            from,
            held: None,
            is_fresh: false,
            copy: None,
        })
    };
    let output = |topic: &String| {
        let kind = Kind::of(shell, graph, topic)?;
        Ok(Output {
            outlet: shell.outlet(kind.format)?,
            message: Packed::of(&vec![0; kind.format.bytes]),
            kind,
            is_used: false,
        })
    };
    Ok((
        read.map(input).collect::<Result<_, ProcessError>>()?,
        process
            .writes
            .iter()
            .map(output)
            .collect::<Result<_, ProcessError>>()?,
    ))
}

impl Input {
    /// The topic.
    pub fn topic(&self) -> &'static str {
        self.kind.format.topic
    }

    /// The layout of its messages.
    pub fn layout(&self) -> &MessageLayout {
        &self.kind.layout
    }

    /// Whether the message is one of the tick in hand.
    pub fn is_fresh(&self) -> bool {
        self.is_fresh
    }

    /// The message of the tick in hand, in shared memory where it was sent: until the next wait.
    pub fn message(&self) -> Option<&[u8]> {
        if !self.is_fresh {
            return None;
        }
        match (&self.held, &self.from) {
            (Some(held), _) => Some(held.bytes()),
            (None, From::Ticks(ticks)) => ticks.current(),
            (None, From::Collector(_)) => None,
        }
    }

    /// The message of the tick in hand, or else the one before, as far as the program still sees it.
    pub(super) fn last(&self) -> Option<&[u8]> {
        self.message().or(self.copy.as_ref().map(Packed::bytes))
    }

    /// Goes on from what [`last`](Self::last) gave, and whether that was one of the tick in hand; `None` of other bytes.
    pub(super) fn resume(&mut self, last: &[u8], is_fresh: bool) -> Option<()> {
        if last.is_empty() {
            return Some(());
        }
        let message = Packed::checked(last).filter(|_| last.len() == self.kind.format.bytes)?;
        self.copy = Some(message.clone());
        self.hold(is_fresh.then_some(message));
        Some(())
    }

    /// Shows a message that is in no shared memory, or none.
    pub(super) fn hold(&mut self, message: Option<Packed>) {
        self.held = message;
        self.show(self.held.is_some());
    }

    /// From now on each message is copied to this place, which stays; zeros until the first.
    pub fn copied(&mut self) -> &[u8] {
        if self.copy.is_none() {
            self.copy = Some(Packed::of(&vec![0; self.kind.format.bytes]));
            self.show(self.is_fresh);
        }
        self.copy.as_ref().map_or(&[], Packed::bytes)
    }

    /// Whether no torque waits for its messages.
    pub(super) fn is_target(&self) -> bool {
        self.topic() == Target::TOPIC
    }

    /// The phase in a torque.
    pub(super) fn phase(&self) -> Option<u32> {
        const AT: usize = offset_of!(TorqueCommand, phase);
        if self.topic() != TorqueCommand::TOPIC {
            return None;
        }
        let word = self.message()?.get(AT..AT + 4)?;
        Some(u32::from_ne_bytes(word.try_into().ok()?))
    }

    /// The next tick that has a message.
    pub(super) fn next(&mut self) -> Result<Option<u64>, Interrupted> {
        let From::Ticks(ticks) = &mut self.from else {
            return Ok(None);
        };
        let tick = ticks.next()?.map(|message| message.tick());
        self.take(tick.is_some());
        Ok(tick)
    }

    /// The message of a tick; `false` when it will not come. Of targets, on which no torque waits, the newest.
    pub(super) fn of_tick(&mut self, tick: u64) -> Result<bool, Interrupted> {
        let is_target = self.is_target();
        let From::Ticks(ticks) = &mut self.from else {
            return Ok(false);
        };
        let has_come = match is_target {
            true => ticks.newest(tick)?.is_some(),
            false => ticks.at(tick)?.is_some(),
        };
        self.take(has_come);
        Ok(has_come || is_target)
    }

    /// The newest message that arrives in a tick.
    pub(super) fn arriving(&mut self, tick: u64, until_ns: Option<u64>) -> Result<(), Interrupted> {
        if let From::Ticks(ticks) = &mut self.from {
            let has_come = ticks.arriving(tick, until_ns)?.is_some();
            self.take(has_come);
        }
        Ok(())
    }

    /// A message has come in shared memory, or none.
    fn take(&mut self, has_come: bool) {
        self.held = None;
        self.show(has_come);
    }

    fn show(&mut self, has_come: bool) {
        self.is_fresh = has_come;
        let Some(mut copy) = self.copy.take() else {
            return;
        };
        if let Some(message) = self.message() {
            copy.bytes_mut().copy_from_slice(message);
        }
        self.copy = Some(copy);
    }
}

impl Output {
    /// The topic.
    pub fn topic(&self) -> &'static str {
        self.kind.format.topic
    }

    /// The layout of its messages.
    pub fn layout(&self) -> &MessageLayout {
        &self.kind.layout
    }

    /// The message to fill: a place that stays, and holds what was sent last. Its header is filled in when it is sent.
    pub fn place(&mut self) -> &mut [u8] {
        self.is_used = true;
        self.message.bytes_mut()
    }

    pub(super) fn is_used(&self) -> bool {
        self.is_used
    }

    /// Its content: the message that was sent last, as far as the program has not changed it.
    pub(super) fn last(&self) -> &[u8] {
        self.message.bytes()
    }

    /// Goes on from what [`last`](Self::last) gave; `None` of other bytes.
    pub(super) fn resume(&mut self, last: &[u8]) -> Option<()> {
        let is_one = last.len() == self.kind.format.bytes;
        self.message = Packed::checked(last).filter(|_| is_one)?;
        Some(())
    }

    /// The first of its fields that holds something else than a message that has been sent; headers are not the program's.
    pub(super) fn other_than(&self, sent: &[u8]) -> Option<String> {
        let ours = self.message.bytes();
        if ours[HEADER..] == sent[HEADER..] {
            return None;
        }
        let differs = |field: &&Field| {
            let place = field.offset..field.offset + field.size;
            field.offset >= HEADER && ours.get(place.clone()) != sent.get(place)
        };
        let field = self.kind.layout.fields.iter().find(differs);
        Some(field.map_or_else(String::new, |field| field.name.to_string()))
    }

    /// The topic, and the first of its fields that holds a number that is not finite.
    pub(super) fn not_finite(&self) -> Option<(&'static str, String)> {
        let Kind { format, layout } = &self.kind;
        let message = self.message.bytes();
        let field = match format.is_listed() {
            true => (format.not_finite)(message)?.to_owned(),
            false => not_finite(message, &layout.fields)?.name.to_string(),
        };
        Some((format.topic, field))
    }

    pub(super) fn send(&mut self, tick: u64) -> Result<(), ProcessError> {
        *self.message.header_mut() = Header {
            tick,
            ..Header::default()
        };
        self.outlet.loan()?.copy_from_slice(self.message.bytes());
        Ok(self.outlet.send()?)
    }
}
