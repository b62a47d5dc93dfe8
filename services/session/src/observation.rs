//! A running graph, read from its control page without affecting its processes.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

use runtime::{
    ControlPage, Counts, Distribution, FaultRecord, FoundRun, MAX_PROCESSES, Manifest,
    ProcessEntry, RunDir, SHM, State, Stop,
};
use serde::Serialize;
use shared_types::codes::{self, name_of, singularity_name};
use shared_types::fault::Kind;
use shared_types::job::{JOB, Job};
use shared_types::{
    ControlState, SensorSample, SingularityReport, SingularityState, TorqueCommand,
};

use crate::Failure;
use crate::table::{number, table};
use crate::text::from_here;

/// A run that is alive.
#[derive(Clone, Debug, Serialize)]
pub struct Living {
    /// Its name in shared memory.
    pub run: String,
    /// Its scenario; empty of a bench.
    pub scenario: String,
    /// Its results folder.
    pub folder: PathBuf,
    /// `"lockstep"` or `"realtime"`.
    pub mode: &'static str,
    /// Ticks begun.
    pub tick: u64,
    /// The process that watches over it.
    pub launcher_pid: u32,
}

impl Living {
    /// All of this user's.
    pub fn all() -> Vec<Self> {
        let alive = RunDir::list().into_iter().filter(|run| run.alive);
        // One may end meanwhile.
        alive.filter_map(|found| Self::of(&found)).collect()
    }

    fn of(found: &FoundRun) -> Option<Self> {
        let (run, manifest, page) = open_run(&found.name).ok()?;
        let (scenario, folder) = job(run.path())
            .map(|job| (job.scenario.name, job.out))
            .unwrap_or_default();
        Some(Self {
            run: found.name.clone(),
            scenario,
            folder,
            mode: manifest.mode.name(),
            tick: ticks_done(&page),
            launcher_pid: found.launcher_pid,
        })
    }

    /// The run that is meant, by its folder, its scenario or its name in shared memory; the only living one where none is.
    ///
    /// # Errors
    /// [`Failure::Input`] with the living runs.
    pub fn find(wanted: Option<&str>) -> Result<Self, Failure> {
        let all = Self::all();
        let folder = wanted.and_then(|wanted| Path::new(wanted).canonicalize().ok());
        let is_meant = |run: &&Self| {
            wanted.is_none_or(|wanted| run.run == wanted || run.scenario == wanted)
                || folder.as_ref() == Some(&run.folder)
        };
        let meant: Vec<&Self> = all.iter().filter(is_meant).collect();
        if let [only] = meant[..] {
            return Ok(only.clone());
        }
        let listed = |runs: &mut dyn Iterator<Item = &Self>| {
            let names: Vec<_> = runs.map(Self::to_string).collect();
            names.join(", ")
        };
        Err(Failure::Input(match wanted {
            None if all.is_empty() => "no run is alive; start one with `armplane run`".to_owned(),
            Some(wanted) if all.is_empty() => {
                format!("no run {wanted} is alive, nor any other; start one with `armplane run`")
            }
            Some(wanted) if meant.is_empty() => {
                format!(
                    "no run {wanted} is alive; alive: {}",
                    listed(&mut all.iter())
                )
            }
            _ => format!(
                "several runs are alive; choose one with --run FOLDER: {}",
                listed(&mut meant.into_iter())
            ),
        }))
    }

    /// Its files in shared memory.
    pub(crate) fn open(&self) -> Result<(RunDir, Manifest, ControlPage), Failure> {
        open_run(&self.run)
    }

    /// The run that a command is about to change: where it is not named, it must have been started from this folder.
    ///
    /// # Errors
    /// [`Failure::Input`] with the living runs.
    pub fn find_to_change(wanted: Option<&str>) -> Result<Self, Failure> {
        let run = Self::find(wanted)?;
        let there = std::fs::read_link(format!("/proc/{}/cwd", run.launcher_pid)).ok();
        if wanted.is_some() || there.is_some() && there == std::env::current_dir().ok() {
            return Ok(run);
        }
        let from = there.map_or("another folder".to_owned(), |folder| {
            folder.display().to_string()
        });
        Err(Failure::Input(format!(
            "the only run alive is {}, started from {from}; if you mean it, give --run {}",
            run.scenario,
            from_here(&run.folder).display()
        )))
    }

    /// The same run after a roll-back.
    pub(crate) fn again(&self) -> Option<Self> {
        Self::all()
            .into_iter()
            .find(|run| (run.launcher_pid, &run.folder) == (self.launcher_pid, &self.folder))
    }

    /// A row for each.
    pub fn table(all: &[Self]) -> String {
        if all.is_empty() {
            return "no run is alive; start one with `armplane run`\n".to_owned();
        }
        let mut rows = table(&["folder", "scenario", "tick"]);
        for run in all {
            rows.add_row([
                from_here(&run.folder).display().to_string().into(),
                run.scenario.as_str().into(),
                number(run.tick),
            ]);
        }
        format!("{rows}\n`armplane top` and `armplane fault` find a run by --run FOLDER.\n")
    }
}

