//! The program on the other side of an exchange page: starts or awaits, asks, watches and ends it.

use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::{Exit, Shell};
use rustix::process::{
    Pid, Signal, getpid, getppid, kill_process_group, set_parent_process_death_signal,
};
use rustix::thread::futex;
use shared_types::codes::{PROGRAM_AWAITED, REQUEST_STOP};
use shared_types::exchange::EXCHANGE_VARIABLE;
use shared_types::layout::MessageLayout;

use crate::failure::Failure;
use crate::page::Page;
use crate::reply::{self, Answer};

/// Interval between checks for the program's exit and the run's stop while waiting for an answer.
const LOOK: Duration = Duration::from_millis(5);

/// The time that a program has to end by itself.
const GRACE: Duration = Duration::from_secs(1);

/// Time for a program to join if its process starts it: an interpreter may have much to load ...
pub(crate) const LONGEST_START: Duration = Duration::from_secs(60);

/// ... and if a person starts it.
pub(crate) const LONGEST_EXTERNAL_START: Duration = Duration::from_secs(600);

/// Time after the start at which a program that has not joined is reported.
const SLOW_START: Duration = Duration::from_secs(5);

/// A program and its page.
pub(crate) struct Program<'a> {
    shell: &'a Shell,
    process: String,
    child: Option<Child>,
    /// The process group of the program and its children.
    group: Option<Pid>,
    pub(crate) page: Page,
    /// For its start, and for an answer.
    limits: (Duration, Duration),
    /// Whether a stop of the run ends a wait at once: not for an observer, which first takes in the
    /// remaining messages. A stop before the end of the run ends every wait that has lasted for
    /// longer than [`GRACE`].
    stops_at_once: bool,
}

impl<'a> Program<'a> {
    /// Starts the program if there is a command; otherwise prints the path of its page.
    pub(crate) fn start(
        shell: &'a Shell,
        process: &str,
        page: Page,
        command: Option<Command>,
        limits: (Duration, Duration),
        stops_at_once: bool,
    ) -> Result<Self, Failure> {
        let failed = |error: std::io::Error| Failure::Start(error.to_string());
        let child = match command {
            Some(command) => Some(start(command, &page).map_err(failed)?),
            None => {
                let (limit_s, page) = (limits.0.as_secs(), page.path().display());
                runtime::complain(&format_args!(
                    "start the program of {process} within {limit_s} s with: {EXCHANGE_VARIABLE}={page} COMMAND"
                ));
                None
            }
        };
        let group = child.as_ref().map(Pid::from_child);
        Ok(Self {
            shell,
            process: process.to_owned(),
            child,
            group,
            page,
            limits,
            stops_at_once,
        })
    }

    /// Waits until the program has joined, and compares versions and layouts; `false` when the run stops before.
    pub(crate) fn join(&mut self, topics: &[(MessageLayout, u32)]) -> Result<bool, Failure> {
        let (began, mut is_reported) = (Instant::now(), self.child.is_none());
        let limit = self.limits.0;
        while !reply::has_joined(&self.page, topics)? {
            if self.shell.is_stopping() {
                return Ok(false);
            }
            // One that refuses the page ends at once: its reason counts.
            match self.look("before it joined") {
                Err(_) if self.page.program() != PROGRAM_AWAITED => continue,
                looked => looked?,
            }
            if began.elapsed() > SLOW_START && !is_reported {
                is_reported = true;
                runtime::complain(&format_args!(
                    "the program of {} has not joined yet; it has {} s in all",
                    self.process,
                    limit.as_secs()
                ));
            }
            if began.elapsed() > limit {
                return Err(Failure::Absent(limit));
            }
            std::thread::sleep(LOOK);
        }
        Ok(true)
    }

    /// Asks for a step and waits for the answer.
    pub(crate) fn ask(&mut self, request: u32, tick: u64) -> Result<Answer, Failure> {
        let expected = self.page.ask(request, tick);
        let began = Instant::now();
        loop {
            let found = match reply::answer(&self.page, expected, tick)? {
                Ok(answer) => return Ok(answer),
                Err(found) => found,
            };
            let limit = rustix::time::Timespec {
                tv_sec: 0,
                tv_nsec: LOOK.as_nanos() as i64,
            };
            // An answer or a signal ends it as well as the limit. A program may wake without an answer, for ever: that does not put the looks below off.
            let _ = futex::wait(
                self.page.answers(),
                futex::Flags::empty(),
                found,
                Some(&limit),
            );
            if self.page.answers().load(Ordering::Acquire) != found {
                continue;
            }
            let is_early = || self.shell.is_stopping_early() && began.elapsed() > GRACE;
            if self.stops_at_once && self.shell.is_stopping() || is_early() {
                return Ok(Answer::Stopped);
            }
            // One that fails ends behind its answer, which counts.
            match self.look(&format!("at tick {tick}")) {
                Err(_) if self.page.answers().load(Ordering::Acquire) != found => continue,
                looked => looked?,
            }
            if began.elapsed() > self.limits.1 {
                let limit = self.limits.1;
                return Err(Failure::Silent { tick, limit });
            }
        }
    }

    /// Whether the program still runs; not known of one that was started separately.
    fn look(&mut self, at: &str) -> Result<(), Failure> {
        match self.child.as_mut().map(Child::try_wait) {
            Some(Ok(Some(status))) => {
                self.child = None;
                let (exit, at) = (Exit::from(status), at.to_owned());
                Err(Failure::Ended { exit, at })
            }
            _ => Ok(()),
        }
    }

    /// Asks the program to end, with the reason if there is one, and makes sure that it does. Other
    /// processes of its group end with it.
    pub(crate) fn end(mut self, reason: &str) {
        self.page.give_reason(reason);
        self.page.ask(REQUEST_STOP, 0);
        if let Some(mut child) = self.child.take() {
            let began = Instant::now();
            while began.elapsed() < GRACE && matches!(child.try_wait(), Ok(None)) {
                std::thread::sleep(LOOK);
            }
            if matches!(child.try_wait(), Ok(None)) {
                runtime::complain(&format_args!(
                    "the program of {} has not ended within {} s and is killed",
                    self.process,
                    GRACE.as_secs()
                ));
                let _ = child.kill();
                let _ = child.wait();
            }
        }
        if let Some(group) = self.group {
            let _ = kill_process_group(group, Signal::KILL);
        }
    }
}

/// Starts the command in its own process group, so that it cannot outlive this process, which may
/// be killed at any tick.
fn start(mut command: Command, page: &Page) -> std::io::Result<Child> {
    let parent = getpid();
    // Its output goes into the log of the run.
    command
        .env(EXCHANGE_VARIABLE, page.path())
        .stdin(Stdio::null())
        .stdout(std::io::stderr())
        .process_group(0);
    // SAFETY: between fork and exec only two system calls are made; nothing is allocated or locked.
    unsafe {
        command.pre_exec(move || {
            set_parent_process_death_signal(Some(Signal::KILL))?;
            // The parent may have died before the line above: then the signal never comes.
            if getppid() == Some(parent) {
                Ok(())
            } else {
                Err(rustix::io::Errno::SRCH.into())
            }
        });
    }
    command.spawn()
}
