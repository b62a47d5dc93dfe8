//! Processes of a run killed at random moments (SIGKILL): its bytes are those of the run that nobody disturbs.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use model::Robot;
use runtime::{ControlPage, Mode, State, random};
use rustix::process::{Signal, pidfd_send_signal};
use serde::Serialize;
use session::{Failure, Observer, Progress, Results, load};
use shared_types::graph::{Graph, Process};
use shared_types::job::Job;
use shared_types::scenario::Scenario;
use shared_types::summary::FaultSummary;

use super::compared::{InProcesses, Place, Reference, first_place, in_processes, record_of};
use crate::folder::Folder;
use crate::signals::{Background, Over, child};

/// Starts of all processes in which some are killed: one death more from the same tick would end the run.
const MOST_STARTS: u64 = 5;

/// The longest time from the beginning of a start until a process is killed in it; ms.
const LONGEST_START_MS: u64 = 60;

/// A run with kills whose bytes are others.
#[derive(Serialize)]
pub struct Unequal {
    /// Number of the run, from 1.
    pub run: usize,
    /// Its deaths, in words.
    pub deaths: Vec<String>,
    /// The reason.
    pub reason: String,
    /// The first place where its messages differ.
    pub difference: Option<Place>,
}

/// All runs.
#[derive(Default, Serialize)]
pub struct Killed {
    /// Name of the scenario.
    pub scenario: String,
    /// Seed of the kills.
    pub seed: u64,
    /// Runs with kills.
    pub histories: usize,
    /// Deaths in all of them.
    pub deaths: usize,
    /// Deaths before the first tick of a start.
    pub at_start: usize,
    /// Deaths after the last tick.
    pub at_end: usize,
    /// Deaths of the process that makes the ticks.
    pub of_source: usize,
    /// Runs with other bytes than the undisturbed one.
    pub unequal: Vec<Unequal>,
    /// The folder that holds these.
    pub folder: Option<PathBuf>,
}

/// Runs a scenario once, and many times while processes are killed; what differs stays in `out`, or in a temporary folder.
///
/// # Errors
/// [`Failure`] where the scenario cannot be run, or a run is interrupted.
pub fn verify_kills(
    robot: &Robot,
    scenario: &Scenario,
    graph: &Graph,
    histories: u32,
    out: Option<&Path>,
    observer: Observer<'_>,
) -> Result<Killed, Failure> {
    let _signals = session::interrupts()?;
    let folder = Folder::create(out)?;
    let job = |results: &Results| {
        load::job(
            robot,
            scenario.clone(),
            graph.clone(),
            Mode::Lockstep,
            results.folder.clone(),
        )
    };
    let undisturbed = Results::within(folder.path(), "undisturbed")?;
    let whole = job(&undisturbed);
    let reference = run(&whole, None)?;
    if let Some(reason) = defect(&reference) {
        return Err(Failure::Work(format!(
            "the undisturbed run of {} {reason}, so there is nothing to compare with",
            scenario.name
        )));
    }
    let mut killed = Killed {
        scenario: scenario.name.clone(),
        seed: scenario.seed,
        ..Killed::default()
    };
    observer(Progress::Begin {
        title: &scenario.name,
        length: u64::from(histories),
        unit: "runs",
    });
    for number in 1..=histories as usize {
        let results = Results::within(folder.path(), &format!("history-{number}"))?;
        let job = job(&results);
        let unequal = killed.history(&job, number, &whole, &reference)?;
        match unequal {
            None => results.clear()?,
            Some(unequal) => {
                let Unequal { reason, deaths, .. } = &unequal;
                observer(Progress::Line(&format!(
                    "run {number}: {reason}; {}",
                    deaths.join("; ")
                )));
                killed.unequal.push(unequal);
            }
        }
        observer(Progress::Step);
    }
    observer(Progress::End);
    if !killed.unequal.is_empty() {
        killed.folder = Some(folder.keep());
    }
    Ok(killed)
}

impl Killed {
    /// A run with kills; `None` where it has the bytes of the undisturbed one.
    fn history(
        &mut self,
        job: &Job,
        number: usize,
        whole: &Job,
        reference: &InProcesses,
    ) -> Result<Option<Unequal>, Failure> {
        let ran = run(job, Some(random(self.seed, number as u64)))?;
        let deaths = self.note(&ran);
        let Some(reason) = defect(&ran).or_else(|| difference(reference, &ran)) else {
            return Ok(None);
        };
        let place = record_of(&whole.out, whole).and_then(|expected| {
            let found = record_of(&job.out, job)?;
            first_place(&Reference::Run(expected), &found, number)
        });
        Ok(Some(Unequal {
            run: number,
            deaths,
            reason,
            difference: place.ok().flatten(),
        }))
    }

    /// Counts the deaths of a run; returns them in words.
    fn note(&mut self, ran: &InProcesses) -> Vec<String> {
        self.histories += 1;
        let is_death = |fault: &&FaultSummary| fault.origin == "detected";
        let deaths = ran.summary.faults.iter().filter(is_death);
        let source = &ran.source;
        deaths
            .map(|fault| {
                self.deaths += 1;
                self.at_start += usize::from(fault.tick == 0);
                self.at_end += usize::from(fault.tick >= ran.ran.ticks);
                self.of_source += usize::from(fault.process == *source);
                fault.detail.clone()
            })
            .collect()
    }
}

