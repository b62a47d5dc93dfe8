//! One run, from the scenario's name to the results folder.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use launcher::{End, Interrupts, Plan};
use model::Robot;
use recorder::Judge;
use runtime::RunDir;
use shared_types::job::{Job, Mode};
use shared_types::process::{Process, Role};
use shared_types::scenario::Scenario;
use shared_types::summary::{FaultSummary, REACHED, Summary};

use crate::drawing::draw_results;
use crate::failure::Failure;
use crate::launch::{Begin, interrupts, launch};
use crate::load::{self, Loaded};
use crate::origin::{self, Origin, Place, begin_at};
use crate::plan::plan;
use crate::progress::{Observer, say};
use crate::results::Results;
use crate::robot;
use crate::ros2;
use crate::summary::{add_deaths, add_earlier, summarise};
use crate::units;
use crate::viewer::Live;

/// The scenario and settings of a run.
#[derive(Clone, Debug)]
pub struct Request {
    /// A built-in scenario's name, or the path of a scenario file.
    pub scenario: String,
    /// Values that override those of the scenario: `control.k_p=900`.
    pub settings: Vec<String>,
    /// Seed of all random numbers of the run; by default the scenario's.
    pub seed: Option<u64>,
    /// The file of a process graph; by default the scenario's, or the built-in graph.
    pub graph: Option<PathBuf>,
    /// The plant in place of the simulated arm, `mujoco`, `mujoco:SCENE.xml` or the address of a robot; the graph's where it is `None`.
    pub plant: Option<String>,
    /// Options of the face for ROS 2; `None` without one.
    pub ros2: Option<String>,
    /// The tick of a run from which it goes on, in place of a scenario.
    pub from: Option<Place>,
    /// Lockstep or real time.
    pub mode: Mode,
    /// The results folder; by default the next free `runs/NAME-NNN`.
    pub out: Option<PathBuf>,
    /// Whether the run is recorded.
    pub record: bool,
    /// Whether the viewer shows the run while it lasts.
    pub live: bool,
    /// A process that is silent for so long is killed and replaced; `None`: as the mode has it, in lockstep without limit.
    pub silence_limit: Option<Duration>,
    /// Lines that the observer got and nobody has read, by process; called when the run is over.
    pub unread: fn() -> BTreeMap<String, u64>,
}

/// A run that has ended.
#[derive(Debug)]
pub struct Finished {
    /// Its summary.
    pub summary: Summary,
    /// Its results folder.
    pub folder: PathBuf,
    /// How its processes ended.
    pub end: End,
    /// Whether the results are whole: summary, job and scenario could be written into the folder, and the record to its end, and the recording was drawn.
    pub saved: Result<(), Failure>,
    /// Held until the results are printed: a second signal does not end the program amid its last words.
    pub signals: Interrupts,
}

/// Loads, validates, launches, summarises and keeps one run.
///
/// # Errors
/// [`Failure::Input`] or [`Failure::File`] before anything is started, where scenario, robot, graph or results folder cannot be used, or the
/// control law refuses the start; [`Failure::Work`] if the processes cannot be started or watched. A run that fails is [`Finished`].
pub fn run(request: &Request, observer: Observer<'_>) -> Result<Finished, Failure> {
    let mut begin = |_: &RunDir| Ok(());
    if let Some(place) = &request.from {
        let (loaded, origin) = begin_at(place, &request.settings)?;
        return run_from(request, loaded, Some(&origin), &mut begin, observer);
    }
    if let Some(branch) = origin::branch_of(&request.scenario) {
        let sentence = format!(
            "{} is of a branch, and this run has its settings from tick 0 on: `{}` repeats the branch",
            request.scenario,
            origin::command(&branch)
        );
        say(observer, sentence);
    }
    let graph = request.graph.as_deref();
    let loaded = load::scenario_in(graph, &request.scenario, &request.settings, request.seed)?;
    run_loaded(request, loaded, &mut begin, observer)
}

/// As [`run`] with a scenario that is loaded; `begin` sees the run before its first process starts.
///
/// # Errors
/// See [`run`].
pub fn run_loaded(
    request: &Request,
    loaded: Loaded,
    begin: Begin<'_>,
    observer: Observer<'_>,
) -> Result<Finished, Failure> {
    run_from(request, loaded, None, begin, observer)
}

fn run_from(
    request: &Request,
    loaded: Loaded,
    origin: Option<&Origin>,
    begin: Begin<'_>,
    observer: Observer<'_>,
) -> Result<Finished, Failure> {
    let Loaded {
        scenario,
        robot,
        graph,
    } = settle(request, loaded, observer)?;
    // Before the first file is made; until then a signal ends the program at once.
    let signals = interrupts()?;
    let mut results = Results::create(request.out.as_deref(), &scenario.name)?;
    let folder = results.folder.clone();
    origin.map_or(Ok(()), |origin| origin.spare(&folder))?;
    let job = Job {
        record: request.record,
        from: origin.map(|origin| origin.branch.clone()),
        ..load::job(&robot, scenario, graph, request.mode, folder.clone())
    };
    results.reserve(&job)?;
    results.remove_old(&job)?;
    let mut plan = plan(&job)?;
    plan.limits = plan.limits.with_silence(request.silence_limit);
    if let Some(origin) = origin {
        plan.begin = origin.hand_over(&job)?;
        let (from, run) = (plan.begin.tick, &origin.branch.run);
        say(observer, format_args!("goes on from tick {from} of {run}"));
    }
    let prepared = Prepared {
        job,
        results,
        plan,
        earlier: origin.map_or_else(Vec::new, |origin| origin.faults.clone()),
        live: request.live.then(Live::start).transpose()?,
        unread: request.unread,
        signals,
    };
    prepared.run(begin, observer)
}

