//! The chain under its scenario's faults of processes and messages: the same steps, ordered by the
//! engine of the lockstep protocol.

use std::convert::Infallible;

use bytemuck::bytes_of;
use lockstep::engine::{Carried, Ended, Engine, Limits, Part, World};
use lockstep::{CHAIN_LAG, Fence, Outage, Role, Shaped, Shaper, first_not_finite, happens};
use model::{Refused, Robot};
use shared_types::fault::{Kind, ScheduledFault, corrupted_topic, shaped_topic};
use shared_types::graph::{self, Graph};
use shared_types::process::{Process, Program};
use shared_types::scenario::Scenario;
use shared_types::topics::{self, Each, TOPICS, Topic};
use shared_types::{Header, Message, Target};

use crate::Tick;
use crate::cycles::InForce;
use crate::stage::Stage;

/// Takes in every message that counts, in the order of its topic: the recorder's part.
pub trait Sink {
    /// A message of a topic has been delivered.
    fn take<M: Topic>(&mut self, message: &M);
}

/// The process graph of a scenario on one thread: the built-in one.
///
/// # Errors
/// [`Refused`] if it cannot be read.
pub fn graph(scenario: &Scenario) -> Result<Graph, Refused> {
    Graph::built_in(scenario.servo.is_some()).map_err(Refused::because)
}

/// The faults that a scenario plans, where one thread can have them: those of sensors and drives,
/// of messages, and deaths and pauses of all processes that are replaced. Faults that only cost a
/// process time change nothing in lockstep.
///
/// # Errors
/// [`Refused`] if a fault ends the run with the plant, or affects the recorder, which one thread
/// does not have; or if it makes no sense.
pub fn planned_faults(scenario: &Scenario) -> Result<Vec<ScheduledFault>, Refused> {
    if scenario.fault.is_empty() {
        return Ok(Vec::new());
    }
    let graph = graph(scenario)?;
    for fault in &scenario.fault {
        let role = graph.process(&fault.process).map(Process::role);
        let (name, kind, process) = (&scenario.name, fault.kind.name(), &fault.process);
        let because = match role {
            Some(graph::Role::World) if fault.kind.ends_process(fault.way) => "it ends the run",
            Some(graph::Role::Observer) => "one thread has no such process",
            _ => continue,
        };
        return Err(Refused::because(format_args!(
            "{name} plans the `{kind}` of the {process}, and {because}: take it out, or run it in processes"
        )));
    }
    scenario.scheduled_faults(&graph).map_err(Refused::because)
}

/// Whether a scenario plans faults of processes or of their messages, besides those of the arm's own sensors and drives.
pub fn plans_faults_of_processes(scenario: &Scenario) -> bool {
    scenario
        .fault
        .iter()
        .any(|fault| !fault.kind.concerns_joint())
}

/// A message of any topic, as its words.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Packed(Vec<u64>);

impl Packed {
    fn read<M: Message>(&self) -> &M {
        bytemuck::from_bytes(bytemuck::cast_slice(&self.0))
    }
}

impl Carried for Packed {
    fn tick(&self) -> u64 {
        self.header().tick
    }
    fn incarnation(&self) -> u32 {
        self.header().incarnation
    }
}

impl Shaped for Packed {
    fn header(&self) -> &Header {
        bytemuck::from_bytes(&bytemuck::cast_slice::<u64, u8>(&self.0)[..size_of::<Header>()])
    }
    fn header_mut(&mut self) -> &mut Header {
        bytemuck::from_bytes_mut(&mut self.bytes_mut()[..size_of::<Header>()])
    }
    fn bytes_mut(&mut self) -> &mut [u8] {
        bytemuck::cast_slice_mut(&mut self.0)
    }
}

/// Faults applied to the messages of a topic.
#[derive(Default)]
struct Wire {
    writer: Option<usize>,
    is_corruptible: bool,
    shaper: Shaper<Packed>,
    /// The last two messages made while faults shape them; they outlive their writer.
    made: [Option<Packed>; 2],
    /// Of the sink.
    fence: Fence,
}

/// The steps of the chain under faults.
struct UnderFaults<'a, O> {
    sink: &'a mut O,
    robot: &'a Robot,
    scenario: &'a Scenario,
    graph: Graph,
    faults: Vec<ScheduledFault>,
    is_shaped: bool,
    parts: Vec<Part>,
    /// Of each process but the plant.
    stages: Vec<Option<Stage>>,
    plant: Box<dyn plant::Step>,
    in_force: InForce,
    tick: Tick,
    wires: Vec<Wire>,
}

