//! `armplane view` and `armplane run --live`: recordings in the installed Rerun viewer.

use std::ffi::OsStr;
use std::io::{ErrorKind, Read};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use model::Robot;
use recorder::{Assembler, Contents, tick_of};
use runtime::Watcher;
use rustix::fs::OFlags;
use shared_types::topics::{COUNT, TOPICS};
use viz::{Happened, Source, Tick};

use crate::failure::Failure;
use crate::observation::job;
use crate::progress::{Observer, say};

/// The viewer's command; another one through the environment variable of that name.
const VIEWER: &str = "rerun";
const VIEWER_VARIABLE: &str = "ARMPLANE_RERUN";
/// Where a viewer that is running listens, by Rerun's convention.
const VIEWER_PORT: u16 = 9876;
/// The oldest viewer that shows everything: whose format and blueprints the recordings are in.
const VIEWER_VERSION: (u32, u32) = (0, 36);

/// Opens a recording in the viewer, or hands it to the one that is running, and waits until it has ended; `layout`, a `.rbl`,
/// replaces the layout in the recording.
///
/// The viewer shows the layout that it reads last, and reads files at once, each at its own speed. With a layout everything therefore goes
/// through the viewer's input, the layout at the end.
///
/// # Errors
/// [`Failure::Work`] if a file cannot be read, there is no viewer, none that can be shown, or it ends with an error.
pub fn show(file: &Path, layout: Option<&Path>, observer: Observer<'_>) -> Result<(), Failure> {
    // The viewer opens the file itself, and would wait at a pipe.
    files::open(file)
        .map_err(|error| Failure::input(format_args!("{}: {error}", file.display())))?;
    if let Some(sentence) = Asked::ask()?.complaint(Duration::from_secs(3)) {
        say(observer, sentence);
    }
    let mut child = match layout {
        None => start(&[file], Stdio::inherit(), Stdio::inherit)?,
        Some(_) => start(&["-"], Stdio::piped(), Stdio::inherit)?,
    };
    if let (Some(layout), Some(mut input)) = (layout, child.stdin.take()) {
        let sent = [file, layout].into_iter().try_for_each(|path| {
            let mut file = files::open(path)?;
            std::io::copy(&mut file, &mut input).map(drop)
        });
        // A viewer that is closed meanwhile says by its status how it ended.
        if let Err(error) = sent
            && error.kind() != ErrorKind::BrokenPipe
        {
            return Err(Failure::Work(format!(
                "the viewer received only a part of the recording: {error}"
            )));
        }
    }
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

/// A live run in the viewer: a process that nobody waits for reads the topics and draws.
///
/// A slow viewer, or a run that is faster than drawing, costs what is shown, never the run.
pub(crate) struct Live {
    version: Asked,
    /// Its standard input ends with the run, however that ends.
    watcher: Option<Child>,
}

/// The subcommand that draws a run while it lasts.
pub const WATCH: &str = "watch";

/// How long the end of a run waits for the one who draws it.
const PATIENCE: Duration = Duration::from_millis(800);
/// How long that one has for the rest where nobody waits.
const REST: Duration = Duration::from_secs(3);
/// How often the topics are looked at.
const LOOK: Duration = Duration::from_millis(20);
/// How long a run may take until its topics are there.
const START: Duration = Duration::from_secs(10);

impl Live {
    /// Starts the viewer, unless one is open.
    ///
    /// # Errors
    /// [`Failure::Work`] if no viewer is installed, or none can open a window.
    pub(crate) fn start() -> Result<Self, Failure> {
        let version = Asked::ask()?;
        if named_viewer_command().is_some() || !is_running() {
            // Not this command's output: whoever reads that does not wait for the viewer's window to be closed.
            start(
                &["--port", &VIEWER_PORT.to_string()],
                Stdio::null(),
                Stdio::null,
            )?;
        }
        Ok(Self {
            version,
            watcher: None,
        })
    }

    /// Draws the run in a directory from now on.
    ///
    /// # Errors
    /// [`Failure::Work`] if the process cannot be started.
    pub(crate) fn follow(&mut self, run: &Path) -> Result<(), Failure> {
        let watcher = launcher::start_beside(WATCH, run);
        self.watcher = Some(watcher.map_err(Failure::cannot("start", Path::new(WATCH)))?);
        Ok(())
    }

    /// The run is over. Answers what to tell the user.
    pub(crate) fn finish(mut self, folder: &Path) -> impl Iterator<Item = String> {
        let over = Instant::now();
        let mut ended = None;
        if let Some(watcher) = &mut self.watcher {
            drop(watcher.stdin.take());
            while ended.is_none() && over.elapsed() < PATIENCE {
                std::thread::sleep(LOOK);
                ended = watcher.try_wait().ok().flatten();
            }
            if ended.is_none() {
                let _ = watcher.kill().and_then(|()| watcher.wait());
            }
        }
        let lack = (!ended.is_some_and(|status| status.success())).then(|| {
            let folder = folder.display();
            format!(
                "the viewer does not have all of the run; `armplane view {folder}` shows it whole"
            )
        });
        lack.into_iter()
            .chain(self.version.complaint(Duration::ZERO))
    }
}

/// Draws a run into the open viewer while it lasts: from its topics, until it has ended or standard input has. Whether all of it was drawn.
///
/// # Errors
/// [`Failure`] where the run cannot be read, or there is no viewer.
pub fn watch(run: &Path) -> Result<bool, Failure> {
    let is_over = Arc::new(AtomicBool::new(false));
    let over = Arc::clone(&is_over);
    std::thread::spawn(move || {
        let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
        over.store(true, Ordering::Relaxed);
        // A viewer that takes nothing more does not keep this process.
        std::thread::sleep(REST);
        std::process::exit(1);
    });
    let job = job(run)?;
    let robot = Robot::from_source(&job.robot).map_err(Failure::work)?;
    let reads = |topic: &str| job.graph.writer(topic).is_some();
    let begun = Instant::now();
    let watcher = loop {
        match Watcher::open(run, WATCH, reads) {
            Ok(watcher) => break watcher,
            Err(error) if is_over.load(Ordering::Relaxed) || begun.elapsed() > START => {
                return Err(Failure::work(error));
            }
            Err(_) => std::thread::sleep(LOOK),
        }
    };
    let contents = Contents::of(&job);
    let layouts = contents.layouts();
    let mut ticks = LiveTicks {
        watcher,
        is_over,
        channels: TOPICS.map(|topic| layouts.iter().position(|layout| layout.topic == topic)),
        assembler: Assembler::new(&contents),
        newest: 0,
        count: 0,
    };
    let url = format!("rerun+http://127.0.0.1:{VIEWER_PORT}/proxy");
    let source = Source {
        job: &job,
        robot: &robot,
        happened: Happened::default(),
        ticks: &mut ticks,
        progress: &mut |_| true,
    };
    let shown = viz::show_live(&url, source);
    shown.map_err(Failure::work)?;
    Ok(ticks.count == ticks.newest + 1)
}

/// The ticks of a run that lasts.
struct LiveTicks {
    watcher: Watcher,
    is_over: Arc<AtomicBool>,
    /// By the topic's place in the list.
    channels: [Option<usize>; COUNT],
    assembler: Assembler,
    newest: u64,
    count: u64,
}

impl Iterator for LiveTicks {
    type Item = Tick;

    fn next(&mut self) -> Option<Tick> {
        loop {
            // Asked first: what came before the answer is taken in below.
            let is_over = self.is_over.load(Ordering::Relaxed);
            let (assembler, newest) = (&mut self.assembler, &mut self.newest);
            self.watcher.collect(|topic, message| {
                *newest = (*newest).max(tick_of(message));
                if let Some(channel) = self.channels[topic] {
                    assembler.take(channel, message);
                }
            });
            let is_rest = |rows: &mut Assembler| is_over.then(|| rows.rest()).flatten();
            while let Some(row) = self
                .assembler
                .next_row()
                .or_else(|| is_rest(&mut self.assembler))
            {
                let messages = *row.messages();
                // Of ticks that went by nothing is shown.
                if messages.sensor.is_some() || messages.torque.is_some() {
                    self.count += 1;
                    return Some(Tick {
                        tick: row.tick,
                        messages,
                        events: Vec::new(),
                    });
                }
            }
            if is_over {
                return None;
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
