//! Goes on with a run whose launcher was killed, or makes its results from the files it left.

use std::collections::BTreeMap;
use std::path::Path;

use model::Robot;
use recorder::MESSAGES;
use runtime::{ControlPage, RunDir};
use shared_types::job::{JOB, Job, Mode};
use shared_types::summary::{INTERRUPTED, Summary};

use crate::drawing::draw_results;
use crate::export::joined;
use crate::failure::Failure;
use crate::launch::interrupts;
use crate::machine::machine;
use crate::observation::{open_run, ticks_done};
use crate::origin::newest_cut;
use crate::plan::{is_external, plan};
use crate::progress::{Observer, say};
use crate::results::{Results, SUMMARY};
use crate::runs::Run;
use crate::session::{Finished, Prepared};
use crate::summary::{add_deaths, deadlines, detected, fault_summary};

/// Makes recording, summary and repeatable scenario of a run from the job and the messages in its
/// folder. Reads its faults from shared memory, if they are still there. If a message log is
/// damaged or missing, the recorder's error in the summary names it and the loss.
///
/// # Errors
/// [`Failure::Input`] if the run still goes on, has ended by itself, or kept no messages;
/// [`Failure::Work`] if a file cannot be written.
pub fn recover(remains: Remains, observer: Observer<'_>) -> Result<Summary, Failure> {
    let Remains { results, job, .. } = remains;
    let robot = Robot::from_source(&job.robot).map_err(Failure::input)?;
    let mut summary = recorder::rebuild(&robot, &job).map_err(Failure::work)?;
    let page = left_in_shared_memory(&job.run);
    if !summary.completed {
        INTERRUPTED.clone_into(&mut summary.outcome);
        summary.reason = interrupted(&summary, page.as_ref().map_or(0, ticks_done));
    }
    summary.machine = machine();
    add_shared_memory(&mut summary, &job, page.as_ref());
    remove_left(&job.run);
    results.keep(&job, &summary)?;
    draw_results(&job, &summary, observer, &mut interrupts()?)?;
    Ok(summary)
}

/// The folder, held from here on, and the job of a run that has no summary.
fn left(folder: &Path) -> Result<(Results, Job), Failure> {
    let folder = folder.canonicalize().map_err(|_| {
        Failure::Input(format!(
            "there is no folder {}: give the one that `armplane run` printed, such as runs/fig5-wrist-rotation-001",
            folder.display()
        ))
    })?;
    let run = Run {
        folder: folder.clone(),
    };
    // One that cannot be read is made anew, too. First of all, because remedies for the rest would be in vain.
    if run.summary().is_ok() {
        return Err(Failure::Input(format!(
            "{} already has its {SUMMARY}: there is nothing to recover",
            folder.display()
        )));
    }
    // Refused while the run goes on.
    let results = Results::of_run(&folder)?;
    if !folder.join(JOB).exists() {
        let folder = folder.display();
        return Err(Failure::Input(format!(
            "{folder} has no {JOB}: its run was killed before it started a process, or it is no folder of a run; `armplane run SCENARIO --out {folder}` makes the run in it"
        )));
    }
    let mut job = run.job()?;
    if !job.record {
        return Err(Failure::Input(format!(
            "{} has no messages to recover from (--no-record): run it again",
            folder.display()
        )));
    }
    job.out.clone_from(&folder);
    Ok((results, job))
}

/// A run that its launcher's end has cut short, and what is left of it.
pub struct Remains {
    /// Held until all is written.
    results: Results,
    job: Job,
    /// Why it cannot go on, in words.
    pub ended: Option<&'static str>,
}

/// Whether a run whose launcher was killed can go on.
///
/// # Errors
/// As [`recover`].
pub fn remains(folder: &Path) -> Result<Remains, Failure> {
    let (results, job) = left(folder)?;
    let ended = if job.mode == Mode::Realtime {
        Some("it ran in real time")
    } else if job
        .scenario
        .servo
        .as_ref()
        .is_some_and(|session| session.live)
    {
        Some("nobody gives it targets any more")
    } else if job.graph.process.iter().any(is_external) {
        Some("a program of it is started by hand")
    } else {
        None
    };
    Ok(Remains {
        results,
        job,
        ended,
    })
}

