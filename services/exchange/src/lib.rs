//! A process whose step runs in a program in any language.
//!
//! armplane's side of an exchange page ([`shared_types::exchange`]): it handles topics, lockstep,
//! faults and checkpoints like every process, and asks the program once per tick. If the program
//! dies, falls silent, answers the wrong tick or writes a NaN, this process exits with a message.
//!
//! ```text
//! page.rs       the page in memory            program.rs   the program: started or awaited, asked, ended
//! reply.rs      what a program writes, judged failure.rs   a program's faults
//! cut.rs        its end by a program          ended.rs     why a turn ends before the run does
//! ports.rs      topics to and from the page   turn.rs      the turns of the three roles
//! describe/     the wire for other languages: `armplane generate wire`
//! ```

mod cut;
pub mod describe;
mod ended;
mod failure;
mod page;
mod ports;
mod program;
pub mod reply;
mod turn;

use std::process::Command;
use std::time::Duration;

use runtime::{ProcessError, Shell};
use shared_types::codes::{REQUEST_START, USE_FEEDBACK, USE_READS, USE_WRITES};
use shared_types::exchange::EXCHANGE_STATE;
use shared_types::graph::{Graph, Process, Role};
use shared_types::layout::MessageLayout;

use ended::Ended;
use program::{LONGEST_EXTERNAL_START, LONGEST_START, Program};
use reply::Answer;

pub use failure::Failure;
pub use page::{About, Page};

/// Default limit for a program's answer.
const USUAL_LIMIT: Duration = Duration::from_secs(10);

/// Takes part for a program. `command` starts it; without one it is awaited. `length` is the planned number of ticks of the run.
///
/// # Errors
/// [`ProcessError`] if the graph breaks or the program fails, in a sentence that names process, tick and reason.
pub fn run(
    shell: &Shell,
    graph: &Graph,
    name: &str,
    dof: usize,
    length: u64,
    command: Option<Command>,
) -> Result<(), ProcessError> {
    let process = graph
        .process(name)
        .ok_or_else(|| ProcessError::setup(format!("the graph has no process {name:?}")))?;
    let topics = topics_of(graph, process)?;
    let manifest = shell.manifest();
    let about = About {
        is_lockstep: manifest.is_lockstep(),
        rate_hz: manifest.rate_hz,
        dof: dof as u32,
        incarnation: shell.incarnation(),
    };
    let failed = |error: std::io::Error| {
        ProcessError::setup(format!("cannot make the exchange page of {name}: {error}"))
    };
    let page = Page::create(shell.run_dir(), name, about, &topics).map_err(failed)?;
    cut::explain(name, page.range());
    let of = |limit_s: u32, usual| match limit_s {
        0 => usual,
        limit_s => Duration::from_secs(u64::from(limit_s)),
    };
    let start = match command.is_some() {
        true => of(process.join_limit_s, LONGEST_START),
        false => of(process.join_limit_s, LONGEST_EXTERNAL_START),
    };
    let limits = (start, of(process.answer_limit_s, USUAL_LIMIT));
    let stops_at_once = process.role() != Role::Observer;
    let died = |failure: &Failure| Err(ProcessError::setup(sentence(name, failure)));
    let mut program = match Program::start(shell, name, page, command, limits, stops_at_once) {
        Ok(program) => program,
        Err(failure) => return died(&failure),
    };
    match take_part(shell, process, &topics, &mut program, length) {
        Ok(()) => {
            program.end("");
            Ok(())
        }
        Err(Ended::Ours(error)) => {
            program.end(&error.to_string());
            Err(error)
        }
        Err(Ended::Theirs(failure)) => {
            program.end(&sentence(name, &failure));
            if let Failure::Ended { exit, .. } = &failure {
                // A program that somebody kills is started again with this process, as one of ours.
                exit.signal()
                    .into_iter()
                    .for_each(|signal| shell.end_by(signal, &sentence(name, &failure)));
            }
            died(&failure)
        }
    }
}

fn take_part(
    shell: &Shell,
    process: &Process,
    topics: &[(MessageLayout, u32)],
    program: &mut Program<'_>,
    length: u64,
) -> Result<(), Ended> {
    if !program.join(topics).map_err(Ended::Theirs)? {
        return Ok(());
    }
    let mut state = shell
        .state_cell(EXCHANGE_STATE)
        .map_err(ProcessError::from)?;
    state
        .previous()
        .into_iter()
        .for_each(|last| program.page.put_state(last));
    if program.ask(REQUEST_START, 0).map_err(Ended::Theirs)? == Answer::Stopped {
        return Ok(());
    }
    match process.role() {
        Role::World => turn::world(shell, topics, program, length),
        Role::Stage => turn::stage(shell, topics, program, &mut state),
        Role::Observer => turn::observer(shell, topics, program),
    }
}

/// The topics of a process in the order of its page.
fn topics_of(graph: &Graph, process: &Process) -> Result<Vec<(MessageLayout, u32)>, ProcessError> {
    let uses = [
        (&process.reads, USE_READS),
        (&process.feedback, USE_FEEDBACK),
        (&process.writes, USE_WRITES),
    ];
    let named = uses
        .iter()
        .flat_map(|(names, usage)| names.iter().map(move |name| (name, *usage)));
    let layout = |name: &String| {
        graph
            .layout(name)
            .ok_or_else(|| ProcessError::setup(format!("there is no topic `{name}`")))
    };
    named
        .map(|(name, usage)| Ok((layout(name)?, usage)))
        .collect()
}

fn sentence(name: &str, failure: &Failure) -> String {
    format!("the program of {name} {failure}")
}