/// Runs a scenario under its faults to its end, handing each message that counts to `sink`. The sentence: why it ended before its task did.
///
/// # Errors
/// As [`planned_faults`], and [`Refused`] by the first cycle that does not accept the robot or the scenario.
pub fn run_under_faults(
    robot: &Robot,
    scenario: &Scenario,
    sink: &mut impl Sink,
) -> Result<Option<String>, Refused> {
    let (graph, faults) = (graph(scenario)?, planned_faults(scenario)?);
    let outage = |(place, fault)| Outage::of(fault, place, false, false);
    let mut outages: Vec<_> = faults.iter().enumerate().filter_map(outage).collect();
    outages
        .iter_mut()
        .enumerate()
        .for_each(|(place, outage)| outage.place = place);
    let shapes = |fault: &ScheduledFault| fault.kind().is_some_and(Kind::shapes_messages);
    let (has_faults, is_shaped) = (!faults.is_empty(), faults.iter().any(shapes));
    let limits = Limits {
        chain_lag: CHAIN_LAG,
        recorder_lag: u64::MAX,
        depth: u64::MAX,
        down: 0,
        retained: 1,
        ticks: u64::MAX,
        is_shaped,
    };
    let parts: Vec<Part> = graph.process.iter().map(part).collect();
    let stage = |process: &Process| Stage::new(process.program(), robot, scenario);
    let wire = |topic: &&str| {
        let writer = graph
            .process
            .iter()
            .position(|one| one.writes.iter().any(|it| it == topic));
        let corrupted = writer.and_then(|writer| corrupted_topic(&graph.process[writer].writes));
        Wire {
            writer,
            is_corruptible: corrupted == Some(*topic),
            ..Wire::default()
        }
    };
    let world = UnderFaults {
        sink,
        robot,
        scenario,
        wires: TOPICS.iter().map(wire).collect(),
        stages: graph.process.iter().map(stage).collect::<Result<_, _>>()?,
        parts: parts.clone(),
        graph,
        faults,
        is_shaped,
        plant: plant::cycle(robot, scenario)?,
        in_force: InForce::of(scenario),
        tick: Tick::default(),
    };
    let ended = Engine::new(world, parts, outages, has_faults, limits).run();
    Ok(ended.err().map(|ended| ended.to_string()))
}

/// A process of the graph, its inputs in the order in which its step takes them.
fn part(process: &Process) -> Part {
    let role = process.role();
    let mut reads: Vec<usize> = process.reads.iter().filter_map(place).collect();
    if process.program() == Some(Program::Controller) {
        // The report comes after the estimate, so that it begins the step.
        reads.swap(0, 1);
    }
    Part {
        name: process.name.clone(),
        role: Role {
            makes_ticks: role == graph::Role::World,
            polled: role == graph::Role::Observer,
        },
        reads,
        feedback: process.feedback.iter().find_map(place),
        writes: process.writes.iter().filter_map(place).collect(),
        restarts: process.restarts(),
    }
}

fn place(topic: impl AsRef<str>) -> Option<usize> {
    TOPICS.iter().position(|one| *one == topic.as_ref())
}

/// Takes a message into the tick.
struct Put<'a>(&'a mut Tick, &'a Packed);

impl Each for Put<'_> {
    type Output = ();
    fn each<M: Topic>(&mut self) {
        *M::of_mut(self.0) = *self.1.read();
    }
}

/// The outputs of a step, topic by topic.
struct Output<'a> {
    process: &'a str,
    incarnation: u32,
    tick: &'a mut Tick,
}

impl Each for Output<'_> {
    type Output = Result<Packed, Ended>;
    fn each<M: Topic>(&mut self) -> Self::Output {
        let message = M::of_mut(self.tick);
        let (process, topic, tick) = (self.process, M::TOPIC, message.header().tick);
        message.header_mut().incarnation = self.incarnation;
        if let Some(field) = first_not_finite(message) {
            return Err(Ended::because(format_args!(
                "the {process} refused its own `{topic}` of tick {tick}: {field} is not finite"
            )));
        }
        Ok(Packed(bytemuck::cast_slice(bytes_of(message)).to_vec()))
    }
}

