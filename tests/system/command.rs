//! Running `armplane` in a folder of its own, and looking at what it leaves.

use std::fmt::Display;
use std::io::Write;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

use crate::life::signal;
use crate::patience::ticks;

/// An empty folder to run in; gone at the end.
pub(crate) struct Desk {
    folder: TempDir,
}

/// The output of a finished command.
pub(crate) struct Said {
    pub(crate) code: i32,
    pub(crate) out: String,
    pub(crate) err: String,
    pub(crate) launcher: u32,
}

impl Desk {
    pub(crate) fn new() -> Self {
        Self {
            folder: tempfile::tempdir().expect("a temporary folder"),
        }
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path().join(name);
        std::fs::write(&path, text).expect("a file in the temporary folder");
        path
    }

    /// The text of a file in the folder.
    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path().join(name))
            .unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// The JSON of a file in the folder.
    pub(crate) fn read_json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// `armplane` in this folder, with its output in pipes.
    pub(crate) fn command(&self, args: impl Args) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_armplane"));
        command
            .args(args.words())
            .current_dir(self.path())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        // A shell without job control starts the tests with SIGINT and SIGQUIT ignored, `nohup` with SIGHUP: until the program catches them, or for good,
        // they would do nothing.
        // SAFETY: signal(2) may be called between fork and exec.
        unsafe {
            command.pre_exec(|| {
                for signal in [libc::SIGINT, libc::SIGQUIT, libc::SIGHUP] {
                    libc::signal(signal, libc::SIG_DFL);
                }
                Ok(())
            });
        }
        command
    }

    pub(crate) fn start(&self, args: impl Args) -> Child {
        self.command(args).spawn().expect("armplane starts")
    }

    /// Starts a run and waits for its first tick.
    pub(crate) fn begin(&self, args: impl Args) -> Child {
        let run = self.start(args);
        until("the first tick", || ticks(&run) > 0);
        run
    }

    pub(crate) fn armplane(&self, args: impl Args) -> Said {
        finish(self.start(args))
    }

    /// A command that succeeds.
    pub(crate) fn succeeds(&self, args: impl Args) -> Said {
        let words = args.words();
        let said = self.armplane(&words);
        assert_eq!(said.code, 0, "{words:?}: {}{}", said.out, said.err);
        said
    }

    /// The JSON of a command that succeeds.
    pub(crate) fn json(&self, args: impl Args) -> Value {
        let words = [args.words(), vec!["--json".to_owned()]].concat();
        let said = self.succeeds(&words);
        assert_nothing_left(said.launcher);
        said.json()
    }

    /// Runs a scenario to a success and reads its summary.
    pub(crate) fn run(&self, args: impl Args) -> Value {
        self.json(&[vec!["run".to_owned()], args.words()].concat())
    }

    /// A command that ends with this exit code, in one sentence that holds each of these names and numbers.
    pub(crate) fn refuses(&self, code: i32, args: impl Args, names: &[&str]) -> Said {
        let words = args.words();
        let said = self.armplane(&words);
        assert_nothing_left(said.launcher);
        assert!(
            said.code == code && names.iter().all(|name| said.err.contains(name)),
            "{words:?}: {} without one of {names:?}: {}{}",
            said.code,
            said.out,
            said.err
        );
        said
    }
}

impl Said {
    /// What it printed for machines.
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.out)
            .unwrap_or_else(|error| panic!("{error}: {}\n{}", self.out, self.err))
    }
}

/// The arguments of a command: words between spaces, or a list where one of them holds a space.
pub(crate) trait Args {
    fn words(&self) -> Vec<String>;
}

impl Args for &str {
    fn words(&self) -> Vec<String> {
        self.split_whitespace().map(str::to_owned).collect()
    }
}

impl Args for &String {
    fn words(&self) -> Vec<String> {
        self.as_str().words()
    }
}

impl<T: AsRef<str>> Args for &[T] {
    fn words(&self) -> Vec<String> {
        self.iter().map(|word| word.as_ref().to_owned()).collect()
    }
}

impl<T: AsRef<str>, const N: usize> Args for &[T; N] {
    fn words(&self) -> Vec<String> {
        self.as_slice().words()
    }
}

impl<T: AsRef<str>> Args for &Vec<T> {
    fn words(&self) -> Vec<String> {
        self.as_slice().words()
    }
}

