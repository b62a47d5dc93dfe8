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

    pub(crate) fn start(&self, args: &[&str]) -> Child {
        let mut command = Command::new(env!("CARGO_BIN_EXE_armplane"));
        command
            .args(args)
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
        command.spawn().expect("armplane starts")
    }

    pub(crate) fn armplane(&self, args: &[&str]) -> Said {
        finish(self.start(args))
    }

    /// Runs a scenario and reads its summary.
    pub(crate) fn run(&self, args: &[&str]) -> Value {
        let said = self.armplane(&[&["run"], args, &["--json"]].concat());
        assert_eq!(said.code, 0, "{}\n{}", said.out, said.err);
        assert_nothing_left(said.launcher);
        serde_json::from_str(&said.out).expect("the summary is JSON")
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
