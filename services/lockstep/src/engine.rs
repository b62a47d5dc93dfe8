//! Runs the processes of a graph on one thread, step by step under the lockstep protocol. It does
//! the work of ports and launcher without shared memory, waits or clocks.
//!
//! A message reaches the retainer of its topic first, then its readers in order; a death may come
//! between any two steps. The driver chooses the process of the next step: the chain lets each run
//! until it waits ([`Engine::run`]), and the simulation tries every order. The [`World`] decides
//! about contents of messages and about further readers.

use std::collections::VecDeque;
use std::hash::Hash;

use process::Fence;

use crate::protocol::{Outage, Progress, Protocol, Role, View};
use crate::recall::oldest_missed;

/// A message on its way.
pub trait Carried: Clone + Eq + Hash {
    /// The tick that it is of.
    fn tick(&self) -> u64;
    /// That of its writer.
    fn incarnation(&self) -> u32;
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

/// The steps of all processes, and the fate of their messages.
pub trait World {
    /// Of any topic.
    type Message: Carried;
    /// State that a process keeps for its replacement.
    type State: Clone + Hash;

    /// The step of a process: its outputs in the order in which they leave. The first of its inputs is there; the source has none. `None`: nothing leaves,
    /// because an input is missing.
    ///
    /// # Errors
    /// [`Ended`] if the process would end the run.
    fn answer(
        &mut self,
        process: usize,
        tick: u64,
        incarnation: u32,
        inputs: &[Option<Self::Message>],
    ) -> Result<Option<Vec<Self::Message>>, Ended>;

    /// The source takes the messages that close the loop of a tick, if they have arrived. Returns
    /// whether the run is over.
    fn close_loop(&mut self, tick: u64, message: Option<Self::Message>) -> bool;

    /// The state of a process after its step.
    fn save(&mut self, process: usize) -> Self::State;

    /// A replacement restores its predecessor's state, or starts anew.
    ///
    /// # Errors
    /// [`Ended`] if it cannot begin.
    fn restore(&mut self, process: usize, state: Option<Self::State>) -> Result<(), Ended>;

    /// Messages that leave at a tick in place of the original.
    fn leave(&mut self, _topic: usize, message: Self::Message, _tick: u64) -> Vec<Self::Message> {
        vec![message]
    }

    /// Messages held back that are due when a tick is closed.
    fn flush(&mut self, _topic: usize, _tick: u64) -> Vec<Self::Message> {
        Vec::new()
    }

    /// Whether a message reaches this reader.
    fn reaches(&self, _reader: usize, _topic: usize, _message: &Self::Message) -> bool {
        true
    }

    /// Whether all its numbers are finite.
    fn is_sound(&self, _topic: usize, _message: &Self::Message) -> bool {
        true
    }

    /// A message is in its topic's retainer. The observer's progress, where there is one that has opened its topics.
    fn retained(&mut self, _topic: usize, _message: &Self::Message, _observer: Option<Progress>) {}

    /// A message has reached all readers, and now the observer.
    fn delivered(&mut self, _topic: usize, _message: &Self::Message) {}

    /// A process has opened its topics while the observer had them open.
    fn connected(&mut self, _process: usize) {}

    /// The launcher copies the retained messages.
    fn hand_over(&mut self) {}

    /// The observer has died, or (`true`) its replacement takes over.
    fn replace_observer(&mut self, _is_back: bool) {}

    /// The observer's next step; one that collects nothing is through at once.
    fn observe(&mut self, _run: &Observed) -> Step {
        Step::Closed(0, true)
    }
}

/// The run as the observer, the process that only collects messages, finds it.
#[derive(Clone, Debug)]
pub struct Observed {
    /// Ticks made, and ticks that it has taken in.
    pub ticks: [u64; 2],
    /// Nothing more comes.
    pub is_over: bool,
    /// It goes down at the end of the round in hand, as planned.
    pub is_falling: bool,
    /// There is a reason for a round without messages.
    pub wants_round: bool,
    /// By process: the first tick of which it has sent nothing more when it died.
    pub before_death: Vec<u64>,
}

/// The end of a step of the observer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// There was nothing to do.
    Idle,
    /// It continues.
    Done,
    /// It has ended a round in which everything of these ticks was taken in; whether the last one.
    Closed(u64, bool),
}

