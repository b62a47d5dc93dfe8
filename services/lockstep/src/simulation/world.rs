//! Processes whose messages are digests of their inputs.

use std::hash::{DefaultHasher, Hash, Hasher};

use super::recorder::{LAG, Recorder};
use crate::engine::{Carried, Ended, Engine, Limits, Observed, Part, Step, World};
use crate::protocol::{Outage, Progress, Role};

/// Unread messages that the buffer of a reader holds; half as many ticks the source may be ahead, as in [`crate::protocol`].
const DEPTH: u64 = 4;

/// Ticks that a death lasts: longer than the source may be ahead, as [`crate::unplanned_death`].
pub(super) const DOWN: u64 = DEPTH / 2 + 2;

pub(super) fn digest(of: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    of.hash(&mut hasher);
    hasher.finish()
}

/// A message: the value stands for its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Sent {
    pub(super) tick: u64,
    pub(super) incarnation: u32,
    pub(super) value: u64,
}

impl Carried for Sent {
    fn tick(&self) -> u64 {
        self.tick
    }
    fn incarnation(&self) -> u32 {
        self.incarnation
    }
}

/// A graph: the source is process 0 and has one output; the last output of the last process closes the loop.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Graph {
    /// By process: the outputs that it reads, each as the writer and the number of the output.
    pub(crate) reads: Vec<Vec<(usize, usize)>>,
    pub(crate) outputs: Vec<usize>,
    pub(crate) ticks: u64,
}

/// The steps of the processes of a graph, and its recorder.
#[derive(Clone, Hash)]
pub(crate) struct Simulated {
    /// The state of each process.
    memory: Vec<u64>,
    outputs: Vec<usize>,
    pub(super) recorder: Option<Recorder>,
}

pub(crate) type Run = Engine<Simulated>;

impl Graph {
    /// A run before its first tick; with a recorder where its volume has room for so many blocks of message logs.
    pub(crate) fn begin(&self, outages: &[Outage], room: Option<u64>) -> Run {
        let count = self.reads.len();
        let first = |process: usize| self.outputs[..process].iter().sum::<usize>();
        let topic = |(writer, output): &(usize, usize)| first(*writer) + output;
        let is_source = |process| process == 0;
        let part = |process: usize| Part {
            role: Role {
                makes_ticks: is_source(process),
                polled: false,
            },
            reads: self.reads[process].iter().map(topic).collect(),
            feedback: is_source(process).then(|| first(count) - 1),
            writes: (first(process)..first(process + 1)).collect(),
            restarts: u32::MAX,
            ..Part::default()
        };
        let recorder = room.map(|_| Part {
            role: Role {
                makes_ticks: false,
                polled: true,
            },
            restarts: u32::MAX,
            ..Part::default()
        });
        let world = Simulated {
            memory: vec![0; count],
            outputs: self.outputs.clone(),
            recorder: room.map(|room| Recorder::new(&self.outputs, room)),
        };
        let limits = Limits {
            chain_lag: DEPTH / 2,
            recorder_lag: LAG,
            depth: DEPTH,
            down: DOWN,
            retained: usize::MAX,
            ticks: self.ticks,
            is_shaped: false,
        };
        let parts = (0..count).map(part).chain(recorder).collect();
        Engine::new(world, parts, outages.to_vec(), false, limits)
    }
}

impl World for Simulated {
    type Message = Sent;
    type State = u64;

    fn answer(
        &mut self,
        process: usize,
        tick: u64,
        incarnation: u32,
        inputs: &[Option<Sent>],
    ) -> Result<Option<Vec<Sent>>, Ended> {
        // As the controller's: without one of its inputs there is no answer.
        if inputs.contains(&None) {
            return Ok(None);
        }
        if process > 0 {
            self.memory[process] = digest((self.memory[process], inputs));
        }
        let value = digest((process, tick, incarnation, self.memory[process]));
        let sent = |output| Sent {
            tick,
            incarnation,
            value: digest((value, output)),
        };
        Ok(Some((0..self.outputs[process]).map(sent).collect()))
    }

    fn close_loop(&mut self, _tick: u64, message: Option<Sent>) -> bool {
        self.memory[0] = digest((self.memory[0], message));
        false
    }

    fn save(&mut self, process: usize) -> u64 {
        self.memory[process]
    }

    fn restore(&mut self, process: usize, state: Option<u64>) -> Result<(), Ended> {
        self.memory[process] = state.unwrap_or(0);
        Ok(())
    }

    fn retained(&mut self, topic: usize, message: &Sent, observer: Option<Progress>) {
        // A writer that sends looks for new readers from time to time, and before the first of them has the message.
        let learns = observer.is_some_and(|one| !digest((message, one)).is_multiple_of(3));
        self.recorder
            .iter_mut()
            .for_each(|recorder| recorder.retain(topic, *message, learns));
    }

    fn delivered(&mut self, topic: usize, message: &Sent) {
        self.recorder
            .iter_mut()
            .for_each(|recorder| recorder.deliver(topic, *message));
    }

    fn connected(&mut self, process: usize) {
        self.recorder
            .iter_mut()
            .for_each(|recorder| recorder.connect(process));
    }

    fn hand_over(&mut self) {
        self.recorder.iter_mut().for_each(Recorder::hand_over);
    }

    fn replace_observer(&mut self, is_back: bool) {
        self.recorder.iter_mut().for_each(if is_back {
            Recorder::resume
        } else {
            Recorder::die
        });
    }

    fn observe(&mut self, run: &Observed) -> Step {
        self.recorder
            .as_mut()
            .map_or(Step::Idle, |recorder| recorder.step(run))
    }
}

impl Run {
    /// The deaths that the launcher writes into the scenario.
    pub(super) fn plan(&self) -> Vec<Outage> {
        let planned = |outage: &Outage| Outage {
            has_struck: false,
            is_unplanned: false,
            ..*outage
        };
        self.outages.iter().map(planned).collect()
    }

    /// All messages that have reached the retainers, by topic.
    pub(super) fn messages(&self) -> Vec<Vec<Sent>> {
        let sent = self.topics.iter().map(|topic| &topic.retained);
        sent.map(|retained| retained.iter().copied().collect())
            .collect()
    }

    pub(super) fn step_of(&mut self, me: usize) -> bool {
        // No simulated process ends its run.
        self.step(me) == Ok(true)
    }
}
