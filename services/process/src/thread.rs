//! A list of steps on one thread, without shared memory: the same bytes as the processes.

use bytemuck::from_bytes_mut;
use shared_types::Header;
use shared_types::fault::ScheduledFault;
use shared_types::graph::{Process, Role};
use shared_types::topics::{ByTopic, TOPICS, Whole};

use crate::edges::{Edges, Ended, Now, Sink};
use crate::port::{Inputs, Outputs, Port};
use crate::scratch::Scratch;
use crate::step::{Flow, Step};

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
    fn step_in_place(
        &mut self,
        tick: u64,
        faults: &[ScheduledFault],
        board: &mut Board,
        scratch: &mut Scratch,
    ) -> Flow {
        let (mut parts, mut outputs) = (board.parts_mut(), Outputs::new(scratch));
        for topic in &self.writes {
            if let Some(place) = parts[*topic].take() {
                outputs.add(TOPICS[*topic], place);
            }
        }
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

    /// Its step on these inputs, beside any thread. Fills the messages that it writes.
    pub fn compute(
        &mut self,
        inputs: &Inputs<'_>,
        board: &mut ByTopic<Whole>,
        scratch: &mut Scratch,
    ) -> Flow {
        self.step_on(inputs, 1, board, scratch)
    }

    /// Its step for a tick, on these inputs.
    pub(crate) fn step_on(
        &mut self,
        inputs: &Inputs<'_>,
        incarnation: u32,
        board: &mut Board,
        scratch: &mut Scratch,
    ) -> Flow {
        let (mut parts, mut outputs) = (board.parts_mut(), Outputs::new(scratch));
        for topic in &self.writes {
            if let Some(place) = parts[*topic].take() {
                outputs.add(TOPICS[*topic], place);
            }
        }
        let flow = self.step.step(inputs, &mut outputs);
        self.head(inputs.tick, incarnation, board);
        flow
    }

    /// Gives its outputs to a sink.
    fn show(&self, board: &mut Board, sink: Sink<'_>) {
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

/// Processes on one thread, in the order of the data.
pub struct Thread {
    members: Vec<Member>,
    /// The run's, of which a fault's `process` is the place in the graph.
    faults: Vec<ScheduledFault>,
    /// Those of sensors and drives in force at the tick in hand.
    in_force: Vec<ScheduledFault>,
    /// Where faults concern processes or messages.
    edges: Option<Edges>,
    scratch: Scratch,
    tick: u64,
}

impl Thread {
    /// Before the first tick.
    #[must_use]
    pub fn new(members: Vec<Member>, faults: Vec<ScheduledFault>) -> Self {
        let is_of_joint =
            |fault: &ScheduledFault| fault.kind().is_some_and(|kind| kind.concerns_joint());
        Self {
            edges: (!faults.iter().all(is_of_joint)).then(|| Edges::new(&members, &faults)),
            // No tick allocates.
            in_force: Vec::with_capacity(faults.len()),
            members,
            faults,
            scratch: Scratch::default(),
            tick: 0,
        }
    }

    /// One tick of all of them, on the messages of `board`, in place; `false` when the task is over, before anything of the tick is sent. Each message
    /// that counts is given to `sink` with the place of its topic in [`TOPICS`].
    ///
    /// # Errors
    /// [`Ended`]: a fault has ended the run.
    pub fn tick(&mut self, board: &mut Board, sink: Sink<'_>) -> Result<bool, Ended> {
        let tick = self.tick;
        self.in_force.clear();
        let is_in_force = |fault: &&ScheduledFault| {
            fault.concerns(tick) && fault.kind().is_some_and(|kind| kind.concerns_joint())
        };
        self.in_force.extend(self.faults.iter().filter(is_in_force));
        for (me, member) in self.members.iter_mut().enumerate() {
            let faults: &[ScheduledFault] = if member.makes_ticks {
                &self.in_force
            } else {
                &[]
            };
            let flow = match &mut self.edges {
                Some(edges) => {
                    let scratch = &mut self.scratch;
                    edges.step(
                        member,
                        &mut Now {
                            me,
                            tick,
                            faults,
                            board,
                            scratch,
                            sink,
                        },
                    )?
                }
                None => {
                    let flow = member.step_in_place(tick, faults, board, &mut self.scratch);
                    if flow == Flow::Go {
                        member.show(board, sink);
                    }
                    flow
                }
            };
            if flow == Flow::Over {
                return Ok(false);
            }
        }
        self.tick += 1;
        Ok(true)
    }

    /// Why the task cannot be done, found before the first tick, in words.
    #[must_use]
    pub fn obstacle(&self) -> Option<&str> {
        self.members
            .iter()
            .find_map(|member| member.step.obstacle())
    }

    /// What its user should know before the first tick, in words.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        self.members.iter().find_map(|member| member.step.warning())
    }
}