/// The scenario with the plant and the doors asked for, whose first tick the law has tried.
fn settle(
    request: &Request,
    mut loaded: Loaded,
    observer: Observer<'_>,
) -> Result<Loaded, Failure> {
    if let Some(plant) = &request.plant {
        robot::put_in(&mut loaded, plant)?;
    }
    if let Some(options) = &request.ros2 {
        ros2::add(&mut loaded, options)?;
    }
    let is_ours = |one: &Process| one.role() == Role::World && one.program().is_some();
    let scenario = &loaded.scenario;
    let has_surface = !scenario.plant.surface.is_empty();
    if scenario.presses() && !has_surface && loaded.graph.process.iter().any(is_ours) {
        return Err(Failure::Input(format!(
            "{}: a segment presses, and there is nothing to press on: add a [[plant.surface]]",
            request.scenario
        )));
    }
    let loaded = robot::settle(loaded, request.mode, observer)?;
    let (robot, scenario) = (&loaded.robot, &loaded.scenario);
    let named = |sentence: String| format!("{}: {sentence}", request.scenario);
    let warning = chain::try_first_tick(robot, scenario, &loaded.graph);
    let warning = warning
        .map_err(|error| Failure::Input(named(error.to_string() + &advice(robot, scenario))))?;
    let warnings = warning.into_iter().chain(units::doubt(scenario));
    warnings
        .map(named)
        .for_each(|warning| say(observer, warning));
    Ok(loaded)
}

/// Advice for a scenario that the law refuses, as a clause: a change with which a run on one thread has reached its goal.
fn advice(robot: &Robot, scenario: &Scenario) -> String {
    let mut succeeds = |changed: &Scenario| {
        let changed = chain::without_faults(changed);
        let Ok(mut judge) = Judge::new(robot, &changed) else {
            return false;
        };
        let ran = chain::run(robot, &changed, |tick| {
            judge.take(&tick.lent());
        });
        ran.is_ok() && judge.verdict().outcome == REACHED
    };
    // Advice that cannot be found is none: the refusal stands for itself.
    control::advice(robot, scenario, &mut succeeds).unwrap_or_default()
}

/// A run whose folder is taken and holds all that comes before its first tick.
pub(crate) struct Prepared {
    pub(crate) job: Job,
    pub(crate) results: Results,
    pub(crate) plan: Plan,
    /// The account of the faults before its first tick.
    pub(crate) earlier: Vec<FaultSummary>,
    pub(crate) live: Option<Live>,
    /// See [`Request`].
    pub(crate) unread: fn() -> BTreeMap<String, u64>,
    pub(crate) signals: Interrupts,
}

impl Prepared {
    /// Launches it, summarises it when it is over, keeps its results and draws it; `begin` sees it before its first process starts.
    ///
    /// # Errors
    /// [`Failure::Work`] if the processes cannot be started or watched, and whatever `begin` returns.
    pub(crate) fn run(
        mut self,
        begin: Begin<'_>,
        observer: Observer<'_>,
    ) -> Result<Finished, Failure> {
        let (from, began) = (self.plan.begin.tick, Instant::now());
        let mut begin = |run: &RunDir| {
            let live = self.live.as_mut();
            live.map_or(Ok(()), |live| live.follow(run.path()))?;
            begin(run)
        };
        let (outcome, account) = launch(&self.job, self.plan, &mut begin, observer)?;
        let mut summary = summarise(&self.job, &outcome, account);
        let unread = (self.unread)();
        for process in &mut summary.processes {
            process.lines_dropped += unread.get(&process.name).copied().unwrap_or_default();
        }
        add_deaths(&mut summary, &self.job.deaths);
        if from > 0 {
            add_earlier(&mut summary, from, &self.earlier, began.elapsed());
        }
        let saved = self.results.keep(&self.job, &summary);
        let folder = self.results.folder.clone();
        for sentence in self.live.into_iter().flat_map(|live| live.finish(&folder)) {
            say(observer, sentence);
        }
        while self.signals.pending().is_some() {}
        let drawn = draw_results(&self.job, &summary, observer, &mut self.signals);
        Ok(Finished {
            saved: saved.and_then(|()| whole(&summary)).and(drawn),
            summary,
            folder,
            end: outcome.end,
            signals: self.signals,
        })
    }
}

/// Whether the record holds the whole run, as far as its summary knows.
///
/// # Errors
/// [`Failure::Work`] if it does not: a full volume, a damaged record.
pub fn whole(summary: &Summary) -> Result<(), Failure> {
    match &summary.recorder.error {
        error if error.is_empty() => Ok(()),
        error => Err(Failure::Work(format!("the results are not whole: {error}"))),
    }
}
