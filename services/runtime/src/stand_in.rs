//! A process that stands for a program which a person, or another program, starts: the launcher has a child to watch, and the program its place.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, getpid, pidfd_open};

use crate::complain::complain;
use crate::control_page::{ControlPage, Stop};
use crate::environment::{PROCESS_VARIABLE, RUN_VARIABLE};
use crate::manifest::Manifest;
use crate::run_dir::RunDir;
use crate::shell::{OpenError, ProcessError, Shell};

/// How often it looks.
const LOOK: Duration = Duration::from_millis(20);

/// The file in which a program that the launcher has not started itself leaves its process id.
fn place(run: &Path, process: &str) -> PathBuf {
    run.join(format!("guest-{process}"))
}

impl Shell {
    /// If another process stands for this one: leaves it the process id, and ends waits when it is gone.
    pub(crate) fn greet(&self) -> std::io::Result<()> {
        let own = getpid().as_raw_nonzero();
        let started = Pid::from_raw(self.shared().entry().pid() as i32);
        if started == Some(getpid()) {
            return Ok(());
        }
        self.shared().look_out.watch(started);
        let path = place(self.run_dir(), self.name());
        let unfinished = path.with_added_extension("new");
        std::fs::write(&unfinished, own.to_string())?;
        std::fs::rename(unfinished, path)
    }
}

/// Says how to start the program of a process, waits for it, at most so long, and stays until it has ended.
///
/// # Errors
/// [`ProcessError`] if it does not come, or ends before the run does.
pub fn stand_in(run: &Path, process: &str, limit: Duration) -> Result<(), ProcessError> {
    let run_dir = RunDir::open(run).map_err(OpenError::from)?;
    let manifest = Manifest::read(&run_dir).map_err(OpenError::from)?;
    let page = ControlPage::open(&run_dir).map_err(OpenError::from)?;
    let me = manifest.index_of(process).unwrap_or(0);
    let is_polled = manifest.processes.get(me).is_some_and(|me| me.polled);
    let is_stopping = || match is_polled {
        true => page.stop() >= Stop::Everything,
        false => page.stop() >= Stop::Chain,
    };
    let (path, began) = (place(run, process), Instant::now());
    let _ = std::fs::remove_file(&path);
    complain(&format_args!(
        "start the program of {process} within {} s with: {RUN_VARIABLE}={} {PROCESS_VARIABLE}={process} COMMAND",
        limit.as_secs(),
        run.display()
    ));
    let pid = loop {
        let pid = std::fs::read_to_string(&path).ok();
        if let Some(pid) = pid.and_then(|pid| Pid::from_raw(pid.parse().ok()?)) {
            break pid;
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
    // Without a descriptor it has ended already.
    let limit = Timespec {
        tv_sec: 0,
        tv_nsec: LOOK.as_nanos() as i64,
    };
    if let Ok(program) = pidfd_open(pid, PidfdFlags::empty()) {
        while matches!(
            poll(&mut [PollFd::new(&program, PollFlags::IN)], Some(&limit)),
            Ok(0) | Err(_)
        ) {}
    }
    match is_stopping() {
        true => Ok(()),
        false => Err(ProcessError::setup(format_args!(
            "the program of {process} has ended at tick {}, before the run",
            page.process(me).ticks()
        ))),
    }
}
