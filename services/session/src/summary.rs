//! The account of a run: the recorder's part, completed by what only the launcher knows.

use launcher::{End, Exit, Failure, Outcome};
use runtime::{FaultRecord, Origin};
use shared_types::fault::ScheduledFault;
use shared_types::graph::Graph;
use shared_types::job::{Job, Mode};
use shared_types::summary::{
    Deadlines, FaultSummary, INTERRUPTED, ProcessSummary, RecorderSummary, Summary,
};

use crate::machine::machine;

/// On every Linux.
const SIGKILL: i32 = rustix::process::Signal::KILL.as_raw();

/// Of a run whose recorder ended for good before the run did.
const NO_ACCOUNT: &str = "the recorder left no account of the run, and its files end before it";

/// The summary of a run: the recorder's part, completed by what only the launcher knows.
#[must_use]
pub fn summarise(job: &Job, outcome: &Outcome, account: Option<Summary>) -> Summary {
    let mut summary = account.unwrap_or_else(|| Summary {
        version: job.version.clone(),
        scenario: job.scenario.name.clone(),
        robot: job.robot.name.clone(),
        mode: job.mode.name().to_owned(),
        seed: job.scenario.seed,
        rate_hz: job.scenario.rate_hz,
        ticks: outcome.ticks,
        outcome: "failed".to_owned(),
        reason: NO_ACCOUNT.to_owned(),
        recorder: RecorderSummary {
            file: if job.record {
                viz::part_name(0)
            } else {
                String::new()
            },
            error: NO_ACCOUNT.to_owned(),
            ..RecorderSummary::default()
        },
        ..Summary::default()
    });
    match &outcome.end {
        End::Completed => {}
        End::Interrupted { signal } => {
            summary.completed = false;
            INTERRUPTED.clone_into(&mut summary.outcome);
            summary.reason = format!("stopped by {signal} after {} ticks", outcome.ticks);
        }
        End::Failed(failure) => {
            let first = sentence(failure);
            summary.completed = false;
            summary.outcome = "failed".to_owned();
            if !is_listed(&job.graph, outcome, failure) {
                let (tick, kind) = match failure {
                    Failure::Died { tick, exit, .. } => (*tick, kind_of(*exit)),
                    _ => (outcome.ticks, "exit"),
                };
                summary.faults.push(FaultSummary {
                    tick,
                    process: named_in(&job.graph, &first),
                    kind: kind.to_owned(),
                    detail: first.clone(),
                    origin: Origin::Detected.name().to_owned(),
                    occurred: true,
                    ..FaultSummary::default()
                });
            }
            summary.reason = first;
        }
    }
    if let (Some(servo), Some(session)) = (&mut summary.servo, &job.scenario.servo) {
        servo.after_end = session.after_end(job.scenario.rate_hz) as u64;
    }
    summary.machine = machine();
    let mut faults: Vec<_> = outcome
        .faults
        .iter()
        .map(|account| fault_summary(job, account))
        .collect();
    for (fault, account) in faults
        .iter_mut()
        .zip(&outcome.faults)
        .filter(|(_, account)| account.exit.is_some())
    {
        let is_it = |(process, at, _): &&(usize, u64, String)| {
            (*process, *at) == (account.scheduled.process as usize, account.scheduled.at)
        };
        if let Some((.., line)) = outcome.last_lines.iter().find(is_it) {
            fault.detail = format!(
                "{}; its last line: {}",
                fault.detail,
                line.trim_start_matches("armplane: ")
            );
        }
    }
    faults.append(&mut summary.faults);
    summary.faults = faults;
    summary.deadlines = deadlines(job, outcome);
    summary.processes = outcome
        .processes
        .iter()
        .map(|process| ProcessSummary {
            name: process.name.clone(),
            pid: process.pid,
            restarts: process.restarts,
            exit: process.exit.to_string(),
            lines_dropped: process.lines_dropped,
        })
        .collect();
    summary
}

