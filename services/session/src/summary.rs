//! The summary of a run: the recorder's part, completed with the launcher's knowledge of processes
//! and deaths.

use std::collections::BTreeMap;
use std::time::Duration;

use launcher::{Death, End, Exit, Failure, Outcome, ProcessOutcome};
use runtime::{Counts, FaultRecord, Origin};
use shared_types::fault::ScheduledFault;
use shared_types::job::{Job, Mode};
use shared_types::process::{Program, Role};
use shared_types::scenario::Scenario;
use shared_types::summary::{
    Deadlines, FAILED, FaultSummary, INTERRUPTED, Pace, ProcessSummary, RecorderSummary, Summary,
};

use crate::export::joined;
use crate::machine::machine;

/// On every Linux.
const SIGKILL: i32 = rustix::process::Signal::KILL.as_raw();

/// Of a run whose recorder ended for good before the run did.
const NO_ACCOUNT: &str = "the recorder left no account of the run, and its files end before it";

/// The summary of a run: the recorder's part, completed by what only the launcher knows.
pub fn summarise(job: &Job, outcome: &Outcome, account: Option<Summary>) -> Summary {
    let mut summary = account.unwrap_or_else(|| without_account(job, outcome));
    // The recorder's are those that it has judged. In real time a plant may be killed between its sample and its account of the tick.
    let ticks = match job.mode {
        Mode::Realtime => outcome.ticks.max(summary.ticks),
        Mode::Lockstep => outcome.ticks,
    };
    summary.ticks = ticks;
    match &outcome.end {
        End::Completed => {}
        End::Interrupted { signal } => {
            summary.completed = false;
            INTERRUPTED.clone_into(&mut summary.outcome);
            summary.reason = format!("stopped by {signal} after {} ticks", outcome.ticks);
        }
        End::Failed(failure) => {
            summary.completed = false;
            summary.outcome = FAILED.to_owned();
            summary.reason = failure.to_string();
        }
    }
    if let (Some(servo), Some(session)) = (&mut summary.servo, &job.scenario.servo) {
        servo.after_end = session.after_end(job.scenario.rate_hz) as u64;
    }
    summary.machine = machine();
    let last_line = |fault: &ScheduledFault| {
        let of = (fault.process as usize, fault.at);
        let mut lines = outcome.last_lines.iter();
        let line = lines.find(|(process, at, _)| (*process, *at) == of);
        line.map(|(.., line)| line.as_str())
    };
    let faults = outcome.faults.iter();
    let faults = faults.map(|account| fault_summary(job, account, last_line(&account.scheduled)));
    let deaths = outcome.deaths.iter().map(death);
    summary.faults = faults.chain(deaths).chain(unlisted(outcome)).collect();
    if matches!(outcome.end, End::Completed) {
        let missed = too_late(&job.scenario, &summary);
        summary.reason = joined([&*summary.reason, &missed]);
    }
    let counts: Vec<_> = outcome.processes.iter().map(|one| one.counts).collect();
    summary.deadlines = deadlines(job, ticks, &counts);
    if summary.deadlines.is_some() {
        // The recorder may have died after its account, or have left none.
        let recorder = outcome.processes.iter();
        let recorder = recorder.filter(|one| one.name == Program::Recorder.name());
        let refused: u64 = recorder
            .map(|one| one.counts.refused + one.counts.fenced)
            .sum();
        let sent: u64 = counts.iter().map(|one| one.sent).sum();
        let missing = sent.saturating_sub(summary.recorder.messages + refused);
        summary.recorder.lost = summary.recorder.lost.max(missing);
    }
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

/// Adds deaths of which only the run's job tells.
pub(crate) fn add_deaths(summary: &mut Summary, deaths: &[FaultSummary]) {
    for process in &mut summary.processes {
        let own = deaths.iter().filter(|death| death.process == process.name);
        process.restarts += own.count() as u32;
    }
    summary.faults.extend_from_slice(deaths);
}

/// Completes the summary of a run that went on from a tick: the account of the faults before it, and the pace of the ticks since, made in so long.
pub(crate) fn add_earlier(
    summary: &mut Summary,
    from: u64,
    faults: &[FaultSummary],
    wall: Duration,
) {
    for fault in summary.faults.iter_mut().filter(|fault| fault.tick < from) {
        let known = |earlier: &&FaultSummary| {
            earlier.plan.is_some() && (earlier.tick, &earlier.plan) == (fault.tick, &fault.plan)
        };
        if let Some(earlier) = faults.iter().find(known) {
            fault.clone_from(earlier);
        }
    }
    let wall_s = wall.as_secs_f64();
    summary.pace = Pace {
        wall_s,
        ticks_per_s: summary.ticks.saturating_sub(from) as f64 / wall_s,
    };
}

/// Planned pushes and faults to which a run that has ended did not come, in words; empty: none.
fn too_late(scenario: &Scenario, summary: &Summary) -> String {
    let end_s = summary.ticks as f64 * scenario.dt_s();
    let pushes = scenario.plant.push.iter();
    let pushes = pushes.map(|push| ("push".to_owned(), push.at_s));
    let faults = summary.faults.iter().filter(|fault| fault.plan.is_some());
    let faults = faults.map(|fault| {
        let what = format!("{} of the {}", fault.kind, fault.process);
        (what, fault.tick as f64 * scenario.dt_s())
    });
    let late = pushes.chain(faults).filter(|(_, at_s)| *at_s >= end_s);
    let late: Vec<_> = late
        .map(|(what, at_s)| format!("{what} at {at_s} s"))
        .collect();
    match late.is_empty() {
        true => String::new(),
        false => format!(
            "the run ended at {end_s:.3} s, before this: {}",
            late.join(", ")
        ),
    }
}

/// The summary of a run whose recorder has left none.
fn without_account(job: &Job, outcome: &Outcome) -> Summary {
    let file = job.record.then(|| recorder::MESSAGES.to_owned());
    Summary {
        of: job.into(),
        ticks: outcome.ticks,
        outcome: FAILED.to_owned(),
        reason: NO_ACCOUNT.to_owned(),
        recorder: RecorderSummary {
            file: file.unwrap_or_default(),
            error: NO_ACCOUNT.to_owned(),
            ..RecorderSummary::default()
        },
        ..Summary::default()
    }
}

/// A fault and its outcome. `last_line`: of the process, where the fault is its end.
pub(crate) fn fault_summary(
    job: &Job,
    account: &FaultRecord,
    last_line: Option<&str>,
) -> FaultSummary {
    let tick = account.scheduled.at;
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
    let recovered_ms = since_ms(account.recovered_ns);
    let (kind, detail) = match (account.exit, &fault) {
        (Some(exit), _) => {
            let after = recovered_ms.map(|ms| format!("its replacement answered {ms:.0} ms later"));
            let detail = ended(&process, exit, tick, after, last_line);
            (kind_of(exit), detail)
        }
        (None, Some(fault)) => (fault.kind.name(), fault.to_string()),
        (None, None) => ("", String::new()),
    };
    FaultSummary {
        tick,
        kind: kind.to_owned(),
        detail,
        origin: account.origin.name().to_owned(),
        occurred: account.injected_ns != 0,
        detected_ms: since_ms(account.detected_ns),
        recovered_ms,
        plan: fault,
        process,
    }
}

/// A death in lockstep, which has cost nothing but time.
pub(crate) fn death(death: &Death) -> FaultSummary {
    let Death {
        process,
        tick,
        exit,
        last_line,
        again,
    } = death;
    let after = again.map(|(from, lost)| {
        let lost_s = lost.as_secs_f64();
        format!("all processes started again from tick {from}, {lost_s:.1} s were lost")
    });
    let detail = ended(process, *exit, *tick, after, last_line.as_deref());
    FaultSummary {
        recovered_ms: again.map(|(_, lost)| lost.as_secs_f64() * 1e3),
        ..detected(process, *tick, kind_of(*exit), detail)
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

/// `estimator ended with exit code 3 at tick 1200; its replacement answered 63 ms later; its last line: no memory`.
fn ended(
    process: &str,
    exit: Exit,
    tick: u64,
    after: Option<String>,
    last_line: Option<&str>,
) -> String {
    let line = last_line.map(|line| line.trim_start_matches("armplane: "));
    let line = line.map(|line| format!("its last line: {line}"));
    let end = format!("{process} ended with {exit} at tick {tick}");
    let parts = [Some(end), after, line];
    parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
}

/// The plant's account of a run's ticks, by what each process has on the control page, in the order of the graph; none in lockstep, which has no deadlines.
pub fn deadlines(job: &Job, ticks: u64, counts: &[Counts]) -> Option<Deadlines> {
    if job.mode == Mode::Lockstep {
        return None;
    }
    let named = || job.graph.process.iter().zip(counts);
    let plant = named().find(|(process, _)| process.role() == Role::World);
    let (world, plant) = plant.map_or(("", Counts::default()), |(world, plant)| {
        (world.name.as_str(), *plant)
    });
    let above_zero = |(_, count): &(String, u64)| *count > 0;
    let mut by_cause: BTreeMap<_, _> = named()
        .map(|(process, counts)| (process.name.clone(), counts.silent))
        .filter(above_zero)
        .collect();
    // A plant that was killed has not accounted for the tick in hand.
    let cut = ticks.saturating_sub(plant.in_time + plant.late + plant.none);
    if cut > 0 {
        *by_cause.entry(world.to_owned()).or_default() += cut;
    }
    let skipped = [
        ("major page fault", plant.skipped_major_fault),
        ("preempted", plant.skipped_preempted),
        ("peer restart", plant.skipped_peer_restart),
        ("overrun", plant.skipped_overrun),
    ];
    let none = plant.none + cut;
    Some(Deadlines {
        total: plant.in_time + plant.late + none,
        in_time: plant.in_time,
        late: plant.late,
        none,
        missed: plant.late + none,
        by_cause,
        skipped: skipped
            .map(|(cause, count)| (cause.to_owned(), count))
            .into_iter()
            .filter(above_zero)
            .collect(),
    })
}

/// What has failed and stands in no fault table: a process that was killed when the run had its last tick, or together with the one whose death ended
/// the run, or that did not do as it was asked. So no summary has a signal and no fault.
fn unlisted(outcome: &Outcome) -> Vec<FaultSummary> {
    let end = |(index, process): (usize, &ProcessOutcome)| {
        let ProcessOutcome { name, exit, .. } = process;
        let own = match &outcome.end {
            End::Failed(failure) if failure.process() == name => Some(failure),
            _ => None,
        };
        let ends = process.restarts as usize + usize::from(!exit.is_success());
        let is_end = |record: &&FaultRecord| {
            let fault = &record.scheduled;
            fault.process as usize == index && fault.ends_process() && record.injected_ns != 0
        };
        let deaths = outcome.deaths.iter().filter(|death| death.process == *name);
        let is_listed = ends <= outcome.faults.iter().filter(is_end).count() + deaths.count();
        let (tick, kind) = match own {
            Some(Failure::Died { tick, exit, .. }) if !is_listed => (*tick, kind_of(*exit)),
            None if !is_listed => (outcome.ticks, kind_of(*exit)),
            Some(Failure::Died { .. }) | None => return None,
            Some(_) => (outcome.ticks, "exit"),
        };
        let ended = || format!("{name} ended with {exit} at the end of the run");
        let detail = own.map_or_else(ended, ToString::to_string);
        Some(detected(name, tick, kind, detail))
    };
    let processes = outcome.processes.iter().enumerate();
    processes.filter_map(end).collect()
}

/// A fault that stands in no fault table.
pub(crate) fn detected(process: &str, tick: u64, kind: &str, detail: String) -> FaultSummary {
    FaultSummary {
        tick,
        process: process.to_owned(),
        kind: kind.to_owned(),
        detail,
        origin: Origin::Detected.name().to_owned(),
        occurred: true,
        ..FaultSummary::default()
    }
}
