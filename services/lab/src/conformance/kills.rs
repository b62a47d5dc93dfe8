//! Processes of a run killed at random moments (SIGKILL): the scenario that the run leaves repeats it byte for byte.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use launcher::{End, Outcome};
use model::Robot;
use runtime::{ControlPage, RunDir, State, random};
use rustix::process::{Signal, pidfd_send_signal};
use session::{Failure, Observer, Progress, load};
use shared_types::graph::{Graph, Restart};
use shared_types::job::{Job, Mode};
use shared_types::scenario::Scenario;
use shared_types::summary::Summary;

use super::stops::child;
use super::verify::{Place, first_place};
use crate::folder::Folder;

/// Most kills of one process: one less than it may be started again.
const MOST_KILLS: u32 = 4;
/// How often the progress of the run is looked at.
const LOOK: Duration = Duration::from_micros(50);
/// The longest wait for a replacement before it is killed as well; ms.
const LONGEST_START_MS: u64 = 25;

/// How to kill processes of a scenario.
pub struct Request<'a> {
    /// The scenario.
    pub scenario: &'a Scenario,
    /// Its arm.
    pub robot: &'a Robot,
    /// The process graph.
    pub graph: &'a Graph,
    /// How many runs with kills, each repeated once.
    pub histories: u32,
    /// Seed of the kills.
    pub seed: u64,
    /// Where runs that do not repeat themselves stay; `None`: in a temporary folder.
    pub out: Option<&'a Path>,
}

/// A run that its own scenario does not repeat.
pub struct Unrepeated {
    /// Number of the run, from 1.
    pub number: u32,
    /// Its deaths, in words.
    pub deaths: Vec<String>,
    /// The reason.
    pub reason: String,
    /// The first place where the repetition differs.
    pub place: Option<Place>,
}

/// All runs.
#[derive(Default)]
pub struct Killed {
    /// Runs with kills.
    pub histories: u32,
    /// Deaths that no plan had.
    pub deaths: u64,
    /// Deaths between two messages of a tick.
    pub within_tick: u64,
    /// Deaths of a replacement before it had answered a tick.
    pub at_start: u64,
    /// Runs that were not repeated.
    pub unrepeated: Vec<Unrepeated>,
    /// The folder that holds these.
    pub folder: Option<PathBuf>,
}

/// Runs a scenario many times while processes are killed, and repeats each run from the scenario that it leaves.
///
/// # Errors
/// [`Failure`] where the scenario cannot be run, or a run is interrupted.
pub fn verify_kills(request: &Request<'_>, observer: Observer<'_>) -> Result<Killed, Failure> {
    let Request {
        scenario,
        robot,
        graph,
        histories,
        seed,
        out,
    } = *request;
    let folder = Folder::create(out)?;
    let mut killed = Killed::default();
    observer(Progress::Begin {
        title: &scenario.name,
        length: u64::from(histories),
        unit: "runs",
    });
    for number in 1..=histories {
        let path = folder.path().join(format!("history-{number}"));
        let job = |scenario: Scenario, graph: Graph, name: &str| {
            let out = path.join(name);
            std::fs::create_dir_all(&out).map_err(|error| {
                Failure::Work(format!("cannot make {}: {error}", out.display()))
            })?;
            Ok::<_, Failure>(Job {
                record: false,
                ..load::job(robot, scenario, graph, Mode::Lockstep, out)
            })
        };
        let live = job(scenario.clone(), graph.clone(), "live")?;
        let first = run(&live, Some(random(seed, u64::from(number))))?;
        session::keep(&live.out, &live, &first.summary)?;
        let planned = load::scenario_in(
            None,
            &live.out.join("scenario.toml").display().to_string(),
            &[],
            None,
        )?;
        let again = job(planned.scenario, planned.graph, "again")?;
        let second = run(&again, None)?;
        killed.note(&first);
        match first.difference(&second) {
            None => {
                let _ = std::fs::remove_dir_all(&path);
            }
            Some(reason) => {
                let place = first_place(
                    graph,
                    &live.out.join(recorder::MESSAGES),
                    &again.out.join(recorder::MESSAGES),
                    number as usize,
                );
                let deaths = first.deaths();
                observer(Progress::Line(&format!(
                    "run {number}: {reason}; {}",
                    deaths.join("; ")
                )));
                killed.unrepeated.push(Unrepeated {
                    number,
                    deaths,
                    reason,
                    place: place.ok().flatten(),
                });
            }
        }
        observer(Progress::Step);
    }
    observer(Progress::End);
    if !killed.unrepeated.is_empty() {
        killed.folder = Some(folder.keep());
    }
    Ok(killed)
}

impl Killed {
    fn note(&mut self, ran: &Ran) {
        self.histories += 1;
        let mut downs: Vec<(u32, u64, u64)> = Vec::new();
        for record in &ran.outcome.faults {
            let fault = &record.scheduled;
            if record.origin != runtime::Origin::Detected {
                continue;
            }
            self.deaths += 1;
            self.within_tick += u64::from(fault.after_outputs() > 0);
            let is_down = |down: &(u32, u64, u64)| {
                down.0 == fault.process && (down.1..=down.2).contains(&fault.at)
            };
            self.at_start += u64::from(downs.iter().any(is_down));
            downs.push((fault.process, fault.at, fault.until));
        }
    }
}

/// A run and its account.
struct Ran {
    outcome: Outcome,
    summary: Summary,
}

impl Ran {
    fn deaths(&self) -> Vec<String> {
        self.summary
            .faults
            .iter()
            .map(|fault| fault.detail.clone())
            .collect()
    }

