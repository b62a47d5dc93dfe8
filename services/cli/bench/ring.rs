//! Messages around a ring of processes: over topics, and over the floors, in turns within one run.

use std::path::Path;
use std::process::Command;

use launcher::{Child, End, Event, Launcher, Limits, Plan, Restart};
use runtime::floor::{Floor, Wake};
use runtime::{Process, ProcessError, Reader, Shell, Writer, now_ns, realtime, sleep_until};
use serde::{Deserialize, Serialize};
use shared_types::wire::HOPS;
use shared_types::{Message, PlantState, SensorSample, SingularityReport, StateEstimate, TorqueCommand};

use super::super::failure::Failure;
use super::Distribution;

const TASK: &str = "ring.json";
const MEASURED: &str = "measured.json";
const PRIORITY: u8 = 80;

/// How a message gets to the next process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Mechanism {
    /// A topic with its doorbell, as in a run: stamped, checked, hashed by whoever likes.
    Topic,
    Futex,
    Pipe,
    Spin,
    /// Not at all: only the first process keeps its rhythm.
    Nothing,
}

impl Mechanism {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Topic => "topic + doorbell",
            Self::Futex => "futex + copy",
            Self::Pipe => "pipe",
            Self::Spin => "spin + copy",
            Self::Nothing => "clock_nanosleep",
        }
    }
}

/// A ring of processes and what goes around in it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Ring {
    /// What process i sends to process i + 1.
    pub(super) topics: Vec<String>,
    /// The core of each process; `None` is wherever the kernel likes, without FIFO.
    pub(super) cores: Vec<Option<usize>>,
    pub(super) mechanisms: Vec<Mechanism>,
    /// Blocks of each mechanism that are measured; one more comes before, which warms everything up.
    pub(super) rounds: u64,
    /// Trips around the ring in a block.
    pub(super) trips: u64,
    /// Trips begin on a grid; `None` is one after the other.
    pub(super) period_ns: Option<u64>,
}

/// What one mechanism took.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Measured {
    pub(super) mechanism: Mechanism,
    /// Once around, from the grid point where there is one, so that a late trip delays nobody's clock.
    pub(super) trip: Distribution,
    /// From the grid point to the first instruction after it.
    pub(super) wake: Distribution,
}

impl Ring {
    /// Runs it in processes of its own.
    pub(super) fn measure(&self) -> Result<Vec<Measured>, Failure> {
        let count = self.topics.len();
        let children = (0..count).map(|index| Child {
            process: Process {
                name: HOPS[index].to_owned(),
                reads: vec![self.topics[(index + count - 1) % count].clone()],
                writes: vec![self.topics[index].clone()],
                core: self.cores[index],
                ..Process::default()
            },
            ends_run: index == 0,
            restart: Restart::Never,
        });
        let plan = Plan {
            mode: runtime::Mode::Lockstep,
            rate_hz: 1000,
            children: children.collect(),
            limits: Limits::default(),
            faults: Vec::new(),
        };
        let launcher = Launcher::prepare(plan).map_err(Failure::work)?;
        let folder = launcher.run_dir().to_owned();
        let task = serde_json::to_vec(self).map_err(Failure::work)?;
        std::fs::write(folder.join(TASK), task).and_then(|()| Floor::create(&folder, count)).map_err(Failure::work)?;
        let mut measured = None;
        let command = |process: &str, run: &Path| {
            let mut command = Command::new(std::env::current_exe()?);
            command.args(["bench-peer", process, "--run"]).arg(run);
            Ok(command)
        };
        let outcome = launcher.run(&command, &mut |event| match event {
            Event::Line { process, line } => eprintln!("{process}: {line}"),
            Event::Stopped => measured = std::fs::read(folder.join(MEASURED)).ok(),
            _ => {}
        });
        match outcome.map_err(Failure::work)?.end {
            End::Completed => serde_json::from_slice(&measured.unwrap_or_default()).map_err(Failure::work),
            End::Interrupted { signal } => Err(Failure::Work(format!("stopped by {signal}"))),
            End::Failed(failure) => Err(Failure::work(failure)),
        }
    }
}

/// One process of a ring, as the launcher starts it.
pub(super) fn peer(name: &str, run: &Path) -> Result<(), ProcessError> {
    let text = std::fs::read(run.join(TASK)).map_err(ProcessError::setup)?;
    let ring: Ring = serde_json::from_slice(&text).map_err(ProcessError::setup)?;
    let index = HOPS.iter().position(|hop| *hop == name).filter(|index| *index < ring.topics.len());
    let index = index.ok_or_else(|| ProcessError::setup(format!("{name:?} is not in the ring")))?;
    let count = ring.topics.len();
    let (reads, writes) = (ring.topics[(index + count - 1) % count].as_str(), ring.topics[index].as_str());
    match (reads, writes) {
        ("plant_state", "sensor") => go::<PlantState, SensorSample>(&ring, index, run),
        ("sensor", "plant_state") => go::<SensorSample, PlantState>(&ring, index, run),
        ("torque", "singularity") => go::<TorqueCommand, SingularityReport>(&ring, index, run),
        ("singularity", "torque") => go::<SingularityReport, TorqueCommand>(&ring, index, run),
        ("torque", "sensor") => go::<TorqueCommand, SensorSample>(&ring, index, run),
        ("sensor", "estimate") => go::<SensorSample, StateEstimate>(&ring, index, run),
        ("estimate", "singularity") => go::<StateEstimate, SingularityReport>(&ring, index, run),
        _ => Err(ProcessError::setup(format!("no ring leads from {reads} to {writes}"))),
    }
}

