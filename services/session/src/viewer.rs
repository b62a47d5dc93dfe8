//! `armplane view` and `armplane run --live`: recordings in the installed Rerun viewer.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::failure::Failure;
use crate::progress::{Observer, Progress};

/// The viewer's command; another one through the environment variable of that name.
const VIEWER: &str = "rerun";
const VIEWER_VARIABLE: &str = "ARMPLANE_RERUN";
/// Where a viewer that is running listens, by Rerun's convention.
const VIEWER_PORT: u16 = 9876;
/// The oldest viewer that shows everything: whose format and blueprints the recordings are in.
const VIEWER_VERSION: (u32, u32) = (0, 36);

/// Opens the files of a recording in the viewer, or hands them to the one that is running, and waits until it has ended; `layout`, a `.rbl`,
/// replaces the layout in the recording.
///
/// The viewer shows the layout that it reads last, and reads files at once, each at its own speed. With a layout everything therefore goes
/// through the viewer's input, the layout at the end.
///
/// # Errors
/// [`Failure::Work`] where a file cannot be read, there is no viewer, none that can be shown, or it ends with an error.
pub fn show(
    files: &[PathBuf],
    layout: Option<&Path>,
    observer: Observer<'_>,
) -> Result<(), Failure> {
    let mut child = match layout {
        None => start(files, Stdio::inherit(), Stdio::inherit, observer)?,
        Some(layout) => {
            let mut child = start(&["-"], Stdio::piped(), Stdio::inherit, observer)?;
            let input = child.stdin.take();
            let all = files.iter().map(PathBuf::as_path).chain([layout]);
            match input.map_or(Ok(()), |mut input| {
                all.into_iter().try_for_each(|path| send(path, &mut input))
            }) {
                // A viewer that is closed meanwhile says by its status how it ended.
                Err(error) if error.kind() != ErrorKind::BrokenPipe => {
                    return Err(Failure::Work(format!(
                        "the viewer did not get the whole recording: {error}"
                    )));
                }
                _ => child,
            }
        }
    };
    // The viewer's own window is the user's: it may outlive this command, whose end it is when the viewer ends first.
    let status = child
        .wait()
        .map_err(|error| Failure::Work(format!("the viewer was lost: {error}")))?;
    if status.success() {
        Ok(())
    } else {
        Err(Failure::Work(format!(
            "the viewer `{}` ended with {status}; what it said is above",
            viewer_command()
        )))
    }
}

fn send(path: &Path, viewer: &mut ChildStdin) -> std::io::Result<()> {
    std::io::copy(&mut files::open(path)?, viewer).map(drop)
}

fn named_viewer_command() -> Option<String> {
    std::env::var(VIEWER_VARIABLE)
        .ok()
        .filter(|command| !command.is_empty())
}

/// The viewer's command: Rerun's, or the one in the environment variable `ARMPLANE_RERUN`.
#[must_use]
pub fn viewer_command() -> String {
    named_viewer_command().unwrap_or_else(|| VIEWER.to_owned())
}

/// Starts the viewer, or hands the files to the one that is running.
fn start(
    arguments: &[impl AsRef<OsStr>],
    input: Stdio,
    output: fn() -> Stdio,
    observer: Observer<'_>,
) -> Result<Child, Failure> {
    let viewer = viewer_command();
    let cannot = |error: std::io::Error| {
        Failure::Work(match error.kind() {
            ErrorKind::NotFound => format!(
                "there is no Rerun viewer `{viewer}` on this machine: install it with `pip install rerun-sdk==0.36.3` or `cargo install rerun-cli@0.36.3 --locked`, or name it in {VIEWER_VARIABLE}"
            ),
            _ => format!("the viewer `{viewer}` cannot be started: {error}"),
        })
    };
    if let Some((major, minor)) = version(&viewer)
        .map_err(cannot)?
        .filter(|version| *version < VIEWER_VERSION)
    {
        observer(Progress::Line(&format!(
            "armplane: the viewer `{viewer}` is {major}.{minor}: one older than 0.36 may show the recording without its layout, or not at all; \
             get a newer one with `pip install rerun-sdk==0.36.3`"
        )));
    }
    if named_viewer_command().is_none() && !has_screen() && !is_running() {
        return Err(Failure::Work(format!(
            "no Rerun viewer listens on 127.0.0.1:{VIEWER_PORT}, and there is no screen here to open one on: start `{VIEWER} --serve-web` \
             and open the address it prints in a browser, then do this again; or, from a machine with a screen and an open viewer, come \
             with `ssh -R {VIEWER_PORT}:localhost:{VIEWER_PORT}`"
        )));
    }
    // A viewer that is started here listens to this machine only.
    let command = &mut Command::new(&viewer);
    command
        .args(arguments)
        .args(["--bind", "127.0.0.1"])
        .stdin(input)
        .stdout(output())
        .stderr(output())
        .spawn()
        .map_err(cannot)
}