impl<O: Sink> World for UnderFaults<'_, O> {
    type Message = Packed;
    type State = Vec<u8>;

    fn answer(
        &mut self,
        process: usize,
        tick: u64,
        incarnation: u32,
        inputs: &[Option<Packed>],
    ) -> Result<Option<Vec<Packed>>, Ended> {
        let mut has_target = false;
        for (topic, input) in self.parts[process].reads.iter().zip(inputs) {
            match input {
                Some(input) => {
                    has_target |= TOPICS[*topic] == Target::TOPIC;
                    topics::named(TOPICS[*topic], &mut Put(&mut self.tick, input));
                }
                None if TOPICS[*topic] == Target::TOPIC => {}
                None => return Ok(None),
            }
        }
        let of = &self.graph.process[process];
        match &mut self.stages[process] {
            Some(stage) => stage.step(&mut self.tick, has_target),
            None if of.program() == Some(Program::Plant) => {
                let Tick {
                    sensor,
                    plant_state,
                    ..
                } = &mut self.tick;
                self.in_force.apply(&mut *self.plant, tick, &self.faults);
                self.plant.sample(tick, sensor, plant_state);
            }
            None => return Ok(Some(Vec::new())),
        }
        let mut output = Output {
            process: &of.name,
            incarnation,
            tick: &mut self.tick,
        };
        let sent = self.parts[process].writes.iter();
        let sent = sent.filter_map(|topic| topics::named(TOPICS[*topic], &mut output));
        sent.collect::<Result<_, _>>().map(Some)
    }

    fn close_loop(&mut self, _tick: u64, message: Option<Packed>) -> bool {
        self.plant.step(message.as_ref().map(Packed::read));
        self.plant.is_over()
    }

    fn save(&mut self, process: usize) -> Vec<u8> {
        self.stages[process]
            .as_ref()
            .map_or_else(Vec::new, Stage::save)
    }

    fn restore(&mut self, process: usize, state: Option<Vec<u8>>) -> Result<(), Ended> {
        let program = self.graph.process[process].program();
        let mut stage = Stage::new(program, self.robot, self.scenario).map_err(Ended::because)?;
        if let (Some(stage), Some(state)) = (&mut stage, state) {
            stage.restore(&state);
        }
        self.stages[process] = stage;
        // What its predecessor held back is gone with it.
        let own = self
            .wires
            .iter_mut()
            .filter(|wire| wire.writer == Some(process));
        own.for_each(|wire| wire.shaper = Shaper::default());
        Ok(())
    }

    fn leave(&mut self, topic: usize, message: Packed, tick: u64) -> Vec<Packed> {
        if !self.is_shaped || !shaped_topic(TOPICS[topic]) {
            return vec![message];
        }
        let wire = &mut self.wires[topic];
        wire.made = [wire.made[1].take(), Some(message.clone())];
        let before = || {
            let made = wire.made.iter().flatten();
            let earlier = made.filter(|one| one.tick() < message.tick());
            earlier.max_by_key(|one| one.tick()).cloned()
        };
        let mut left = Vec::new();
        let faults = of(&self.faults, wire.writer, tick);
        let deliver = |one: &Packed| {
            left.push(one.clone());
            Ok::<(), Infallible>(())
        };
        let when = (tick, wire.is_corruptible);
        let Ok(()) = wire
            .shaper
            .shape(&message, when, faults, before, |_| (), deliver);
        left
    }

    fn flush(&mut self, topic: usize, tick: u64) -> Vec<Packed> {
        let mut left = Vec::new();
        let shaper = &mut self.wires[topic].shaper;
        shaper.flush(tick, |message| left.push(message.clone()));
        left
    }

    fn reaches(&self, reader: usize, topic: usize, message: &Packed) -> bool {
        let Process {
            reads, feedback, ..
        } = &self.graph.process[reader];
        let read = reads
            .iter()
            .chain(feedback)
            .position(|one| one == TOPICS[topic]);
        let cuts = |(_, fault, kind): (usize, &ScheduledFault, Kind)| {
            let is_it = kind == Kind::Cut && Some(fault.target as usize) == read;
            is_it && happens(fault, message.tick())
        };
        !of(&self.faults, Some(reader), message.tick()).any(cuts)
    }

    fn is_sound(&self, topic: usize, message: &Packed) -> bool {
        struct Sound<'a>(&'a Packed);
        impl Each for Sound<'_> {
            type Output = bool;
            fn each<M: Topic>(&mut self) -> bool {
                self.0.read::<M>().is_finite()
            }
        }
        topics::named(TOPICS[topic], &mut Sound(message)) == Some(true)
    }

    fn delivered(&mut self, topic: usize, message: &Packed) {
        struct Take<'a, O>(&'a mut O, &'a Packed);
        impl<O: Sink> Each for Take<'_, O> {
            type Output = ();
            fn each<M: Topic>(&mut self) {
                self.0.take::<M>(self.1.read());
            }
        }
        let is_admitted = self.wires[topic].fence.admits(message.incarnation(), None);
        if is_admitted && self.is_sound(topic, message) {
            topics::named(TOPICS[topic], &mut Take(&mut *self.sink, message));
        }
    }
}

/// The faults of a process at a tick, with their places.
fn of(
    faults: &[ScheduledFault],
    process: Option<usize>,
    tick: u64,
) -> impl Iterator<Item = (usize, &ScheduledFault, Kind)> {
    let concerned = move |(_, fault): &(usize, &ScheduledFault)| {
        Some(fault.process as usize) == process && fault.concerns(tick)
    };
    let all = faults.iter().enumerate().filter(concerned);
    all.filter_map(|(place, fault)| Some((place, fault, fault.kind()?)))
}
