//! Processes that take turns on one thread, in lockstep under planned faults: their ports without shared memory, waits and clocks.
//!
//! Each process has its turn once a tick, in the order in which the data flow: so a writer has closed the tick before a reader looks, and no process
//! waits. What becomes of a message, which process is down when, and from which checkpoint a replacement goes on is decided by [`crate::protocol`] and
//! [`crate::message_faults`], as between processes.

use std::collections::VecDeque;
use std::convert::Infallible;

use shared_types::Checkpoint;
use shared_types::fault::{Kind, ScheduledFault, corrupted_topic, shaped_topic};
use shared_types::graph::{self, Graph};
use shared_types::process::{MOST_RESTARTS, Restart};
use shared_types::topics::{self, Build, ByTopic, Each, Family, Topic};

use crate::fence::{Fence, first_not_finite};
use crate::message_faults::{Shaper, happens};
use crate::protocol::{Outage, Progress, Protocol, Role, View};

/// Takes in every message that counts, in the order of its topic: the recorder's part.
pub trait Sink {
    /// A message of a topic has been delivered.
    fn take<M: Topic>(&mut self, message: &M);
}

/// Why a run ends before its task does, in one sentence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ended(String);

impl Ended {
    /// For this reason.
    pub fn because(reason: impl std::fmt::Display) -> Self {
        Self(reason.to_string())
    }
}

impl std::fmt::Display for Ended {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// The states that a process leaves for its replacement: those of the last two ticks that it has answered, as in its checkpoint file.
#[derive(Clone, Debug)]
pub struct Checkpoints<C> {
    slot: C,
    committed: [Option<(u64, C)>; 2],
}

impl<C: Checkpoint> Default for Checkpoints<C> {
    fn default() -> Self {
        Self {
            slot: C::zeroed(),
            committed: [None; 2],
        }
    }
}

impl<C: Checkpoint> Checkpoints<C> {
    /// The state of the tick in hand, to be overwritten as a whole.
    pub fn slot(&mut self) -> &mut C {
        &mut self.slot
    }

    /// Commits the state of a tick.
    pub fn commit(&mut self, tick: u64) {
        self.committed = [self.committed[1], Some((tick, self.slot))];
    }

    /// The newest state of a tick from which the replacement may go on; newer ones are taken back.
    pub fn resume(&mut self, may_resume_from: impl Fn(u64) -> bool) -> Option<&C> {
        let newest = self
            .committed
            .into_iter()
            .flatten()
            .filter(|(tick, _)| may_resume_from(*tick))
            .max_by_key(|(tick, _)| *tick);
        self.committed = [None, newest];
        self.committed[1].as_ref().map(|(_, state)| state)
    }
}

/// One process: its part in the graph, and how far it has come.
#[derive(Clone, Debug)]
struct Process {
    name: String,
    role: Role,
    reads: Vec<String>,
    writes: Vec<String>,
    progress: Progress,
    may_restart: bool,
    /// The tick in hand: everything before it is closed.
    tick: u64,
    /// The outputs of a tick that have left, a bit each.
    sent: (u64, u32),
    has_fallen: bool,
}

/// One reader's end of a topic.
struct Inbox<M> {
    reader: usize,
    unread: VecDeque<M>,
    fence: Fence,
    /// The tick of the last message lent.
    last: Option<u64>,
    /// A message that came before its time.
    ahead: Option<M>,
}

impl<M> Inbox<M> {
    /// That of a process that answers from this tick on.
    fn from(reader: usize, tick: u64) -> Self {
        Self {
            reader,
            unread: VecDeque::new(),
            fence: Fence::default(),
            last: tick.checked_sub(1),
            ahead: None,
        }
    }
}

/// A topic: what faults make of its messages, and who reads them.
struct Wire<M> {
    writer: Option<usize>,
    is_corruptible: bool,
    shaper: Shaper<M>,
    /// The last two messages made while faults shape them; they outlive their writer.
    made: [Option<M>; 2],
    /// Of the sink.
    fence: Fence,
    inboxes: Vec<Inbox<M>>,
}

struct Wires;

impl Family for Wires {
    type Of<M: Topic> = Wire<M>;
}

/// The processes of a graph, their topics, and the faults planned for them.
pub struct Run<'a, O> {
    sink: &'a mut O,
    faults: Vec<ScheduledFault>,
    has_struck: Vec<bool>,
    is_shaped: bool,
    processes: Vec<Process>,
    wires: ByTopic<Wires>,
}

