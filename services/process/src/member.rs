//! A process of a graph with its step, on the messages of a tick.

use bytemuck::from_bytes_mut;
use shared_types::Header;
use shared_types::fault::ScheduledFault;
use shared_types::graph::{Process, Role};
use shared_types::topics::{ByTopic, COUNT, TOPICS, Whole};

use crate::port::{Inputs, Outputs, Port};
use crate::scratch::Scratch;
use crate::step::{Flow, Step};

/// Takes in every message that counts, with the place of its topic.
pub(crate) type Sink<'a> = &'a mut dyn FnMut(usize, &[u8]);

/// The messages of a tick, which steps read and write in place.
pub(crate) type Board = ByTopic<Whole>;

/// An input of a member.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Input {
    /// Its topic, by its place in [`TOPICS`].
    pub(crate) topic: usize,
    /// Its place among the topics that the graph has the process read.
    pub(crate) read: usize,
    pub(crate) is_needed: bool,
}

/// A process of a graph on the thread.
pub struct Member {
    pub(crate) name: String,
    /// Its place in the graph, by which faults name it.
    pub(crate) place: usize,
    pub(crate) makes_ticks: bool,
    pub(crate) reads: Vec<Input>,
    /// By their places in [`TOPICS`], in the order in which they leave.
    pub(crate) writes: Vec<usize>,
    pub(crate) step: Box<dyn Step>,
}

impl Member {
    /// The process at a place of its graph, which says what it reads and writes of what its step does.
    #[must_use]
    pub fn new(place: usize, process: &Process, step: Box<dyn Step>) -> Self {
        let index = |port: &Port| TOPICS.iter().position(|topic| *topic == port.topic);
        let input = |port: &Port| {
            let mut declared = process.reads.iter().chain(&process.feedback);
            Some(Input {
                topic: index(port)?,
                read: declared.position(|topic| topic == port.topic)?,
                is_needed: port.is_needed,
            })
        };
        let is_written = |port: &&Port| process.writes.iter().any(|topic| topic == port.topic);
        Self {
            name: process.name.clone(),
            place,
            makes_ticks: process.role() == Role::World,
            reads: step.reads().iter().filter_map(input).collect(),
            writes: step
                .writes()
                .iter()
                .filter(is_written)
                .filter_map(index)
                .collect(),
            step,
        }
    }

    /// Its step for a tick, on the messages of the board.
    #[inline]
    pub(crate) fn step_in_place(
        &mut self,
        tick: u64,
        faults: &[ScheduledFault],
        board: &mut Board,
        scratch: &mut Scratch,
    ) -> Flow {
        let mut parts = board.parts_mut();
        let mut outputs = self.outputs(&mut parts, scratch);
        let mut inputs = Inputs::of(tick, faults);
        // Before the first tick nothing has closed the loop.
        let has_inputs = !self.makes_ticks || tick > 0;
        for input in self.reads.iter().filter(|_| has_inputs) {
            if let Some(message) = parts[input.topic].as_deref() {
                inputs.add(TOPICS[input.topic], message);
            }
        }
        let flow = self.step.step(&inputs, &mut outputs);
        self.head(tick, 1, board);
        flow
    }

    /// Whether it makes the ticks.
    #[must_use]
    pub fn makes_ticks(&self) -> bool {
        self.makes_ticks
    }

    /// Its step.
    #[must_use]
    pub fn step(&self) -> &dyn Step {
        &*self.step
    }

    /// Its step on these inputs. Fills the messages that it writes.
    pub fn step_on(
        &mut self,
        inputs: &Inputs<'_>,
        incarnation: u32,
        board: &mut ByTopic<Whole>,
        scratch: &mut Scratch,
    ) -> Flow {
        let mut outputs = self.outputs(&mut board.parts_mut(), scratch);
        let flow = self.step.step(inputs, &mut outputs);
        self.head(inputs.tick, incarnation, board);
        flow
    }

    /// The places of its outputs, taken from those of all messages.
    #[inline]
    fn outputs<'a>(
        &self,
        parts: &mut [Option<&'a mut [u8]>; COUNT],
        scratch: &'a mut Scratch,
    ) -> Outputs<'a> {
        let mut outputs = Outputs::new(scratch);
        for topic in &self.writes {
            if let Some(place) = parts[*topic].take() {
                outputs.add(TOPICS[*topic], place);
            }
        }
        outputs
    }

    /// Gives its outputs to a sink.
    pub(crate) fn show(&self, board: &mut Board, sink: Sink<'_>) {
        let parts = board.parts_mut();
        for topic in &self.writes {
            parts[*topic]
                .iter()
                .for_each(|message| sink(*topic, message));
        }
    }

    /// The headers of its outputs.
    #[inline]
    fn head(&self, tick: u64, incarnation: u32, board: &mut Board) {
        let mut parts = board.parts_mut();
        for topic in &self.writes {
            if let Some(message) = &mut parts[*topic] {
                let header: &mut Header = from_bytes_mut(&mut message[..size_of::<Header>()]);
                *header = Header {
                    tick,
                    incarnation,
                    ..Header::default()
                };
            }
        }
    }
}
