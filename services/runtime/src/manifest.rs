//! The run's description for its processes: one small file in the run's directory.

use std::path::PathBuf;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use shared_types::job::Mode;
use shared_types::layout::MessageLayout;
use shared_types::process::MAX_PROCESSES;
use shared_types::{Message, Target};

use crate::control_page::Stop;
use crate::run_dir::RunDir;

/// Beyond it, a tick is no whole number of µs, and no process can keep up.
const FASTEST_HZ: u32 = 1_000_000;

/// Seeded disturbances of the timing of one process: in a sound lockstep run they change no byte.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Disturbance {
    /// A pause before the process joins the run.
    pub start_delay: Duration,
    /// Its nice value, 0 to 19: how readily it lets others go first.
    pub nice: i32,
    /// The seed of random short pauses before it looks for a message; `None` is no pauses.
    pub pauses: Option<u64>,
    /// It accepts the previous tick's message if the right one has not arrived. That breaks
    /// lockstep: what it computes depends on the quicker process. It is here to show that such a
    /// process is caught.
    pub unordered: bool,
    /// It takes in messages of dead incarnations. It is here to show that the drill catches it.
    #[serde(default)]
    pub unfenced: bool,
}

/// One process of the graph, as the others see it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Process {
    /// Its name: the sub-command that runs it.
    pub name: String,
    /// Topics that it reads.
    pub reads: Vec<String>,
    /// Topics that it writes; a topic has one writer.
    pub writes: Vec<String>,
    /// It makes the ticks (the plant): while it is stopped, there are none.
    #[serde(default)]
    pub makes_ticks: bool,
    /// Its place in the stamps of messages; the process that makes the ticks has place 0, and one that writes nothing has none.
    #[serde(default)]
    pub hop: Option<usize>,
    /// The core it is pinned to.
    pub core: Option<usize>,
    /// Its `SCHED_FIFO` priority in real time, 1 to 99.
    pub priority: Option<u8>,
    /// The disturbance that `verify` applies to it; none in an ordinary run.
    #[serde(default)]
    pub disturbance: Disturbance,
}

impl Process {
    /// Whether it only reads (the recorder). It looks for messages by itself: no process wakes it, it is stopped after all others, and in lockstep the source
    /// of ticks waits for it.
    pub fn is_polled(&self) -> bool {
        self.writes.is_empty()
    }

    /// The stage of the run's end that concerns it.
    pub(crate) fn stops_at(&self) -> Stop {
        match self.is_polled() {
            true => Stop::Everything,
            false => Stop::Chain,
        }
    }
}

/// The run as all its processes know it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// How time passes.
    pub mode: Mode,
    /// Ticks per second of the arm's time.
    pub rate_hz: u32,
    /// The longest a process waits for another one before it gives up; `None` is without limit.
    pub wait_limit: Option<Duration>,
    /// All processes; the index is the process's line on the control_page.
    pub processes: Vec<Process>,
    /// The messages that only the graph of this run knows.
    #[serde(default)]
    pub messages: Vec<MessageLayout>,
    /// The first tick: 0, or that of the cut from which the processes go on.
    #[serde(default)]
    pub from: u64,
}

/// Why a manifest cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// The file cannot be read or written.
    #[error("cannot use {path}: {source}")]
    File {
        /// The path.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is not a manifest of this version.
    #[error("{path} is not a manifest that this version of armplane wrote: {source}")]
    Syntax {
        /// The path.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// Too many processes for the control_page.
    #[error(
        "the graph has {count} processes; at most {MAX_PROCESSES} have room on the control page"
    )]
    TooMany {
        /// The count.
        count: usize,
    },
    /// No tick rate that a run can have.
    #[error("the tick rate is {rate_hz} Hz; it must be 1 to {FASTEST_HZ}")]
    Rate {
        /// The rate asked for.
        rate_hz: u32,
    },
}

impl Manifest {
    /// Whether time passes tick by tick.
    pub fn is_lockstep(&self) -> bool {
        self.mode == Mode::Lockstep
    }

    /// All topics of the run, sorted: the index is the topic's bit on every doorbell.
    pub fn topics(&self) -> Vec<&str> {
        let mut topics: Vec<&str> = self
            .processes
            .iter()
            .flat_map(|p| p.reads.iter().chain(&p.writes))
            .map(String::as_str)
            .collect();
        topics.sort_unstable();
        topics.dedup();
        topics
    }

    /// The topic's place in [`topics`](Self::topics), 0 if it has none.
    pub(crate) fn topic_index(&self, topic: &str) -> usize {
        let topics = self.topics();
        topics.iter().position(|&one| one == topic).unwrap_or(0)
    }

    /// The names of all processes, for a message.
    pub fn names(&self) -> String {
        let names: Vec<_> = self.processes.iter().map(|p| p.name.as_str()).collect();
        names.join(", ")
    }

    /// The process's line on the control_page.
    pub fn index_of(&self, process: &str) -> Option<usize> {
        self.processes.iter().position(|p| p.name == process)
    }

    /// The message of a topic that only the graph of this run knows.
    pub fn message(&self, topic: &str) -> Option<&MessageLayout> {
        self.messages.iter().find(|message| message.topic == topic)
    }

    /// The one process that writes a topic.
    pub fn writer_of(&self, topic: &str) -> Option<usize> {
        self.processes
            .iter()
            .position(|p| p.writes.iter().any(|t| t == topic))
    }

