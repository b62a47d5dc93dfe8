//! Running `armplane` in a folder of its own, and looking at what it leaves.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fmt::Display;
use std::io::Write;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use runtime::{ControlPage, RunDir};
use serde_json::Value;
use tempfile::TempDir;

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

    /// The path of a file in the folder.
    pub(crate) fn at(&self, name: impl AsRef<Path>) -> PathBuf {
        self.path().join(name)
    }

    /// Writes a file, in a folder that is made where it is not there.
    pub(crate) fn file(&self, name: impl AsRef<Path>, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.at(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(&path, content).expect("a file in the temporary folder");
        path
    }

    /// Puts a file of `tests/golden` into the folder.
    pub(crate) fn golden(&self, name: &str) {
        self.file(name, source(&format!("tests/golden/{name}")));
    }

    pub(crate) fn bytes(&self, name: impl AsRef<Path>) -> Vec<u8> {
        let path = self.at(name);
        std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    /// The text of a file in the folder.
    pub(crate) fn read(&self, name: impl AsRef<Path>) -> String {
        String::from_utf8(self.bytes(name)).expect("UTF-8")
    }

    /// The JSON of a file in the folder.
    pub(crate) fn read_json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub(crate) fn has(&self, name: impl AsRef<Path>) -> bool {
        self.at(name).symlink_metadata().is_ok()
    }

    pub(crate) fn remove(&self, name: impl AsRef<Path>) {
        std::fs::remove_file(self.at(name)).expect("a file in the temporary folder");
    }

    /// The names in a folder of the folder, sorted.
    pub(crate) fn names(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.at(folder)).into_iter().flatten();
        let name = |entry: std::fs::DirEntry| entry.file_name().to_string_lossy().into_owned();
        let mut names: Vec<_> = entries.flatten().map(name).collect();
        names.sort();
        names
    }

    /// A program in this folder, with its output in pipes, and the Python package of the repository in the path of Python.
    pub(crate) fn program(&self, name: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(name);
        command
            .current_dir(self.path())
            .env("PYTHONPATH", root().join("python"))
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .env("ARMPLANE", env!("CARGO_BIN_EXE_armplane"))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// `armplane` in this folder.
    pub(crate) fn command(&self, args: &str) -> Command {
        let mut command = self.program(env!("CARGO_BIN_EXE_armplane"));
        command.args(words(args));
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

    /// Runs lines of the shell, where `armplane` is ours.
    pub(crate) fn shell(&self, lines: &str) -> Said {
        let program = Path::new(env!("CARGO_BIN_EXE_armplane"));
        let tests = std::env::current_exe().expect("this test");
        let [programs, libraries] = [program, &*tests].map(|path| path.parent().expect("a folder"));
        let others = std::env::var("PATH").unwrap_or_default();
        let mut bash = self.program("bash");
        bash.args(["-o", "pipefail", "-ec", lines.trim()]);
        bash.env("PATH", format!("{}:{others}", programs.display()));
        bash.env("PROFILE", programs.file_name().expect("a profile"));
        bash.env("LIBRARIES", libraries).env("ROOT", root());
        bash.spawn().expect("bash starts").finish()
    }

    pub(crate) fn start(&self, args: &str) -> Child {
        self.command(args).spawn().expect("armplane starts")
    }

    /// Starts a run and waits for its first ticks.
    pub(crate) fn begin(&self, args: &str) -> Child {
        let run = self.start(args);
        until("the first ticks", || run.ticks() > 100);
        run
    }

    pub(crate) fn armplane(&self, args: &str) -> Said {
        self.start(args).finish()
    }

    /// A command that succeeds.
    pub(crate) fn succeeds(&self, args: &str) -> Said {
        self.refuses(0, args, "")
    }

    /// The JSON of a command that succeeds.
    pub(crate) fn json(&self, args: &str) -> Value {
        self.succeeds(&format!("{args} --json")).json()
    }

    /// Runs a scenario to a success and reads its summary.
    pub(crate) fn run(&self, args: &str) -> Value {
        self.json(&format!("run {args}"))
    }

    /// A command that ends with this exit code, in one sentence that holds each of these names and numbers, which stand between spaces.
    pub(crate) fn refuses(&self, code: i32, args: &str, names: &str) -> Said {
        let said = self.armplane(args);
        assert!(
            said.code == code && names.split_whitespace().all(|name| said.err.contains(name)),
            "{args}: {} without one of {names}: {}{}",
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

/// The arguments of a command: words between spaces, or between two of `'`.
fn words(args: &str) -> impl Iterator<Item = &str> {
    let parts = args.split('\'').enumerate();
    parts.flat_map(|(place, part)| match place % 2 {
        0 => part.split_whitespace().collect::<Vec<_>>(),
        _ => vec![part],
    })
}

/// A part of the program's JSON whose kind is known.
pub(crate) trait Known {
    fn list(&self) -> &[Value];
    fn count(&self) -> u64;
    fn number(&self) -> f64;
    fn text(&self) -> &str;

    /// Asserts that it has each value of an expected JSON object; a key is a path, `faults/0/process`, and `faults/#` is the length of a list.
    fn holds(&self, expected: &str);
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

    fn holds(&self, expected: &str) {
        let expected: BTreeMap<String, Value> = serde_json::from_str(expected).expect("JSON");
        for (path, value) in expected {
            let of = |path: &str| self.pointer(&format!("/{path}")).unwrap_or(&Value::Null);
            let found = match path.strip_suffix("/#") {
                Some(list) => of(list).list().len().into(),
                None => of(&path).clone(),
            };
            assert_eq!(found, value, "{path}: {self}");
        }
    }
}

/// A command that goes on.
pub(crate) trait Running {
    /// Ticks that its run has begun.
    fn ticks(&self) -> u64;
    /// The process of its run by its name.
    fn pid(&self, process: &str) -> Option<i32>;
    fn signal(&self, name: &str);
    /// Sends a signal to a process of its run.
    fn strike(&self, process: &str, name: &str);
    /// Waits for its end. One that was not killed leaves nothing.
    fn finish(self) -> Said;
    /// Ends it by Ctrl-C.
    fn interrupt(self) -> Said;
}

impl Running for Child {
    fn ticks(&self) -> u64 {
        let Some(run) =
            run_of(self.id()).and_then(|name| RunDir::open(&Path::new("/dev/shm").join(name)).ok())
        else {
            return 0;
        };
        ControlPage::open(&run).map_or(0, |page| page.process(0).ticks())
    }

    fn pid(&self, process: &str) -> Option<i32> {
        let mut children = children_of_run(self.id()).into_iter();
        Some(children.find(|(name, _)| name == process)?.1)
    }

    fn signal(&self, name: &str) {
        signal(self.id().cast_signed(), name);
    }

    fn strike(&self, process: &str, name: &str) {
        signal(self.pid(process).expect("it lives"), name);
    }

    fn finish(self) -> Said {
        let launcher = self.id();
        let Output {
            status,
            stdout,
            stderr,
        } = self.wait_with_output().expect("armplane ends");
        if status.code().is_some() {
            assert_nothing_left(launcher);
        }
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        Said {
            code: status.code().unwrap_or(-1),
            out: text(stdout),
            err: text(stderr),
            launcher,
        }
    }

    fn interrupt(self) -> Said {
        self.signal("INT");
        self.finish()
    }
}

/// Sends a signal to a process that lives.
pub(crate) fn signal(pid: i32, name: &str) {
    assert!(is_sent(pid, name));
}

/// Sends a signal to a process, and says whether it still lived.
pub(crate) fn is_sent(pid: i32, name: &str) -> bool {
    let sent = Command::new("kill")
        .args([format!("-{name}"), pid.to_string()])
        .status();
    sent.expect("kill").success()
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

/// No file of the run in shared memory, no child of the launcher alive, and no program of its graph.
pub(crate) fn assert_nothing_left(launcher: u32) {
    let left = (
        in_shared_memory(launcher),
        children_of_run(launcher),
        programs_of(launcher),
    );
    assert_eq!(left, Default::default(), "files, processes, programs");
}

/// Of the processes of this machine, what is found in a file of `/proc`: words that end with zero.
fn processes<T>(file: &str, found: impl Fn(i32, &[Cow<'_, str>]) -> Option<T>) -> Vec<T> {
    let entries = std::fs::read_dir("/proc").expect("proc").flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    let of = |pid: i32| {
        let text = std::fs::read(format!("/proc/{pid}/{file}")).ok()?;
        let words = text.split(|byte| *byte == 0).map(String::from_utf8_lossy);
        found(pid, &words.collect::<Vec<_>>())
    };
    pids.filter_map(of).collect()
}

/// Processes started for a launcher's run, by the run directory in their arguments: name and process id.
pub(crate) fn children_of_run(launcher: u32) -> Vec<(String, i32)> {
    let marker = format!("-{launcher}-");
    let is_of_run = |run: &str| run.contains("/armplane-") && run.contains(&marker);
    processes("cmdline", |pid, words| match words {
        [_, name, option, run, ..] if option == "--run" && is_of_run(run) => {
            Some((name.to_string(), pid))
        }
        _ => None,
    })
}

/// Programs of others in a launcher's run, by their environment.
fn programs_of(launcher: u32) -> Vec<i32> {
    let marker = format!("-{launcher}-");
    let is_run = |word: &Cow<'_, str>| word.starts_with("ARMPLANE_RUN=") && word.contains(&marker);
    processes("environ", |pid, words| {
        words.iter().any(is_run).then_some(pid)
    })
}

/// How often a process was replaced in a run.
pub(crate) fn restarts(summary: &Value, process: &str) -> u64 {
    let mut processes = summary["processes"].list().iter();
    let found = processes.find(|one| one["name"] == process);
    found.expect("a process of the run")["restarts"].count()
}

/// The folder of the repository.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The text of a file of the repository.
pub(crate) fn source(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
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