/// Both ends that a process has, by topic and by floor.
struct Ends<In: Message, Out: Message> {
    reader: Reader<In>,
    writer: Writer<Out>,
    floor: Floor,
    from: usize,
    to: usize,
    /// Messages sent on the topic: their ticks follow each other.
    sent: u64,
}

impl<In: Message + Default, Out: Message + Default> Ends<In, Out> {
    fn send(&mut self, mechanism: Mechanism) -> Result<(), ProcessError> {
        let mut message = Out::default();
        let wake = match mechanism {
            Mechanism::Topic => {
                message.header_mut().tick = self.sent;
                self.sent += 1;
                return Ok(self.writer.send(message)?);
            }
            Mechanism::Futex => Wake::Futex,
            Mechanism::Pipe => Wake::Pipe,
            Mechanism::Spin => Wake::Spin,
            Mechanism::Nothing => return Ok(()),
        };
        self.floor.send(wake, self.to, &message).map_err(ProcessError::setup)
    }

    fn receive(&mut self, mechanism: Mechanism) -> Result<(), ProcessError> {
        let wake = match mechanism {
            Mechanism::Topic => {
                let message = self.reader.next()?.ok_or_else(|| ProcessError::setup("stopped before the end"))?;
                std::hint::black_box(message);
                return Ok(());
            }
            Mechanism::Futex => Wake::Futex,
            Mechanism::Pipe => Wake::Pipe,
            Mechanism::Spin => Wake::Spin,
            Mechanism::Nothing => return Ok(()),
        };
        std::hint::black_box(self.floor.receive::<In>(wake, self.from).map_err(ProcessError::setup)?);
        Ok(())
    }
}

fn go<In: Message + Default, Out: Message + Default>(ring: &Ring, index: usize, run: &Path) -> Result<(), ProcessError> {
    let count = ring.topics.len();
    let shell = Shell::open(run, HOPS[index])?;
    let (reader, writer) = (shell.reader()?, shell.writer()?);
    let floor = Floor::open(run, count).map_err(ProcessError::setup)?;
    let mut ends = Ends::<In, Out> { reader, writer, floor, from: (index + count - 1) % count, to: index, sent: 0 };
    if ring.cores[index].is_some() {
        realtime::enter(Some(PRIORITY)).iter().for_each(|right| eprintln!("measured without {right}"));
    }
    // Nobody measures before everybody is connected, whichever mechanism comes first.
    shell.pace(0).next()?;
    if index == 0 {
        let measured = drive(ring, &mut ends)?;
        let text = serde_json::to_vec(&measured).map_err(ProcessError::setup)?;
        return std::fs::write(run.join(MEASURED), text).map_err(ProcessError::setup);
    }
    for _ in 0..=ring.rounds {
        for mechanism in ring.mechanisms.iter().copied().filter(|mechanism| *mechanism != Mechanism::Nothing) {
            for _ in 0..ring.trips {
                ends.receive(mechanism)?;
                ends.send(mechanism)?;
            }
        }
    }
    // The end of the run is the first process's to say.
    ends.reader.next()?;
    Ok(())
}

/// The first process: sends, and takes the time until the answer has come around.
fn drive<In: Message + Default, Out: Message + Default>(ring: &Ring, ends: &mut Ends<In, Out>) -> Result<Vec<Measured>, ProcessError> {
    let mut histograms: Vec<_> = ring.mechanisms.iter().map(|_| (super::histogram(), super::histogram())).collect();
    for round in 0..=ring.rounds {
        for (&mechanism, (trips, wakes)) in ring.mechanisms.iter().zip(&mut histograms) {
            let mut grid_ns = now_ns();
            for _ in 0..ring.trips {
                let began_ns = match ring.period_ns {
                    None => now_ns(),
                    Some(period) => {
                        grid_ns += period;
                        while now_ns() < grid_ns {
                            sleep_until(grid_ns);
                        }
                        grid_ns
                    }
                };
                let awake_ns = if ring.period_ns.is_some() { now_ns() } else { began_ns };
                ends.send(mechanism)?;
                ends.receive(mechanism)?;
                let ended_ns = now_ns();
                if round > 0 {
                    trips.saturating_record(ended_ns - began_ns);
                    wakes.saturating_record(awake_ns - began_ns);
                }
            }
        }
    }
    let of = |(&mechanism, (trips, wakes)): (&Mechanism, &(_, _))| Measured {
        mechanism,
        trip: Distribution::of(trips),
        wake: Distribution::of(wakes),
    };
    Ok(ring.mechanisms.iter().zip(&histograms).map(of).collect())
}
