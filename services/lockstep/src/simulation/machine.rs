//! A graph of processes under the lockstep protocol, without processes: the launcher's and the ports' part in the protocol as steps of a state.
//!
//! The decisions are those of [`crate::protocol`]. A state holds, besides what they read, the messages on their way: a message reaches the retainer of its
//! topic first, then one reader after the other, and a death may come between any two of these. A value stands for the bytes: it depends on the tick,
//! the incarnation, the inputs and the state that the process has kept in its checkpoint.

use std::collections::BTreeMap;
use std::hash::Hash;

use super::defect::{Defect, digest};
use super::recorder::{LAG, Recorder, Step};
use crate::protocol::{Outage, Progress, Protocol, Role, View};

/// Unread messages that the buffer of a reader holds; half as many ticks the source may be ahead, as in [`crate::protocol`].
const DEPTH: u64 = 4;

/// Ticks that a death lasts: longer than the source may be ahead, as [`crate::unplanned_death`].
pub(crate) const DOWN: u64 = DEPTH / 2 + 2;

/// A graph: the source is process 0 and has one output; the last output of the last process closes the loop.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Graph {
    /// By process: the outputs that it reads, each as the writer and the number of the output.
    pub(crate) reads: Vec<Vec<(usize, usize)>>,
    pub(crate) outputs: Vec<usize>,
    pub(crate) ticks: u64,
}

impl Graph {
    fn readers(&self, output: (usize, usize)) -> Vec<usize> {
        let last = self.reads.len() - 1;
        let closes_loop = output == (last, self.outputs[last] - 1);
        let reads = |process: &usize| {
            self.reads[*process].contains(&output) || (*process == 0 && closes_loop)
        };
        (0..self.reads.len()).filter(reads).collect()
    }
}

/// Where a process is between two steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum At {
    /// Dead; the launcher has not detected it.
    Dead,
    /// Detected; the launcher starts it again at some step.
    Detected,
    /// Started, and not yet through with what comes before its first tick.
    Starting,
    /// At the beginning of its tick in hand.
    Tick,
    /// Before a step of sending an output: 0 commits the checkpoint, 1 reaches the retainer, the others a reader each.
    Sending(usize, usize),
    /// All is sent, and the tick not closed.
    Closing,
    /// The source, waiting for the torque of its tick.
    Torque,
    /// The source, waiting for the others at the end.
    Finish,
    Done,
}

/// Writer, number of the output, tick.
pub(crate) type Place = (usize, usize, u64);

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct State {
    pub(crate) progress: Vec<Progress>,
    pub(crate) at: Vec<At>,
    pub(crate) tick: Vec<u64>,
    pub(crate) outages: Vec<Outage>,
    /// The state of each process, and the value of its tick in hand.
    memory: Vec<u64>,
    value: Vec<u64>,
    /// The last two commits: tick and state.
    checkpoint: Vec<[Option<(u64, u64)>; 2]>,
    pub(crate) retainer: BTreeMap<Place, u64>,
    buffers: Vec<BTreeMap<Place, u64>>,
    pub(crate) kills_left: u32,
    chain_lag: u64,
    recorder_lag: u64,
    /// The process after those of the graph, where the run has one.
    pub(crate) recorder: Option<Recorder>,
    is_stopping: bool,
    /// A process died and the launcher detected it after the last tick: the run is reported as failed, and has no plan that repeats it.
    pub(crate) has_failed: bool,
    /// The first guarantee of the machine itself that was broken.
    pub(crate) broken: Option<&'static str>,
}

impl View for State {
    fn processes(&self) -> usize {
        self.progress.len()
    }
    fn role(&self, process: usize) -> Role {
        Role {
            makes_ticks: process == 0,
            polled: process == self.memory.len(),
        }
    }
    fn progress(&self, process: usize) -> Progress {
        self.progress[process]
    }
    fn has_faults(&self) -> bool {
        !self.outages.is_empty()
    }
    fn outages(&self) -> impl Iterator<Item = Outage> {
        self.outages.iter().copied()
    }
    fn is_lockstep(&self) -> bool {
        true
    }
    fn recorder_lag(&self) -> u64 {
        self.recorder_lag
    }
    fn chain_lag(&self) -> u64 {
        self.chain_lag
    }
}

