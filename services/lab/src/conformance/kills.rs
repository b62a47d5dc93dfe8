//! Processes of a run killed at random moments (SIGKILL): the scenario that the run leaves repeats it byte for byte.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use model::Robot;
use runtime::{ControlPage, Origin, State, random};
use rustix::process::{Signal, pidfd_send_signal};
use serde::Serialize;
use session::{Failure, Observer, Progress, Results, load};
use shared_types::graph::{Graph, Process, Restart};
use shared_types::job::{Job, Mode};
use shared_types::scenario::Scenario;

use super::compared::{InProcesses, Place, Reference, first_place, in_processes, record_of};
use crate::folder::Folder;
use crate::signals::{Background, Over, child};

/// Most kills of one process: one less than it may be started again.
const MOST_KILLS: u32 = 4;

/// The longest wait for a replacement before it is killed as well; ms.
const LONGEST_START_MS: u64 = 25;

/// A run that its own scenario does not repeat.
#[derive(Serialize)]
pub struct Unrepeated {
    /// Number of the run, from 1.
    pub run: usize,
    /// Its deaths, in words.
    pub deaths: Vec<String>,
    /// The reason.
    pub reason: String,
    /// The first place where the repetition differs.
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

/// Runs a scenario many times while processes are killed, and repeats each run from the scenario that it leaves; what is not repeated stays in `out`, or in
/// a temporary folder.
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
        let history = killed.history(robot, scenario, graph, number, &results.folder)?;
        if let Some(unrepeated) = history {
            let Unrepeated { reason, deaths, .. } = &unrepeated;
            observer(Progress::Line(&format!(
                "run {number}: {reason}; {}",
                deaths.join("; ")
            )));
            killed.unrepeated.push(unrepeated);
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
    /// A run with kills and its repetition; `None` where they have the same bytes.
    fn history(
        &mut self,
        robot: &Robot,
        scenario: &Scenario,
        graph: &Graph,
        number: usize,
        path: &Path,
    ) -> Result<Option<Unrepeated>, Failure> {
        let job = |scenario: Scenario, graph: Graph, results: &Results| Job {
            record: false,
            ..load::job(
                robot,
                scenario,
                graph,
                Mode::Lockstep,
                results.folder.clone(),
            )
        };
        let folders = [
            Results::within(path, "live")?,
            Results::within(path, "again")?,
        ];
        let live = job(scenario.clone(), graph.clone(), &folders[0]);
        let first = run(&live, Some(random(scenario.seed, number as u64)))?;
        session::keep(&live.out, &live, &first.summary)?;
        let left = live.out.join("scenario.toml").display().to_string();
        let planned = load::scenario_in(None, &left, &[], None)?;
        let again = job(planned.scenario, planned.graph, &folders[1]);
        let second = run(&again, None)?;
        self.note(&first);
        let Some(reason) = difference(&first, &second) else {
            folders.iter().try_for_each(Results::clear)?;
            return Ok(None);
        };
        let place = record_of(&live.out, &live).and_then(|one| {
            first_place(
                &Reference::Run(one),
                &record_of(&again.out, &again)?,
                number,
            )
        });
        Ok(Some(Unrepeated {
            run: number,
            deaths: first
                .summary
                .faults
                .iter()
                .map(|fault| fault.detail.clone())
                .collect(),
            reason,
            difference: place.ok().flatten(),
        }))
    }

    fn note(&mut self, ran: &InProcesses) {
        self.histories += 1;
        let mut downs: Vec<(u32, u64, u64)> = Vec::new();
        for record in ran
            .faults
            .iter()
            .filter(|record| record.origin == Origin::Detected)
        {
            let fault = &record.scheduled;
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

impl fmt::Display for Killed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            scenario,
            seed,
            histories,
            deaths,
            within_tick,
            at_start,
            unrepeated,
            folder,
        } = self;
        for place in unrepeated.iter().filter_map(|run| run.difference.as_ref()) {
            writeln!(f, "{place}")?;
        }
        if let Some(folder) = folder {
            writeln!(f, "runs that did not repeat are in {}", folder.display())?;
        }
        writeln!(
            f,
            "{scenario}, seed {seed}: {} of {histories} runs repeated byte for byte ({deaths} deaths, {within_tick} between two messages of a tick, \
             {at_start} of replacements that had not answered)",
            histories - unrepeated.len()
        )
    }
}

/// Why the repetition is not the run with kills; `None`: it is.
fn difference(live: &InProcesses, again: &InProcesses) -> Option<String> {
    for (name, InProcesses { ran, summary, .. }) in
        [("with kills", live), ("from its scenario", again)]
    {
        if !ran.failure.is_empty() {
            return Some(format!("the run {name} did not finish: {}", ran.failure));
        }
        let lost = summary.recorder.lost;
        if lost > 0 || summary.topics.is_empty() {
            return Some(format!(
                "the recorder of the run {name} has lost {lost} ticks"
            ));
        }
    }
    let (one, two) = (&live.ran.topics, &again.ran.topics);
    let differs = one
        .iter()
        .filter(|(name, topic)| two.get(*name) != Some(*topic))
        .map(|(name, _)| name.as_str());
    (one != two).then(|| {
        format!(
            "other messages of {}",
            differs.collect::<Vec<_>>().join(", ")
        )
    })
}

/// Runs a job; with a seed processes are killed meanwhile.
fn run(job: &Job, kills: Option<u64>) -> Result<InProcesses, Failure> {
    let beside = |page| {
        kills
            .map(|seed| Killer::start(page, job, seed))
            .into_iter()
            .collect()
    };
    in_processes(job, session::plan(job)?, String::new(), beside, &|_| {})
}

struct Killer {
    page: ControlPage,
    /// The process that makes the ticks.
    source: usize,
    victims: Vec<usize>,
    /// Kills so far, by process.
    kills: Vec<u32>,
    /// Ticks of the scenario.
    length: u64,
    seed: u64,
    drawn: u64,
}

impl Killer {
    fn start(page: ControlPage, job: &Job, seed: u64) -> Background {
        let processes = &job.graph.process;
        let is_source = |process: &Process| !process.feedback.is_empty();
        let is_victim = |index: &usize| {
            processes[*index].restart == Restart::Always && !is_source(&processes[*index])
        };
        let mut killer = Self {
            page,
            source: processes.iter().position(is_source).unwrap_or_default(),
            victims: (0..processes.len()).filter(is_victim).collect(),
            kills: vec![0; processes.len()],
            length: job.scenario.planned_ticks().max(1),
            seed,
            drawn: 0,
        };
        Background::start(move |over| {
            if !killer.victims.is_empty() {
                // Where the run is over before the last moment has come, that is all.
                let _ = killer.work(over);
            }
        })
    }

