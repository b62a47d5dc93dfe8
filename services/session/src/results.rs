//! The folder of a run: made before anything starts, filled when the run is over.

use std::path::{Path, PathBuf};

use shared_types::job::Job;
use shared_types::scenario::Scenario;
use shared_types::summary::Summary;

use crate::failure::Failure;

/// Name of the job, in a run's directory in shared memory and in its results folder.
pub const JOB: &str = "job.json";
/// Name of the summary in the results folder.
pub const SUMMARY: &str = "summary.json";
const SCENARIO: &str = "scenario.toml";
const ROBOT_URDF: &str = "robot.urdf";
const ROBOT_TOML: &str = "robot.toml";
/// In the results folder while the run goes on; gone at its end.
const RESERVE: &str = ".armplane";
/// More than a summary takes, faults included; bytes.
const SUMMARY_BYTES: usize = 128 * 1024;

/// The results folder: made before anything starts, removed again if nothing came of it.
pub struct Results {
    /// Absolute.
    pub folder: PathBuf,
    made: bool,
}

impl Results {
    /// The folder asked for, or the next free `runs/NAME-NNN`.
    ///
    /// # Errors
    /// [`Failure::Input`] if it cannot be written to.
    pub fn create(wanted: Option<&Path>, name: &str) -> Result<Self, Failure> {
        let cannot = |path: &Path, error: std::io::Error| {
            Failure::Input(format!("cannot write results to {}: {error}; choose another folder with --out", path.display()))
        };
        let folder = match wanted {
            Some(folder) => folder.to_owned(),
            None => (1..).map(|n| PathBuf::from(format!("runs/{name}-{n:03}"))).find(|path| !path.exists()).unwrap_or_default(),
        };
        let made = !folder.exists();
        std::fs::create_dir_all(&folder).map_err(|error| cannot(&folder, error))?;
        let folder = folder.canonicalize().map_err(|error| cannot(&folder, error))?;
        let results = Self { folder, made };
        let probe = results.folder.join(RESERVE);
        std::fs::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe)).map_err(|error| cannot(&results.folder, error))?;
        Ok(results)
    }

    /// Writes a JSON file into the folder.
    ///
    /// # Errors
    /// [`Failure::Work`] where it cannot be written.
    pub fn save(&self, name: &str, value: &serde_json::Value) -> Result<(), Failure> {
        let path = self.folder.join(name);
        let text = serde_json::to_vec_pretty(value).map_err(Failure::work)?;
        std::fs::write(&path, text).map_err(|error| Failure::Work(format!("cannot write {}: {error}", path.display())))
    }

    /// Takes the room that the run's account will need: a recording that fills the disk shall not be the end of the summary too.
    pub(crate) fn reserve(&self, job: &Job) -> Result<(), Failure> {
        let size = 2 * serde_json::to_vec_pretty(job).map_err(Failure::work)?.len() + SUMMARY_BYTES;
        let path = self.folder.join(RESERVE);
        std::fs::write(&path, vec![0; size]).map_err(|error| {
            let _ = std::fs::remove_file(&path);
            Failure::Input(format!("cannot write results to {}: {error}; choose another folder with --out", self.folder.display()))
        })
    }

    /// Removes the recording that an earlier run left in the folder.
    pub(crate) fn remove_old_recording(&self) -> Result<(), Failure> {
        viz::parts_in(&self.folder).iter().try_for_each(|old| {
            std::fs::remove_file(old).map_err(|error| Failure::Input(format!("cannot replace {}: {error}", old.display())))
        })
    }

    fn release(&self) {
        let _ = std::fs::remove_file(self.folder.join(RESERVE));
    }

    /// Writes what makes the run repeatable and readable: the summary, the job, and the scenario with every fault planned that came to pass.
    pub(crate) fn keep(&self, job: &Job, summary: &Summary) -> Result<(), Failure> {
        self.release();
        keep(&self.folder, job, summary)
    }
}

/// Writes into a run's folder what makes it repeatable and readable.
///
/// # Errors
/// [`Failure::Work`] where a file cannot be written.
pub fn keep(folder: &Path, job: &Job, summary: &Summary) -> Result<(), Failure> {
    let cannot = |name: &str, error: std::io::Error| Failure::Work(format!("cannot write {}: {error}", folder.join(name).display()));
    let repeated = repeated(job, summary)?;
    let summary = serde_json::to_vec_pretty(summary).map_err(Failure::work)?;
    let job_text = serde_json::to_vec_pretty(job).map_err(Failure::work)?;
    for (name, text) in [(SUMMARY, summary), (JOB, job_text)].into_iter().chain(repeated) {
        // Whole or not at all: a full disk leaves no half file.
        let (draft, path) = (folder.join(format!(".{name}")), folder.join(name));
        let written = std::fs::write(&draft, text).and_then(|()| std::fs::rename(&draft, &path));
        written.map_err(|error| {
            let _ = std::fs::remove_file(&draft);
            cannot(name, error)
        })?;
    }
    Ok(())
}

impl Drop for Results {
    fn drop(&mut self) {
        self.release();
        if self.made {
            // Fails, as it should, where there is something in it.
            let _ = std::fs::remove_dir(&self.folder);
        }
    }
}

/// The files of the scenario that gives the same bytes again, and the robot beside it where it is not a built-in one.
fn repeated(job: &Job, summary: &Summary) -> Result<Vec<(&'static str, Vec<u8>)>, Failure> {
    let fault = summary.faults.iter().filter_map(|fault| fault.fault.clone()).collect();
    let mut files = Vec::new();
    let mut scenario = Scenario { fault, ..job.scenario.clone() };
    if scenario.robot.ends_with(".urdf") {
        ROBOT_URDF.clone_into(&mut scenario.robot);
        files.push((ROBOT_URDF, job.robot.urdf.clone().into_bytes()));
        if !job.robot.description.is_empty() {
            files.push((ROBOT_TOML, job.robot.description.clone().into_bytes()));
        }
    }
    files.push((SCENARIO, toml::to_string(&scenario).map_err(Failure::work)?.into_bytes()));
    Ok(files)
}
