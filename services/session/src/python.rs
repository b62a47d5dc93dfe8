//! Finds the Python that has the package `armplane`.

use std::ffi::OsString;
use std::io::Write;
use std::process::{Command, Stdio};

use serde_json::Value;

/// The exit code of `env` for a program that is not there.
const NOT_FOUND: i32 = 127;

/// Where a module of the package is run.
#[derive(Debug)]
pub struct Python {
    /// The interpreter: the one in this program's folder, if both were installed together,
    /// otherwise the one in PATH.
    pub program: String,
    /// PYTHONPATH, where the package lies in the source tree of this program.
    pub path: Option<OsString>,
}

impl Python {
    /// What to install where there is no interpreter; the extra packages follow.
    pub const MISSING: &str = "there is no Python: install Python 3.9 or newer, then pip install";

    /// Looks for it beside this program and in the folders above.
    #[must_use]
    pub fn find() -> Self {
        let program = std::env::current_exe().unwrap_or_default();
        let beside = program.with_file_name("python3");
        let mut packages = program.ancestors().map(|folder| folder.join("python"));
        let package = packages.find(|folder| folder.join("armplane/mujoco.py").is_file());
        let path = package.map(|package| {
            let others = std::env::var_os("PYTHONPATH").unwrap_or_default();
            let others =
                std::env::split_paths(&others).filter(|folder| !folder.as_os_str().is_empty());
            let all = std::iter::once(package).chain(others);
            std::env::join_paths(all).unwrap_or_default()
        });
        let program = match beside.is_file() {
            true => beside.display().to_string(),
            false => "python3".to_owned(),
        };
        Self { program, path }
    }
    /// The command that runs a module.
    #[must_use]
    pub fn command(module: &str, arguments: impl IntoIterator<Item = String>) -> Vec<String> {
        let Self { program, path } = Self::find();
        let path = path.map(|path| ["env".to_owned(), format!("PYTHONPATH={}", path.display())]);
        path.into_iter()
            .flatten()
            .chain([program, "-m".to_owned(), module.to_owned()])
            .chain(arguments)
            .collect()
    }

    /// Lets a program load its packages and exit. If it refuses, its last line is the reason.
    /// `packages` are those to install with Python.
    ///
    /// # Errors
    /// The reason, with the remedy where Python or the package is missing.
    pub(crate) fn ask(
        mut command: Command,
        question: &Value,
        packages: &str,
    ) -> Result<(), String> {
        let missing = |error: String| format!("{} {packages} ({error})", Self::MISSING);
        let failed = |error: std::io::Error| missing(format!("python3: {error}"));
        command.stdin(Stdio::piped()).stdout(Stdio::null());
        let mut child = command.stderr(Stdio::piped()).spawn().map_err(failed)?;
        if let Some(mut stdin) = child.stdin.take() {
            // A program that ends before it has read everything says why.
            let _ = stdin.write_all(question.to_string().as_bytes());
        }
        let said = child.wait_with_output().map_err(failed)?;
        let errors = String::from_utf8_lossy(&said.stderr);
        let last = errors.lines().rfind(|line| !line.trim().is_empty());
        match last.unwrap_or("the program ended without a word") {
            _ if said.status.success() => Ok(()),
            line if said.status.code() == Some(NOT_FOUND) => Err(missing(line.to_owned())),
            line if line.contains("No module named 'armplane'") => Err(
                "Python lacks the package armplane: pip install the wheel that `python/build` makes (docs/python.md)"
                    .to_owned(),
            ),
            line => Err(line.to_owned()),
        }
    }
}