/// Goes on with a run in lockstep whose launcher was killed, from the newest cut in its record to its end. `unread`: see [`Request`](crate::Request).
///
/// # Errors
/// As [`recover`], and [`Failure::Work`] if the processes cannot be started or watched.
pub fn go_on(
    remains: Remains,
    unread: fn() -> BTreeMap<String, u64>,
    observer: Observer<'_>,
) -> Result<Finished, Failure> {
    let Remains {
        mut results,
        mut job,
        ..
    } = remains;
    let signals = interrupts()?;
    let mut plan = plan(&job)?;
    let mut earlier = Vec::new();
    // Those that were given while it ran, too, as far as they are known.
    if let Some(page) = left_in_shared_memory(&job.run) {
        let records = || page.fault_table().records();
        plan.faults = records().map(|(_, record)| record.scheduled).collect();
        earlier.extend(records().map(|(_, record)| fault_summary(&job, &record, None)));
    }
    remove_left(&job.run);
    plan.begin = newest_cut(&results.folder.join(MESSAGES), &job, &plan.faults, u64::MAX)?;
    let from = plan.begin.tick;
    say(observer, format_args!("goes on from tick {from}"));
    results.reserve(&job)?;
    let killed = format!("the launcher was killed; the run went on from tick {from}");
    job.deaths.push(detected("launcher", from, "kill", killed));
    let prepared = Prepared {
        job,
        results,
        plan,
        earlier,
        live: None,
        unread,
        signals,
    };
    prepared.run(&mut |_| Ok(()), observer)
}

/// Why the run did not come to its end; `done`: the ticks that it has done, where that is still known.
fn interrupted(summary: &Summary, done: u64) -> String {
    match summary.ticks {
        0 if !summary.recorder.error.is_empty() => {
            "no tick in the message log is complete".to_owned()
        }
        0 => "the launcher was killed before the messages of a whole tick were kept".to_owned(),
        // The last of them were in no file.
        ticks if done > ticks => format!(
            "the launcher was killed; recovered from the messages of {ticks} ticks, of {done} that the run had done"
        ),
        ticks => format!("the launcher was killed; recovered from the messages of {ticks} ticks"),
    }
}

/// Adds the parts that no message contains: deadlines and faults.
fn add_shared_memory(summary: &mut Summary, job: &Job, page: Option<&ControlPage>) {
    let account = page.and_then(|page| {
        let counts = (0..job.graph.process.len()).map(|process| page.process(process).counts());
        deadlines(job, ticks_done(page), &counts.collect::<Vec<_>>())
    });
    // Of other ticks than the summary's it would not add up.
    summary.deadlines = account.filter(|account| account.total == summary.ticks);
    if job.mode == Mode::Realtime && summary.deadlines.is_none() {
        let unknown = "which of these ticks had torque in time is not known: no message says it";
        summary.reason = joined([&summary.reason, unknown]);
    }
    let faults = page
        .into_iter()
        .flat_map(|page| page.fault_table().records());
    summary.faults = faults
        .map(|(_, record)| fault_summary(job, &record, None))
        .collect();
    add_deaths(summary, &job.deaths);
    if !summary.completed {
        let killed = "the launcher was killed".to_owned();
        let killed = detected("launcher", summary.ticks, "kill", killed);
        summary.faults.push(killed);
    }
    if page.is_none() {
        let gone = "faults and ends of processes before are not known: they stood in shared memory, which is gone";
        summary.reason = joined([&summary.reason, gone]);
    }
}

/// The control page of a run whose directory still exists.
fn left_in_shared_memory(run: &str) -> Option<ControlPage> {
    open_run(run).ok().map(|(_, _, page)| page)
}

/// Removes what the launcher of a run has left in shared memory.
fn remove_left(run: &str) {
    if let Err(error) = RunDir::remove_left(run) {
        runtime::complain(&error);
    }
}
