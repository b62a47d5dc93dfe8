//! The thread under its scenario's faults of processes and messages.

use model::{Refused, Robot};
use process::Step;
use shared_types::fault::ScheduledFault;
use shared_types::graph::{self, Graph};
use shared_types::process::Process;
use shared_types::scenario::Scenario;

use crate::{Tick, possible, thread};

/// The process graph of a scenario on one thread: the built-in one.
///
/// # Errors
/// [`Refused`] if it cannot be read.
pub fn graph(scenario: &Scenario) -> Result<Graph, Refused> {
    Graph::of(scenario).map_err(Refused::because)
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

/// Runs a scenario under its faults to its end, under a `controller` of others where there is one, handing each message that counts to `sink`, with its topic's
/// place in the list. The sentence: why it ended before its task did.
///
/// # Errors
/// As [`planned_faults`], [`Refused`] by the first step that does not accept the robot or the scenario, and where its path cannot be followed.
pub fn run_under_faults(
    robot: &Robot,
    scenario: &Scenario,
    controller: Option<Box<dyn Step>>,
    sink: &mut dyn FnMut(usize, &[u8]),
) -> Result<Option<String>, Refused> {
    let faults = planned_faults(scenario)?;
    let mut thread = thread(robot, scenario, faults, controller, |_| true)?;
    possible(&thread)?;
    let mut tick = Tick::default();
    loop {
        match thread.tick(&mut tick, sink) {
            Ok(true) => {}
            Ok(false) => return Ok(None),
            Err(ended) => return Ok(Some(ended.to_string())),
        }
    }
}