/// As people name it; a bench has no more than its name in shared memory.
impl fmt::Display for Living {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.scenario.as_str() {
            "" => f.write_str(&self.run),
            scenario => write!(f, "{scenario} in {}", from_here(&self.folder).display()),
        }
    }
}

/// The files of a run, by its name in shared memory.
pub(crate) fn open_run(name: &str) -> Result<(RunDir, Manifest, ControlPage), Failure> {
    let run = RunDir::open(&Path::new(SHM).join(name)).map_err(Failure::input)?;
    let manifest = Manifest::read(&run).map_err(Failure::work)?;
    let control_page = ControlPage::open(&run).map_err(Failure::work)?;
    Ok((run, manifest, control_page))
}

/// Ticks that a process of a run has done, the most of all.
pub(crate) fn ticks_done(page: &ControlPage) -> u64 {
    let ticks = (0..MAX_PROCESSES).map(|process| page.process(process).ticks());
    ticks.max().unwrap_or_default()
}

/// The job of a run in shared memory.
///
/// # Errors
/// [`Failure::Work`] if it cannot be read; a bench has none.
pub(crate) fn job(run: &Path) -> Result<Job, Failure> {
    let text = files::read(&run.join(JOB)).map_err(Failure::work)?;
    serde_json::from_slice(&text).map_err(Failure::work)
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
    /// The run's name in shared memory.
    pub run: String,
    /// The run as people name it.
    #[serde(skip)]
    pub title: String,
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

/// The counters of a process at one time.
struct Sample {
    ticks: u64,
    step: Distribution,
    age: Distribution,
}

impl Sample {
    fn of(entry: &ProcessEntry) -> Self {
        Self {
            ticks: entry.ticks(),
            step: entry.step(),
            age: entry.age(),
        }
    }
}

/// Samples the control page of one run.
pub struct Observer {
    run: RunDir,
    living: Living,
    manifest: Manifest,
    control_page: ControlPage,
    at: Instant,
    before: Vec<Sample>,
}

impl Observer {
    /// Opens a living run.
    ///
    /// # Errors
    /// The run has ended, or its files cannot be read.
    pub fn open(living: Living) -> Result<Self, Failure> {
        let (run, manifest, control_page) = living.open()?;
        let entries = (0..manifest.processes.len()).map(|index| control_page.process(index));
        Ok(Self {
            before: entries.map(Sample::of).collect(),
            at: Instant::now(),
            run,
            living,
            manifest,
            control_page,
        })
    }

    /// Whether the run is over.
    pub fn is_over(&self) -> bool {
        self.control_page.stop() != Stop::No || !self.run.path().exists()
    }

    /// The run since the last call, or since [`Observer::open`].
    pub fn observe(&mut self) -> Observation {
        let (page, at) = (&self.control_page, Instant::now());
        let elapsed_s = (at - self.at).as_secs_f64().max(1e-9);
        let tick = ticks_done(page);
        let process = |(index, last): (usize, &mut Sample)| {
            let (described, entry) = (&self.manifest.processes[index], page.process(index));
            let earlier = std::mem::replace(last, Sample::of(entry));
            let (now, counts) = (&*last, entry.counts());
            ObservedProcess {
                name: described.name.clone(),
                state: state(entry.state()),
                pid: entry.pid(),
                starts: entry.incarnation(),
                core: described.core,
                ticks: now.ticks,
                ticks_per_s: now.ticks.saturating_sub(earlier.ticks) as f64 / elapsed_s,
                missed: counts.silent,
                counts,
                step_us: times(&earlier.step, &now.step),
                age_us: times(&earlier.age, &now.age),
            }
        };
        let (report, modes) = (
            page.latest::<SingularityReport>(),
            page.latest::<ControlState>().mode,
        );
        let sample = page.latest::<SensorSample>();
        let processes = &self.manifest.processes;
        let name = |place: u32| processes.get(place as usize).map(|one| one.name.clone());
        let fault = |(_, record): (usize, FaultRecord)| ObservedFault {
            process: name(record.scheduled.process).unwrap_or_default(),
            kind: record.scheduled.kind().map_or("unknown", Kind::name),
            origin: record.origin.name(),
            tick: record.scheduled.at,
            active: record.scheduled.concerns(tick),
        };
        self.at = at;
        Observation {
            run: self.living.run.clone(),
            title: self.living.to_string(),
            mode: self.manifest.mode.name(),
            rate_hz: self.manifest.rate_hz,
            processes: self.before.iter_mut().enumerate().map(process).collect(),
            drive: name_of(codes::DRIVES, sample.drive),
            stale_ticks: sample.stale_ticks.into(),
            phase: name_of(codes::PHASES, page.latest::<TorqueCommand>().phase),
            singularities: (0..)
                .zip(report.listed().iter().zip(modes))
                .map(singularity)
                .collect(),
            faults: page.fault_table().records().map(fault).collect(),
        }
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
        State::Done => "done",
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

fn singularity((place, (one, mode)): (usize, (&SingularityState, u32))) -> ObservedSingularity {
    ObservedSingularity {
        name: singularity_name(one.kind, place).to_owned(),
        s: one.s,
        inside: one.inside != 0,
        class: name_of(codes::TYPES, one.class),
        mode: name_of(codes::MODES, mode),
    }
}
