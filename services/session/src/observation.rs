//! A running graph, read from its control page without affecting its processes.

use std::path::Path;
use std::time::Instant;

use runtime::{
    ControlPage, ControlPageError, Counts, Distribution, FaultRecord, LiveSingularity, LiveState,
    Manifest, RunDir, SHM, State, Stop,
};
use serde::Serialize;
use shared_types::codes::{self, name_of, singularity_name};
use shared_types::fault::Kind;

use crate::Failure;

/// The run of this name, or the only living one.
///
/// # Errors
/// [`Failure::Input`] with the names of the living runs.
pub fn choose(wanted: Option<&str>) -> Result<String, Failure> {
    let alive: Vec<String> = RunDir::list()
        .into_iter()
        .filter(|run| run.alive)
        .map(|run| run.name)
        .collect();
    let listed = || {
        if alive.is_empty() {
            "none".to_owned()
        } else {
            alive.join(", ")
        }
    };
    match (wanted, &alive[..]) {
        (Some(wanted), _) if alive.iter().any(|name| name == wanted) => Ok(wanted.to_owned()),
        (Some(wanted), _) => Err(Failure::Input(format!(
            "no run {wanted} is alive; alive: {}",
            listed()
        ))),
        (None, [only]) => Ok(only.clone()),
        (None, []) => Err(Failure::Input(
            "no run is alive; start one with `armplane run`".to_owned(),
        )),
        (None, _) => Err(Failure::Input(format!(
            "several runs are alive; choose one with --run: {}",
            listed()
        ))),
    }
}

/// The run that a command is about to change: the one of this name, or the only living one where it was started from this folder.
///
/// # Errors
/// [`Failure::Input`] with the names of the living runs.
pub fn choose_to_change(wanted: Option<&str>) -> Result<String, Failure> {
    let name = choose(wanted)?;
    let launcher = RunDir::list()
        .into_iter()
        .find(|run| run.name == name)
        .map(|run| run.launcher_pid)
        .unwrap_or_default();
    let (here, there) = (
        std::env::current_dir().ok(),
        std::fs::read_link(format!("/proc/{launcher}/cwd")).ok(),
    );
    if wanted.is_none() && (here.is_none() || here != there) {
        let folder = there.map_or("another folder".to_owned(), |folder| {
            folder.display().to_string()
        });
        return Err(Failure::Input(format!(
            "the only run alive is {name}, started from {folder}; if you mean it, give --run {name}"
        )));
    }
    Ok(name)
}

/// Percentiles of times between two samples of a run; the longest covers the whole run; µs.
#[derive(Debug, Serialize)]
pub struct Times {
    /// Times between the two samples.
    pub count: u64,
    /// Median.
    pub p50: Option<f64>,
    /// 99th percentile.
    pub p99: Option<f64>,
    /// 99.9th percentile.
    pub p999: Option<f64>,
    /// Longest of the run.
    pub max: f64,
    /// Times in the whole run.
    #[serde(skip)]
    pub in_all: u64,
}

/// One process between two samples.
#[derive(Debug, Serialize)]
pub struct ObservedProcess {
    /// Its name in the graph.
    pub name: String,
    /// Its state.
    pub state: &'static str,
    /// Its process id.
    pub pid: u32,
    /// How often it was started.
    pub starts: u32,
    /// The core that it is pinned to.
    pub core: Option<usize>,
    /// Ticks closed.
    pub ticks: u64,
    /// Ticks closed per second of wall-clock time.
    pub ticks_per_s: f64,
    /// Deadlines of torque that were missed because of it: it was the first of the chain that had not sent.
    pub missed: u64,
    /// All its counters.
    pub counts: Counts,
    /// Input to output.
    pub step_us: Times,
    /// Since the tick's sample.
    pub age_us: Times,
}

/// One singularity, as the analyzer last reported it.
#[derive(Debug, Serialize)]
pub struct ObservedSingularity {
    /// Its name.
    pub name: String,
    /// s_i, in the unit of its measure.
    pub s: f64,
    /// Whether the arm is inside its neighbourhood.
    pub inside: bool,
    /// Its type.
    #[serde(rename = "type")]
    pub class: &'static str,
    /// The law's mode at it.
    pub mode: &'static str,
}

/// One entry of the fault table.
#[derive(Debug, Serialize)]
pub struct ObservedFault {
    /// Its process.
    pub process: String,
    /// Its kind.
    pub kind: &'static str,
    /// `"planned"`, `"live"` or `"detected"`.
    pub origin: &'static str,
    /// Its first tick.
    pub tick: u64,
    /// Whether it is in force.
    pub active: bool,
}

/// A run between two samples of its control page; serialises to the JSON of `armplane top --json`.
#[derive(Debug, Serialize)]
pub struct Observation {
    /// The run's name.
    pub run: String,
    /// `"lockstep"` or `"realtime"`.
    pub mode: &'static str,
    /// Ticks per second of the arm's time.
    pub rate_hz: u32,
    /// In the order of the graph.
    pub processes: Vec<ObservedProcess>,
    /// The drive's state.
    pub drive: &'static str,
    /// Ticks without a fresh torque.
    pub stale_ticks: u64,
    /// The task's phase.
    pub phase: &'static str,
    /// In the order of the report.
    pub singularities: Vec<ObservedSingularity>,
    /// In the order of the fault table.
    pub faults: Vec<ObservedFault>,
}

