//! Turns a graph file into the launcher's plan.

use std::time::Duration;

use launcher::{Child, Limits, Plan};
use runtime::realtime::allowed_cores;
use shared_types::graph::{Graph, Role};
use shared_types::job::{Job, Mode};
use shared_types::process::Process;

use crate::failure::Failure;
use crate::robot;

/// The launcher's plan of a job: a child process per process of the graph, and the scheduled faults.
///
/// # Errors
/// [`Failure::Input`] if a fault of the scenario does not fit the graph.
pub fn plan(job: &Job) -> Result<Plan, Failure> {
    robot::check_mode(&job.graph, job.mode)?;
    let (mode, graph) = (job.mode, &job.graph);
    let faults = job
        .scenario
        .scheduled_faults(graph)
        .map_err(|complaint| Failure::Input(format!("{}: {complaint}", job.scenario.name)))?;
    let cores = allowed_cores();
    // Lockstep runs side by side shall not all crowd the same core: which one is "core 0" turns with the process id.
    let turn = if mode == Mode::Lockstep {
        std::process::id() as usize
    } else {
        0
    };
    let hops = graph.hops();
    let children = graph.process.iter().map(|process| Child {
        process: runtime::Process {
            name: process.name.clone(),
            reads: [&process.reads[..], &process.feedback].concat(),
            writes: process.writes.clone(),
            makes_ticks: process.role() == Role::World,
            hop: hops.iter().position(|hop| hop.name == process.name),
            core: (!cores.is_empty()).then(|| cores[(process.core + turn) % cores.len()]),
            priority: (process.priority > 0).then_some(process.priority as u8),
            disturbance: runtime::Disturbance::default(),
        },
        ends_run: process.role() == Role::World,
        most_restarts: process.restarts(),
        longest_stop: (process.answer_limit_s > 0)
            .then(|| Duration::from_secs(process.answer_limit_s.into())),
    });
    let messages = graph.own_messages().collect();
    let limits = match graph.process.iter().any(is_external) {
        true => Limits {
            start: None,
            wait: None,
            awaits_person: true,
            ..Limits::of(mode)
        },
        false => with_joining(Limits::of(mode), graph),
    };
    Ok(Plan {
        mode,
        rate_hz: job.scenario.rate_hz,
        children: children.collect(),
        messages,
        limits,
        faults,
        begin: launcher::Begin::default(),
    })
}

/// Whether a process starts when a person, or a robot, is ready for it.
pub(crate) fn is_external(process: &Process) -> bool {
    process.external || !process.robot.is_empty()
}

/// An interpreter may have much to load before it joins.
const LONGEST_START_S: u32 = 60;

/// With the time that programs of others have to join.
fn with_joining(limits: Limits, graph: &Graph) -> Limits {
    let of_others = graph.process.iter().filter(|one| one.is_of_others());
    let limit = |one: &Process| match one.join_limit_s {
        0 => LONGEST_START_S,
        limit_s => limit_s,
    };
    let longest = of_others.map(|one| Duration::from_secs(limit(one).into()));
    Limits {
        start: longest.max().max(limits.start),
        ..limits
    }
}