/// A process in its graph; topics are numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Part {
    /// Its name.
    pub name: String,
    /// Its role in the protocol.
    pub role: Role,
    /// The topics that it reads; a message of the first begins its step.
    pub reads: Vec<usize>,
    /// The topic that closes the loop, of the source.
    pub feedback: Option<usize>,
    /// The topics that it writes.
    pub writes: Vec<usize>,
    /// How often it is started again at most.
    pub restarts: u32,
}

/// The sizes of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Limits {
    /// Ticks that the source may be ahead of a process.
    pub chain_lag: u64,
    /// The same, of the observer.
    pub recorder_lag: u64,
    /// Unread messages that a reader has room for.
    pub depth: u64,
    /// Ticks that a death without a plan lasts.
    pub down: u64,
    /// Messages of a topic that its retainer holds.
    pub retained: usize,
    /// The run ends before this tick, if not earlier.
    pub ticks: u64,
    /// Any number of messages may leave in a tick; it is over when its inputs are.
    pub is_shaped: bool,
}

/// State of a process between two steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum At {
    /// Dead; the launcher has not detected it.
    Dead,
    /// Detected; the launcher starts it again at some step.
    Detected,
    /// Started, and not yet ready for its first tick.
    Starting,
    /// At the beginning of its tick in hand.
    Tick,
    /// Before a step of sending an output: 0 commits the checkpoint, 1 reaches the retainer, then a reader each, at last the observer.
    Sending(usize, usize),
    /// All is sent, and the tick not closed.
    Closing,
    /// The source, waiting for the messages that close the loop.
    Torque,
    /// The source, waiting for the others at the end.
    Finish,
    Done,
}

#[derive(Clone, Hash)]
pub(crate) struct Process<M, S> {
    part: Part,
    pub(crate) progress: Progress,
    pub(crate) at: At,
    pub(crate) tick: u64,
    /// Of the step in hand.
    outputs: Vec<M>,
    /// Messages that leave for the current output.
    leaving: Vec<M>,
    /// The last two commits: tick and state.
    checkpoint: [Option<(u64, S)>; 2],
}

/// A reader's end of a topic.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Inbox<M> {
    reader: usize,
    unread: VecDeque<M>,
    fence: Fence,
    /// Earlier ticks are not for it.
    next: u64,
}