    fn draw(&mut self, most: u64) -> u64 {
        self.drawn += 1;
        random(self.seed, self.drawn) % most.max(1)
    }

    fn ticks(&self) -> u64 {
        self.page.process(self.source).ticks()
    }

    fn victim(&mut self) -> usize {
        let place = self.draw(self.victims.len() as u64) as usize;
        self.victims[place]
    }

    fn pause(&mut self, over: &Over, most_us: u64) -> Option<()> {
        let pause = self.draw(most_us);
        over.rest(Duration::from_micros(pause)).then_some(())
    }

    fn kill(&mut self, process: usize) {
        if self.kills[process] < MOST_KILLS
            && let Some(child) = child(self.page.process(process).pid())
        {
            // It fails where the process has just ended.
            self.kills[process] += u32::from(pidfd_send_signal(&child, Signal::KILL).is_ok());
        }
    }

    /// One to three deaths, each at a tick of its own, some of them before the first; `None` when the run is over.
    fn work(&mut self, over: &Over) -> Option<()> {
        let until = |is: bool| is.then_some(());
        let mut tick = 0;
        for _ in 0..=self.draw(3) {
            if self.draw(8) > 0 {
                tick += self.draw(self.length / 2);
                until(over.wait(|| self.ticks() > tick))?;
            } else {
                let first = self.victim();
                until(over.wait(|| self.page.process(first).state() != State::Absent))?;
                self.pause(over, 1_000 * LONGEST_START_MS)?;
            }
            let victim = self.victim();
            let (struck_at, incarnation) = (self.ticks(), self.page.process(victim).incarnation());
            self.kill(victim);
            match self.draw(4) {
                // Others with it.
                0 => {
                    for _ in 0..=self.draw(2) {
                        let other = self.victim();
                        self.pause(over, 2_000)?;
                        self.kill(other);
                    }
                }
                // Its replacements while they start.
                1 => {
                    for more in 1..=1 + self.draw(2) as u32 {
                        until(over.wait(|| {
                            self.page.process(victim).incarnation() >= incarnation + more
                        }))?;
                        self.pause(over, 1_000 * LONGEST_START_MS)?;
                        self.kill(victim);
                    }
                }
                // Another one about the end of its down time.
                2 => {
                    let (other, later) = (self.victim(), 90 + self.draw(20));
                    until(over.wait(|| self.ticks() >= struck_at + later))?;
                    self.kill(other);
                }
                _ => {}
            }
        }
        Some(())
    }
}
