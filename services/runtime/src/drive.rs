//! The loop of a process: any step, on the topics of its graph.

use process::{Flow, Inputs, Outputs, Port, Scratch, Step};
use shared_types::fault::ScheduledFault;
use shared_types::job::Mode;
use shared_types::wire::Header;

use crate::bus::error::TopicError;
use crate::bus::format::Format;
use crate::bus::port::Incoming;
use crate::bus::reader::Ticks;
use crate::bus::writer::Outlet;
use crate::checkpoint::StateCell;
use crate::fault::table::MOST_FAULTS;
use crate::shell::{ProcessError, Shell};
use crate::tick_source::TickSource;

/// Inputs of a process from outside of the graph: a person's targets.
pub trait Outside {
    /// Adds what has come by a tick to its inputs. It may wait: then the run does.
    fn add<'a>(&'a mut self, inputs: &mut Inputs<'a>);
}

/// Nothing.
impl Outside for () {
    fn add<'a>(&'a mut self, _inputs: &mut Inputs<'a>) {}
}

/// Takes part in a run with a step until the run stops, or the step says that the task is over.
///
/// The graph says which of the topics that the step knows it reads and writes. A step that the graph gives `feedback` makes the ticks: in real time on the
/// grid, its outputs made before that in the tick before.
///
/// # Errors
/// [`ProcessError`] if the graph breaks, or an output is refused.
pub fn drive(
    shell: &Shell,
    step: &mut dyn Step,
    outside: &mut dyn Outside,
) -> Result<(), ProcessError> {
    let manifest = shell.manifest();
    let makes_ticks = manifest
        .index_of(shell.name())
        .is_some_and(|me| manifest.processes[me].makes_ticks);
    let ports = Ports::open(shell, step)?;
    match makes_ticks {
        true => make_ticks(shell, step, ports),
        false => answer_ticks(shell, step, ports, outside),
    }
}

