//! Finding a finished run: by its folder, by one of its files, or the latest one.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use recorder::{MESSAGES, Ticks};
use shared_types::job::{JOB, Job};
use shared_types::summary::Summary;
use viz::RECORDING;

use crate::failure::Failure;
use crate::observation::Living;
use crate::progress::{Observer, say};
use crate::results::{RUNS, SCENARIO, SUMMARY};

/// The remedy where a run has not written its results yet.
const ALIVE: &str = "the run is still alive: wait until it has ended";

/// A run's folder and its files.
pub struct Run {
    /// The results folder.
    pub folder: PathBuf,
}

impl Run {
    /// The run that is meant: a folder, a file in it, the name of a folder under `runs`, or the latest of those.
    ///
    /// # Errors
    /// [`Failure::Input`] if there is no such run.
    pub fn find(wanted: Option<&Path>) -> Result<Self, Failure> {
        let folder = match wanted {
            None => latest()?,
            Some(path) if path.is_dir() => path.to_owned(),
            Some(path) if path.is_file() => files::folder_of(path).to_owned(),
            Some(path) if Path::new(RUNS).join(path).is_dir() => Path::new(RUNS).join(path),
            Some(path) => {
                return Err(Failure::Input(format!(
                    "there is no run {}: give the folder that `armplane run` printed, such as {RUNS}/fig5-wrist-rotation-001",
                    path.display()
                )));
            }
        };
        let run = Self { folder };
        if ![SUMMARY, JOB, MESSAGES, RECORDING]
            .iter()
            .any(|name| run.has(name))
        {
            return Err(Failure::Input(format!(
                "{} is not a run: its folder has neither {SUMMARY} nor {MESSAGES}",
                wanted.unwrap_or(&run.folder).display()
            )));
        }
        Ok(run)
    }

    /// The refusal of something that is asked for with it.
    pub(crate) fn refuse(&self, why: impl Display) -> Failure {
        Failure::Input(format!("{}: {why}", self.folder.display()))
    }

    /// Whether a tick of the record can be read.
    ///
    /// # Errors
    /// [`Failure::Input`] if there is none.
    pub(crate) fn check_readable(&self, job: &Job) -> Result<(), Failure> {
        let opened = Ticks::open(&self.folder.join(MESSAGES), job);
        let mut rows = opened.map_err(|error| Failure::Input(self.with_remedy(&error)))?;
        if rows.next().is_some() {
            return Ok(());
        }
        let damage = rows.damage(self.summary().ok().as_ref());
        let lack = damage
            .first()
            .map_or("its record has no tick", String::as_str);
        Err(Failure::Input(self.with_remedy(&lack)))
    }

    /// A sentence on what the record lacks, and how to get it.
    pub fn with_remedy(&self, lack: &impl Display) -> String {
        let folder = self.folder.display();
        let remedy = if self.is_alive() {
            ALIVE.to_owned()
        } else if self.folder.join(SCENARIO).exists() {
            self.again()
        } else {
            format!("if the run has ended, `armplane recover {folder}` makes its results")
        };
        format!("{folder}: {lack}; {remedy}")
    }

    /// Says to which tick a record was read that has no summary beside it: the run goes on, or its launcher was killed.
    pub fn say_end(&self, last: u64, observer: Observer<'_>) {
        let state = match self.is_alive() {
            true => "still runs".to_owned(),
            false => format!("has no {SUMMARY}"),
        };
        let folder = self.folder.display();
        say(
            observer,
            format_args!("{folder} {state}: its record was read to tick {last}"),
        );
    }

    /// The way to the same run with all its results.
    fn again(&self) -> String {
        match self.folder.join(SCENARIO).exists() {
            true => format!(
                "`armplane run {}/{SCENARIO}` makes the run again",
                self.folder.display()
            ),
            false => "run its scenario again".to_owned(),
        }
    }