    /// Why the other run is not this one; `None`: it is.
    fn difference(&self, other: &Self) -> Option<String> {
        for (name, ran) in [("with kills", self), ("from its scenario", other)] {
            if let End::Failed(failure) = &ran.outcome.end {
                return Some(format!("the run {name} did not come to its end: {failure}"));
            }
            if ran.summary.recorder.lost > 0 || ran.summary.topics.is_empty() {
                return Some(format!(
                    "the recorder of the run {name} has lost {} ticks",
                    ran.summary.recorder.lost
                ));
            }
        }
        let (one, two) = (&self.summary.topics, &other.summary.topics);
        let differs = one
            .iter()
            .filter(|(name, topic)| two.get(*name) != Some(*topic))
            .map(|(name, _)| name.as_str());
        let differs: Vec<_> = differs.collect();
        (!differs.is_empty() || one.len() != two.len())
            .then(|| format!("other messages of {}", differs.join(", ")))
    }
}

/// Runs a job; with a seed processes are killed meanwhile.
fn run(job: &Job, kills: Option<u64>) -> Result<Ran, Failure> {
    let plan = session::plan(job)?;
    let mut thread = None;
    let mut begin = |run: &RunDir| {
        let control_page = ControlPage::open(run).map_err(Failure::work)?;
        thread = kills.map(|seed| Kills::start(control_page, job, seed));
        Ok(())
    };
    let (outcome, account) = session::launch_begun(job, plan, &mut begin, &|_| {})?;
    drop(thread);
    if let End::Interrupted { signal } = &outcome.end {
        return Err(Failure::Work(format!("stopped by {signal}")));
    }
    let summary = session::summarise(job, &outcome, account);
    Ok(Ran { outcome, summary })
}

/// Kills processes until it is dropped.
struct Kills {
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Kills {
    fn start(control_page: ControlPage, job: &Job, seed: u64) -> Self {
        let processes = job.graph.process.iter().enumerate();
        let victims = processes.clone().filter(|(_, process)| {
            process.restart == Restart::Always && process.feedback.is_empty()
        });
        let victims: Vec<usize> = victims.map(|(index, _)| index).collect();
        let source = processes
            .clone()
            .find(|(_, process)| !process.feedback.is_empty())
            .map_or(0, |(index, _)| index);
        let is_over = Arc::new(AtomicBool::new(false));
        let mut killer = Killer {
            control_page,
            source,
            kills: vec![0; job.graph.process.len()],
            victims,
            length: job.scenario.planned_ticks().max(1),
            seed,
            drawn: 0,
            is_over: Arc::clone(&is_over),
        };
        Self {
            is_over,
            thread: Some(std::thread::spawn(move || killer.work())),
        }
    }
}

impl Drop for Kills {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Killer {
    control_page: ControlPage,
    /// The process that makes the ticks.
    source: usize,
    victims: Vec<usize>,
    /// Kills so far, by process.
    kills: Vec<u32>,
    /// Ticks of the scenario.
    length: u64,
    seed: u64,
    drawn: u64,
    is_over: Arc<AtomicBool>,
}

impl Killer {
    fn draw(&mut self, most: u64) -> u64 {
        self.drawn += 1;
        random(self.seed, self.drawn) % most.max(1)
    }

    /// Waits; whether the run still goes on.
    fn wait(&self, until: impl Fn(&Self) -> bool) -> bool {
        while !until(self) && !self.is_over.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
        }
        !self.is_over.load(Ordering::Relaxed)
    }

    fn ticks(&self) -> u64 {
        self.control_page.process(self.source).ticks()
    }

    fn victim(&mut self) -> usize {
        let place = self.draw(self.victims.len() as u64) as usize;
        self.victims.get(place).copied().unwrap_or(0)
    }

    fn kill(&mut self, process: usize) {
        if self.kills[process] < MOST_KILLS
            && let Some(child) = child(self.control_page.process(process).pid())
        {
            // It fails where the process has just ended.
            self.kills[process] += u32::from(pidfd_send_signal(&child, Signal::KILL).is_ok());
        }
    }

    /// One to three deaths, each at a tick of its own, some of them before the first.
    fn work(&mut self) {
        if self.victims.is_empty() {
            return;
        }
        let mut tick = 0;
        for _ in 0..=self.draw(3) {
            if self.draw(8) > 0 {
                tick += self.draw(self.length / 2);
                if !self.wait(|killer| killer.ticks() > tick) {
                    return;
                }
            } else {
                let first = self.victim();
                if !self.wait(|killer| killer.control_page.process(first).state() != State::Absent)
                {
                    return;
                }
                let pause = self.draw(LONGEST_START_MS);
                std::thread::sleep(Duration::from_millis(pause));
            }
            let victim = self.victim();
            let (struck_at, incarnation) = (
                self.ticks(),
                self.control_page.process(victim).incarnation(),
            );
            self.kill(victim);
            match self.draw(4) {
                // Others with it.
                0 => {
                    for _ in 0..=self.draw(2) {
                        let (other, pause) = (self.victim(), self.draw(3) * self.draw(1_000));
                        std::thread::sleep(Duration::from_micros(pause));
                        self.kill(other);
                    }
                }
                // Its replacements while they start.
                1 => {
                    for more in 1..=1 + self.draw(2) as u32 {
                        if !self.wait(|killer| {
                            killer.control_page.process(victim).incarnation() >= incarnation + more
                        }) {
                            return;
                        }
                        let pause = self.draw(1_000 * LONGEST_START_MS);
                        std::thread::sleep(Duration::from_micros(pause));
                        self.kill(victim);
                    }
                }
                // Another one about the end of its down time.
                2 => {
                    let (other, later) = (self.victim(), 90 + self.draw(20));
                    if !self.wait(|killer| killer.ticks() >= struck_at + later) {
                        return;
                    }
                    self.kill(other);
                }
                _ => {}
            }
        }
    }
}