impl State {
    pub(crate) fn new(graph: &Graph, outages: &[Outage], kills: u32, defect: Defect) -> Self {
        let count = graph.reads.len();
        let progress = Progress {
            ticks: 0,
            incarnation: 1,
            is_running: true,
            awaits_progress: false,
        };
        Self {
            progress: vec![progress; count],
            at: vec![At::Tick; count],
            tick: vec![0; count],
            outages: outages.to_vec(),
            memory: vec![0; count],
            value: vec![0; count],
            checkpoint: vec![[None; 2]; count],
            retainer: BTreeMap::new(),
            buffers: vec![BTreeMap::new(); count],
            kills_left: kills,
            chain_lag: if defect == Defect::NoLag {
                u64::MAX
            } else {
                DEPTH / 2
            },
            recorder_lag: if defect == Defect::NoRecorderLag {
                u64::MAX
            } else {
                LAG
            },
            recorder: None,
            is_stopping: false,
            has_failed: false,
            broken: None,
        }
    }

    /// With a recorder, on a volume with room for so many blocks of message logs.
    pub(crate) fn with_recorder(mut self, graph: &Graph, room: u64, defect: Defect) -> Self {
        self.recorder = Some(Recorder::new(&graph.outputs, room, defect));
        self.progress.push(self.progress[0]);
        self.at.push(At::Tick);
        self
    }

    /// Whether the recorder has opened its topics.
    fn is_recorded(&self) -> bool {
        self.recorder.is_some() && matches!(self.at.last(), Some(At::Starting | At::Tick))
    }

    fn hand_over(&mut self) {
        self.recorder.iter_mut().for_each(Recorder::hand_over);
    }

