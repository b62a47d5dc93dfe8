//! Finds the Python that has the package `armplane`.

use std::ffi::OsString;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::{Duration, Instant};

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

/// The interpreter in which this program is a module.
static HOST: OnceLock<String> = OnceLock::new();

/// Where a module of the package is run.
pub struct Python {
    /// The interpreter: the one in which this program is a module, else the one in this program's
    /// folder, if both were installed together, otherwise the one in PATH.
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

    /// States the interpreter in which this program is a module: its path does not say which environment it runs in.
    pub fn is_host(interpreter: String) {
        // Said once: a process has one.
        let _ = HOST.set(interpreter);
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
        let program = match HOST.get() {
            Some(host) => host.clone(),
            None if beside.is_file() => beside.display().to_string(),
            None => "python3".to_owned(),
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

    /// Lets a program load its packages, answer on standard output and exit, within `limit`. If it refuses, its last line is the reason.
    /// `packages` are those to install with Python.
    ///
    /// # Errors
    /// The reason, with the remedy where Python or the package is missing.
    pub(crate) fn ask(
        mut command: Command,
        question: &Value,
        packages: &str,
        limit: Duration,
    ) -> Result<Vec<u8>, String> {
        let missing = |error: String| format!("{MISSING} {packages} ({error})");
        let failed = |error: std::io::Error| missing(format!("python3: {error}"));
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.stderr(Stdio::piped()).spawn().map_err(failed)?;
        // Threads of their own: a full pipe holds up neither side, and what a descendant holds open nobody waits for.
        if let Some(mut stdin) = child.stdin.take() {
            let question = question.to_string();
            // A program that ends before it has read everything says why.
            thread::spawn(move || stdin.write_all(question.as_bytes()));
        }
        let answer = child.stdout.take().map(beginning);
        let said = child.stderr.take().map(last_words);
        let status = ended(&mut child, limit).map_err(failed)?;
        let Some(status) = status else {
            let seconds = limit.as_secs();
            return Err(format!(
                "it does not load within {seconds} s: --join-limit allows more"
            ));
        };
        let said = said.and_then(|said| said.recv_timeout(PATIENCE).ok());
        let errors = String::from_utf8_lossy(said.as_deref().unwrap_or_default()).into_owned();
        let last = errors.lines().rfind(|line| !line.trim().is_empty());
        match last.unwrap_or("the program ended without a word") {
            _ if status.success() => {
                let answer = answer.and_then(|answer| answer.recv_timeout(PATIENCE).ok());
                Ok(answer.unwrap_or_default())
            }
            line if status.code() == Some(NOT_FOUND) => Err(missing(line.to_owned())),
            line if line.contains("No module named 'armplane'") => Err(LACK.to_owned()),
            line => Err(line.to_owned()),
        }
    }
}

/// How long the last words of a program that has ended may take.
const PATIENCE: Duration = Duration::from_secs(1);
/// Bytes of them that are kept.
const KEPT: usize = 64 << 10;

/// The longest answer; bytes.
const ANSWER: u64 = 64 << 20;

/// The beginning of all that a program writes, as soon as it is closed.
fn beginning(mut from: impl Read + Send + 'static) -> Receiver<Vec<u8>> {
    let (send, receive) = mpsc::channel();
    thread::spawn(move || {
        let mut kept = Vec::new();
        let read = from.by_ref().take(ANSWER).read_to_end(&mut kept);
        // An answer that nobody reads would stop the program.
        let left = std::io::copy(&mut from, &mut std::io::sink());
        send.send(if read.and(left).is_ok() {
            kept
        } else {
            Vec::new()
        })
    });
    receive
}

/// The end of all that a program writes, as soon as it is closed.
fn last_words(mut from: impl Read + Send + 'static) -> Receiver<Vec<u8>> {
    let (send, receive) = mpsc::channel();
    thread::spawn(move || {
        let (mut kept, mut part) = (Vec::new(), [0; 4096]);
        while let Ok(count @ 1..) = from.read(&mut part) {
            kept.extend_from_slice(&part[..count]);
            if kept.len() > 2 * KEPT {
                kept.drain(..kept.len() - KEPT);
            }
        }
        send.send(kept)
    });
    receive
}

/// Waits for a program's end; `None` where it has taken too long, and was killed.
fn ended(child: &mut Child, limit: Duration) -> std::io::Result<Option<ExitStatus>> {
    let until = Instant::now() + limit;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if Instant::now() > until {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        thread::sleep(Duration::from_millis(10));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(script: &str, limit_ms: u64) -> Result<Vec<u8>, String> {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        let question = Value::from("x".repeat(1 << 20));
        Python::ask(command, &question, "p", Duration::from_millis(limit_ms))
    }

    #[test]
    fn a_program_that_floods_or_hangs_is_neither_waited_for_nor_kept() {
        assert_eq!(
            asked("cat > /dev/null; echo yes", 60_000),
            Ok(b"yes\n".to_vec())
        );
        let flood = "head -c 8000000 /dev/zero | tr '\\0' x >&2; echo >&2; echo last >&2; exit 1";
        assert_eq!(asked(flood, 60_000), Err("last".to_owned()));
        assert!(asked("exec sleep 60", 200).is_err());
        assert!(asked("sleep 3 >&2 & exit 1", 60_000).is_err());
    }
}