/// Whether a window can be opened: on Linux by what the desktop sets.
fn has_screen() -> bool {
    !cfg!(target_os = "linux")
        || ["DISPLAY", "WAYLAND_DISPLAY"]
            .iter()
            .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
}

/// Whether a viewer is open, which then shows what it is handed.
fn is_running() -> bool {
    TcpStream::connect_timeout(
        &SocketAddr::from((Ipv4Addr::LOCALHOST, VIEWER_PORT)),
        Duration::from_millis(300),
    )
    .is_ok()
}

/// The version that the viewer reports; `None` without an answer in time.
fn version(viewer: &str) -> std::io::Result<Option<(u32, u32)>> {
    let command = &mut Command::new(viewer);
    let mut child = command
        .arg("--version")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()?;
    let began = Instant::now();
    while child.try_wait()?.is_none() {
        if began.elapsed() > Duration::from_secs(3) {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::sleep(LOOK);
    }
    let mut said = String::new();
    if let Some(output) = child.stdout.take() {
        // A version is text.
        let _ = output.take(4096).read_to_string(&mut said);
    }
    Ok(said.split_whitespace().find_map(numbers))
}

/// Major and minor of `0.36.3`.
fn numbers(word: &str) -> Option<(u32, u32)> {
    let mut parts = word.split('.');
    Some((parts.next()?.parse().ok()?, parts.next()?.parse().ok()?))
}

/// A running run in the viewer: what the recorder writes into its files is passed on to `rerun -`.
///
/// No process waits for the viewer: the recorder writes files as ever, and a thread of this process reads them. The files are the queue, so a
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
    ///
    /// # Errors
    /// [`Failure::Work`] where there is no viewer, or none that can be shown.
    pub(crate) fn start(folder: &Path, observer: Observer<'_>) -> Result<Self, Failure> {
        // Not this command's output: whoever reads that does not wait for the viewer's window to be closed.
        let mut child = start(&["-"], Stdio::piped(), Stdio::null, observer)?;
        let Some(input) = child.stdin.take() else {
            return Err(Failure::Work("the viewer takes no input".to_owned()));
        };
        let (over, passed) = (
            Arc::new(AtomicBool::new(false)),
            Arc::new(AtomicU64::new(0)),
        );
        let feed = Feed {
            folder: folder.to_owned(),
            over: Arc::clone(&over),
            passed: Arc::clone(&passed),
        };
        let thread = std::thread::spawn(move || feed.run(input));
        Ok(Self {
            over,
            passed,
            thread,
        })
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
                return Some(format!(
                    "the viewer has stopped reading after {:.1} MB; the recording is whole",
                    passed as f64 / 1e6
                ));
            }
            std::thread::sleep(LOOK);
        }
        match self.thread.join() {
            Ok(Ok(())) => None,
            Ok(Err(error)) if error.kind() == ErrorKind::BrokenPipe => {
                Some("the viewer was closed before the end; the recording is whole".to_owned())
            }
            Ok(Err(error)) => Some(format!(
                "the viewer did not get everything: {error}; the recording is whole"
            )),
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
            let Some(mut file) = self.await_part(part)? else {
                break;
            };
            self.pass_on(&mut file, part, &mut viewer)?;
        }
        viewer.flush()
    }

    /// Opens a part as soon as it exists; `None` when the run is over without it.
    fn await_part(&self, part: u32) -> std::io::Result<Option<File>> {
        loop {
            let over = self.over.load(Ordering::Acquire);
            match files::open(&self.folder.join(viz::part_name(part))) {
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
            let ended = self.over.load(Ordering::Acquire)
                || std::fs::metadata(&next).is_ok_and(|file| file.len() > HEAD);
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

#[cfg(test)]
mod tests {
    use super::numbers;

    #[test]
    fn a_viewers_version_is_found_in_what_it_says() {
        let find = |said: &str| said.split_whitespace().find_map(numbers);
        assert_eq!(
            find("rerun-cli 0.36.3 (base native_viewer) [rustc 1.95.0 (59807616e)]"),
            Some((0, 36))
        );
        assert_eq!(find("rerun_py 0.26.2-rc.1"), Some((0, 26)));
        assert_eq!(find("no such option: --version"), None);
    }
}
