//! The place of a program in the run that started it: for programs that a graph names as the command of a process.

use std::path::Path;

use shared_types::job::{JOB, Job};

use crate::shell::{OpenError, ProcessError, Shell};

/// The environment variable with the directory of the run.
pub const RUN_VARIABLE: &str = "ARMPLANE_RUN";

/// The environment variable with the name of the process.
pub const PROCESS_VARIABLE: &str = "ARMPLANE_PROCESS";

impl Shell {
    /// Joins the run that started this program, under the name that the graph gives it.
    ///
    /// # Errors
    /// [`OpenError::NotStarted`] where no graph started this program; else as [`Shell::open`].
    pub fn from_environment() -> Result<Self, OpenError> {
        let variable = |name: &'static str| std::env::var(name).map_err(|_| OpenError::NotStarted { variable: name });
        Self::open(Path::new(&variable(RUN_VARIABLE)?), &variable(PROCESS_VARIABLE)?)
    }

    /// The job of the run: its scenario, robot and graph.
    ///
    /// # Errors
    /// When its file cannot be read, or another version of armplane wrote it.
    pub fn job(&self) -> Result<Job, ProcessError> {
        let path = self.run_dir().join(JOB);
        let text = std::fs::read(&path).map_err(|error| ProcessError::setup(format!("cannot read {}: {error}", path.display())))?;
        serde_json::from_slice(&text).map_err(|error| ProcessError::setup(format!("{}: {error}", path.display())))
    }
}
