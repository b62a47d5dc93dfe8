//! The loop of a process: any step, on the topics of its graph.

use process::{Flow, Inputs, Outputs, Port, Scratch, Step};
use shared_types::fault::ScheduledFault;
use shared_types::wire::Header;

use crate::bus::error::TopicError;
use crate::bus::format::Format;
use crate::bus::port::Incoming;
use crate::bus::reader::Ticks;
use crate::bus::writer::Outlet;
use crate::fault::table::MOST_FAULTS;
use crate::saving::Saving;
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
    let ports = Ports::open(shell, step)?;
    match shell.makes_ticks() {
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
    let (mut saving, _) = Saving::begin(shell, step)?;
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
        saving.save(tick + 1, step, &[])?;
        for (_, outlet) in &mut outlets {
            outlet.send()?;
        }
    }
    Ok(())
}

/// The process that makes the ticks.
struct Source<'a> {
    shell: &'a Shell,
    step: &'a mut dyn Step,
    outlets: Vec<(&'static str, Outlet)>,
    scratch: Scratch,
    ticks: TickSource,
    saving: Saving,
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
    let (saving, carried) = Saving::begin(shell, step)?;
    let mut source = Source {
        shell,
        step,
        outlets,
        scratch,
        ticks: shell.tick_source(shell.manifest().from),
        saving,
        faults: Vec::with_capacity(MOST_FAULTS),
    };
    if !source.ticks.begin()? {
        return Ok(());
    }
    let carried = inlets.first().map(|inlet| (inlet.port.topic, &carried[..]));
    let mut flow = source.make(carried.filter(|(_, message)| !message.is_empty()))?;
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
            saving,
            faults,
        } = self;
        let tick = ticks.coming();
        saving.save(tick, *step, message.map_or(&[], |(_, message)| message))?;
        saving.commit();
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
