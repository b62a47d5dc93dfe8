//! Finds the Python that has the package `armplane`.

use std::ffi::OsString;
use std::io::{ErrorKind, Write};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::failure::Failure;

/// The exit code of `env` for a program that is not there.
const NOT_FOUND: i32 = 127;

/// Remedy where there is no interpreter; the extra packages to install follow.
const MISSING: &str = "there is no Python: install Python 3.9 or newer, then pip install";
/// ... and where there is one without the package.
const LACK: &str = "Python lacks the package armplane: pip install the wheel that `python/build` makes (docs/python.md)";

/// Runs a module of the package as the command `armplane NAME`.
const COMMAND: &str = "import importlib.util, runpy, sys
name, lack = sys.argv[1:3]
sys.argv[1:3] = []
try:
    found = importlib.util.find_spec('armplane.' + name)
except ModuleNotFoundError:
    found = None
if found is None:
    print(f'armplane: {lack} with its extra [{name}]', file=sys.stderr)
    sys.exit(2)
runpy.run_module('armplane.' + name, run_name='__main__', alter_sys=True)";

/// Where a module of the package is run.
pub struct Python {
    /// The interpreter: the one in this program's folder, if both were installed together,
    /// otherwise the one in PATH.
    program: String,
    /// PYTHONPATH, where the package lies in the source tree of this program.
    path: Option<OsString>,
}

impl Python {
    /// Becomes a command of the package, which finds this program by the variable ARMPLANE; returns the reason where that cannot be.
    pub fn exec(name: &str, arguments: impl IntoIterator<Item = String>) -> Failure {
        let Self { program, path } = Self::find();
        let mut python = Command::new(program);
        python.args(["-c", COMMAND, name, LACK]).args(arguments);
        python.envs(path.map(|path| ("PYTHONPATH", path)));
        python.envs(std::env::current_exe().map(|own| ("ARMPLANE", own)));
        let error = python.exec();
        match error.kind() {
            ErrorKind::NotFound => Failure::Input(format!("{MISSING} 'armplane[{name}]'")),
            _ => Failure::work(format!("cannot start Python: {error}")),
        }
    }

    /// Looks for it beside this program and in the folders above.
    fn find() -> Self {
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
        let missing = |error: String| format!("{MISSING} {packages} ({error})");
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
            line if line.contains("No module named 'armplane'") => Err(LACK.to_owned()),
            line => Err(line.to_owned()),
        }
    }
}
