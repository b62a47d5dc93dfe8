//! Messages around a ring of processes, by each mechanism in alternating rounds of one run.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use launcher::{Begin, Child, Event, Launcher, Limits, Outcome, Plan, Ran};
use runtime::{Mode, Process, ProcessError, Shell, now_ns, realtime};
use serde::{Deserialize, Serialize};
use session::{Failure, Observer, Progress};
use shared_types::topics::OfTopic;

use super::transports::{self, Ends, Kind, Mechanism, Place};
use super::{Distribution, histogram};
use crate::end::{check, mishap};

const TASK: &str = "ring.json";
const MEASURED: &str = "measured.json";
const PRIORITY: u8 = 80;

/// A ring of processes and what goes around in it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Ring {
    /// The message from process i to process i + 1.
    pub(super) topics: Vec<String>,
    /// The core of each process; with `None` the kernel chooses it, without FIFO.
    pub(super) cores: Vec<Option<usize>>,
    pub(super) mechanisms: Vec<Mechanism>,
    /// Rounds of each mechanism that are measured; one more comes before, which warms everything up.
    pub(super) rounds: u64,
    /// Trips around the ring in a round.
    pub(super) trips: u64,
    /// Hand-overs that a trip counts as.
    pub(super) share: f64,
}

impl Ring {
    /// Runs it in processes of its own.
    pub(super) fn measure(
        &self,
        observer: Observer<'_>,
    ) -> Result<Vec<(Mechanism, Distribution)>, Failure> {
        // Until everything of the ring is removed.
        let mut signals = session::interrupts()?;
        let launcher = Launcher::prepare(self.plan()).map_err(Failure::work)?;
        let folder = launcher.run_dir().to_owned();
        let task = serde_json::to_vec(self).map_err(Failure::work)?;
        std::fs::write(folder.join(TASK), task)
            .and_then(|()| transports::create(&folder, self.topics.len()))
            .map_err(Failure::work)?;
        let mut measured = None;
        let command = |process: &str, run: &Path| {
            let mut command = Command::new(std::env::current_exe()?);
            command.args(["bench-peer", process, "--run"]).arg(run);
            Ok(command)
        };
        let outcome = launcher.run(&command, &|_| None, &mut |event| match event {
            Event::Line { process, line } => {
                observer(Progress::Line(&format!("{process}: {line}")))
            }
            Event::Stopped => measured = std::fs::read(folder.join(MEASURED)).ok(),
            _ => {}
        });
        check(&mut signals)?;
        let outcome = ended(outcome.map_err(Failure::work)?)?;
        match mishap(&outcome.end)? {
            None => serde_json::from_slice(&measured.unwrap_or_default()).map_err(Failure::work),
            Some(mishap) => Err(Failure::work(mishap)),
        }
    }

    /// Its processes: each reads what the one before it writes.
    fn plan(&self) -> Plan {
        let count = self.topics.len();
        let children = (0..count).map(|index| Child {
            process: Process {
                name: peer_name(index),
                hop: Some(index),
                reads: vec![self.topics[(index + count - 1) % count].clone()],
                writes: vec![self.topics[index].clone()],
                core: self.cores[index],
                ..Process::default()
            },
            ends_run: index == 0,
            most_restarts: 0,
            longest_stop: None,
        });
        Plan {
            mode: Mode::Lockstep,
            rate_hz: 1000,
            children: children.collect(),
            messages: Vec::new(),
            limits: Limits {
                // None of them has anything to finish.
                stop: Duration::from_millis(100),
                ..Limits::of(Mode::Lockstep)
            },
            faults: Vec::new(),
            begin: Begin::default(),
        }
    }
}

fn ended(ran: Ran) -> Result<Outcome, Failure> {
    match ran {
        Ran::Ended(outcome) => Ok(*outcome),
        Ran::RolledBack(_) => {
            let reason = "a process of the ring was killed: measure again";
            Err(Failure::Work(reason.to_owned()))
        }
    }
}

/// The name of a process of a ring.
fn peer_name(index: usize) -> String {
    format!("peer-{index}")
}

/// One process of a ring, as the launcher starts it.
///
/// # Errors
/// [`ProcessError`] where it cannot join the ring, a message is not the one that was sent, or the run stops.
pub fn peer(name: &str, run: &Path) -> Result<(), ProcessError> {
    let text = std::fs::read(run.join(TASK)).map_err(ProcessError::setup)?;
    let ring: Ring = serde_json::from_slice(&text).map_err(ProcessError::setup)?;
    let count = ring.topics.len();
    let me = (0..count).find(|index| peer_name(*index) == name);
    let me = me.ok_or_else(|| ProcessError::setup(format!("{name:?} is not in the ring")))?;
    let place = Place {
        from: (me + count - 1) % count,
        me,
        to: (me + 1) % count,
    };
    let kind = |index: usize| {
        let topic = &ring.topics[index];
        Kind::named(topic)
            .ok_or_else(|| ProcessError::setup(format!("there is no topic {topic:?}")))
    };
    let kinds = [kind(place.from)?, kind(me)?];
    let shell = Shell::open(run, name)?;
    let mut ends = Vec::new();
    for mechanism in Mechanism::ALL {
        ends.push(transports::open(mechanism, &shell, place, &kinds)?);
    }
    if ring.cores[me].is_some() {
        realtime::enter(Some(PRIORITY), realtime::Lock::AtOnce)
            .iter()
            .for_each(|right| tracing::warn!("measured without {right}"));
    }
    // No measurement before every process is connected, whichever mechanism comes first.
    let mut ticks = shell.tick_source(0);
    ticks.next()?;
    let measured = go_round(&ring, me == 0, &mut ends)?;
    if me == 0 {
        let text = serde_json::to_vec(&measured).map_err(ProcessError::setup)?;
        std::fs::write(run.join(MEASURED), text).map_err(ProcessError::setup)?;
        return Ok(ticks.finish()?);
    }
    // The first process ends the run.
    while !shell.is_stopping() {
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}

/// All rounds of one process: the first sends, and takes the time until the message has come around; the others hand it on.
fn go_round(
    ring: &Ring,
    is_first: bool,
    ends: &mut [Ends],
) -> Result<Vec<(Mechanism, Distribution)>, ProcessError> {
    let mut times: Vec<_> = ring.mechanisms.iter().map(|_| histogram()).collect();
    for round in 0..=ring.rounds {
        for (mechanism, times) in ring.mechanisms.iter().zip(&mut times) {
            let Ends { send, receive } = &mut ends[*mechanism as usize];
            for number in round * ring.trips..(round + 1) * ring.trips {
                let began_ns = now_ns();
                if is_first {
                    send(number)?;
                }
                let came = receive()?;
                if came != number {
                    let name = mechanism.name();
                    let text = format!("{name} handed over message {came} instead of {number}");
                    return Err(ProcessError::setup(text));
                }
                if !is_first {
                    send(number)?;
                } else if round > 0 {
                    times.saturating_record(now_ns() - began_ns);
                }
            }
        }
    }
    let of =
        |(mechanism, times): (&Mechanism, _)| (*mechanism, Distribution::of(times, ring.share));
    Ok(ring.mechanisms.iter().zip(&times).map(of).collect())
}
