//! `armplane view` and `armplane run --live`: recordings in the installed Rerun viewer.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::OFlags;
use rustix::time::Timespec;

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
/// [`Failure::Work`] if a file cannot be read, there is no viewer, none that can be shown, or it ends with an error.
pub fn show(
    files: &[PathBuf],
    layout: Option<&Path>,
    observer: Observer<'_>,
) -> Result<(), Failure> {
    // The viewer opens the files itself, and would wait at a pipe.
    for path in files {
        files::open(path)
            .map_err(|error| Failure::input(format_args!("{}: {error}", path.display())))?;
    }
    if let Some(sentence) = Asked::ask()?.complaint(Duration::from_secs(3)) {
        observer(Progress::Line(&format!("armplane: {sentence}")));
    }
    let mut child = match layout {
        None => start(files, Stdio::inherit(), Stdio::inherit)?,
        Some(layout) => {
            let mut child = start(&["-"], Stdio::piped(), Stdio::inherit)?;
            let input = child.stdin.take();
            let all = files.iter().map(PathBuf::as_path).chain([layout]);
            match input.map_or(Ok(()), |mut input| {
                all.into_iter().try_for_each(|path| send(path, &mut input))
            }) {
                // A viewer that is closed meanwhile says by its status how it ended.
                Err(error) if error.kind() != ErrorKind::BrokenPipe => {
                    return Err(Failure::Work(format!(
                        "the viewer received only a part of the recording: {error}"
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
            "the viewer `{}` ended with {status}; its output is above",
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
pub fn viewer_command() -> String {
    named_viewer_command().unwrap_or_else(|| VIEWER.to_owned())
}

/// Starts the viewer, or hands the files to the one that is running.
fn start(
    arguments: &[impl AsRef<OsStr>],
    input: Stdio,
    output: fn() -> Stdio,
) -> Result<Child, Failure> {
    let viewer = viewer_command();
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
        .map_err(cannot_start)
}

fn cannot_start(error: std::io::Error) -> Failure {
    let viewer = viewer_command();
    Failure::Work(match error.kind() {
        ErrorKind::NotFound => format!(
            "there is no Rerun viewer `{viewer}` on this machine: install it with `pip install rerun-sdk==0.36.3` or `cargo install rerun-cli@0.36.3 --locked`, or name it in {VIEWER_VARIABLE}"
        ),
        _ => format!("the viewer `{viewer}` cannot be started: {error}"),
    })
}

/// Whether a window can be opened; on Linux, the desktop's environment variables tell.
fn has_screen() -> bool {
    !cfg!(target_os = "linux")
        || ["DISPLAY", "WAYLAND_DISPLAY"]
            .iter()
            .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
}

/// Whether a viewer is open that can show a recording.
fn is_running() -> bool {
    TcpStream::connect_timeout(
        &SocketAddr::from((Ipv4Addr::LOCALHOST, VIEWER_PORT)),
        Duration::from_millis(300),
    )
    .is_ok()
}

/// The viewer, asked for its version.
struct Asked(Child);

impl Asked {
    fn ask() -> Result<Self, Failure> {
        let command = &mut Command::new(viewer_command());
        command
            .arg("--version")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(cannot_start)
            .map(Self)
    }

    /// A sentence about a viewer that is too old; none without an answer within so long.
    fn complaint(mut self, limit: Duration) -> Option<String> {
        let asked = Instant::now();
        while self.0.try_wait().ok()?.is_none() {
            if asked.elapsed() >= limit {
                return None;
            }
            std::thread::sleep(LOOK);
        }
        let mut said = String::new();
        // A version is text. A descendant that holds the pipe open does not keep this waiting: a pipe without data is not read.
        let mut output = self.0.stdout.take()?;
        rustix::fs::fcntl_setfl(&output, OFlags::NONBLOCK).ok()?;
        let _ = output.by_ref().take(4096).read_to_string(&mut said);
        let (major, minor) = said
            .split_whitespace()
            .find_map(numbers)
            .filter(|version| *version < VIEWER_VERSION)?;
        Some(format!(
            "the viewer `{}` is {major}.{minor}: one older than 0.36 may show the recording without its layout, or not at all; \
             get a newer one with `pip install rerun-sdk==0.36.3`",
            viewer_command()
        ))
    }
}

impl Drop for Asked {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Major and minor of `0.36.3`.
fn numbers(word: &str) -> Option<(u32, u32)> {
    let mut parts = word.split('.');
    Some((parts.next()?.parse().ok()?, parts.next()?.parse().ok()?))
}

/// A live run in the viewer: a process that nobody waits for passes the recorder's files on to
/// `rerun -`.
///
/// The recorder writes files as ever, and [`feed`] reads them. The files are the queue, so a slow viewer falls behind and loses nothing, also when the
/// run is over; one that is closed ends the passing on, not the run.
pub(crate) struct Live {
    /// Its standard input ends with the run, however that ends.
    feeder: Child,
    version: Asked,
}

/// The subcommand that passes a recording on to the viewer.
pub const FEED: &str = "feed";

/// How long the end of a run may wait until the viewer has everything.
const PATIENCE: Duration = Duration::from_millis(300);
/// A viewer that reads nothing for so long gets no more.
const STUCK: Duration = Duration::from_secs(60);
/// More bytes than the head of a recording has.
const HEAD: u64 = 64;
/// How often the files are looked at.
const LOOK: Duration = Duration::from_millis(20);

impl Live {
    /// Starts the viewer for a run whose recording goes into `folder`.
    ///
    /// # Errors
    /// [`Failure::Work`] if no viewer is installed, or none can open a window.
    pub(crate) fn start(folder: &Path) -> Result<Self, Failure> {
        let version = Asked::ask()?;
        // Not this command's output: whoever reads that does not wait for the viewer's window to be closed.
        let mut viewer = start(&["-"], Stdio::piped(), Stdio::null)?;
        let input = viewer.stdin.take().map_or_else(Stdio::null, Stdio::from);
        let feeder = launcher::reexec(FEED, folder).and_then(|mut command| {
            command
                .process_group(0)
                .stdin(Stdio::piped())
                .stdout(input)
                .stderr(Stdio::null())
                .spawn()
        });
        let feeder =
            feeder.map_err(|error| Failure::Work(format!("cannot start {FEED}: {error}")))?;
        Ok(Self { feeder, version })
    }

    /// The run is over. Answers what to tell the user.
    pub(crate) fn finish(mut self) -> impl Iterator<Item = String> {
        drop(self.feeder.stdin.take());
        let over = Instant::now();
        let mut ended = None;
        while ended.is_none() && over.elapsed() < PATIENCE {
            std::thread::sleep(LOOK);
            ended = self.feeder.try_wait().ok().flatten();
        }
        let passed = match ended.map(|status| status.success()) {
            Some(true) => None,
            Some(false) => Some("the viewer was closed before the end; the recording is complete"),
            None => Some(
                "the viewer has not read everything yet and will get the rest; the recording is complete",
            ),
        };
        let passed = passed.map(str::to_owned);
        passed
            .into_iter()
            .chain(self.version.complaint(Duration::ZERO))
    }
}

/// Passes the recording in a folder on to a viewer while it is made, until standard input ends and nothing is left.
///
/// # Errors
/// The viewer's own, or the one of a file.
pub fn feed(folder: &Path, viewer: OwnedFd) -> std::io::Result<()> {
    let viewer = File::from(viewer);
    rustix::fs::fcntl_setfl(&viewer, OFlags::NONBLOCK)?;
    for part in 0.. {
        let Some(mut file) = await_part(folder, part)? else {
            break;
        };
        pass_part(&mut file, &folder.join(viz::part_name(part + 1)), &viewer)?;
    }
    Ok(())
}

/// Whether a file can be read or written, or its other end is closed, within so long.
fn is_ready(file: impl AsFd, flags: PollFlags, limit: Duration) -> bool {
    let limit = Timespec {
        tv_sec: limit.as_secs() as i64,
        tv_nsec: i64::from(limit.subsec_nanos()),
    };
    poll(&mut [PollFd::new(&file, flags)], Some(&limit)).is_ok_and(|ready| ready > 0)
}

/// Waits for a moment; whether the run is over.
fn is_over() -> bool {
    is_ready(std::io::stdin(), PollFlags::IN, LOOK)
}

/// Opens a part as soon as it exists; `None` when the run is over without it.
fn await_part(folder: &Path, part: u32) -> std::io::Result<Option<File>> {
    loop {
        let over = is_over();
        match files::open(&folder.join(viz::part_name(part))) {
            Ok(file) => return Ok(Some(file)),
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            Err(_) if over => return Ok(None),
            Err(_) => {}
        }
    }
}

/// Passes on a part, and everything added to it, until the next part exists or the run is over.
fn pass_part(part: &mut File, next: &Path, viewer: &File) -> std::io::Result<()> {
    let mut buffer = vec![0; 1 << 16];
    loop {
        // Asked before reading: what was written before the answer is read below.
        // A successor is made, with no more than its head, before its predecessor has got its end; what it holds is written after.
        let ended = is_over() || std::fs::metadata(next).is_ok_and(|file| file.len() > HEAD);
        loop {
            let got = part.read(&mut buffer)?;
            if got == 0 {
                break;
            }
            pass(&buffer[..got], viewer)?;
        }
        if ended {
            return Ok(());
        }
    }
}

fn pass(mut bytes: &[u8], mut viewer: &File) -> std::io::Result<()> {
    while !bytes.is_empty() {
        match viewer.write(bytes) {
            Ok(passed) => bytes = &bytes[passed..],
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                if !is_ready(viewer, PollFlags::OUT, STUCK) {
                    return Err(ErrorKind::TimedOut.into());
                }
            }
            Err(error) => return Err(error),
        }
    }
    Ok(())
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
