//! The edges of a thread under faults: which messages leave a process, which reach its readers, and
//! when a process is absent.
//!
//! A process that a plan kills or stops is absent: it closes its ticks without a step, and its state stays. With a death, what faults held back of it is
//! gone, and its incarnation is one higher afterwards.

use std::collections::VecDeque;
use std::convert::Infallible;

use shared_types::fault::{Kind, ScheduledFault, corrupted_topic, shaped_topic};
use shared_types::topics::{COUNT, OfTopic, TOPICS};

use crate::absence::absence;
use crate::fence::Fence;
use crate::member::{Board, Input, Member, Sink};
use crate::message_faults::{Shaper, is_cut};
use crate::packed::Packed;
use crate::port::{Inputs, Port};
use crate::scratch::Scratch;
use crate::step::Flow;

/// Why a run ends before its task does: a process has made a message with a number that is not finite.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the {process} refused its own `{topic}` of tick {tick}: {field} is not finite")]
pub struct Ended {
    /// The process.
    pub process: String,
    /// The message's topic.
    pub topic: &'static str,
    /// Its tick.
    pub tick: u64,
    /// The first such field.
    pub field: &'static str,
}

/// The messages on their way to a reader.
#[derive(Clone, Debug, Default)]
struct Inbox {
    /// Place of the topic among those that the graph has the reader read.
    read: usize,
    unread: VecDeque<Packed>,
    fence: Fence,
    /// Earlier ticks are not for it.
    next: u64,
}

impl Inbox {
    /// The next message from tick `from` on.
    fn look(&mut self, from: u64) -> Option<&Packed> {
        self.next = self.next.max(from);
        let is_past = |message: &mut Packed| message.header().tick < self.next;
        while self.unread.pop_front_if(is_past).is_some() {}
        self.unread.front()
    }

    /// The message of a tick.
    fn at(&mut self, tick: u64) -> Option<Packed> {
        let found = self.look(tick).filter(|one| one.header().tick == tick);
        let found = found.cloned();
        self.next = tick + 1;
        found
    }

    /// The newest of those that have come.
    fn newest(&mut self) -> Option<Packed> {
        let mut newest = None;
        while let Some(message) = self.look(0) {
            let message = message.clone();
            self.next = message.header().tick + 1;
            newest = Some(message);
        }
        newest
    }
}

/// The tick in hand of a process.
pub(crate) struct Now<'a> {
    /// Its place on the thread.
    pub(crate) me: usize,
    pub(crate) tick: u64,
    /// The faults of sensors and drives.
    pub(crate) faults: &'a [ScheduledFault],
    pub(crate) board: &'a mut Board,
    pub(crate) scratch: &'a mut Scratch,
    pub(crate) sink: Sink<'a>,
}

/// A process under faults.
struct Life {
    /// Its place in the graph.
    place: usize,
    incarnation: u32,
    /// One for each of its inputs.
    inboxes: Vec<Inbox>,
}

/// The destinations of messages.
struct Readers {
    ports: [Port; COUNT],
    lives: Vec<Life>,
    /// By topic, the inboxes: a member and one of its inputs.
    of: [Vec<(usize, usize)>; COUNT],
    /// Of the sink.
    fences: [Fence; COUNT],
}

impl Readers {
    fn deliver(&mut self, topic: usize, message: &[u8], faults: &[ScheduledFault], sink: Sink<'_>) {
        let packed = Packed::of(message);
        let header = packed.header();
        let is_sound = (self.ports[topic].not_finite)(message).is_none();
        for (member, input) in &self.of[topic] {
            let Life { place, inboxes, .. } = &mut self.lives[*member];
            let inbox = &mut inboxes[*input];
            let of_reader = of(faults, *place, header.tick);
            if is_cut(of_reader, inbox.read, header.tick).is_none()
                && inbox.fence.admits(header.incarnation, None)
                && is_sound
                && header.tick >= inbox.next
            {
                inbox.unread.push_back(packed.clone());
            }
        }
        if self.fences[topic].admits(header.incarnation, None) && is_sound {
            sink(topic, message);
        }
    }
}

/// The edges of a thread.
pub(crate) struct Edges {
    /// The run's.
    faults: Vec<ScheduledFault>,
    readers: Readers,
    shapers: [Shaper; COUNT],
}

/// The faults of a process at a tick, with their places.
fn of(
    faults: &[ScheduledFault],
    process: usize,
    tick: u64,
) -> impl Iterator<Item = (usize, &ScheduledFault, Kind)> {
    let all = faults.iter().enumerate();
    let concerned = move |(_, fault): &(usize, &ScheduledFault)| {
        fault.process as usize == process && fault.concerns(tick)
    };
    all.filter(concerned)
        .filter_map(|(place, fault)| Some((place, fault, fault.kind()?)))
}

