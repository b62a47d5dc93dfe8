//! The loop of a process: any step, on the topics of its graph.

use process::{Flow, Inputs, Outputs, Port, Scratch, Step};
use shared_types::fault::ScheduledFault;
use shared_types::wire::Header;

use crate::bus::format::Format;
use crate::bus::port::Incoming;
use crate::bus::reader::Ticks;
use crate::bus::writer::{Outlet, SendError};
use crate::fault::table::MOST_FAULTS;
use crate::saving::Saving;
use crate::shell::{ProcessError, Shell};

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
    let (mut inlets, mut outlets) = (Vec::new(), Vec::new());
    for port in step.reads() {
        if port.is_needed || shell.reads(port.topic) {
            let ticks = shell.inlet(Format::of_port(port))?;
            inlets.push(Inlet { port: *port, ticks });
        }
    }
    for port in step.writes() {
        if port.is_needed || shell.writes(port.topic) {
            outlets.push((port.topic, shell.outlet(Format::of_port(port))?));
        }
    }
    let (saving, carried) = Saving::begin(shell, step)?;
    let driven = Driven {
        shell,
        step,
        outlets,
        scratch: Scratch::default(),
        saving,
    };
    match shell.own().makes_ticks {
        true => driven.make_ticks(inlets, &carried),
        false => driven.answer_ticks(inlets, outside),
    }
}

struct Inlet {
    port: Port,
    ticks: Ticks,
}

/// A step on the topics of its process.
struct Driven<'a> {
    shell: &'a Shell,
    step: &'a mut dyn Step,
    outlets: Vec<(&'static str, Outlet)>,
    scratch: Scratch,
    saving: Saving,
}

impl Driven<'_> {
    /// The loop of a process that reads messages of a tick and writes others of the same tick.
    fn answer_ticks(
        mut self,
        mut inlets: Vec<Inlet>,
        outside: &mut dyn Outside,
    ) -> Result<(), ProcessError> {
        let Some((first, others)) = inlets.split_first_mut() else {
            return Err(ProcessError::setup(format_args!(
                "{} reads no topic that its graph gives it",
                self.shell.name()
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
            let (_, has_noticed) = self.compute(&inputs)?;
            if has_noticed {
                self.shell.shared.message_fault_detected();
            }
            self.saving.save(tick + 1, &*self.step, &[])?;
            self.send()?;
        }
        Ok(())
    }

    /// The loop of the process that makes the ticks. What closes the loop in a tick is an input of the next one's step, which is taken at once: its outputs
    /// wait for their time. `carried`: the message that was carried over a cut; empty: none.
    fn make_ticks(mut self, mut inlets: Vec<Inlet>, carried: &[u8]) -> Result<(), ProcessError> {
        let mut source = self.shell.tick_source(self.shell.manifest().from);
        if !source.begin()? {
            return Ok(());
        }
        // Those of its sensors and drives that are in force.
        let mut faults = Vec::with_capacity(MOST_FAULTS);
        let carried = inlets.first().map(|inlet| (inlet.port.topic, carried));
        let mut message = carried.filter(|(_, message)| !message.is_empty());
        while self.make(source.coming(), message, &mut faults)? == Flow::Go {
            let Some(tick) = source.next()? else {
                return Ok(());
            };
            self.send()?;
            message = match inlets.first_mut() {
                Some(Inlet { port, ticks }) => {
                    let message = ticks.arriving(tick, source.deadline_ns())?;
                    message.map(|message| (port.topic, &**message))
                }
                None => None,
            };
        }
        Ok(source.finish()?)
    }

    /// Makes the messages of a tick, after the one that has closed the loop of the last, if one has come.
    fn make(
        &mut self,
        tick: u64,
        message: Option<(&'static str, &[u8])>,
        faults: &mut Vec<ScheduledFault>,
    ) -> Result<Flow, ProcessError> {
        let carried = message.map_or(&[][..], |(_, message)| message);
        self.saving.save(tick, &*self.step, carried)?;
        self.saving.commit();
        let shared = &self.shell.shared;
        shared.learn();
        faults.clear();
        for (place, scheduled, kind) in shared.faults.known.borrow().of(shared.me, tick) {
            if kind.concerns_joint() {
                shared.mark_injected(place);
                faults.push(*scheduled);
            }
        }
        let mut inputs = Inputs::of(tick, faults);
        if let Some((topic, message)) = message {
            inputs.add(topic, message);
        }
        let (flow, has_noticed) = self.compute(&inputs)?;
        if has_noticed {
            self.shell.mark_detected_at(tick);
        }
        Ok(flow)
    }

    /// Computes the outputs of a tick in place, and leaves them on loan. What the step returns, and whether it has noticed a fault.
    fn compute(&mut self, inputs: &Inputs<'_>) -> Result<(Flow, bool), ProcessError> {
        let mut outputs = Outputs::new(&mut self.scratch);
        for (topic, outlet) in &mut self.outlets {
            outputs.add(topic, outlet.loan()?);
        }
        let flow = self.step.step(inputs, &mut outputs);
        let has_noticed = outputs.has_noticed;
        for (_, outlet) in &mut self.outlets {
            if let Some(header) = outlet.header() {
                *header = Header {
                    tick: inputs.tick,
                    ..Header::default()
                };
            }
        }
        Ok((flow, has_noticed))
    }

    fn send(&mut self) -> Result<(), SendError> {
        let mut outlets = self.outlets.iter_mut();
        outlets.try_for_each(|(_, outlet)| outlet.send())
    }
}