/// The ends of a process's topics.
struct Ports {
    inlets: Vec<Inlet>,
    outlets: Vec<(&'static str, Outlet)>,
    scratch: Scratch,
}

struct Inlet {
    port: Port,
    ticks: Ticks,
}

impl Ports {
    fn open(shell: &Shell, step: &dyn Step) -> Result<Self, TopicError> {
        let mut ports = Self {
            inlets: Vec::new(),
            outlets: Vec::new(),
            scratch: Scratch::default(),
        };
        for port in step.reads() {
            if port.is_needed || shell.reads(port.topic) {
                shell.declared("read", port.topic)?;
                let ticks = shell.inlet(Format::of_port(port))?;
                ports.inlets.push(Inlet { port: *port, ticks });
            }
        }
        for port in step.writes() {
            if port.is_needed || shell.writes(port.topic) {
                shell.declared("write", port.topic)?;
                let outlet = shell.outlet(Format::of_port(port))?;
                ports.outlets.push((port.topic, outlet));
            }
        }
        Ok(ports)
    }
}

/// Computes the outputs of a tick in place, and leaves them on loan. What the step returns, and whether it has noticed a fault.
fn compute(
    step: &mut dyn Step,
    inputs: &Inputs<'_>,
    outlets: &mut [(&'static str, Outlet)],
    scratch: &mut Scratch,
) -> Result<(Flow, bool), ProcessError> {
    let mut outputs = Outputs::new(scratch);
    for (topic, outlet) in outlets.iter_mut() {
        outlet.loan()?;
        if let Some(place) = outlet.on_loan() {
            outputs.add(topic, place);
        }
    }
    let flow = step.step(inputs, &mut outputs);
    let has_noticed = outputs.has_noticed;
    for (_, outlet) in outlets {
        if let Some(header) = outlet.header() {
            *header = Header {
                tick: inputs.tick,
                ..Header::default()
            };
        }
    }
    Ok((flow, has_noticed))
}

/// The loop of a process that reads messages of a tick and writes others of the same tick.
fn answer_ticks(
    shell: &Shell,
    step: &mut dyn Step,
    ports: Ports,
    outside: &mut dyn Outside,
) -> Result<(), ProcessError> {
    let Ports {
        mut inlets,
        mut outlets,
        mut scratch,
    } = ports;
    let (mut state, mut cell) = resumed(shell, step)?;
    let Some((first, others)) = inlets.split_first_mut() else {
        return Err(ProcessError::setup(format_args!(
            "{} reads no topic that its graph gives it",
            shell.name()
        )));
    };
    'ticks: while let Some(message) = first.ticks.next()? {
        let tick = message.tick();
        let mut inputs = Inputs::of(tick, &[]);
        inputs.add(first.port.topic, message);
        for Inlet { port, ticks } in others.iter_mut() {
            let message: Option<&Incoming> = match port.is_needed {
                true => ticks.at(tick)?,
                false => ticks.newest(tick)?,
            };
            match message {
                Some(message) => inputs.add(port.topic, message),
                None if port.is_needed => continue 'ticks,
                None => {}
            }
        }
        outside.add(&mut inputs);
        let (_, has_noticed) = compute(step, &inputs, &mut outlets, &mut scratch)?;
        if has_noticed {
            shell.mark_message_fault_detected();
        }
        if let Some(cell) = &mut cell {
            step.save(&mut state);
            if !cell.write(&state) {
                return Err(too_large(shell, state.len()));
            }
        }
        for (_, outlet) in &mut outlets {
            outlet.send()?;
        }
    }
    Ok(())
}

/// Room for a state to grow, at least; bytes.
const ROOM: usize = 4096;

/// The state's bytes, and its cell; a replacement goes on from the state of the last tick that its predecessor sent. In lockstep no process is replaced,
/// so there is no cell.
fn resumed(
    shell: &Shell,
    step: &mut dyn Step,
) -> Result<(Vec<u8>, Option<StateCell>), ProcessError> {
    let mut state = Vec::new();
    if shell.mode() == Mode::Lockstep {
        return Ok((state, None));
    }
    step.save(&mut state);
    let cell = shell.state_cell(2 * state.len() + ROOM)?;
    if let Some(last) = cell.previous() {
        let damaged = |damaged| ProcessError::setup(format_args!("{}: {damaged}", shell.name()));
        step.restore(last).map_err(damaged)?;
    }
    Ok((state, Some(cell)))
}

fn too_large(shell: &Shell, bytes: usize) -> ProcessError {
    ProcessError::setup(format_args!(
        "the state of {} has grown to {bytes} bytes, more than twice what it began with",
        shell.name()
    ))
}

/// The process that makes the ticks.
struct Source<'a> {
    shell: &'a Shell,
    step: &'a mut dyn Step,
    outlets: Vec<(&'static str, Outlet)>,
    scratch: Scratch,
    ticks: TickSource,
    /// Those of its sensors and drives that are in force.
    faults: Vec<ScheduledFault>,
}

/// The loop of the process that makes the ticks. What closes the loop in a tick is an input of the next one's step, which is taken at once: its outputs
/// wait for their time.
fn make_ticks(shell: &Shell, step: &mut dyn Step, ports: Ports) -> Result<(), ProcessError> {
    let Ports {
        mut inlets,
        outlets,
        scratch,
    } = ports;
    let mut source = Source {
        shell,
        step,
        outlets,
        scratch,
        ticks: shell.tick_source(0),
        faults: Vec::with_capacity(MOST_FAULTS),
    };
    if !source.ticks.begin()? {
        return Ok(());
    }
    let mut flow = source.make(None)?;
    while flow == Flow::Go {
        let Some(tick) = source.ticks.next()? else {
            return Ok(());
        };
        for (_, outlet) in &mut source.outlets {
            outlet.send()?;
        }
        let message = match inlets.first_mut() {
            Some(Inlet { port, ticks }) => {
                let message = ticks.arriving(tick, source.ticks.deadline_ns())?;
                message.map(|message| (port.topic, &**message))
            }
            None => None,
        };
        flow = source.make(message)?;
    }
    Ok(source.ticks.finish()?)
}

impl Source<'_> {
    /// Makes the messages of the tick that comes next, after the one that has closed the loop of the last, if one has come.
    fn make(&mut self, message: Option<(&'static str, &[u8])>) -> Result<Flow, ProcessError> {
        let Self {
            shell,
            step,
            outlets,
            scratch,
            ticks,
            faults,
        } = self;
        let tick = ticks.coming();
        faults.clear();
        shell.faults_at(tick, |place, scheduled, kind| {
            if kind.concerns_joint() {
                shell.mark_injected(place);
                faults.push(*scheduled);
            }
        });
        let mut inputs = Inputs::of(tick, faults);
        if let Some((topic, message)) = message {
            inputs.add(topic, message);
        }
        let (flow, has_noticed) = compute(*step, &inputs, outlets, scratch)?;
        if has_noticed {
            shell.mark_detected_at(tick);
        }
        Ok(flow)
    }
}