struct ProcessSample {
    pid: u32,
    incarnation: u32,
    state: State,
    ticks: u64,
    counts: Counts,
    step: Distribution,
    age: Distribution,
}

struct Sample {
    at: Instant,
    processes: Vec<ProcessSample>,
    arm: LiveState,
    faults: Vec<FaultRecord>,
}

/// Samples the control page of one run.
pub struct Observer {
    run: RunDir,
    name: String,
    manifest: Manifest,
    control_page: ControlPage,
    before: Sample,
}

impl Observer {
    /// Opens a living run.
    ///
    /// # Errors
    /// The run has ended, or its files cannot be read.
    pub fn open(name: &str) -> Result<Self, Failure> {
        let run = RunDir::open(&Path::new(SHM).join(name)).map_err(Failure::input)?;
        let manifest = Manifest::read(&run).map_err(Failure::work)?;
        let control_page =
            ControlPage::open(&run).map_err(|error: ControlPageError| Failure::work(error))?;
        let before = sample(&control_page, &manifest);
        Ok(Self {
            run,
            name: name.to_owned(),
            manifest,
            control_page,
            before,
        })
    }

    /// Whether the run is over.
    pub fn is_over(&self) -> bool {
        self.control_page.stop() != Stop::No || !self.run.path().exists()
    }

    /// The run since the last call, or since [`Observer::open`].
    pub fn observe(&mut self) -> Observation {
        let now = sample(&self.control_page, &self.manifest);
        let elapsed_s = (now.at - self.before.at).as_secs_f64().max(1e-9);
        let process = |index: usize| {
            let (described, before, now) = (
                &self.manifest.processes[index],
                &self.before.processes[index],
                &now.processes[index],
            );
            ObservedProcess {
                name: described.name.clone(),
                state: state(now.state),
                pid: now.pid,
                starts: now.incarnation,
                core: described.core,
                ticks: now.ticks,
                ticks_per_s: now.ticks.saturating_sub(before.ticks) as f64 / elapsed_s,
                missed: now.counts.silent,
                counts: now.counts,
                step_us: times(&before.step, &now.step),
                age_us: times(&before.age, &now.age),
            }
        };
        let tick = now
            .processes
            .iter()
            .map(|sample| sample.ticks)
            .max()
            .unwrap_or(0);
        let fault = |record: &FaultRecord| ObservedFault {
            process: self
                .manifest
                .processes
                .get(record.scheduled.process as usize)
                .map(|one| one.name.clone())
                .unwrap_or_default(),
            kind: record.scheduled.kind().map_or("unknown", Kind::name),
            origin: record.origin.name(),
            tick: record.scheduled.at,
            active: record.scheduled.concerns(tick),
        };
        let observation = Observation {
            run: self.name.clone(),
            mode: self.manifest.mode.name(),
            rate_hz: self.manifest.rate_hz,
            processes: (0..now.processes.len()).map(process).collect(),
            drive: name_of(codes::DRIVES, now.arm.drive),
            stale_ticks: now.arm.stale_ticks.into(),
            phase: name_of(codes::PHASES, now.arm.phase),
            singularities: now
                .arm
                .singularities
                .iter()
                .enumerate()
                .map(singularity)
                .collect(),
            faults: now.faults.iter().map(fault).collect(),
        };
        self.before = now;
        observation
    }
}

fn sample(control_page: &ControlPage, manifest: &Manifest) -> Sample {
    let process = |index: usize| {
        let entry = control_page.process(index);
        ProcessSample {
            pid: entry.pid(),
            incarnation: entry.incarnation(),
            state: entry.state(),
            ticks: entry.ticks(),
            counts: entry.counts(),
            step: entry.step(),
            age: entry.age(),
        }
    };
    Sample {
        at: Instant::now(),
        processes: (0..manifest.processes.len()).map(process).collect(),
        arm: control_page.live_state(),
        faults: control_page
            .fault_table()
            .records()
            .map(|(_, record)| record)
            .collect(),
    }
}

fn state(state: State) -> &'static str {
    match state {
        State::Absent => "absent",
        State::Starting => "starting",
        State::Ready => "ready",
        State::Connected => "connected",
        State::Running => "running",
        State::Gone => "gone",
        State::Stopped => "stopped",
    }
}

fn times(before: &Distribution, now: &Distribution) -> Times {
    let spread = now.since(before);
    let [p50, p99, p999] = [0.5, 0.99, 0.999].map(|share| spread.quantile_us(share));
    Times {
        count: spread.count(),
        p50,
        p99,
        p999,
        max: now.longest_us(),
        in_all: now.count(),
    }
}

fn singularity((place, one): (usize, &LiveSingularity)) -> ObservedSingularity {
    ObservedSingularity {
        name: singularity_name(one.kind, place).to_owned(),
        s: one.s,
        inside: one.is_inside,
        class: name_of(codes::TYPES, one.class),
        mode: name_of(codes::MODES, one.mode),
    }
}
