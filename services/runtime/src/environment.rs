//! The run that started this program, for programs that a graph names as the command of a process.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use process::Step;
use shared_types::job::{JOB, Job};

use crate::control_page::State;
use crate::drive::drive;
use crate::shell::{Inhabitant, ProcessError, Shell};

/// The environment variable with the directory of the run.
pub const RUN_VARIABLE: &str = "ARMPLANE_RUN";

/// The environment variable with the name of the process.
pub const PROCESS_VARIABLE: &str = "ARMPLANE_PROCESS";

/// The `main` of a program that a graph names as the command of a process: makes its step from the job, and takes part until the run stops.
pub fn join<S: Step, E: std::fmt::Display>(make: impl FnOnce(&Job) -> Result<S, E>) -> ExitCode {
    let take_part = || {
        let shell = Shell::started(None, None)?;
        let mut step = make(&shell.job()?).map_err(ProcessError::setup)?;
        drive(&shell, &mut step, &mut ())
    };
    match take_part() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn variable(name: &'static str) -> Result<OsString, ProcessError> {
    std::env::var_os(name).ok_or(ProcessError::NotStarted { variable: name })
}

impl Shell {
    /// Joins the run that started this program, under the name that the graph gives it; with a run that is used instead of the environment's, and a name
    /// for a program that no graph started.
    ///
    /// # Errors
    /// [`ProcessError::NotStarted`] if no graph started this program; else as [`Shell::open`].
    pub fn started(run: Option<&Path>, process: Option<&str>) -> Result<Self, ProcessError> {
        let run = run.map_or_else(
            || variable(RUN_VARIABLE).map(PathBuf::from),
            |run| Ok(run.to_owned()),
        )?;
        let name = variable(PROCESS_VARIABLE).map(|name| name.to_string_lossy().into_owned());
        let name = name.or_else(|missing| process.map(str::to_owned).ok_or(missing))?;
        Self::open(&run, &name)
    }

    /// As [`Shell::started`], for a program that uses this crate as a library; with a run, a name, or both, that are used instead of the
    /// environment's.
    pub(crate) fn of_others(
        run: Option<&Path>,
        process: Option<&str>,
    ) -> Result<Self, ProcessError> {
        let (run_dir, whose) = match run {
            Some(run) => (run.to_owned(), Inhabitant::Visitor),
            None => (variable(RUN_VARIABLE)?.into(), Inhabitant::Guest),
        };
        let name = match process {
            Some(process) => process.to_owned(),
            None => variable(PROCESS_VARIABLE)?.to_string_lossy().into_owned(),
        };
        let shell = Self::open_as(&run_dir, &name, whose)?;
        // The launcher has begun its incarnation, and nobody has taken part as it.
        if !matches!(
            shell.shared.entry().state(),
            State::Absent | State::Starting
        ) {
            return Err(ProcessError::Again { process: name });
        }
        shell.greet().map_err(ProcessError::Occupancy)?;
        Ok(shell)
    }

    /// The job of the run: its scenario, robot and graph.
    ///
    /// # Errors
    /// When its file cannot be read, or another version of armplane wrote it.
    pub fn job(&self) -> Result<Job, ProcessError> {
        let path = self.run_dir().join(JOB);
        let text = std::fs::read(&path).map_err(|error| {
            ProcessError::setup(format!("cannot read {}: {error}", path.display()))
        })?;
        serde_json::from_slice(&text)
            .map_err(|error| ProcessError::setup(format!("{}: {error}", path.display())))
    }
}