    fn protocol(&self, me: usize) -> Protocol<'_, Self> {
        Protocol::new(self, me)
    }

    /// The message of an output at a tick, as a reader finds it.
    fn message(
        &self,
        me: usize,
        (writer, output): (usize, usize),
        tick: u64,
        defect: Defect,
    ) -> Option<u64> {
        let place = (writer, output, tick);
        let missed =
            || self.protocol(me).sent_before_death(writer) > tick && defect != Defect::NoRetainer;
        self.buffers[me].get(&place).copied().or_else(|| {
            if missed() {
                self.retainer.get(&place).copied()
            } else {
                None
            }
        })
    }

    pub(crate) fn die(&mut self, me: usize, at: At) {
        self.progress[me].is_running = false;
        self.at[me] = at;
        if me == self.memory.len() {
            self.recorder.iter_mut().for_each(Recorder::die);
        }
    }

    /// Kills a process that lives, without a plan.
    pub(crate) fn kill(&mut self, me: usize) {
        if !matches!(self.at[me], At::Dead | At::Detected | At::Done) {
            self.has_failed |= self.is_stopping && me < self.memory.len();
            self.die(me, At::Dead);
        }
    }

    fn close(&mut self, me: usize) {
        if self.progress[me].ticks != self.tick[me] {
            self.broken
                .get_or_insert("a process closes another tick than its next");
        }
        self.tick[me] += 1;
        self.progress[me].ticks = self.tick[me];
    }

    fn begin_tick(&mut self, graph: &Graph, me: usize) {
        self.at[me] = match (self.tick[me] >= graph.ticks || self.is_stopping, me) {
            (false, _) => At::Tick,
            (true, 0) => At::Finish,
            (true, _) => At::Done,
        };
    }

    /// A death that no plan had, as the launcher enters it.
    fn detect(&mut self, graph: &Graph, me: usize, defect: Defect) {
        let closed = self.progress[me].ticks;
        self.hand_over();
        let has_sent = |output: &usize| {
            self.retainer
                .keys()
                .any(|key| (key.0, key.1) == (me, *output) && key.2 >= closed)
        };
        let sent = (0..graph.outputs[me]).filter(has_sent).count();
        let (at, after_outputs) = match sent {
            _ if defect == Defect::PlacedByClosings => (closed, 0),
            sent if sent == graph.outputs[me] => (closed + 1, 0),
            _ if defect == Defect::NoDeathWithinTick => (closed, 0),
            sent => (closed, sent as u32),
        };
        let (place, until) = (self.outages.len(), at + DOWN);
        self.outages.push(Outage {
            place,
            process: me,
            at,
            until,
            has_struck: true,
            is_death: true,
            is_unplanned: true,
            after_outputs,
        });
        self.progress[me].ticks = closed.max(at);
        self.at[me] = At::Detected;
    }

    fn start(&mut self, graph: &Graph, me: usize) {
        if let Some(outage) = self.protocol(me).downfall_at_start() {
            self.outages[outage.place].has_struck = true;
            return self.die(me, At::Detected);
        }
        let commits = self.checkpoint[me].iter().flatten();
        let last = commits
            .filter(|(tick, _)| self.protocol(me).may_resume_from(*tick))
            .max_by_key(|(tick, _)| *tick);
        let last = last.copied();
        self.memory[me] = last.map_or(0, |(_, memory)| memory);
        self.checkpoint[me] = [None, last];
        let back = self.protocol(me).returns_at();
        self.progress[me].ticks = self
            .protocol(me)
            .skips_to(back)
            .unwrap_or(self.progress[me].ticks);
        self.tick[me] = self.progress[me].ticks;
        self.progress[me].is_running = true;
        if self.is_recorded() {
            self.recorder
                .iter_mut()
                .for_each(|recorder| recorder.connect(me));
        }
        self.begin_tick(graph, me);
    }

    /// One step of the recorder, or of the launcher for it; whether there was one.
    fn step_recorder(&mut self) -> bool {
        let me = self.memory.len();
        let closed = self.progress[me].ticks;
        match self.at[me] {
            At::Dead => {
                let (place, until) = (self.outages.len(), closed + DOWN);
                let (has_struck, is_death, is_unplanned) = (true, true, true);
                self.outages.push(Outage {
                    place,
                    process: me,
                    at: closed,
                    until,
                    has_struck,
                    is_death,
                    is_unplanned,
                    after_outputs: 0,
                });
                self.at[me] = At::Detected;
            }
            At::Detected => {
                self.hand_over();
                self.progress[me].incarnation += 1;
                self.at[me] = At::Starting;
            }
            At::Starting => {
                self.recorder.iter_mut().for_each(Recorder::resume);
                self.progress[me].is_running = true;
                self.at[me] = At::Tick;
            }
            At::Tick => return self.record(me, closed),
            _ => return false,
        }
        true
    }

    fn record(&mut self, me: usize, closed: u64) -> bool {
        let Some(mut recorder) = self.recorder.take() else {
            return false;
        };
        let is_over = self.is_stopping && self.at[..me].iter().all(|at| *at == At::Done);
        let falls = |state: &Self, ticks| {
            state.protocol(me).downfall(ticks).is_some() && state.protocol(me).is_settled(ticks)
        };
        let wants_round = is_over || recorder.is_falling || falls(self, closed);
        let before_death = |writer| self.protocol(me).sent_before_death(writer);
        let step = recorder.step(
            self.progress[0].ticks,
            closed,
            is_over,
            before_death,
            wants_round,
        );
        let (is_falling, is_last) = (recorder.is_falling, recorder.is_last);
        if let Step::Closed(ticks) = step {
            self.progress[me].ticks = closed.max(ticks);
            recorder.is_falling = falls(self, closed.max(ticks));
        }
        self.recorder = Some(recorder);
        match step {
            Step::Idle => return false,
            Step::Closed(_) if is_last => self.at[me] = At::Done,
            Step::Closed(ticks) if is_falling => {
                let outage = self.protocol(me).downfall(closed.max(ticks));
                outage
                    .into_iter()
                    .for_each(|outage| self.outages[outage.place].has_struck = true);
                self.die(me, At::Detected);
            }
            Step::Closed(_) | Step::Done => {}
        }
        true
    }

    /// One step of a process, or of the launcher for it; whether there was one.
    pub(crate) fn step(&mut self, graph: &Graph, me: usize, defect: Defect) -> bool {
        if me == self.memory.len() {
            return self.step_recorder();
        }
        let tick = self.tick[me];
        match self.at[me] {
            At::Done => return false,
            At::Dead => self.detect(graph, me, defect),
            At::Detected => {
                self.hand_over();
                self.progress[me].incarnation += 1;
                self.at[me] = At::Starting;
            }
            At::Starting => self.start(graph, me),
            At::Tick if me == 0 => {
                self.progress[0].awaits_progress =
                    self.protocol(0).holds_back(tick).is_some() && defect != Defect::NoHoldBack;
                if self.progress[0].awaits_progress {
                    return false;
                }
                self.value[0] = digest((tick, self.memory[0]));
                self.at[0] = At::Sending(0, 1);
            }
            At::Tick => return self.take_inputs(graph, me, defect),
            At::Sending(output, 0) => {
                self.checkpoint[me] = [self.checkpoint[me][1], Some((tick, self.memory[me]))];
                self.at[me] = At::Sending(output, 1);
            }
            At::Sending(output, 1) => {
                let value = digest((self.value[me], output));
                if self.retainer.insert((me, output, tick), value).is_some() {
                    self.broken.get_or_insert("a process sends a tick twice");
                }
                // A writer that sends looks for new readers from time to time, and before the first of them has the message.
                let learns =
                    self.is_recorded() && !digest((value, self.progress.last())).is_multiple_of(3);
                self.recorder
                    .iter_mut()
                    .for_each(|recorder| recorder.retain(me, output, (tick, value), learns));
                self.at[me] = At::Sending(output, 2);
            }
            At::Sending(output, stage) => self.deliver(graph, me, output, stage),
            At::Closing => {
                self.close(me);
                if me == 0 {
                    (self.at[0], self.tick[0]) = (At::Torque, tick);
                } else {
                    self.begin_tick(graph, me);
                }
            }
            At::Torque => {
                let last = graph.reads.len() - 1;
                let torque = self.message(0, (last, graph.outputs[last] - 1), tick, defect);
                if torque.is_none() && !self.protocol(0).has_closed(Some(last), tick) {
                    return false;
                }
                self.memory[0] = digest((self.memory[0], torque));
                self.tick[0] = tick + 1;
                self.begin_tick(graph, 0);
            }
            At::Finish => {
                if self.protocol(0).unfinished(graph.ticks).is_some() && defect != Defect::NoFinish
                {
                    return false;
                }
                // The launcher stops the others now: each at its next wait.
                self.is_stopping = true;
                let count = self.memory.len();
                self.has_failed = self.at[..count].contains(&At::Dead);
                let is_waiting = |at: &At| !matches!(at, At::Sending(..) | At::Closing);
                self.at[..count]
                    .iter_mut()
                    .filter(|at| is_waiting(at))
                    .for_each(|at| *at = At::Done);
            }
        }
        true
    }

    fn take_inputs(&mut self, graph: &Graph, me: usize, defect: Defect) -> bool {
        let tick = self.tick[me];
        let mut inputs = Vec::new();
        for (number, input) in graph.reads[me].iter().enumerate() {
            let message = self.message(me, *input, tick, defect);
            if message.is_none() && !self.protocol(me).has_closed(Some(input.0), tick) {
                return false;
            }
            if number == 0
                && let Some(outage) = self.protocol(me).downfall(tick)
            {
                self.outages[outage.place].has_struck = true;
                self.die(me, At::Detected);
                return true;
            }
            let Some(message) = message else {
                self.close(me);
                self.begin_tick(graph, me);
                return true;
            };
            inputs.push(message);
        }
        self.memory[me] = digest((self.memory[me], &inputs));
        self.value[me] = digest((me, tick, self.progress[me].incarnation, self.memory[me]));
        self.at[me] = At::Sending(0, usize::from(graph.outputs[me] > 1));
        true
    }

    fn deliver(&mut self, graph: &Graph, me: usize, output: usize, stage: usize) {
        let (tick, last) = (self.tick[me], graph.outputs[me] - 1);
        let readers = graph.readers((me, output));
        let place = (me, output, tick);
        if let Some(&reader) = readers.get(stage - 2) {
            if self.progress[reader].is_running && tick >= self.tick[reader] + DEPTH {
                self.broken
                    .get_or_insert("a message is lost: its reader is too far behind");
            }
            self.buffers[reader].extend(self.retainer.get(&place).map(|message| (place, *message)));
        }
        if stage - 2 == readers.len() && self.is_recorded() {
            let message = self.retainer.get(&place).map(|value| (tick, *value));
            self.recorder
                .iter_mut()
                .zip(message)
                .for_each(|(recorder, message)| recorder.deliver(me, output, message));
        }
        if stage - 1 < readers.len() + usize::from(self.recorder.is_some()) {
            self.at[me] = At::Sending(output, stage + 1);
        } else if output == last {
            self.at[me] = At::Closing;
        } else if let Some(outage) = self.protocol(me).downfall_after(tick, output as u32 + 1) {
            self.outages[outage.place].has_struck = true;
            self.die(me, At::Detected);
        } else {
            self.at[me] = At::Sending(output + 1, usize::from(output + 1 != last));
        }
    }

    /// The deaths that the launcher writes into the scenario.
    pub(crate) fn plan(&self) -> Vec<Outage> {
        self.outages
            .iter()
            .map(|outage| Outage {
                has_struck: false,
                is_unplanned: false,
                ..*outage
            })
            .collect()
    }
}
