//! A process that stands for a program which a person, or another program, starts: the launcher has a child to watch, and the program its place.

use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, getpid, pidfd_open};

use crate::complain::complain;
use crate::control_page::{ControlPage, Stop};
use crate::environment::{PROCESS_VARIABLE, RUN_VARIABLE};
use crate::manifest::{Manifest, Process};
use crate::run_dir::RunDir;
use crate::shell::{ProcessError, Shell};

/// How often it looks.
const LOOK: Duration = Duration::from_millis(20);

/// So long a program that has left the run may be ahead of the run's end.
const AHEAD: Duration = Duration::from_secs(1);

/// A program that has left the run writes this before the reason why it could not go on.
const LEFT: &str = "left ";

/// The file in which a program that the launcher has not started itself leaves its process id, and then that it has left the run.
fn place(run: &Path, process: &str) -> PathBuf {
    run.join(format!("guest-{process}"))
}

impl Shell {
    /// If another process stands for this one: leaves it the process id, and ends waits when it is gone.
    pub(crate) fn greet(&self) -> std::io::Result<()> {
        let Some(place) = self.stand_in() else {
            return Ok(());
        };
        self.shared.look_out.watch(self.launched());
        leave(&place, &getpid().as_raw_nonzero().to_string())
    }

    /// Where another process that stands for this one reads that it has left.
    pub(crate) fn stand_in(&self) -> Option<PathBuf> {
        (self.launched() != Some(getpid())).then(|| place(self.run_dir(), self.name()))
    }

    /// The process that the launcher has started as this one.
    fn launched(&self) -> Option<Pid> {
        Pid::from_raw(self.shared.entry().pid() as i32)
    }
}

/// Writes a text whole or not at all.
fn leave(path: &Path, text: &str) -> std::io::Result<()> {
    let unfinished = path.with_added_extension("new");
    std::fs::write(&unfinished, text)?;
    std::fs::rename(unfinished, path)
}

/// Tells the process that stands for this one that it has left the run, and why it could not go on; nothing: it could.
pub(crate) fn part(stand_in: &Path, why: &str) {
    // Without the file that one waits until this process has ended.
    let _ = leave(stand_in, &format!("{LEFT}{why}"));
}

/// Says how to start the program of a process, waits for it, at most so long, and stays until it has left the run or ended.
///
/// # Errors
/// [`ProcessError`] if it does not come, or ends before the run does.
pub fn stand_in(run: &Path, process: &str, limit: Duration) -> Result<(), ProcessError> {
    let run_dir = RunDir::open(run)?;
    let (manifest, page) = (Manifest::read(&run_dir)?, ControlPage::open(&run_dir)?);
    let me = manifest.index_of(process).unwrap_or(0);
    let own = manifest.processes.get(me);
    let stops_at = own.map_or(Stop::Chain, Process::stops_at);
    let is_stopping = || page.stop() >= stops_at;
    let (path, began) = (place(run, process), Instant::now());
    let _ = std::fs::remove_file(&path);
    complain(&format_args!(
        "start the program of {process} within {} s with: {RUN_VARIABLE}={} {PROCESS_VARIABLE}={process} COMMAND",
        limit.as_secs(),
        run.display()
    ));
    // Without a descriptor it has ended already; one that has left at once may have been too quick to be seen.
    let program = loop {
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        if text.starts_with(LEFT) {
            break None;
        }
        if let Some(pid) = text.parse().ok().and_then(Pid::from_raw) {
            break pidfd_open(pid, PidfdFlags::empty()).ok();
        }
        if is_stopping() {
            return Ok(());
        }
        if began.elapsed() > limit {
            let limit_s = limit.as_secs();
            return Err(ProcessError::setup(format_args!(
                "the program of {process} has not joined within {limit_s} s; `join_limit_s` in the graph allows it longer"
            )));
        }
        std::thread::sleep(LOOK);
    };
    let why = loop {
        let has_ended = program.as_ref().is_none_or(has_ended);
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        match text.strip_prefix(LEFT) {
            Some(why) => break Some(why.to_owned()),
            None if has_ended => break None,
            None => {}
        }
    };
    let left = Instant::now();
    while why.as_deref() == Some("") && !is_stopping() && left.elapsed() < AHEAD {
        std::thread::sleep(LOOK);
    }
    match is_stopping() {
        true => Ok(()),
        false => Err(ProcessError::setup(
            match why.filter(|why| !why.is_empty()) {
                Some(why) => why,
                None => format!(
                    "the program of {process} has ended at tick {}, before the run",
                    page.process(me).ticks()
                ),
            },
        )),
    }
}

/// Whether a program has ended, after a look that takes some time.
fn has_ended(program: &OwnedFd) -> bool {
    let limit = Timespec {
        tv_sec: 0,
        tv_nsec: LOOK.as_nanos() as i64,
    };
    let found = poll(&mut [PollFd::new(program, PollFlags::IN)], Some(&limit));
    !matches!(found, Ok(0) | Err(_))
}
