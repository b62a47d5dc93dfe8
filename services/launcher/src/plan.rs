//! The plan of a run: its processes, and the events that it reports.

use std::io;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use runtime::{Exit, FaultTable, Mode, NamedSaved, Process};
use shared_types::fault::ScheduledFault;
use shared_types::layout::MessageLayout;

use crate::delay::Delay;
use crate::outcome::Death;

/// A process to start.
#[derive(Clone, Debug)]
pub struct Child {
    /// As the others see it.
    pub process: Process,
    /// Its successful end, after all ticks, is the end of the run.
    pub ends_run: bool,
    /// How often it is started again in real time after an unrequested end; after one more the run ends. In lockstep all processes start again, whatever
    /// this is; 0 means that an error of its own is the end there too.
    pub most_restarts: u32,
    /// How long it may be stopped (SIGSTOP) where nothing else limits that; `None`: as long as its user likes.
    pub longest_stop: Option<Duration>,
}

/// The launcher's time limits. `None`: no limit, because in lockstep no clock decides about a
/// process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Until all processes are ready.
    pub start: Option<Duration>,
    /// A program that a person starts comes when it comes, and a robot first moves to the start posture: the start has no limit.
    pub awaits_person: bool,
    /// From the request to stop until SIGTERM, and from SIGTERM until SIGKILL.
    pub stop: Duration,
    /// The same for the polled processes (the recorder has files to finish).
    pub stop_polled: Duration,
    /// Whether a process that has not stopped by then is killed although its run is complete.
    pub kills_at_end: bool,
    /// The longest one process waits for another.
    pub wait: Option<Duration>,
    /// A process that makes no progress for so long, while it should, is killed ...
    pub silent: Option<Duration>,
    /// ... or sooner if the kernel reports it as stopped.
    pub stopped: Option<Duration>,
}

/// The time that processes have until they are ready for the first tick.
const START: Duration = Duration::from_secs(20);

impl Limits {
    /// In lockstep a process is killed for a fault or a request of the user, never for the time it takes: it may be stopped, traced, or
    /// share its core with others. In real time a silent process is replaced.
    pub fn of(mode: Mode) -> Self {
        let seconds = Duration::from_secs;
        let patient = Self {
            start: None,
            awaits_person: false,
            stop: seconds(2),
            stop_polled: seconds(30),
            kills_at_end: false,
            wait: None,
            silent: None,
            stopped: None,
        };
        match mode {
            Mode::Lockstep => patient,
            Mode::Realtime => Self {
                start: Some(START),
                kills_at_end: true,
                wait: Some(seconds(10)),
                silent: Some(seconds(2)),
                stopped: Some(Duration::from_millis(100)),
                ..patient
            },
        }
    }

    /// With the user's own limit on how long a process may be silent or stopped; until its first tick it has at least [`START`].
    pub fn with_silence(self, limit: Option<Duration>) -> Self {
        let Some(silent) = limit else {
            return self;
        };
        let start = silent.max(START).max(self.start.unwrap_or_default());
        Self {
            start: (!self.awaits_person).then_some(start),
            silent: limit,
            stopped: limit,
            kills_at_end: true,
            ..self
        }
    }
}

/// The processes to start, and their settings.
#[derive(Clone, Debug)]
pub struct Plan {
    /// How time passes.
    pub mode: Mode,
    /// Ticks per second of the arm's time.
    pub rate_hz: u32,
    /// The processes, in the order of the data: sources first.
    pub children: Vec<Child>,
    /// The messages that only the graph of this run knows.
    pub messages: Vec<MessageLayout>,
    /// How long the launcher is patient.
    pub limits: Limits,
    /// The planned faults.
    pub faults: Vec<ScheduledFault>,
    /// The place at which it begins.
    pub begin: Begin,
}

/// The place at which the processes begin.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Begin {
    /// The first tick: 0, or that of a cut.
    pub tick: u64,
    /// The state of each process there, by its name.
    pub saved: Vec<NamedSaved>,
}

/// An event of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// Ticks done so far; reported regularly.
    Progress {
        /// Ticks that the process whose end ends the run has begun.
        ticks: u64,
    },
    /// A process wrote a line to its standard error.
    Line {
        /// The process.
        process: &'a str,
        /// The line.
        line: &'a str,
    },
    /// A process did nothing more and has been killed for it.
    Silenced {
        /// The process.
        process: &'a str,
        /// For how long it had done nothing.
        silent: Duration,
        /// The tick that it has not closed.
        tick: u64,
        /// The topics whose messages close its ticks.
        writes: &'a [String],
    },
    /// The run waits for a process, for a time that a person notices; reported once for each reason.
    Waiting {
        /// The process.
        process: &'a str,
        /// The reason.
        reason: Delay,
        /// The tick that it has not closed.
        tick: u64,
        /// The topics whose messages close its ticks.
        writes: &'a [String],
    },
    /// Processes ended unasked in lockstep: all start again.
    RolledBack {
        /// The ends.
        deaths: &'a [Death],
        /// The first tick that comes again.
        from: u64,
    },
    /// A process ended unasked in real time and has been started again.
    Restarted {
        /// The process.
        process: &'a str,
        /// How it had ended.
        exit: Exit,
        /// Its new process id.
        pid: u32,
        /// How often it has been started by now.
        incarnation: u32,
    },
    /// All processes have ended, and the run's directory is about to be removed: the last chance to
    /// read it.
    Stopped,
}

/// Gives the command for a process, by its name and the run's directory.
pub(crate) type Commands<'a> = &'a dyn Fn(&str, &Path) -> io::Result<Command>;
/// Gives the newest cut at which a run with these faults can go on, if there is one.
pub(crate) type Newest<'a> = &'a dyn Fn(&FaultTable) -> Option<Begin>;
/// Takes what happens.
pub(crate) type Report<'a> = &'a mut dyn FnMut(Event<'_>);

/// The usual command for a process: this same program again, `armplane NAME --run DIR`.
///
/// # Errors
/// When the operating system does not give this program's path.
pub fn reexec(process: &str, run: &Path) -> io::Result<Command> {
    let mut command = Command::new(std::env::current_exe()?);
    command.arg(process).arg("--run").arg(run);
    Ok(command)
}

/// Starts this program again beside a run, as `armplane NAME --run DIR`: apart from the terminal's signals, as every process of the run, and with a
/// standard input that ends with this process.
///
/// # Errors
/// When it cannot be started.
pub fn start_beside(name: &str, run: &Path) -> io::Result<std::process::Child> {
    let mut command = reexec(name, run)?;
    let command = command.process_group(0).stdin(Stdio::piped());
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_on_silence_limits_the_start_too_but_where_a_person_starts_a_program() {
        let start = |awaits_person, limit_s| {
            let limits = Limits {
                awaits_person,
                ..Limits::of(Mode::Lockstep)
            };
            let limited = limits.with_silence(Some(Duration::from_secs(limit_s)));
            limited.start.map(|limit| limit.as_secs())
        };
        assert_eq!(Limits::of(Mode::Lockstep).start, None);
        assert_eq!(
            [start(false, 1), start(false, 60), start(true, 1)],
            [Some(20), Some(60), None]
        );
    }
}