impl<O> View for Run<'_, O> {
    fn processes(&self) -> usize {
        self.processes.len()
    }

    fn role(&self, process: usize) -> Role {
        self.processes[process].role
    }

    fn progress(&self, process: usize) -> Progress {
        self.processes[process].progress
    }

    fn has_faults(&self) -> bool {
        !self.faults.is_empty()
    }

    fn outages(&self) -> impl Iterator<Item = Outage> {
        self.faults
            .iter()
            .enumerate()
            .filter_map(|(place, fault)| Outage::of(fault, place, self.has_struck[place], false))
    }

    fn is_lockstep(&self) -> bool {
        true
    }
}

/// The faults of a process at a tick, with their places.
fn of(
    faults: &[ScheduledFault],
    process: usize,
    tick: u64,
) -> impl Iterator<Item = (usize, &ScheduledFault, Kind)> {
    let concerned = move |(_, fault): &(usize, &ScheduledFault)| {
        fault.process as usize == process && fault.concerns(tick)
    };
    faults
        .iter()
        .enumerate()
        .filter(concerned)
        .filter_map(|(place, fault)| Some((place, fault, fault.kind()?)))
}

/// Brings a message to all readers, and to the sink where it counts.
fn deliver<M: Topic>(
    message: &M,
    fence: &mut Fence,
    inboxes: &mut [Inbox<M>],
    sink: &mut impl Sink,
) {
    inboxes
        .iter_mut()
        .for_each(|inbox| inbox.unread.push_back(*message));
    if fence.admits(message.header(), None) && message.is_finite() {
        sink.take(message);
    }
}

impl<'a, O: Sink> Run<'a, O> {
    /// The processes of a graph before the first tick, with the faults planned for them.
    #[must_use]
    pub fn new(graph: &Graph, faults: Vec<ScheduledFault>, sink: &'a mut O) -> Self {
        let processes: Vec<Process> = graph.process.iter().map(process).collect();
        let is_shaped = faults
            .iter()
            .any(|fault| fault.kind().is_some_and(Kind::shapes_messages));
        let wires = ByTopic::build(&mut Connect(&processes));
        Self {
            sink,
            has_struck: vec![false; faults.len()],
            faults,
            is_shaped,
            processes,
            wires,
        }
    }

    /// The source begins a tick.
    pub fn begin(&mut self, source: usize, tick: u64) {
        self.processes[source].tick = tick;
    }

    /// The faults planned.
    pub fn faults(&self) -> impl Iterator<Item = &ScheduledFault> {
        self.faults.iter()
    }

    /// The next message for a process at `now`, the source's tick in hand; `None` where its turn is over: it has closed the tick, stands still, or is dead.
    pub fn next<M: Topic>(&mut self, me: usize, now: u64) -> Option<M> {
        let tick = self.processes[me].tick;
        if tick > now || self.processes[me].has_fallen {
            return None;
        }
        let found = self.look_for_next::<M>(me);
        if let Some(outage) = Protocol::new(self, me).downfall(tick) {
            self.has_struck[outage.place] = true;
            if outage.is_death {
                self.processes[me].has_fallen = true;
            } else {
                // It stands still: what comes meanwhile is not for it.
                let process = &mut self.processes[me];
                (process.tick, process.progress.ticks) = (outage.until, outage.until);
                self.inbox::<M>(me).last = outage.until.checked_sub(1);
            }
            return None;
        }
        match &found {
            Some(message) => self.inbox::<M>(me).last = Some(message.header().tick),
            None => self.close(me),
        }
        found
    }

    /// The message of a tick that another input has named; `None` where it will not come.
    pub fn at<M: Topic>(&mut self, me: usize, tick: u64) -> Option<M> {
        loop {
            let inbox = self.inbox::<M>(me);
            let message = match inbox.ahead.take() {
                Some(message) => message,
                None => self.receive::<M>(me)?,
            };
            match message.header().tick {
                came if came == tick => return Some(message),
                came if came > tick => {
                    self.inbox::<M>(me).ahead = Some(message);
                    return None;
                }
                _ => {}
            }
        }
    }

    /// The newest message that has come to the source in its tick in hand; `None` where none is newer than the last.
    pub fn arriving<M: Topic>(&mut self, me: usize) -> Option<M> {
        let (tick, mut newest) = (self.processes[me].tick, None);
        while let Some(message) = self.receive::<M>(me) {
            let came = message.header().tick;
            let inbox = self.inbox::<M>(me);
            if inbox.last.is_some_and(|last| came <= last) {
                continue;
            }
            inbox.last = Some(came);
            newest = Some(message);
            if came == tick && !self.is_shaped {
                break;
            }
        }
        newest
    }