    /// The topics on which a message of this one waits, itself the last, each with its writer, in the order of the data. Targets are no part of it: no
    /// torque waits for them.
    pub(crate) fn chain_to(&self, topic: &str) -> Vec<(usize, usize)> {
        let mut hops: Vec<_> = self.processes.iter().enumerate().collect();
        hops.retain(|(_, process)| process.hop.is_some());
        hops.sort_by_key(|(_, process)| std::cmp::Reverse(process.hop));
        let (mut awaited, mut chain) = (vec![topic], Vec::new());
        for (index, process) in hops {
            let before = chain.len();
            let writes = process.writes.iter().map(String::as_str);
            chain.extend(
                writes
                    .filter(|topic| awaited.contains(topic) && *topic != Target::TOPIC)
                    .map(|topic| (self.topic_index(topic), index)),
            );
            if chain.len() > before && !process.makes_ticks {
                awaited.extend(process.reads.iter().map(String::as_str));
            }
        }
        chain.reverse();
        chain
    }

    /// How many processes read a topic.
    pub(crate) fn readers_of(&self, topic: &str) -> usize {
        self.processes
            .iter()
            .filter(|process| process.reads.iter().any(|read| read == topic))
            .count()
    }

    /// The processes that a message on this topic wakes.
    pub fn woken_by<'a>(&'a self, topic: &'a str) -> impl Iterator<Item = usize> + 'a {
        let reads = move |p: &Process| !p.is_polled() && p.reads.iter().any(|t| t == topic);
        self.processes
            .iter()
            .enumerate()
            .filter(move |(_, p)| reads(p))
            .map(|(index, _)| index)
    }

    /// One tick of the arm's time; ns.
    pub fn period_ns(&self) -> u64 {
        1_000_000_000 / u64::from(self.rate_hz)
    }

    /// Writes it into the run's directory.
    ///
    /// # Errors
    /// When it contradicts itself or the file cannot be written.
    pub fn write(&self, run: &RunDir) -> Result<(), ManifestError> {
        self.check()?;
        let path = run.path().join("manifest.json");
        let text = serde_json::to_vec_pretty(self).map_err(|source| ManifestError::Syntax {
            path: path.clone(),
            source,
        })?;
        std::fs::write(&path, text).map_err(|source| ManifestError::File { path, source })
    }

    /// Reads it from the run's directory.
    ///
    /// # Errors
    /// When there is none, or it is not one of this version.
    pub fn read(run: &RunDir) -> Result<Self, ManifestError> {
        let path = run.path().join("manifest.json");
        let text = std::fs::read(&path).map_err(|source| ManifestError::File {
            path: path.clone(),
            source,
        })?;
        let manifest: Self = serde_json::from_slice(&text)
            .map_err(|source| ManifestError::Syntax { path, source })?;
        manifest.check()?;
        Ok(manifest)
    }

    fn check(&self) -> Result<(), ManifestError> {
        if self.processes.len() > MAX_PROCESSES {
            return Err(ManifestError::TooMany {
                count: self.processes.len(),
            });
        }
        if !(1..=FASTEST_HZ).contains(&self.rate_hz) {
            return Err(ManifestError::Rate {
                rate_hz: self.rate_hz,
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn process(name: &str, reads: &[&str], writes: &[&str]) -> Process {
        let own = |names: &[&str]| names.iter().map(ToString::to_string).collect();
        Process {
            name: name.into(),
            reads: own(reads),
            writes: own(writes),
            ..Process::default()
        }
    }

    fn manifest(rate_hz: u32, processes: Vec<Process>) -> Manifest {
        Manifest {
            mode: Mode::Lockstep,
            rate_hz,
            wait_limit: Some(Duration::from_secs(1)),
            processes,
            messages: Vec::new(),
            from: 0,
        }
    }

    #[test]
    fn it_survives_the_file_and_knows_who_talks_to_whom() {
        let (run, processes) = (
            RunDir::create().unwrap(),
            vec![
                process("plant", &["torque"], &["sensor"]),
                process("controller", &["sensor"], &["torque"]),
                process("recorder", &["sensor", "torque"], &[]),
            ],
        );
        let written = manifest(1000, processes);
        written.write(&run).unwrap();
        let read = Manifest::read(&run).unwrap();
        assert_eq!(read, written);
        assert_eq!(read.topics(), ["sensor", "torque"]);
        assert_eq!(
            (read.writer_of("torque"), read.period_ns()),
            (Some(1), 1_000_000)
        );
        assert_eq!(
            read.woken_by("sensor").collect::<Vec<_>>(),
            [1],
            "the recorder polls"
        );
    }

    #[test]
    fn contradictions_are_refused() {
        let run = RunDir::create().unwrap();
        let refused = |rate_hz, processes| manifest(rate_hz, processes).write(&run).unwrap_err();
        let crowd = (0..=MAX_PROCESSES).map(|i| process(&i.to_string(), &[], &[]));
        assert!(matches!(
            refused(1, crowd.collect()),
            ManifestError::TooMany { .. }
        ));
        for rate_hz in [0, FASTEST_HZ + 1, u32::MAX] {
            assert!(matches!(
                refused(rate_hz, vec![]),
                ManifestError::Rate { .. }
            ));
        }
    }
}