    /// The run's summary.
    ///
    /// # Errors
    /// [`Failure::Input`] if it cannot be read.
    pub fn summary(&self) -> Result<Summary, Failure> {
        self.json(SUMMARY).map_err(|defect| {
            if self.is_alive() {
                return Failure::Input(format!("{defect}; {ALIVE}"));
            }
            let path = self.folder.join(SUMMARY);
            let first = if self.has(SUMMARY) && !path.is_file() {
                format!("remove {}, and ", path.display())
            } else {
                String::new()
            };
            let remedy = format!(
                "if the run has ended, {first}`armplane recover {}` makes its results",
                self.folder.display()
            );
            Failure::Input(format!("{defect}; {remedy}"))
        })
    }

    /// The run's summary, if there is one: the launcher may have been killed before.
    ///
    /// # Errors
    /// A clause, where it is there and cannot be read.
    pub fn summary_if_any(&self) -> Result<Option<Summary>, String> {
        if self.has(SUMMARY) {
            self.json(SUMMARY).map(Some)
        } else {
            Ok(None)
        }
    }

    /// The run's job.
    ///
    /// # Errors
    /// [`Failure::Input`] if it cannot be read or is invalid.
    pub fn job(&self) -> Result<Job, Failure> {
        let folder = self.folder.display();
        if ![JOB, SUMMARY, MESSAGES].iter().any(|name| self.has(name)) {
            let remedy = format!(
                "give the folder that `armplane run` printed, such as {RUNS}/fig5-wrist-rotation-001"
            );
            return Err(Failure::Input(format!(
                "{folder} is not the folder of a run (it has no {JOB}): {remedy}"
            )));
        }
        self.read_job()
            .map_err(|defect| Failure::Input(format!("{defect}; {}", self.again())))
    }

    /// As [`job`](Self::job), where it cannot be read with a clause.
    pub(crate) fn read_job(&self) -> Result<Job, String> {
        let job: Job = self.json(JOB)?;
        job.check()
            .map_err(|complaint| format!("{}: {complaint}", self.folder.join(JOB).display()))?;
        Ok(job)
    }

    /// A clause for each way in which the record is damaged or does not match the summary's counts; and whether messages may be lost amid it.
    pub fn message_damage(&self, job: &Job, summary: Option<&Summary>) -> (Vec<String>, bool) {
        match Ticks::open(&self.folder.join(MESSAGES), job) {
            _ if !job.record => (Vec::new(), false),
            Ok(mut ticks) => {
                ticks.by_ref().for_each(drop);
                let may_lack = !ticks.damage_so_far().is_empty();
                (ticks.damage(summary), may_lack)
            }
            Err(error) => (vec![error.to_string()], true),
        }
    }

    /// Whether it still goes on.
    pub(crate) fn is_alive(&self) -> bool {
        let folder = self.folder.canonicalize().ok();
        Living::all()
            .into_iter()
            .any(|run| Some(run.folder) == folder)
    }

    fn has(&self, name: &str) -> bool {
        std::fs::symlink_metadata(self.folder.join(name)).is_ok()
    }

    fn json<T: serde::de::DeserializeOwned>(&self, name: &str) -> Result<T, String> {
        let path = self.folder.join(name);
        if !self.has(name) {
            return Err(format!("{} has no {name}", self.folder.display()));
        }
        let text = files::read(&path)
            .map_err(|error| format!("cannot read {}: {error}", path.display()))?;
        serde_json::from_slice(&text).map_err(|error| {
            format!(
                "{} is not what `armplane run` wrote: {error}",
                path.display()
            )
        })
    }
}

/// The run under `runs` whose record or summary was written last.
fn latest() -> Result<PathBuf, Failure> {
    let changed = |folder: &Path| {
        [MESSAGES, SUMMARY, RECORDING]
            .iter()
            .filter_map(|name| {
                std::fs::metadata(folder.join(name))
                    .and_then(|file| file.modified())
                    .ok()
            })
            .max()
    };
    let folders = std::fs::read_dir(RUNS)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path());
    let latest = folders
        .filter_map(|folder| Some((changed(&folder)?, folder)))
        .max();
    latest.map(|(_, folder)| folder).ok_or_else(|| {
        Failure::Input(format!(
            "there is no run under {RUNS}/: start one with `armplane run`, or give its folder"
        ))
    })
}
