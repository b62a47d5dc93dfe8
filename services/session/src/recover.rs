//! Makes the results of a run whose launcher was killed, from the files it left.

use std::path::{Path, PathBuf};

use model::Robot;
use runtime::{ControlPage, MAX_PROCESSES, RunDir, SHM};
use shared_types::job::{JOB, Job, Mode};
use shared_types::summary::{INTERRUPTED, Summary};

use crate::export::{joined, seal};
use crate::failure::Failure;
use crate::machine::machine;
use crate::results::{EARLIER, Results, SUMMARY, keep};
use crate::runs::Run;
use crate::summary::{deadlines, detected, fault_summary};

/// More ticks than the last chunk of a recorder that is killed has.
const LAST_CHUNK: u64 = 128;

/// Makes recording, summary and repeatable scenario of a run from the job and the messages in its
/// folder. Reads its faults from shared memory, if they are still there. If a message log is
/// damaged or missing, the recorder's error in the summary names it and the loss.
///
/// # Errors
/// [`Failure::Input`] if the run still goes on, has ended by itself, or kept no messages;
/// [`Failure::Work`] if a file cannot be written.
pub fn recover(folder: &Path) -> Result<Summary, Failure> {
    let folder = folder.canonicalize().map_err(|_| {
        Failure::Input(format!(
            "there is no folder {}: give the one that `armplane run` printed, such as runs/fig5-wrist-rotation-001",
            folder.display()
        ))
    })?;
    let run = Run {
        folder: folder.clone(),
        parts: Vec::new(),
    };
    // One that cannot be read is made anew, too. First of all, because remedies for the rest would be in vain.
    if run.summary().is_ok() {
        return Err(Failure::Input(format!(
            "{} already has its {SUMMARY}: there is nothing to recover",
            folder.display()
        )));
    }
    // Held until all is written; refused while the run goes on.
    let _results = Results::of_run(&folder)?;
    if !folder.join(JOB).exists() {
        return Err(Failure::Input(nothing_begun(&folder)));
    }
    let mut job = run.job()?;
    if !job.messages {
        return Err(Failure::Input(format!(
            "{} has no messages to recover from (--no-messages): run it again",
            folder.display()
        )));
    }
    job.out.clone_from(&folder);
    let (mut summary, kept) = rebuilt(&folder, &job)?;
    let page = left_in_shared_memory(&job.run);
    // A recorder that is killed has up to a block of each topic's messages in its memory, of ticks whose rows may be in the recording.
    let ordinary = !summary.completed
        && summary.recorder.error.is_empty()
        && kept.is_some_and(|rows| rows <= summary.recorder.rows + LAST_CHUNK);
    let kept = kept
        .map(|rows| format!("the run's own recording has {rows} rows, and stays in {EARLIER}/"))
        .unwrap_or_default();
    if !ordinary {
        summary.recorder.error = joined([&summary.recorder.error, &kept]);
    }
    if !summary.completed {
        INTERRUPTED.clone_into(&mut summary.outcome);
        summary.reason = interrupted(&summary, page.as_ref().map_or(0, ticks_done));
        if ordinary {
            summary.reason = joined([&summary.reason, &kept]);
        }
    }
    summary.machine = machine();
    add_shared_memory(&mut summary, &job, page.as_ref());
    keep(&folder, &job, &summary)?;
    Ok(summary)
}

/// Summary and recording from the messages, or rows of the run's own recording, if that has more.
fn rebuilt(folder: &Path, job: &Job) -> Result<(Summary, Option<u64>), Failure> {
    let robot = Robot::from_source(&job.robot).map_err(Failure::input)?;
    let earlier = Earlier::set_aside(folder)?;
    let mut summary = match recorder::rebuild(&robot, job) {
        Ok(summary) => summary,
        Err(error) => {
            let back = earlier.put_back(folder);
            return Err(back.map_or_else(|failure| failure, |()| Failure::work(error)));
        }
    };
    seal(folder, &mut summary.recorder);
    let kept = earlier.compare(summary.recorder.rows)?;
    Ok((summary, kept))
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
        .map(|(_, record)| fault_summary(job, &record))
        .collect();
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

/// The recording that a run left, out of the way of the one that is made from its messages: it may hold more than they do.
struct Earlier {
    folder: PathBuf,
}

impl Earlier {
    fn set_aside(run: &Path) -> Result<Self, Failure> {
        let folder = run.join(EARLIER);
        // One that is there already is the run's own; the other was made by a recovery that was killed.
        if viz::parts_in(&folder).is_empty() && !viz::parts_in(run).is_empty() {
            std::fs::create_dir_all(&folder).map_err(Failure::cannot("make", &folder))?;
            move_recording(run, &folder)?;
        }
        Ok(Self { folder })
    }

    fn put_back(&self, run: &Path) -> Result<(), Failure> {
        move_recording(&self.folder, run)?;
        let _ = std::fs::remove_dir(&self.folder);
        Ok(())
    }

    /// Removes it where `rows`, those of the new recording, are as many; otherwise it stays, and this is the number of its rows.
    fn compare(&self, rows: u64) -> Result<Option<u64>, Failure> {
        let parts = viz::parts_in(&self.folder);
        let before = viz::rows_in(&parts);
        if before > rows {
            return Ok(Some(before));
        }
        for part in parts {
            std::fs::remove_file(&part).map_err(Failure::cannot("remove", &part))?;
        }
        let _ = std::fs::remove_dir(&self.folder);
        Ok(None)
    }
}

fn move_recording(from: &Path, to: &Path) -> Result<(), Failure> {
    for part in viz::parts_in(from) {
        let place = part
            .file_name()
            .map_or_else(|| to.to_owned(), |name| to.join(name));
        std::fs::rename(&part, &place).map_err(|error| {
            Failure::Work(format!(
                "cannot move {} to {}: {error}",
                part.display(),
                place.display()
            ))
        })?;
    }
    Ok(())
}

/// Why a folder without a job has nothing to recover, and the remedy.
fn nothing_begun(folder: &Path) -> String {
    let folder = folder.display();
    format!(
        "{folder} has no {JOB}: its run was killed before it started a process, or it is no folder of a run; `armplane run SCENARIO --out {folder}` makes the run in it"
    )
}

/// The control page of a run whose directory still exists.
fn left_in_shared_memory(run: &str) -> Option<ControlPage> {
    RunDir::open(&Path::new(SHM).join(run))
        .ok()
        .and_then(|run| ControlPage::open(&run).ok())
}

/// Ticks that a process of the run has done, the most of all.
fn ticks_done(page: &ControlPage) -> u64 {
    (0..MAX_PROCESSES)
        .map(|process| page.process(process).ticks())
        .max()
        .unwrap_or_default()
}