impl<M> Inbox<M> {
    fn from(reader: usize, next: u64) -> Self {
        let (unread, fence) = (VecDeque::new(), Fence::default());
        Self {
            reader,
            unread,
            fence,
            next,
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Wire<M> {
    writer: usize,
    pub(crate) retained: VecDeque<M>,
    inboxes: Vec<Inbox<M>>,
}

/// The processes of a graph between two steps.
#[derive(Clone, Hash)]
pub struct Engine<W: World> {
    pub(crate) world: W,
    pub(crate) processes: Vec<Process<W::Message, W::State>>,
    pub(crate) topics: Vec<Wire<W::Message>>,
    pub(crate) outages: Vec<Outage>,
    limits: Limits,
    has_faults: bool,
    is_stopping: bool,
    is_observer_falling: bool,
    /// A process died and the launcher detected it after the last tick: the run is reported as failed, and has no plan that repeats it.
    pub(crate) has_failed: bool,
    /// The first guarantee of the engine itself that was broken.
    pub(crate) broken: Option<&'static str>,
}

impl<W: World> View for Engine<W> {
    fn processes(&self) -> usize {
        self.processes.len()
    }
    fn role(&self, process: usize) -> Role {
        self.processes[process].part.role
    }
    fn progress(&self, process: usize) -> Progress {
        self.processes[process].progress
    }
    fn has_faults(&self) -> bool {
        self.has_faults || !self.outages.is_empty()
    }
    fn outages(&self) -> impl Iterator<Item = Outage> {
        self.outages.iter().copied()
    }
    fn is_lockstep(&self) -> bool {
        true
    }
    fn recorder_lag(&self) -> u64 {
        self.limits.recorder_lag
    }
    fn chain_lag(&self) -> u64 {
        self.limits.chain_lag
    }
}

impl<W: World> Engine<W> {
    /// Before the first tick. `outages` are those planned; `has_faults`: there are other faults besides.
    pub fn new(
        world: W,
        parts: Vec<Part>,
        outages: Vec<Outage>,
        has_faults: bool,
        limits: Limits,
    ) -> Self {
        let topics = parts.iter().flat_map(|part| &part.writes).max();
        let reads = |part: &Part, topic| {
            let mut inputs = part.reads.iter().chain(&part.feedback);
            !part.role.polled && inputs.any(|one| *one == topic)
        };
        let of_all = |is: &dyn Fn(&Part) -> bool| {
            let all = parts.iter().enumerate().filter(|(_, part)| is(part));
            all.map(|(place, _)| place).collect::<Vec<_>>()
        };
        let wire = |topic| Wire {
            // A topic that no process writes has no messages.
            writer: of_all(&|part| part.writes.contains(&topic))
                .first()
                .copied()
                .unwrap_or(0),
            retained: VecDeque::new(),
            inboxes: of_all(&|part| reads(part, topic))
                .into_iter()
                .map(|reader| Inbox::from(reader, 0))
                .collect(),
        };
        let progress = Progress {
            ticks: 0,
            incarnation: 1,
            is_running: true,
            awaits_progress: false,
        };
        Self {
            world,
            topics: (0..topics.map_or(0, |most| most + 1)).map(wire).collect(),
            processes: parts
                .into_iter()
                .map(|part| Process {
                    part,
                    progress,
                    at: At::Tick,
                    tick: 0,
                    outputs: Vec::new(),
                    leaving: Vec::new(),
                    checkpoint: [None, None],
                })
                .collect(),
            outages,
            limits,
            has_faults,
            is_stopping: false,
            is_observer_falling: false,
            has_failed: false,
            broken: None,
        }
    }

    /// Lets each process in turn go on until it waits, to the end of the run.
    ///
    /// # Errors
    /// [`Ended`] if it ends before.
    pub fn run(&mut self) -> Result<(), Ended> {
        while !self.is_over() {
            let mut has_moved = false;
            for me in 0..self.processes.len() {
                while self.step(me)? {
                    has_moved = true;
                }
            }
            if let Some(broken) = self.broken {
                return Err(Ended::because(broken));
            }
            if !has_moved {
                return Err(Ended::because("no process can go on"));
            }
        }
        Ok(())
    }

    /// Whether every process has ended.
    pub(crate) fn is_over(&self) -> bool {
        self.has_failed || self.processes.iter().all(|one| one.at == At::Done)
    }

    fn protocol(&self, me: usize) -> Protocol<'_, Self> {
        Protocol::new(self, me)
    }

    fn inbox(&mut self, me: usize, topic: usize) -> Option<&mut Inbox<W::Message>> {
        let inboxes = &mut self.topics[topic].inboxes;
        inboxes.iter_mut().find(|inbox| inbox.reader == me)
    }

    /// The next message from tick `from` on for a reader: from its buffer, or one that a dead
    /// writer had sent only to the retainer. It is not removed.
    fn look(&mut self, me: usize, topic: usize, from: u64) -> Option<W::Message> {
        let before_death = self
            .protocol(me)
            .sent_before_death(self.topics[topic].writer);
        let Wire {
            retained, inboxes, ..
        } = &mut self.topics[topic];
        let inbox = inboxes.iter_mut().find(|inbox| inbox.reader == me)?;
        inbox.next = inbox.next.max(from);
        let (unread, next) = (&mut inbox.unread, inbox.next);
        while unread
            .pop_front_if(|message| message.tick() < next)
            .is_some()
        {}
        let came = unread.front().map_or(u64::MAX, Carried::tick);
        if next < before_death && next < came {
            let before = came.min(before_death);
            let newest_first = retained.iter().rev();
            let missed = oldest_missed(newest_first, next, before, |message| message.tick());
            missed
                .into_iter()
                .for_each(|one| unread.push_front(one.clone()));
        }
        unread.front().cloned()
    }

    fn has_closed(&self, me: usize, topic: usize) -> bool {
        let (writer, tick) = (self.topics[topic].writer, self.processes[me].tick);
        self.protocol(me).has_closed(Some(writer), tick)
    }

    fn strike(&mut self, outage: Outage) {
        self.outages[outage.place].has_struck = true;
    }

    fn die(&mut self, me: usize, at: At) {
        let one = &mut self.processes[me];
        (one.progress.is_running, one.at) = (false, at);
        if one.part.role.polled {
            self.is_observer_falling = false;
            self.world.replace_observer(false);
        }
    }

    /// Kills a process that lives, without a plan.
    pub fn kill(&mut self, me: usize) {
        if self.is_alive(me) {
            self.has_failed |= self.is_stopping && !self.role(me).polled;
            self.die(me, At::Dead);
        }
    }

    pub(crate) fn is_alive(&self, me: usize) -> bool {
        !matches!(self.processes[me].at, At::Dead | At::Detected | At::Done)
    }

    /// The launcher detects a death that no plan had, and enters it.
    fn detect(&mut self, me: usize) {
        self.world.hand_over();
        let Process { part, progress, .. } = &self.processes[me];
        let closed = progress.ticks;
        let last = |topic: &usize| self.topics[*topic].retained.back();
        let has_sent = |topic: &&usize| last(topic).is_some_and(|last| last.tick() >= closed);
        let sent = part.writes.iter().filter(has_sent).count();
        let is_answered = sent > 0 && sent == part.writes.len();
        let at = closed + u64::from(is_answered);
        self.outages.push(Outage {
            place: self.outages.len(),
            process: me,
            at,
            until: at + self.limits.down,
            has_struck: true,
            is_death: true,
            is_unplanned: true,
            after_outputs: if is_answered { 0 } else { sent as u32 },
        });
        self.processes[me].progress.ticks = closed.max(at);
        self.processes[me].at = At::Detected;
    }

    fn restart(&mut self, me: usize) -> Result<(), Ended> {
        self.world.hand_over();
        let Process {
            part,
            progress,
            at,
            tick,
            ..
        } = &mut self.processes[me];
        let (name, restarts) = (&part.name, progress.incarnation - 1);
        if restarts >= part.restarts {
            return Err(Ended::because(format_args!(
                "the {name} ended at tick {tick} after {restarts} restarts, all that its budget allows"
            )));
        }
        progress.incarnation += 1;
        *at = At::Starting;
        Ok(())
    }

    fn start(&mut self, me: usize) -> Result<(), Ended> {
        if self.role(me).polled {
            self.world.replace_observer(true);
            self.processes[me].progress.is_running = true;
            self.processes[me].at = At::Tick;
            return Ok(());
        }
        if let Some(outage) = self.protocol(me).downfall_at_start() {
            self.strike(outage);
            self.die(me, At::Detected);
            return Ok(());
        }
        let commits = self.processes[me].checkpoint.iter().flatten();
        let may_resume = |commit: &&(u64, _)| self.protocol(me).may_resume_from(commit.0);
        let last = commits
            .filter(may_resume)
            .max_by_key(|(tick, _)| *tick)
            .cloned();
        self.world
            .restore(me, last.as_ref().map(|(_, state)| state.clone()))?;
        let back = self.protocol(me).skips_to(self.protocol(me).returns_at());
        let one = &mut self.processes[me];
        one.checkpoint = [None, last];
        one.progress.ticks = back.unwrap_or(one.progress.ticks);
        (one.tick, one.progress.is_running) = (one.progress.ticks, true);
        let inboxes = self.topics.iter_mut().flat_map(|topic| &mut topic.inboxes);
        inboxes
            .filter(|inbox| inbox.reader == me)
            .for_each(|inbox| *inbox = Inbox::from(me, one.tick));
        if self.observer().is_some() {
            self.world.connected(me);
        }
        self.begin_tick(me);
        Ok(())
    }

    /// The observer that has opened its topics.
    fn observer(&self) -> Option<Progress> {
        let is_there = |one: &&Process<_, _>| {
            one.part.role.polled && matches!(one.at, At::Starting | At::Tick)
        };
        self.processes.iter().find(is_there).map(|one| one.progress)
    }

    fn begin_tick(&mut self, me: usize) {
        let is_over = self.processes[me].tick >= self.limits.ticks || self.is_stopping;
        self.processes[me].at = match (is_over, self.role(me).makes_ticks) {
            (false, _) => At::Tick,
            (true, true) => At::Finish,
            (true, false) => At::Done,
        };
    }

    /// One step of a process, or of the launcher for it; whether there was one.
    ///
    /// # Errors
    /// [`Ended`] if the run cannot go on.
    pub fn step(&mut self, me: usize) -> Result<bool, Ended> {
        let role = self.role(me);
        match self.processes[me].at {
            At::Done => return Ok(false),
            At::Dead => self.detect(me),
            At::Detected => self.restart(me)?,
            At::Starting => self.start(me)?,
            At::Tick if role.polled => return Ok(self.observe(me)),
            At::Tick if role.makes_ticks => return self.make_tick(me),
            At::Tick => return self.take_inputs(me),
            At::Sending(output, stage) => self.send(me, output, stage),
            At::Closing => self.close(me),
            At::Torque => return Ok(self.close_loop(me)),
            At::Finish => return Ok(self.finish(me)),
        }
        Ok(true)
    }

    fn make_tick(&mut self, me: usize) -> Result<bool, Ended> {
        let tick = self.processes[me].tick;
        let waits = self.protocol(me).holds_back(tick).is_some();
        self.processes[me].progress.awaits_progress = waits;
        if !waits {
            self.answer(me, tick, &[])?;
        }
        Ok(!waits)
    }

    fn answer(&mut self, me: usize, tick: u64, inputs: &[Option<W::Message>]) -> Result<(), Ended> {
        let incarnation = self.progress(me).incarnation;
        if let Some(outputs) = self.world.answer(me, tick, incarnation, inputs)? {
            self.processes[me].outputs = outputs;
            self.processes[me].at = self.at_output(me, 0);
        }
        Ok(())
    }

    /// Where the sending of an output begins: the checkpoint is committed before the last.
    fn at_output(&self, me: usize, output: usize) -> At {
        At::Sending(
            output,
            usize::from(output + 1 < self.processes[me].outputs.len()),
        )
    }

    fn take_inputs(&mut self, me: usize) -> Result<bool, Ended> {
        let (tick, reads) = (
            self.processes[me].tick,
            self.processes[me].part.reads.clone(),
        );
        let first = self.look(me, reads[0], 0);
        if first.is_none() && !self.has_closed(me, reads[0]) {
            return Ok(false);
        }
        if let Some(outage) = self.protocol(me).downfall(tick) {
            self.strike(outage);
            if outage.is_death {
                self.die(me, At::Detected);
            } else {
                // It stands still: what comes meanwhile is not for it.
                let one = &mut self.processes[me];
                (one.tick, one.progress.ticks) = (outage.until, outage.until);
                self.inbox(me, reads[0])
                    .into_iter()
                    .for_each(|inbox| inbox.next = outage.until);
            }
            return Ok(true);
        }
        let Some(first) = first else {
            self.close(me);
            return Ok(true);
        };
        let (label, mut inputs) = (first.tick(), vec![Some(first)]);
        for &topic in &reads[1..] {
            let message = self
                .look(me, topic, label)
                .filter(|one| one.tick() == label);
            if message.is_none() && !self.has_closed(me, topic) {
                return Ok(false);
            }
            inputs.push(message);
        }
        for &topic in &reads {
            self.inbox(me, topic)
                .into_iter()
                .for_each(|inbox| inbox.next = label + 1);
        }
        self.answer(me, label, &inputs).map(|()| true)
    }

    fn send(&mut self, me: usize, output: usize, stage: usize) {
        let one = &mut self.processes[me];
        let (topic, is_last) = (one.part.writes[output], output + 1 == one.outputs.len());
        let tick = one.outputs[output].tick();
        match stage {
            0 => {
                let state = self.world.save(me);
                one.checkpoint = [one.checkpoint[1].take(), Some((tick, state))];
            }
            1 => {
                let leaving = self
                    .world
                    .leave(topic, one.outputs[output].clone(), one.tick);
                one.leaving.clone_from(&leaving);
                leaving
                    .iter()
                    .for_each(|message| self.retain(topic, message));
            }
            reader => self.deliver(me, topic, reader - 2),
        }
        let has_observer = self.processes.iter().any(|one| one.part.role.polled);
        let stages = 2 + self.topics[topic].inboxes.len() + usize::from(has_observer);
        self.processes[me].at = if stage + 1 < stages {
            At::Sending(output, stage + 1)
        } else if is_last {
            let goes_on = self.limits.is_shaped && !self.role(me).makes_ticks;
            if goes_on { At::Tick } else { At::Closing }
        } else if let Some(outage) = self.protocol(me).downfall_after(tick, output as u32 + 1) {
            self.strike(outage);
            return self.die(me, At::Detected);
        } else {
            self.at_output(me, output + 1)
        };
    }

    fn retain(&mut self, topic: usize, message: &W::Message) {
        let observer = self.observer();
        let retained = &mut self.topics[topic].retained;
        let is_repeated = retained
            .back()
            .is_some_and(|last| last.tick() >= message.tick());
        if is_repeated && !self.limits.is_shaped {
            self.broken.get_or_insert("a process sends a tick twice");
        }
        retained.push_back(message.clone());
        if retained.len() > self.limits.retained {
            retained.pop_front();
        }
        self.world.retained(topic, message, observer);
    }

    /// Delivers leaving messages to the reader at a place, or after the last one to the observer.
    fn deliver(&mut self, me: usize, topic: usize, place: usize) {
        let Self {
            world,
            processes,
            topics,
            limits,
            broken,
            ..
        } = self;
        for message in &processes[me].leaving {
            let Some(inbox) = topics[topic].inboxes.get_mut(place) else {
                world.delivered(topic, message);
                continue;
            };
            let Process { progress, tick, .. } = &processes[inbox.reader];
            if progress.is_running && message.tick() >= tick.saturating_add(limits.depth) {
                broken.get_or_insert("a message is lost: its reader is too far behind");
            }
            if world.reaches(inbox.reader, topic, message)
                && inbox.fence.admits(message.incarnation(), None)
                && world.is_sound(topic, message)
            {
                inbox.unread.push_back(message.clone());
            }
        }
    }

    /// A process sends nothing more in its current tick except messages held back until now.
    fn close(&mut self, me: usize) {
        let tick = self.processes[me].tick;
        if self.processes[me].progress.ticks != tick {
            self.broken
                .get_or_insert("a process closes another tick than its next");
        }
        self.processes[me].progress.ticks = tick + 1;
        for topic in self.processes[me].part.writes.clone() {
            self.processes[me].leaving = self.world.flush(topic, tick);
            (0..=self.topics[topic].inboxes.len()).for_each(|place| self.deliver(me, topic, place));
        }
        if self.role(me).makes_ticks {
            self.processes[me].at = At::Torque;
        } else {
            self.processes[me].tick = tick + 1;
            self.begin_tick(me);
        }
    }

    fn close_loop(&mut self, me: usize) -> bool {
        let (tick, feedback) = (self.processes[me].tick, self.processes[me].part.feedback);
        let (mut newest, mut next) = (None, 0);
        if let Some(topic) = feedback {
            let is_closed = self.has_closed(me, topic);
            let came = self
                .look(me, topic, 0)
                .is_some_and(|one| one.tick() == tick);
            if !(is_closed || came && !self.limits.is_shaped) {
                return false;
            }
            while let Some(message) = self.look(me, topic, next) {
                next = message.tick() + 1;
                newest = Some(message);
            }
        }
        if self.world.close_loop(tick, newest) {
            self.limits.ticks = tick + 1;
        }
        self.processes[me].tick = tick + 1;
        self.begin_tick(me);
        true
    }

    fn finish(&mut self, me: usize) -> bool {
        if self
            .protocol(me)
            .unfinished(self.processes[me].tick)
            .is_some()
        {
            return false;
        }
        // The launcher stops the others now: each at its next wait.
        self.is_stopping = true;
        for one in self
            .processes
            .iter_mut()
            .filter(|one| !one.part.role.polled)
        {
            self.has_failed |= one.at == At::Dead;
            if !matches!(one.at, At::Sending(..) | At::Closing) {
                one.at = At::Done;
            }
        }
        true
    }

    fn observe(&mut self, me: usize) -> bool {
        let closed = self.progress(me).ticks;
        let is_done = |one: &Process<_, _>| one.at == At::Done || one.part.role.polled;
        let is_over = self.is_stopping && self.processes.iter().all(is_done);
        let falls = |run: &Self, ticks| {
            let protocol = run.protocol(me);
            protocol
                .downfall(ticks)
                .filter(|_| protocol.is_settled(ticks))
        };
        let source = |one: &&Process<_, _>| one.part.role.makes_ticks;
        let made = self
            .processes
            .iter()
            .find(source)
            .map_or(0, |one| one.progress.ticks);
        let before_death = |writer| self.protocol(me).sent_before_death(writer);
        let is_falling = self.is_observer_falling;
        let run = Observed {
            ticks: [made, closed],
            is_over,
            is_falling,
            wants_round: is_over || is_falling || falls(self, closed).is_some(),
            before_death: (0..self.processes.len()).map(before_death).collect(),
        };
        match self.world.observe(&run) {
            Step::Idle => return false,
            Step::Done => {}
            Step::Closed(ticks, is_last) => {
                let ticks = closed.max(ticks);
                self.processes[me].progress.ticks = ticks;
                self.is_observer_falling = falls(self, ticks).is_some();
                if is_last {
                    self.processes[me].at = At::Done;
                } else if is_falling {
                    let outage = self.protocol(me).downfall(ticks);
                    outage.into_iter().for_each(|outage| self.strike(outage));
                    self.die(me, At::Detected);
                }
            }
        }
        true
    }
}