/// A part of the program's JSON whose kind is known.
pub(crate) trait Known {
    fn list(&self) -> &[Value];
    fn count(&self) -> u64;
    fn number(&self) -> f64;
    fn text(&self) -> &str;
}

impl Known for Value {
    fn list(&self) -> &[Value] {
        self.as_array().unwrap_or_else(|| panic!("{self}"))
    }

    fn count(&self) -> u64 {
        self.as_u64().unwrap_or_else(|| panic!("{self}"))
    }

    fn number(&self) -> f64 {
        self.as_f64().unwrap_or_else(|| panic!("{self}"))
    }

    fn text(&self) -> &str {
        self.as_str().unwrap_or_else(|| panic!("{self}"))
    }
}

/// Waits for a command to end.
pub(crate) fn finish(child: Child) -> Said {
    let launcher = child.id();
    let Output {
        status,
        stdout,
        stderr,
    } = child.wait_with_output().expect("armplane ends");
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    Said {
        code: status.code().unwrap_or(-1),
        out: text(stdout),
        err: text(stderr),
        launcher,
    }
}

/// Ends a run by Ctrl-C; nothing is left of it.
pub(crate) fn interrupt(run: Child) -> Said {
    signal(run.id() as i32, "INT");
    let said = finish(run);
    assert_nothing_left(said.launcher);
    said
}

/// The names of what a launcher has in shared memory.
pub(crate) fn in_shared_memory(launcher: u32) -> Vec<String> {
    let marker = format!("-{launcher}-");
    let names = std::fs::read_dir("/dev/shm")
        .expect("shared memory")
        .flatten()
        .filter_map(|entry| entry.file_name().into_string().ok());
    names
        .filter(|name| name.starts_with("armplane-") && name.contains(&marker))
        .collect()
}

/// The name of the run that a launcher has made, which is its directory in shared memory.
pub(crate) fn run_of(launcher: u32) -> Option<String> {
    in_shared_memory(launcher)
        .into_iter()
        .find(|name| !name.contains('.'))
}

/// No file of the run in shared memory, no child of the launcher alive.
pub(crate) fn assert_nothing_left(launcher: u32) {
    assert_eq!(
        in_shared_memory(launcher),
        Vec::<String>::new(),
        "left in shared memory"
    );
    let children = children_of_run(launcher);
    assert!(children.is_empty(), "processes left: {children:?}");
}

/// Processes started for a launcher's run, by the run directory in their arguments: name and process id.
pub(crate) fn children_of_run(launcher: u32) -> Vec<(String, i32)> {
    let marker = format!("-{launcher}-");
    let mut children = Vec::new();
    for entry in std::fs::read_dir("/proc").expect("proc").flatten() {
        let Some(pid) = entry
            .file_name()
            .to_str()
            .and_then(|name| name.parse::<i32>().ok())
        else {
            continue;
        };
        let Ok(text) = std::fs::read(entry.path().join("cmdline")) else {
            continue;
        };
        let words: Vec<String> = text
            .split(|byte| *byte == 0)
            .map(|word| String::from_utf8_lossy(word).into_owned())
            .collect();
        if words.len() > 3
            && words[2] == "--run"
            && words[3].contains("/armplane-")
            && words[3].contains(&marker)
        {
            children.push((words[1].clone(), pid));
        }
    }
    children
}

/// The process of a run by its name.
pub(crate) fn pid_of(launcher: u32, process: &str) -> Option<i32> {
    let children = children_of_run(launcher);
    let found = children.into_iter().find(|(name, _)| name == process);
    found.map(|(_, pid)| pid)
}

/// How often a process was replaced in a run.
pub(crate) fn restarts(summary: &Value, process: &str) -> u64 {
    let processes = summary["processes"].as_array().expect("processes");
    let found = processes.iter().find(|one| one["name"] == process);
    found
        .and_then(|one| one["restarts"].as_u64())
        .expect("a process of the run")
}

/// Waits until something is so.
pub(crate) fn until(what: &str, mut so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !so() {
        assert!(
            began.elapsed() < Duration::from_secs(60),
            "waited a minute for {what}"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Reports that a test, or a part of it, cannot run on this machine, and counts it: on standard error itself, because the test harness
/// discards what a passing test prints.
pub(crate) fn skipped(why: impl Display) {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed) + 1;
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    writeln!(
        std::io::stderr(),
        "\nskipped: {why} ({test}; {count} skipped so far)"
    )
    .expect("standard error takes a line");
}