impl Edges {
    pub(crate) fn new(members: &[Member], faults: &[ScheduledFault]) -> Self {
        let mut readers: [Vec<(usize, usize)>; COUNT] = Default::default();
        let mut shapers: [Shaper; COUNT] = Default::default();
        for (place, member) in members.iter().enumerate() {
            for (input, read) in member.reads.iter().enumerate() {
                readers[read.topic].push((place, input));
            }
            let writes: Vec<String> = member
                .writes
                .iter()
                .map(|topic| TOPICS[*topic].to_owned())
                .collect();
            let corrupted = corrupted_topic(&writes);
            for topic in &member.writes {
                shapers[*topic] = Shaper::new(corrupted == Some(TOPICS[*topic]));
            }
        }
        let inbox = |input: &Input| Inbox {
            read: input.read,
            ..Inbox::default()
        };
        let life = |member: &Member| Life {
            place: member.place,
            incarnation: 1,
            inboxes: member.reads.iter().map(inbox).collect(),
        };
        Self {
            faults: faults.to_vec(),
            readers: Readers {
                ports: Port::all(),
                lives: members.iter().map(life).collect(),
                of: readers,
                fences: Default::default(),
            },
            shapers,
        }
    }

    /// All that a process does at a tick.
    pub(crate) fn step(&mut self, member: &mut Member, now: &mut Now<'_>) -> Result<Flow, Ended> {
        if member.makes_ticks {
            return self.make(member, now);
        }
        if self.is_absent(member, now) {
            return Ok(Flow::Go);
        }
        let me = now.me;
        let first = |edges: &mut Self| {
            let inbox = edges.readers.lives[me].inboxes.first_mut()?;
            inbox.look(0).map(|message| message.header().tick)
        };
        while let Some(label) = first(self) {
            self.answer(member, label, now)?;
        }
        self.close(member, now);
        Ok(Flow::Go)
    }

    /// The tick of the process that makes them: on the newest message that closes the loop, if one has come.
    fn make(&mut self, member: &mut Member, now: &mut Now<'_>) -> Result<Flow, Ended> {
        let inboxes = &mut self.readers.lives[now.me].inboxes;
        let newest = inboxes.first_mut().and_then(Inbox::newest);
        let mut inputs = Inputs::of(now.tick, now.faults);
        for (message, input) in newest.iter().zip(&member.reads) {
            inputs.add(TOPICS[input.topic], message.bytes());
        }
        let flow = member.step_on(&inputs, 1, now.board, now.scratch);
        if flow == Flow::Go {
            self.send(member, now.tick, now)?;
            self.close(member, now);
        }
        Ok(flow)
    }

    /// The step for a message of its first input that has come.
    fn answer(&mut self, member: &mut Member, label: u64, now: &mut Now<'_>) -> Result<(), Ended> {
        let life = &mut self.readers.lives[now.me];
        let messages = life.inboxes.iter_mut().map(|inbox| inbox.at(label));
        let messages: Vec<_> = messages.collect();
        let mut inputs = Inputs::of(label, &[]);
        for (input, message) in member.reads.iter().zip(&messages) {
            match message {
                Some(message) => inputs.add(TOPICS[input.topic], message.bytes()),
                None if input.is_needed => return Ok(()),
                None => {}
            }
        }
        let incarnation = life.incarnation;
        // A stage does not end a run.
        let _ = member.step_on(&inputs, incarnation, now.board, now.scratch);
        self.send(member, label, now)
    }

    /// Sends the outputs of a step.
    fn send(&mut self, member: &Member, label: u64, now: &mut Now<'_>) -> Result<(), Ended> {
        let parts = now.board.parts();
        for topic in &member.writes {
            if let Some(field) = (self.readers.ports[*topic].not_finite)(parts[*topic]) {
                return Err(Ended {
                    process: member.name.clone(),
                    topic: TOPICS[*topic],
                    tick: label,
                    field,
                });
            }
        }
        for topic in &member.writes {
            let (readers, faults) = (&mut self.readers, &self.faults);
            let mut deliver = |message: &[u8]| readers.deliver(*topic, message, faults, now.sink);
            if !shaped_topic(TOPICS[*topic]) {
                deliver(parts[*topic]);
                continue;
            }
            let own = of(faults, member.place, now.tick);
            let deliver = |message: &[u8]| {
                deliver(message);
                Ok::<(), Infallible>(())
            };
            let shaper = &mut self.shapers[*topic];
            let Ok(()) = shaper.shape(parts[*topic], now.tick, own, |_| (), deliver);
        }
        Ok(())
    }

    /// Sends what faults have held back until now.
    fn close(&mut self, member: &Member, now: &mut Now<'_>) {
        for topic in &member.writes {
            let (readers, faults) = (&mut self.readers, &self.faults);
            let deliver = |message: &[u8]| readers.deliver(*topic, message, faults, now.sink);
            self.shapers[*topic].flush(now.tick, deliver);
        }
    }

    /// Whether the process is absent at this tick. With a death, what it holds back is gone.
    fn is_absent(&mut self, member: &Member, now: &Now<'_>) -> bool {
        let takes_down = |fault: &&ScheduledFault| {
            fault.process as usize == member.place && fault.kind().is_some_and(Kind::takes_down)
        };
        let (deaths, returns) = absence(self.faults.iter().filter(takes_down), now.tick);
        let life = &mut self.readers.lives[now.me];
        if std::mem::replace(&mut life.incarnation, 1 + deaths) != 1 + deaths {
            let own = member.writes.iter();
            own.for_each(|topic| self.shapers[*topic].die());
        }
        let is_absent = returns > now.tick;
        if let Some(first) = life.inboxes.first_mut().filter(|_| is_absent) {
            // Messages that come meanwhile are not for it.
            first.next = returns;
        }
        is_absent
    }
}