/// Whether the end of the process that ended the run stands in the fault table: one entry for each of its deaths.
fn is_listed(graph: &Graph, outcome: &Outcome, failure: &Failure) -> bool {
    let Failure::Died {
        process, restarts, ..
    } = failure
    else {
        return false;
    };
    let ends = outcome.faults.iter().filter(|account| {
        let name = graph
            .process
            .get(account.scheduled.process as usize)
            .map(|process| &process.name);
        name == Some(process) && account.exit.is_some()
    });
    ends.count() > *restarts as usize
}

/// A fault and its outcome.
pub(crate) fn fault_summary(job: &Job, account: &FaultRecord) -> FaultSummary {
    let process = job
        .graph
        .process
        .get(account.scheduled.process as usize)
        .map(|process| process.name.clone())
        .unwrap_or_default();
    let fault = job
        .graph
        .target(&process)
        .and_then(|target| account.scheduled.fault(&process, &target));
    let since_ms = |ns: u64| {
        (account.injected_ns != 0 && ns != 0)
            .then(|| ns.saturating_sub(account.injected_ns) as f64 * 1e-6)
    };
    let (kind, detail) = match (account.exit, &fault) {
        (Some(exit), _) => (
            kind_of(exit),
            ended(
                &process,
                exit,
                &account.scheduled,
                account.recovered_ns != 0,
            ),
        ),
        (None, Some(fault)) => (fault.kind.name(), fault.to_string()),
        (None, None) => ("", String::new()),
    };
    FaultSummary {
        tick: account.scheduled.at,
        kind: kind.to_owned(),
        detail,
        origin: account.origin.name().to_owned(),
        occurred: account.injected_ns != 0,
        detected_ms: since_ms(account.detected_ns),
        recovered_ms: since_ms(account.recovered_ns),
        plan: fault,
        process,
    }
}

/// The kind of an end that no plan had.
fn kind_of(exit: Exit) -> &'static str {
    match exit {
        Exit::Code(_) => "exit",
        Exit::Signal(SIGKILL) => "kill",
        Exit::Signal(_) => "signal",
    }
}

/// `estimator ended with exit code 3 at tick 1200; its replacement answers from tick 1300 on`.
fn ended(process: &str, exit: Exit, scheduled: &ScheduledFault, is_replaced: bool) -> String {
    let after = match scheduled.after_outputs() {
        0 => String::new(),
        outputs => format!(" after {outputs} of its messages"),
    };
    let until = if is_replaced {
        format!("; its replacement answers from tick {} on", scheduled.until)
    } else {
        String::new()
    };
    format!(
        "{process} ended with {exit} at tick {}{after}{until}",
        scheduled.at
    )
}

/// The failure on one line: with the reason that the process itself gave, where it gave one.
fn sentence(failure: &Failure) -> String {
    let text = failure.to_string();
    let first = text
        .lines()
        .next()
        .unwrap_or_default()
        .trim_end_matches("; its last lines:");
    let own = match failure {
        Failure::Died { last_words, .. } => last_words
            .iter()
            .rev()
            .find_map(|line| line.strip_prefix("armplane: ")),
        _ => None,
    };
    own.map_or_else(|| first.to_owned(), |own| format!("{first}: {own}"))
}

fn named_in(graph: &Graph, sentence: &str) -> String {
    graph
        .process
        .iter()
        .find(|process| sentence.starts_with(&process.name))
        .map(|process| process.name.clone())
        .unwrap_or_default()
}

/// Missed deadlines by process and cause; none in lockstep, which has no deadlines.
#[must_use]
pub fn deadlines(job: &Job, outcome: &Outcome) -> Deadlines {
    if job.mode == Mode::Lockstep {
        return Deadlines::default();
    }
    let mut deadlines = Deadlines {
        total: outcome.ticks,
        ..Deadlines::default()
    };
    for process in &outcome.processes {
        let counts = &process.counts;
        let causes = [
            ("major page fault", counts.missed_major_fault),
            ("preempted", counts.missed_preempted),
            ("peer restart", counts.missed_peer_restart),
            ("late input", counts.missed_late_input),
            ("overrun", counts.missed_overrun),
        ];
        for (cause, count) in causes.into_iter().filter(|(_, count)| *count > 0) {
            deadlines
                .by_cause
                .insert(format!("{}: {cause}", process.name), count);
            deadlines.missed += count;
        }
    }
    deadlines
}
