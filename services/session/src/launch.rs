//! Starts the processes of a plan, and listens to them until they end.

use std::path::{Path, PathBuf};
use std::process::Command;

use files::Draft;
use launcher::{Death, Delay, Event, Interrupts, Launcher, Outcome, Plan, Ran};
use model::Robot;
use runtime::{FaultTable, RunDir};
use shared_types::graph::Process;
use shared_types::job::{JOB, Job};
use shared_types::summary::Summary;

use crate::export::joined;
use crate::failure::Failure;
use crate::load;
use crate::origin::{self, Past};
use crate::progress::{Observer, Progress};
use crate::summary::death;

/// Memory for the recorder's part of the summary, taken before the first process starts; bytes.
const ACCOUNT_BYTES: usize = 256 * 1024;

/// The arm of a run in MJCF, for programs of others.
const ARM: &str = "arm.xml";

/// Runs the processes to the end of the task, or of one of them, and tells the observer what happens; `begin` sees the run before its first process starts,
/// each time that all processes start.
///
/// # Errors
/// See [`launch_watched`].
pub fn launch(
    job: &Job,
    plan: Plan,
    begin: Begin<'_>,
    observer: Observer<'_>,
) -> Result<(Outcome, Option<Summary>), Failure> {
    observer(Progress::Begin {
        title: &job.scenario.name,
        length: job.scenario.planned_ticks(),
        unit: "ticks",
    });
    let launched = launch_watched(job, plan, begin, &mut |event| match event {
        Event::Progress { ticks } => observer(Progress::Position(*ticks)),
        Event::Line { process, line } => observer(Progress::Line(&format!("{process}: {line}"))),
        Event::Silenced {
            process,
            silent,
            tick,
            writes,
        } => {
            let due = due(*tick, writes)
                .map(|due| format!(": {due} was due"))
                .unwrap_or_default();
            observer(Progress::Line(&format!(
                "{process} has done nothing for {} ms and is killed{due}",
                silent.as_millis()
            )));
        }
        Event::RolledBack { deaths, from } => observer(Progress::Line(&rolled_back(deaths, *from))),
        Event::Restarted {
            process,
            exit,
            pid,
            incarnation,
        } => {
            observer(Progress::Line(&format!(
                "{process} ended with {exit} and was started again (start {incarnation}, process {pid})"
            )));
        }
        Event::Waiting {
            process,
            reason: Delay::Behind,
            tick,
            writes,
        } if !writes.is_empty() => {
            let due = due(*tick, writes).unwrap_or_default();
            let remedy = "Ctrl-C ends the run; `--silence-limit SECONDS` would replace the process";
            observer(Progress::Line(&format!(
                "{process} has not sent {due}: waiting ({remedy})"
            )));
        }
        Event::Waiting {
            process, reason, ..
        } => observer(Progress::Line(&format!("{process} {reason}"))),
        Event::Stopped => {}
    });
    observer(Progress::End);
    launched
}

/// `plant ended with signal 9 (SIGKILL) at tick 1200: all processes repeat the ticks from 1000 on, in 0.1 s`.
fn rolled_back(deaths: &[Death], from: u64) -> String {
    let ends = deaths
        .iter()
        .map(|death| format!("{} ended with {}", death.process, death.exit));
    let (tick, lost) = (
        deaths.iter().map(|death| death.tick).max(),
        deaths.iter().filter_map(|death| death.again).max(),
    );
    format!(
        "{} at tick {}: all processes repeat the ticks from {from} on, in {:.1} s",
        ends.collect::<Vec<_>>().join(" and "),
        tick.unwrap_or_default(),
        lost.unwrap_or_default().1.as_secs_f64()
    )
}

/// Messages that are due from a process, in words; `None` if it writes none.
fn due(tick: u64, writes: &[String]) -> Option<String> {
    let topics: Vec<String> = writes.iter().map(|topic| format!("`{topic}`")).collect();
    (!topics.is_empty()).then(|| format!("{} of tick {tick}", topics.join(", ")))
}

/// Takes in Ctrl-C and its like as long as the result is held: a command holds it until its results are written.
///
/// # Errors
/// [`Failure::Work`] if the kernel refuses.
pub fn interrupts() -> Result<Interrupts, Failure> {
    Interrupts::catch().map_err(Failure::work)
}

/// Called with a run before its first process starts: in lockstep after each roll-back, too, with another directory.
pub type Begin<'a> = &'a mut dyn FnMut(&RunDir) -> Result<(), Failure>;

