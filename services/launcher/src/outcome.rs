//! Failures of a run, and its outcome.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use runtime::{
    ControlPageError, Exit, FaultRecord, MOST_FAULTS, ManifestError, RunDirError, SHM, TopicError,
};

/// Why a run could not be prepared; nothing of it is left.
#[derive(Debug, thiserror::Error)]
pub enum LaunchError {
    /// Its directory.
    #[error(transparent)]
    RunDir(#[from] RunDirError),
    /// Its manifest.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    /// Its control page.
    #[error(transparent)]
    ControlPage(#[from] ControlPageError),
    /// Its topics.
    #[error(transparent)]
    Topic(#[from] TopicError),
    /// A process.
    #[error("cannot start {process} ({command}): {source}")]
    Spawn {
        /// The process.
        process: String,
        /// The command.
        command: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The states from which its processes go on.
    #[error("no memory for the states from which the processes go on: {0}")]
    Cut(io::Error),
    /// More faults than a run can have.
    #[error("{count} faults are planned, but a run takes at most {MOST_FAULTS}: plan fewer")]
    TooManyFaults {
        /// The count.
        count: usize,
    },
    /// Signals cannot be caught.
    #[error("cannot catch SIGINT, SIGTERM and the like: {0}")]
    Signals(io::Error),
    /// No second thread.
    #[error("cannot start a second thread of the launcher: {0}")]
    Sweeper(io::Error),
}

/// The failure of a run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// A process ended unasked.
    #[error("{process} (process {pid}) ended unexpectedly with {exit} at tick {tick}{}{}{}{}{}", spent(*restarts), rolled_back(*roll_backs), stranger(*exit, *tick), hint(suspect), said(last_words))]
    Died {
        /// The process.
        process: String,
        /// Its process id.
        pid: u32,
        /// The exit.
        exit: Exit,
        /// The first tick that it did not answer.
        tick: u64,
        /// How often it had been started again.
        restarts: u32,
        /// How often all processes had been started again for deaths.
        roll_backs: u32,
        /// Another process that had fallen behind before, which may be the reason.
        suspect: Option<String>,
        /// The end of its standard error.
        last_words: Vec<String>,
    },
    /// A process died in real time, and its death cannot be kept.
    #[error(
        "{process} died at tick {tick}, and the fault table is full ({MOST_FAULTS} faults): plan fewer"
    )]
    NoRoom {
        /// The process.
        process: String,
        /// The first tick without its messages.
        tick: u64,
    },
    /// The run's directory is gone: no process can be replaced, and the recorder has nowhere to leave its account.
    #[error(
        "the run's files in {SHM} are gone since tick {tick}: something has emptied it; run it again"
    )]
    Emptied {
        /// The tick.
        tick: u64,
    },
    /// A process did not get ready.
    #[error(
        "{process} was not ready for the first tick within {limit:?}: it must open its topics and ask for its first message"
    )]
    Slow {
        /// The process.
        process: String,
        /// The limit.
        limit: Duration,
    },
    /// A process did not stop after the request and SIGTERM.
    #[error("{process} (process {pid}) did not stop within {limit:?} and was killed")]
    DidNotStop {
        /// The process.
        process: String,
        /// Its process id.
        pid: u32,
        /// The limit.
        limit: Duration,
    },
}

impl Failure {
    /// The process that has failed; empty where none has.
    pub fn process(&self) -> &str {
        match self {
            Self::Emptied { .. } => "",
            Self::Died { process, .. }
            | Self::NoRoom { process, .. }
            | Self::Slow { process, .. }
            | Self::DidNotStop { process, .. } => process,
        }
    }
}

fn spent(restarts: u32) -> String {
    if restarts == 0 {
        String::new()
    } else {
        format!(" after {restarts} restarts, all that its budget allows")
    }
}

fn rolled_back(roll_backs: u32) -> String {
    match roll_backs {
        0 => String::new(),
        1 => " after a roll-back".to_owned(),
        _ => format!(" after {roll_backs} roll-backs to the same tick"),
    }
}

/// A program that ends well before the first tick has not heard of the run.
fn stranger(exit: Exit, tick: u64) -> &'static str {
    match exit.is_success() && tick == 0 {
        true => ", before it took part in the run (docs/wire.md shows how a program does)",
        false => "",
    }
}

fn hint(suspect: &Option<String>) -> String {
    suspect
        .as_ref()
        .map(|name| format!(" ({name} was behind)"))
        .unwrap_or_default()
}

/// The line that tells most of its end; all of them have been shown.
fn said(last_words: &[String]) -> String {
    let own = |line: &String| line.strip_prefix("armplane: ").map(str::to_owned);
    let line = last_words.iter().rev().find_map(own);
    line.or_else(|| last_words.last().cloned())
        .map_or_else(String::new, |line| format!(": {line}"))
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// All ticks are done.
    Completed,
    /// By a signal to the launcher.
    Interrupted {
        /// Which signal.
        signal: &'static str,
    },
    /// Something went wrong.
    Failed(Failure),
}

/// The unplanned end of a process in lockstep.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Death {
    /// The process.
    pub process: String,
    /// The first tick that it had not closed.
    pub tick: u64,
    /// The exit.
    pub exit: Exit,
    /// The last line that it wrote to its standard error.
    pub last_line: Option<String>,
    /// From which tick all processes started again, and the time that was lost; `None`: they did not.
    pub again: Option<(u64, Duration)>,
}

/// The outcome of one process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessOutcome {
    /// Its name.
    pub name: String,
    /// The process id of its last incarnation.
    pub pid: u32,
    /// How often it was started again for its own end, alone or with all others.
    pub restarts: u32,
    /// How its last incarnation ended.
    pub exit: Exit,
    /// Lines of its standard error that were dropped, because they came faster than they were taken, or after its end.
    pub lines_dropped: u64,
    /// Everything it counted, by name: ticks with torque and without, refused, lost and repeated messages.
    pub counts: runtime::Counts,
}

/// The outcome of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// How it ended.
    pub end: End,
    /// Ticks done.
    pub ticks: u64,
    /// Its processes, in the order of the plan.
    pub processes: Vec<ProcessOutcome>,
    /// Its faults, planned and live, in the order in which they were known.
    pub faults: Vec<FaultRecord>,
    /// Deaths in lockstep that no plan had.
    pub deaths: Vec<Death>,
    /// By process and tick of its end in real time: the last line that it wrote to its standard error.
    pub last_lines: Vec<(usize, u64, String)>,
}