    /// Sends a message of a process that has not died in its turn. Whether it was the last of the outputs of its tick: then the tick's state is
    /// committed.
    ///
    /// # Errors
    /// [`Ended`] where a number in it is not finite: the process would end of it.
    pub fn send<M: Topic>(&mut self, me: usize, mut message: M) -> Result<bool, Ended> {
        let Process {
            name,
            writes,
            progress,
            tick: in_hand,
            sent,
            has_fallen,
            ..
        } = &mut self.processes[me];
        if *has_fallen {
            return Ok(false);
        }
        let tick = message.header().tick;
        message.header_mut().incarnation = progress.incarnation;
        if let Some(field) = first_not_finite(&message) {
            let topic = M::TOPIC;
            return Err(Ended(format!(
                "the {name} refused its own `{topic}` of tick {tick}: {field} is not finite"
            )));
        }
        let output = writes
            .iter()
            .position(|topic| topic == M::TOPIC)
            .unwrap_or_default();
        let before = if sent.0 == tick { sent.1 } else { 0 };
        *sent = (tick, before | 1 << output);
        let outputs = sent.1.count_ones();
        let is_last = outputs as usize >= writes.len();
        let in_hand = *in_hand;
        let Wire {
            is_corruptible,
            shaper,
            made,
            fence,
            inboxes,
            ..
        } = M::of_mut(&mut self.wires);
        let sink = &mut *self.sink;
        if self.is_shaped && shaped_topic(M::TOPIC) {
            *made = [made[1], Some(message)];
            let earlier = || {
                made.iter()
                    .flatten()
                    .filter(|one| one.header().tick < tick)
                    .max_by_key(|one| one.header().tick)
                    .copied()
            };
            let faults = of(&self.faults, me, in_hand);
            let deliver = |message: &M| {
                deliver(message, fence, inboxes, sink);
                Ok::<(), Infallible>(())
            };
            let Ok(()) = shaper.shape(
                &message,
                (in_hand, *is_corruptible),
                faults,
                earlier,
                |_| (),
                deliver,
            );
        } else {
            deliver(&message, fence, inboxes, sink);
        }
        if !is_last {
            if let Some(outage) = Protocol::new(self, me).downfall_after(tick, outputs) {
                self.has_struck[outage.place] = true;
                self.processes[me].has_fallen = true;
            }
        } else if self.processes[me].role.makes_ticks || !self.is_shaped {
            self.close(me);
        }
        Ok(is_last)
    }

    /// Whether a process has died in its turn.
    #[must_use]
    pub fn has_fallen(&self, me: usize) -> bool {
        self.processes[me].has_fallen
    }

    /// Starts a process again that has died. It answers when its outage is over.
    ///
    /// # Errors
    /// [`Ended`] where it has been started again as often as its budget allows.
    pub fn restart(&mut self, me: usize) -> Result<(), Ended> {
        loop {
            let Process {
                name,
                progress,
                may_restart,
                tick,
                ..
            } = &mut self.processes[me];
            if !*may_restart || progress.incarnation > MOST_RESTARTS {
                let restarts = progress.incarnation - 1;
                return Err(Ended(format!(
                    "the {name} ended at tick {tick} after {restarts} restarts, all that its budget allows"
                )));
            }
            progress.incarnation += 1;
            match Protocol::new(self, me).downfall_at_start() {
                Some(outage) => self.has_struck[outage.place] = true,
                None => break,
            }
        }
        let protocol = Protocol::new(self, me);
        let back = protocol.returns_at();
        let ticks = protocol
            .skips_to(back)
            .unwrap_or(self.processes[me].progress.ticks);
        let process = &mut self.processes[me];
        (
            process.progress.ticks,
            process.tick,
            process.sent,
            process.has_fallen,
        ) = (ticks, back, (0, 0), false);
        topics::each(&mut Reconnect {
            wires: &mut self.wires,
            me,
            back,
        });
        Ok(())
    }

    /// Whether the replacement of a process may go on from the state committed for a tick.
    #[must_use]
    pub fn may_resume_from(&self, me: usize, tick: u64) -> bool {
        Protocol::new(self, me).may_resume_from(tick)
    }

    /// A process sends nothing more in its tick in hand but what faults have held back until now.
    fn close(&mut self, me: usize) {
        let Process {
            tick,
            progress,
            role,
            ..
        } = &mut self.processes[me];
        let closed = *tick;
        progress.ticks = closed + 1;
        if !role.makes_ticks {
            *tick = closed + 1;
        }
        if self.is_shaped {
            topics::each(&mut Flush {
                wires: &mut self.wires,
                sink: self.sink,
                me,
                tick: closed,
            });
        }
    }

