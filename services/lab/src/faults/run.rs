//! A run in its processes, of which faults are requested before its first tick, as `armplane fault` would; and what is seen of it.

use launcher::Failure as Mishap;
use model::Robot;
use recorder::{Contents, RecordReader};
use runtime::{ControlPage, RunDir, random};
use session::{Failure, Results};
use shared_types::fault::Fault;
use shared_types::job::Job;
use shared_types::summary::Summary;
use shared_types::{Message, PlantState, SensorSample};

use super::without::Without;
use crate::end::mishap;

/// What all runs of an experiment share. Their files are in one folder, each run's in the place of the last one's.
pub(super) struct Stage<'a> {
    pub(super) results: Results,
    pub(super) job: Job,
    pub(super) robot: &'a Robot,
    pub(super) without: Option<Without>,
}

/// All that is seen of a run.
pub(super) struct Ran {
    pub(super) job: Job,
    /// Why it ended before its task did.
    pub(super) failure: Option<Mishap>,
    pub(super) summary: Summary,
    pub(super) truth: Vec<PlantState>,
    pub(super) samples: Vec<SensorSample>,
    pub(super) left_behind: Vec<String>,
}

impl Stage<'_> {
    /// Runs the scenario with planned faults, and with live ones.
    pub(super) fn run(&self, planned: Vec<Fault>, live: &[Fault]) -> Result<Ran, Failure> {
        let mut job = self.job.clone();
        job.scenario.fault = planned;
        // The judge of a cell reads the record.
        job.record = true;
        self.results.clear()?;
        let mut plan = session::plan(&job)?;
        self.without
            .iter()
            .for_each(|without| without.leave_out_of(&mut plan));
        // Of each start of the processes.
        let mut names = Vec::new();
        let mut begin = |run: &RunDir| {
            if names.is_empty() {
                request(&ControlPage::open(run).map_err(Failure::work)?, &job, live)?;
            }
            names.push(run.name().to_owned());
            Ok(())
        };
        let launched = session::launch_watched(&job, plan, &mut begin, &mut |_| ());
        let (outcome, account) = launched?;
        let summary = session::summarise(&job, &outcome, account);
        Ok(Ran {
            truth: messages_of(&job),
            samples: messages_of(&job),
            left_behind: names.iter().flat_map(|name| left_over(name)).collect(),
            failure: mishap(&outcome.end)?.cloned(),
            job,
            summary,
        })
    }
}

fn request(page: &ControlPage, job: &Job, live: &[Fault]) -> Result<(), Failure> {
    for (number, fault) in live.iter().enumerate() {
        let (rate_hz, seed) = (job.scenario.rate_hz, job.scenario.seed);
        let schedule = |target| fault.schedule(&target, rate_hz, random(seed, number as u64));
        let scheduled = job.graph.target(&fault.process).map(schedule).transpose();
        let scheduled = scheduled.map_err(Failure::input)?;
        let place = scheduled.and_then(|fault| page.fault_table().request(&fault));
        place.ok_or_else(|| Failure::Work(format!("the run does not take this fault: {fault}")))?;
    }
    Ok(())
}

/// All messages of a topic that a run kept; a full volume ends them early, and they are whole up to there.
fn messages_of<M: Message>(job: &Job) -> Vec<M> {
    RecordReader::open(&job.out.join(recorder::MESSAGES), &Contents::of(job))
        .map(|record| record.messages().collect())
        .unwrap_or_default()
}

/// Leftovers of a run: files in shared memory or among the temporary ones, children, living or not.
fn left_over(run: &str) -> Vec<String> {
    let mut left = Vec::new();
    for folder in [runtime::SHM.into(), std::env::temp_dir()] {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let own = entries.filter(|entry| entry.file_name().to_string_lossy().contains(run));
        left.extend(own.map(|entry| entry.path().display().to_string()));
    }
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    let ours = pids.filter(|pid| crate::signals::parent(*pid) == Some(std::process::id()));
    left.extend(ours.map(|pid| format!("process {pid}")));
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_child_that_nobody_waited_for_is_left_over() {
        let mut child = std::process::Command::new("true").spawn().unwrap();
        let name = format!("process {}", child.id());
        assert!(left_over("no-such-run").contains(&name));
        child.wait().unwrap();
        assert!(!left_over("no-such-run").contains(&name));
    }
}