/// Runs the processes; `begin` sees the run before its first process starts, each time, `report` every event. Returns the launcher's outcome and the
/// recorder's part of the summary.
///
/// # Errors
/// [`Failure::Work`] if the launcher cannot prepare or watch the run, and whatever `begin` returns.
pub fn launch_watched(
    job: &Job,
    plan: Plan,
    begin: Begin<'_>,
    report: &mut dyn FnMut(&Event<'_>),
) -> Result<(Outcome, Option<Summary>), Failure> {
    // Before the first file of the run is made: from here on a signal ends the run, and the run removes what it has made.
    let _signals = interrupts()?;
    let mut launcher = Launcher::prepare(plan).map_err(Failure::work)?;
    loop {
        let Start {
            job, account_path, ..
        } = &Start::set_up(job, &launcher, begin)?;
        let commands = |name: &str, run: &Path| command(job, name, run);
        let newest = |faults: &FaultTable| newest_cut(job, faults);
        let mut account = None;
        let ran = launcher.run(&commands, &newest, &mut |event| {
            if event == Event::Stopped {
                let text = std::fs::read(account_path).ok();
                account = text.and_then(|text| serde_json::from_slice(&text).ok());
            }
            report(&event);
        });
        match ran.map_err(Failure::work)? {
            Ran::Ended(outcome) => return Ok((*outcome, whole_account(job, account)?)),
            Ran::RolledBack(again) => launcher = *again,
        }
    }
}

/// The newest cut in the record of a job's run from which a run with these faults goes on.
fn newest_cut(job: &Job, faults: &FaultTable) -> Option<launcher::Begin> {
    let record = job.out.join(recorder::MESSAGES);
    if !job.record {
        return None;
    }
    let faults: Vec<_> = faults.records().map(|(_, fault)| fault.scheduled).collect();
    let cut = origin::newest_cut(&record, job, &faults, u64::MAX);
    let cut = cut.inspect_err(runtime::complain).ok()?;
    (cut.tick > 0).then_some(cut)
}

/// The recorder's part of the summary, made from the record where the recorder has left none.
fn whole_account(job: &Job, account: Option<Summary>) -> Result<Option<Summary>, Failure> {
    let has_record = job.record && job.out.join(recorder::MESSAGES).exists();
    if account.is_some() || !has_record {
        return Ok(account);
    }
    let robot = Robot::from_source(&job.robot).map_err(Failure::work)?;
    let mut made = recorder::rebuild(&robot, job).map_err(Failure::work)?;
    let none = "the recorder left no account of the run: this one is made from its record";
    made.recorder.error = joined([none, &made.recorder.error]);
    Ok(Some(made))
}

/// One start of all processes of a run, which has a directory of its own.
struct Start {
    job: Job,
    /// The recorder's part of the summary.
    account_path: PathBuf,
    _guard: Option<launcher::Guard>,
    /// The messages of programs without a state before the cut.
    _past: Option<Past>,
}

impl Start {
    /// Puts all that the processes need to know into the run's directory.
    fn set_up(job: &Job, launcher: &Launcher, begin: Begin<'_>) -> Result<Self, Failure> {
        let (run_dir, cut) = (launcher.run_dir(), launcher.begin());
        let name = run_dir.file_name().unwrap_or_default();
        let job = Job {
            run: name.to_string_lossy().into_owned(),
            deaths: [
                &job.deaths[..],
                &launcher.deaths().iter().map(death).collect::<Vec<_>>(),
            ]
            .concat(),
            ..job.clone()
        };
        let account_path = run_dir.join(recorder::SUMMARY);
        runtime::reserve(&account_path, ACCOUNT_BYTES)
            .map_err(|error| Failure::Work(format!("no memory for the run's summary: {error}")))?;
        write_job(&job, run_dir)?;
        let has_past = origin::has_past(&cut.saved);
        let past = has_past.then(|| Past::leave(&job, cut)).transpose()?;
        begin(&RunDir::open(run_dir).map_err(Failure::work)?)?;
        let mut programs = job.graph.process.iter().map(|process| &process.command);
        let has_programs = programs.any(|command| !command.is_empty());
        let start = || launcher::Guard::start(GUARD, run_dir);
        let guard = has_programs.then(start).transpose();
        let guard = guard.map_err(Failure::cannot("start", Path::new(GUARD)))?;
        Ok(Self {
            job,
            account_path,
            _guard: guard,
            _past: past,
        })
    }
}

/// Writes what the processes need to know, and the arm for programs; and the job into the results folder too, before anything happens: what a killed
/// launcher leaves can be read and recovered.
fn write_job(job: &Job, run_dir: &Path) -> Result<(), Failure> {
    let path = run_dir.join(JOB);
    let text = serde_json::to_vec(job).map_err(Failure::work)?;
    files::write(&path, text).map_err(Failure::cannot("write", &path))?;
    if job.graph.process.iter().any(Process::is_of_others) {
        let (robot, path) = (Robot::from_source(&job.robot), run_dir.join(ARM));
        let robot = robot.map_err(Failure::work)?;
        let start = robot.start_posture(&job.scenario.start);
        let arm = robot.to_mjcf(job.scenario.frame(), &start.map_err(Failure::work)?);
        files::write(&path, arm).map_err(Failure::cannot("write", &path))?;
    }
    if job.out.is_dir() {
        let record = job.out.join(recorder::MESSAGES);
        if job.record && !record.exists() {
            // Empty, and before the job: a killed run that has a job and no record has lost it since.
            files::create(&record).map_err(Failure::cannot("make", &record))?;
        }
        let path = job.out.join(JOB);
        let kept = serde_json::to_vec_pretty(job).map_err(Failure::work)?;
        Draft::write(&path, kept).map_err(Failure::cannot("write", &path))?;
    }
    Ok(())
}

/// The command of a process: this program itself, or the one in the graph.
fn command(job: &Job, name: &str, run: &Path) -> std::io::Result<Command> {
    let Some(process) = job.graph.process(name) else {
        return launcher::reexec(name, run);
    };
    if !process.command.is_empty() {
        // Started again: what its predecessor has left.
        launcher::end_descendants(run, Some(name));
    }
    if !process.robot.is_empty() {
        return launcher::reexec(ROBOT, run);
    }
    if process.external {
        return launcher::reexec(STAND_IN, run);
    }
    let Some(mut command) = load::command(&job.graph, name) else {
        return launcher::reexec(process.program_name(), run);
    };
    // It finds the library that fits this program.
    command.env("ARMPLANE", std::env::current_exe()?);
    Ok(command)
}

/// The subcommand that ends the descendants of a run's programs once its launcher has ended.
pub const GUARD: &str = "guard";

/// The subcommand that stands for a program which is started separately.
const STAND_IN: &str = "stand-in";

/// The subcommand that stands for a robot.
pub const ROBOT: &str = "plant-fci";