    fn inbox<M: Topic>(&mut self, me: usize) -> &mut Inbox<M> {
        let inboxes = &mut M::of_mut(&mut self.wires).inboxes;
        let place = inboxes
            .iter()
            .position(|inbox| inbox.reader == me)
            .unwrap_or(inboxes.len());
        if place == inboxes.len() {
            // A reader that the graph does not name: nothing comes to it.
            inboxes.push(Inbox::from(me, 0));
        }
        &mut inboxes[place]
    }

    /// The next message that counts for this reader.
    fn receive<M: Topic>(&mut self, me: usize) -> Option<M> {
        let read = self.processes[me]
            .reads
            .iter()
            .position(|topic| topic == M::TOPIC);
        loop {
            let message = self.inbox::<M>(me).unread.pop_front()?;
            let tick = message.header().tick;
            let cuts = |(_, fault, kind): (usize, &ScheduledFault, Kind)| {
                kind == Kind::Cut
                    && read.is_some_and(|read| fault.target as usize == read)
                    && happens(fault, tick)
            };
            if of(&self.faults, me, tick).any(cuts) {
                continue;
            }
            if self.inbox::<M>(me).fence.admits(message.header(), None) && message.is_finite() {
                return Some(message);
            }
        }
    }

    fn look_for_next<M: Topic>(&mut self, me: usize) -> Option<M> {
        let inbox = self.inbox::<M>(me);
        let last = inbox.last;
        let is_new = |message: &M| last.is_none_or(|last| message.header().tick > last);
        if let Some(ahead) = inbox.ahead.take().filter(is_new) {
            return Some(ahead);
        }
        loop {
            let message = self.receive::<M>(me)?;
            if is_new(&message) {
                return Some(message);
            }
        }
    }
}

/// A process of a graph before its first tick.
fn process(process: &graph::Process) -> Process {
    let role = process.role();
    Process {
        name: process.name.clone(),
        role: Role {
            makes_ticks: role == graph::Role::World,
            polled: role == graph::Role::Observer,
        },
        reads: process
            .reads
            .iter()
            .chain(&process.feedback)
            .cloned()
            .collect(),
        writes: process.writes.clone(),
        progress: Progress {
            ticks: 0,
            incarnation: 1,
            is_running: true,
            awaits_progress: false,
        },
        may_restart: process.restart == Restart::Always,
        tick: 0,
        sent: (0, 0),
        has_fallen: false,
    }
}

/// Connects each topic with its writer and its readers.
struct Connect<'a>(&'a [Process]);

impl Build<Wires> for Connect<'_> {
    type Error = Infallible;

    fn build<M: Topic>(&mut self) -> Result<Wire<M>, Infallible> {
        let is_topic = |topic: &String| topic == M::TOPIC;
        let writer = self
            .0
            .iter()
            .position(|process| process.writes.iter().any(is_topic));
        let corruptible = writer.and_then(|writer| corrupted_topic(&self.0[writer].writes));
        let reads = |(_, process): &(usize, &Process)| {
            !process.role.polled && process.reads.iter().any(is_topic)
        };
        Ok(Wire {
            writer,
            is_corruptible: corruptible == Some(M::TOPIC),
            shaper: Shaper::default(),
            made: [None; 2],
            fence: Fence::default(),
            inboxes: self
                .0
                .iter()
                .enumerate()
                .filter(reads)
                .map(|(reader, _)| Inbox::from(reader, 0))
                .collect(),
        })
    }
}

/// Delivers what faults have held back of the messages of a process.
struct Flush<'a, O> {
    wires: &'a mut ByTopic<Wires>,
    sink: &'a mut O,
    me: usize,
    tick: u64,
}

impl<O: Sink> Each for Flush<'_, O> {
    type Output = ();

    fn each<M: Topic>(&mut self) {
        let Wire {
            writer,
            shaper,
            fence,
            inboxes,
            ..
        } = M::of_mut(self.wires);
        if *writer == Some(self.me) {
            shaper.flush(self.tick, |message| {
                deliver(message, fence, inboxes, self.sink)
            });
        }
    }
}

/// Gives a replacement ends of its own: what its predecessor held back or had not read is gone with it.
struct Reconnect<'a> {
    wires: &'a mut ByTopic<Wires>,
    me: usize,
    back: u64,
}

impl Each for Reconnect<'_> {
    type Output = ();

    fn each<M: Topic>(&mut self) {
        let Wire {
            writer,
            shaper,
            inboxes,
            ..
        } = M::of_mut(self.wires);
        if *writer == Some(self.me) {
            *shaper = Shaper::default();
        }
        for inbox in inboxes.iter_mut().filter(|inbox| inbox.reader == self.me) {
            *inbox = Inbox::from(self.me, self.back);
        }
    }
}
