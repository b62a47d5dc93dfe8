//! `armplane view` and `armplane run --live`: recordings in the installed Rerun viewer.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitCode, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::ViewArgs;
use super::export::save_blueprint;
use super::failure::Failure;
use super::out::say;
use super::runs::Run;

/// The viewer's command; another one through the environment variable of that name.
const VIEWER: &str = "rerun";
const VIEWER_VARIABLE: &str = "ARMPLANE_RERUN";

pub(crate) fn view(args: &ViewArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let run = Run::find(args.run.as_deref())?;
    let mut files = run.recording()?.to_vec();
    if let Some(layout) = args.layout {
        let path = run.folder.join(format!("{}.rbl", layout.name()));
        save_blueprint(&run, layout, &path)?;
        files.push(path);
    }
    if as_json {
        say!("{}", serde_json::json!({"viewer": viewer(), "files": files}));
    }
    let mut child = start(&files, Stdio::inherit(), Stdio::inherit)?;
    // The viewer's own window is the user's: it may outlive this command, whose end it is when the viewer ends first.
    let status = child.wait().map_err(|error| Failure::Work(format!("the viewer was lost: {error}")))?;
    if status.success() { Ok(ExitCode::SUCCESS) } else { Err(Failure::Work(format!("the viewer `{}` ended with {status}", viewer()))) }
}

fn viewer() -> String {
    std::env::var(VIEWER_VARIABLE).ok().filter(|command| !command.is_empty()).unwrap_or_else(|| VIEWER.to_owned())
}

/// Starts the viewer, or hands the files to the one that is running.
fn start(arguments: &[impl AsRef<OsStr>], input: Stdio, output: fn() -> Stdio) -> Result<Child, Failure> {
    let viewer = viewer();
    Command::new(&viewer).args(arguments).stdin(input).stdout(output()).stderr(output()).spawn().map_err(|error| {
        Failure::Work(match error.kind() {
            ErrorKind::NotFound => format!(
                "there is no Rerun viewer `{viewer}` on this machine: install it with `pip install rerun-sdk==0.36.3` or `cargo install rerun-cli@0.36.3 --locked`, or name it in {VIEWER_VARIABLE}"
            ),
            _ => format!("the viewer `{viewer}` cannot be started: {error}"),
        })
    })
}

/// A running run in the viewer: what the recorder writes into its files is passed on to `rerun -`.
///
/// Nobody waits for the viewer: the recorder writes files as ever, and a thread of this process reads them. The files are the queue, so a
/// slow viewer falls behind and loses nothing; one that is closed ends the passing on, not the run.
pub(crate) struct Live {
    over: Arc<AtomicBool>,
    passed: Arc<AtomicU64>,
    thread: JoinHandle<std::io::Result<()>>,
}

/// How long the viewer may take for what it has not read yet when the run is over.
const PATIENCE: Duration = Duration::from_secs(5);
/// More bytes than the head of a recording has.
const HEAD: u64 = 64;
/// How often the files are looked at.
const LOOK: Duration = Duration::from_millis(20);

impl Live {
    /// Starts the viewer for a run whose recording goes into `folder`.
    pub(crate) fn start(folder: &Path) -> Result<Self, Failure> {
        // Not this command's output: whoever reads that does not wait for the viewer's window to be closed.
        let mut child = start(&["-"], Stdio::piped(), Stdio::null)?;
        let Some(input) = child.stdin.take() else { return Err(Failure::Work("the viewer takes no input".to_owned())) };
        let (over, passed) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let feed = Feed { folder: folder.to_owned(), over: Arc::clone(&over), passed: Arc::clone(&passed) };
        let thread = std::thread::spawn(move || feed.run(input));
        Ok(Self { over, passed, thread })
    }

    /// The run is over: waits for the viewer to take the rest. Answers what to tell the user, if anything.
    pub(crate) fn finish(self) -> Option<String> {
        self.over.store(true, Ordering::Release);
        let (mut since, mut before) = (Instant::now(), 0);
        while !self.thread.is_finished() {
            let passed = self.passed.load(Ordering::Relaxed);
            if passed > before {
                (since, before) = (Instant::now(), passed);
            }
            if since.elapsed() > PATIENCE {
                return Some(format!("the viewer has stopped reading after {:.1} MB; the recording is whole", passed as f64 / 1e6));
            }
            std::thread::sleep(LOOK);
        }
        match self.thread.join() {
            Ok(Ok(())) => None,
            Ok(Err(error)) if error.kind() == ErrorKind::BrokenPipe => {
                Some("the viewer was closed before the end; the recording is whole".to_owned())
            }
            Ok(Err(error)) => Some(format!("the viewer did not get everything: {error}; the recording is whole")),
            Err(_) => Some("the viewer did not get everything; the recording is whole".to_owned()),
        }
    }
}

struct Feed {
    folder: PathBuf,
    over: Arc<AtomicBool>,
    passed: Arc<AtomicU64>,
}

impl Feed {
    fn run(&self, mut viewer: ChildStdin) -> std::io::Result<()> {
        for part in 0.. {
            let Some(mut file) = self.await_part(part)? else { break };
            self.pass_on(&mut file, part, &mut viewer)?;
        }
        viewer.flush()
    }

    /// Opens a part as soon as it exists; `None` when the run is over without it.
    fn await_part(&self, part: u32) -> std::io::Result<Option<File>> {
        loop {
            let over = self.over.load(Ordering::Acquire);
            match File::open(self.folder.join(viz::part_name(part))) {
                Ok(file) => return Ok(Some(file)),
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                Err(_) if over => return Ok(None),
                Err(_) => std::thread::sleep(LOOK),
            }
        }
    }

    /// Passes on what a part holds and what comes, until it has a successor or the run is over.
    fn pass_on(&self, file: &mut File, part: u32, viewer: &mut ChildStdin) -> std::io::Result<()> {
        let next = self.folder.join(viz::part_name(part + 1));
        let mut buffer = vec![0; 1 << 16];
        loop {
            // Asked before reading: what was written before the answer is read below.
            // A successor is made, with no more than its head, before its predecessor has got its end; what it holds is written after.
            let ended = self.over.load(Ordering::Acquire) || std::fs::metadata(&next).is_ok_and(|file| file.len() > HEAD);
            loop {
                let got = file.read(&mut buffer)?;
                if got == 0 {
                    break;
                }
                viewer.write_all(&buffer[..got])?;
                self.passed.fetch_add(got as u64, Ordering::Relaxed);
            }
            if ended {
                return Ok(());
            }
            std::thread::sleep(LOOK);
        }
    }
}