impl fmt::Display for Killed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            scenario,
            seed,
            histories,
            deaths,
            at_start,
            at_end,
            of_source,
            unequal,
            folder,
        } = self;
        for place in unequal.iter().filter_map(|run| run.difference.as_ref()) {
            writeln!(f, "{place}")?;
        }
        if let Some(folder) = folder {
            writeln!(f, "runs with other bytes are in {}", folder.display())?;
        }
        writeln!(
            f,
            "{scenario}, seed {seed}: {} of {histories} runs with kills have the bytes of the undisturbed one \
             ({deaths} deaths, {of_source} of the plant, {at_start} before the first tick, {at_end} after the last)",
            histories - unequal.len()
        )
    }
}

/// Why a run is not whole; `None`: it is.
fn defect(run: &InProcesses) -> Option<String> {
    let InProcesses { ran, summary, .. } = run;
    if !ran.failure.is_empty() {
        return Some(format!("did not finish: {}", ran.failure));
    }
    let lost = summary.recorder.lost;
    (lost > 0 || summary.topics.is_empty()).then(|| format!("has lost {lost} messages"))
}

/// The topics in which a run is not the reference; `None`: in none.
fn difference(reference: &InProcesses, run: &InProcesses) -> Option<String> {
    let (one, two) = (&reference.ran.topics, &run.ran.topics);
    let differs = one
        .iter()
        .filter(|(name, topic)| two.get(*name) != Some(*topic))
        .map(|(name, _)| name.as_str());
    (one != two).then(|| {
        format!(
            "has other messages of {}",
            differs.collect::<Vec<_>>().join(", ")
        )
    })
}

/// Runs a job; with a seed processes are killed meanwhile.
fn run(job: &Job, kills: Option<u64>) -> Result<InProcesses, Failure> {
    let started = Arc::new(Mutex::new(Started::default()));
    let killer = kills.map(|seed| Killer::start(Arc::clone(&started), job, seed));
    let beside = |page| {
        let mut started = started.lock().unwrap_or_else(PoisonError::into_inner);
        started.count += 1;
        started.page = Some(page);
        Vec::new()
    };
    let ran = in_processes(job, session::plan(job)?, String::new(), beside, &|_| {});
    drop(killer);
    ran
}

/// The last start of all processes.
#[derive(Default)]
struct Started {
    count: u64,
    page: Option<ControlPage>,
}

struct Killer {
    started: Arc<Mutex<Started>>,
    /// The process that makes the ticks.
    source: usize,
    processes: usize,
    /// Ticks of the scenario.
    length: u64,
    seed: u64,
    drawn: u64,
}

impl Killer {
    fn start(started: Arc<Mutex<Started>>, job: &Job, seed: u64) -> Background {
        let processes = &job.graph.process;
        let is_source = |process: &Process| !process.feedback.is_empty();
        let mut killer = Self {
            started,
            source: processes.iter().position(is_source).unwrap_or_default(),
            processes: processes.len(),
            length: job.scenario.planned_ticks().max(1),
            seed,
            drawn: 0,
        };
        // A run may be over before the last moment comes.
        Background::start(move |over| {
            let _ = killer.work(over);
        })
    }

    fn draw(&mut self, most: u64) -> u64 {
        self.drawn += 1;
        random(self.seed, self.drawn) % most.max(1)
    }

    /// Something of the last start; `None` before the first.
    fn of_start<T>(&self, look: impl FnOnce(u64, &ControlPage) -> T) -> Option<T> {
        let started = self.started.lock().unwrap_or_else(PoisonError::into_inner);
        started.page.as_ref().map(|page| look(started.count, page))
    }

    fn pause(&mut self, over: &Over, most_us: u64) -> Option<()> {
        let pause = self.draw(most_us);
        over.rest(Duration::from_micros(pause)).then_some(())
    }

    /// Kills a process of the last start, as long as the run can bear it. No start begins meanwhile.
    fn kill(&mut self, process: usize) {
        self.of_start(|count, page| {
            if count <= MOST_STARTS
                && let Some(child) = child(page.process(process).pid())
            {
                // It fails where the process has just ended.
                let _ = pidfd_send_signal(&child, Signal::KILL);
            }
        });
    }

    /// Up to three strikes, each at a moment of its own; `None` when the run is over.
    fn work(&mut self, over: &Over) -> Option<()> {
        let until = |is: bool| is.then_some(());
        for _ in 0..=self.draw(3) {
            match self.draw(6) {
                0 => {
                    // While the processes start, perhaps for the second time.
                    let before = self.of_start(|count, _| count).unwrap_or_default();
                    let begins = || self.of_start(|count, _| count > before || before == 1);
                    until(over.wait(|| begins() == Some(true)))?;
                    self.pause(over, 1_000 * LONGEST_START_MS)?;
                }
                1 => {
                    let source = self.source;
                    let is_over = |page: &ControlPage| page.process(source).state() == State::Gone;
                    until(over.wait(|| self.of_start(|_, page| is_over(page)) == Some(true)))?;
                    self.pause(over, 20_000)?;
                }
                _ => {
                    let (tick, source) = (self.draw(self.length), self.source);
                    let ticks = |page: &ControlPage| page.process(source).ticks();
                    until(over.wait(|| self.of_start(|_, page| ticks(page) > tick) == Some(true)))?;
                }
            }
            self.strike(over)?;
        }
        Some(())
    }

    /// One process, several, or all, within two milliseconds.
    fn strike(&mut self, over: &Over) -> Option<()> {
        let most = self.processes as u64;
        let count = match self.draw(3) {
            0 => 1 + self.draw(most),
            1 => most,
            _ => 1,
        };
        let first = self.draw(most);
        for place in 0..count {
            self.kill(((first + place) % most) as usize);
            self.pause(over, 2_000 / most)?;
        }
        Some(())
    }
}
