//! The results of a run whose launcher was killed, from what it left.

use std::path::Path;

use runtime::{ControlPage, FaultRecord, MAX_PROCESSES, RunDir, SHM};
use shared_types::job::JOB;
use shared_types::summary::{INTERRUPTED, Summary};

use crate::failure::Failure;
use crate::load;
use crate::machine::machine;
use crate::results::{Results, SUMMARY, keep};
use crate::runs::Run;
use crate::summary::fault_summary;

/// Makes the recording, the summary and the repeatable scenario of a run from the job and the messages in its folder, and its faults from what is
/// still in shared memory. Where a message log is damaged or missing, the recorder's error in the summary says which, and what it costs.
///
/// # Errors
/// [`Failure::Input`] where the run goes on, or has ended by itself, or kept no messages; [`Failure::Work`] where something cannot be written.
pub fn recover(folder: &Path) -> Result<Summary, Failure> {
    let folder = folder.canonicalize().map_err(|_| {
        Failure::Input(format!(
            "there is no folder {}: give the one that `armplane run` named, such as runs/fig5-wrist-rotation-001",
            folder.display()
        ))
    })?;
    // Held until all is written; refused while the run goes on.
    let _results = Results::of_run(&folder)?;
    let run = Run { folder: folder.clone(), parts: Vec::new() };
    // One that cannot be read is made anew, too.
    if run.summary().is_ok() {
        return Err(Failure::Input(format!("{} has its {SUMMARY}: there is nothing to recover", folder.display())));
    }
    if !folder.join(JOB).exists() {
        return Err(Failure::Input(nothing_begun(&folder)));
    }
    let mut job = run.job()?;
    if !job.messages {
        return Err(Failure::Input(format!(
            "{} was run without its messages: nothing can be recovered from it; run it again",
            folder.display()
        )));
    }
    job.out.clone_from(&folder);
    let robot = load::robot_of(&job.robot).map_err(Failure::input)?;
    let mut summary = recorder::rebuild(&robot, &job).map_err(Failure::work)?;
    let (lost, page) = (without_messages(&summary), left_in_shared_memory(&job.run));
    if !summary.completed {
        INTERRUPTED.clone_into(&mut summary.outcome);
        summary.reason = match (summary.ticks, &lost[..]) {
            (0, []) => "the launcher was killed before the messages of a whole tick were kept".to_owned(),
            (0, lost) => format!("no tick is whole: the message log of {} is missing, empty or damaged", lost.join(", ")),
            // Of those that the run has done, where that is still known: the last of them were in no file.
            (ticks, _) => match page.as_ref().map_or(0, ticks_done) {
                done if done > ticks => {
                    format!("the launcher was killed; recovered from the messages of {ticks} ticks, of {done} that the run had done")
                }
                _ => format!("the launcher was killed; recovered from the messages of {ticks} ticks"),
            },
        };
    }
    summary.machine = machine();
    let faults: Vec<FaultRecord> = page.map(|page| page.fault_table().records().map(|(_, record)| record).collect()).unwrap_or_default();
    summary.faults = faults.iter().map(|record| fault_summary(&job, record)).collect();
    keep(&folder, &job, &summary)?;
    Ok(summary)
}

/// The topics without a message, where others have so many that theirs must have been kept, too.
fn without_messages(summary: &Summary) -> Vec<String> {
    let most = summary.topics.values().map(|topic| topic.count).max().unwrap_or_default();
    let lost = summary.topics.iter().filter(|(_, topic)| topic.count == 0 && most > 2 * message_log::BLOCK as u64);
    lost.map(|(name, _)| format!("`{name}`")).collect()
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
    RunDir::open(&Path::new(SHM).join(run)).ok().and_then(|run| ControlPage::open(&run).ok())
}

/// Ticks that a process of the run has done, the most of all.
fn ticks_done(page: &ControlPage) -> u64 {
    (0..MAX_PROCESSES).map(|process| page.process(process).ticks()).max().unwrap_or_default()
}
