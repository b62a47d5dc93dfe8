//! `armplane run`: validate, launch, watch, tell.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use launcher::{Child, End, Event, Launcher, Limits, Outcome, Plan, Restart};
use runtime::realtime::allowed_cores;
use runtime::{FaultRecord, RunDir};
use shared_types::graph::{self, Graph};
use shared_types::job::{Job, Mode};
use shared_types::scenario::Scenario;
use shared_types::summary::{Deadlines, FaultSummary, ProcessSummary, Summary};

use super::failure::Failure;
use super::out::say;
use super::process::JOB;
use super::table::{digits, number, table};
use super::view::Live;
use super::{RunArgs, load, report};

const SUMMARY: &str = "summary.json";
const SCENARIO: &str = "scenario.toml";
const ROBOT_URDF: &str = "robot.urdf";
const ROBOT_TOML: &str = "robot.toml";
/// In the results folder while the run goes on; gone at its end.
const RESERVE: &str = ".armplane";
/// More than a summary takes, faults included; bytes.
const SUMMARY_BYTES: usize = 128 * 1024;

pub(crate) fn run(args: &RunArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let load::Loaded { scenario, robot } = load::scenario(&args.scenario, &args.set, args.seed)?;
    let graph = load::graph(args.graph.as_deref())?;
    chain::try_first_tick(&robot, &scenario).map_err(|error| Failure::Input(format!("{}: {error}", args.scenario)))?;
    let mode = Mode::from(args.mode);
    let results = Results::create(args.out.as_deref(), &scenario.name)?;
    let job = Job {
        record: !args.no_record,
        messages: !args.no_record && !args.no_messages,
        live: args.live,
        ..load::job(&robot, scenario, graph, mode, results.folder.clone())
    };
    results.reserve(&job)?;
    for old in viz::parts_in(&results.folder) {
        std::fs::remove_file(&old).map_err(|error| Failure::Input(format!("cannot replace {}: {error}", old.display())))?;
    }
    let plan = plan(&job)?;
    let live = if args.live { Some(Live::start(&results.folder)?) } else { None };
    let launched = launch(&job, plan);
    if let Some(sentence) = live.and_then(Live::finish) {
        eprintln!("armplane: {sentence}");
    }
    let (outcome, account) = launched?;
    let summary = summarise(&job, &outcome, account);
    let kept = results.keep(&job, &summary);
    if as_json {
        say!("{}", serde_json::to_string_pretty(&summary).map_err(Failure::work)?);
    } else {
        tell(&summary, &results.folder);
    }
    if let End::Failed(failure) = &outcome.end {
        return Err(Failure::Work(failure.to_string()));
    }
    kept?;
    Ok(if summary.outcome == "goal reached" { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// Runs the processes to the end of the task, or of one of them, and says what happens. Returns what became of them, and the recorder's account.
pub(crate) fn launch(job: &Job, plan: Plan) -> Result<(Outcome, Option<Summary>), Failure> {
    let bar = progress_bar(&job.scenario);
    let launched = launch_quietly(job, plan, &mut |_| Ok(()), &mut |event| match event {
        Event::Progress { ticks } => bar.set_position(*ticks),
        Event::Line { process, line } => bar.suspend(|| eprintln!("{process}: {line}")),
        Event::Silenced { process, silent } => {
            bar.suspend(|| eprintln!("{process} has done nothing for {} ms and is killed", silent.as_millis()));
        }
        Event::Restarted { process, exit, pid, incarnation } => {
            bar.suspend(|| eprintln!("{process} ended with {exit} and was started again (start {incarnation}, process {pid})"));
        }
        Event::Go | Event::Stopping | Event::Stopped => {}
    });
    bar.finish_and_clear();
    launched
}

/// Gets to know a run before its first process starts.
pub(crate) type Begin<'a> = &'a mut dyn FnMut(&RunDir) -> Result<(), Failure>;

/// The same without a word; `begin` sees the run before anything of it starts.
pub(crate) fn launch_quietly(
    job: &Job,
    plan: Plan,
    begin: Begin<'_>,
    report: &mut dyn FnMut(&Event<'_>),
) -> Result<(Outcome, Option<Summary>), Failure> {
    let launcher = Launcher::prepare(plan).map_err(Failure::work)?;
    let run_dir = launcher.run_dir().to_owned();
    let job = Job { run: run_dir.file_name().unwrap_or_default().to_string_lossy().into_owned(), ..job.clone() };
    let (path, account_path) = (run_dir.join(JOB), run_dir.join(recorder::SUMMARY));
    let text = serde_json::to_vec(&job).map_err(Failure::work)?;
    std::fs::write(&path, text).map_err(|error| Failure::Work(format!("cannot write {}: {error}", path.display())))?;
    begin(&RunDir::open(&run_dir).map_err(Failure::work)?)?;
    let mut account = None;
    let outcome = launcher.run(&launcher::reexec, &mut |event| {
        if event == Event::Stopped {
            account = std::fs::read(&account_path).ok().and_then(|text| serde_json::from_slice(&text).ok());
        }
        report(&event);
    });
    Ok((outcome.map_err(Failure::work)?, account))
}

/// A bar on a terminal, nothing elsewhere.
pub(crate) fn progress_bar(scenario: &Scenario) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} {wide_bar:.cyan/dim} {pos}/{len} ticks  {per_sec}  {eta}");
    let bar = ProgressBar::new(scenario.planned_ticks()).with_message(scenario.name.clone());
    style.map_or(bar.clone(), |style| bar.with_style(style))
}

/// From the graph, as people write it, to the launcher's plan.
pub(crate) fn plan(job: &Job) -> Result<Plan, Failure> {
    let place = |name: &str| job.graph.process.iter().position(|process| process.name == name).and_then(|place| u32::try_from(place).ok());
    let faults = job.scenario.strikes(place).map_err(|complaint| Failure::Input(format!("{}: {complaint}", job.scenario.name)))?;
    let cores = allowed_cores();
    // Lockstep runs side by side shall not all crowd the same core: which one is "core 0" turns with the process id.
    let turn = if job.mode == Mode::Lockstep { std::process::id() as usize } else { 0 };
    let children = job.graph.process.iter().map(|process| Child {
        process: runtime::Process {
            name: process.name.clone(),
            reads: process.reads.iter().chain(&process.feedback).cloned().collect(),
            writes: process.writes.clone(),
            polled: process.writes.is_empty(),
            makes_ticks: !process.feedback.is_empty(),
            core: (!cores.is_empty()).then(|| cores[(process.core + turn) % cores.len()]),
            priority: (process.priority > 0).then_some(process.priority as u8),
            disturbance: runtime::Disturbance::default(),
        },
        ends_run: !process.feedback.is_empty(),
        restart: match process.restart {
            graph::Restart::Never => Restart::Never,
            graph::Restart::Always => Restart::Budget { times: 5, back_off: Duration::from_millis(10) },
        },
    });
    Ok(Plan {
        mode: match job.mode {
            Mode::Lockstep => runtime::Mode::Lockstep,
            Mode::Realtime => runtime::Mode::Realtime,
        },
        rate_hz: job.scenario.rate_hz,
        children: children.collect(),
        limits: Limits::default(),
        faults,
    })
}

/// The recorder's part, completed by what only the launcher knows.
pub(crate) fn summarise(job: &Job, outcome: &Outcome, account: Option<Summary>) -> Summary {
    let mut summary = account.unwrap_or_else(|| Summary {
        version: job.version.clone(),
        scenario: job.scenario.name.clone(),
        robot: job.robot.name.clone(),
        mode: job.mode.name().to_owned(),
        seed: job.scenario.seed,
        rate_hz: job.scenario.rate_hz,
        ticks: outcome.ticks,
        outcome: "failed".to_owned(),
        reason: "the recorder left no account of the run".to_owned(),
        ..Summary::default()
    });
    match &outcome.end {
        End::Completed => {}
        End::Interrupted { signal } => {
            summary.completed = false;
            summary.outcome = "interrupted".to_owned();
            summary.reason = format!("stopped by {signal} after {} ticks", outcome.ticks);
        }
        End::Failed(failure) => {
            let sentence = failure.to_string();
            let first = sentence.lines().next().unwrap_or_default().trim_end_matches("; it said:").to_owned();
            summary.completed = false;
            summary.outcome = "failed".to_owned();
            summary.faults.push(FaultSummary {
                tick: outcome.ticks,
                process: named_in(&job.graph, &first),
                kind: "exit".to_owned(),
                detail: first.clone(),
                ..FaultSummary::default()
            });
            summary.reason = first;
        }
    }
    summary.machine = report::machine();
    let mut faults: Vec<_> = outcome.faults.iter().map(|account| fault_summary(job, account)).collect();
    faults.append(&mut summary.faults);
    summary.faults = faults;
    summary.deadlines = deadlines(job, outcome);
    summary.processes = outcome
        .processes
        .iter()
        .map(|process| ProcessSummary {
            name: process.name.clone(),
            pid: process.pid,
            restarts: process.restarts,
            exit: process.exit.to_string(),
        })
        .collect();
    summary
}

/// What a fault was and what became of it.
fn fault_summary(job: &Job, account: &FaultRecord) -> FaultSummary {
    let process = job.graph.process.get(account.scheduled.process as usize).map(|process| process.name.clone()).unwrap_or_default();
    let fault = account.scheduled.fault(&process);
    let since_ms = |ns: u64| (account.injected_ns != 0 && ns != 0).then(|| ns.saturating_sub(account.injected_ns) as f64 * 1e-6);
    FaultSummary {
        tick: account.scheduled.at,
        kind: fault.as_ref().map(|fault| fault.kind.name().to_owned()).unwrap_or_default(),
        detail: fault.as_ref().map(ToString::to_string).unwrap_or_default(),
        origin: account.origin.name().to_owned(),
        struck: account.injected_ns != 0,
        detected_ms: since_ms(account.detected_ns),
        restored_ms: since_ms(account.recovered_ns),
        fault,
        process,
    }
}

fn named_in(graph: &Graph, sentence: &str) -> String {
    graph.process.iter().find(|process| sentence.starts_with(&process.name)).map(|process| process.name.clone()).unwrap_or_default()
}

pub(crate) fn deadlines(job: &Job, outcome: &Outcome) -> Deadlines {
    if job.mode == Mode::Lockstep {
        return Deadlines::default();
    }
    let mut deadlines = Deadlines { total: outcome.ticks, ..Deadlines::default() };
    for process in &outcome.processes {
        let counts = &process.counts;
        let causes = [
            ("major page fault", counts.missed_major_fault),
            ("preempted", counts.missed_preempted),
            ("peer restart", counts.missed_peer_restart),
            ("late input", counts.missed_late_input),
            ("overrun", counts.missed_overrun),
        ];
        for (cause, count) in causes.into_iter().filter(|(_, count)| *count > 0) {
            deadlines.by_cause.insert(format!("{}: {cause}", process.name), count);
            deadlines.missed += count;
        }
    }
    deadlines
}

/// The results folder: made before anything starts, removed again if nothing came of it.
pub(crate) struct Results {
    pub(crate) folder: PathBuf,
    made: bool,
}

impl Results {
    /// The folder asked for, or the next free `runs/NAME-NNN`.
    ///
    /// # Errors
    /// [`Failure::Input`] if it cannot be written to.
    pub(crate) fn create(wanted: Option<&Path>, name: &str) -> Result<Self, Failure> {
        let cannot = |path: &Path, error: std::io::Error| {
            Failure::Input(format!("cannot write results to {}: {error}; choose another folder with --out", path.display()))
        };
        let folder = match wanted {
            Some(folder) => folder.to_owned(),
            None => (1..).map(|n| PathBuf::from(format!("runs/{name}-{n:03}"))).find(|path| !path.exists()).unwrap_or_default(),
        };
        let made = !folder.exists();
        std::fs::create_dir_all(&folder).map_err(|error| cannot(&folder, error))?;
        let folder = folder.canonicalize().map_err(|error| cannot(&folder, error))?;
        let results = Self { folder, made };
        let probe = results.folder.join(RESERVE);
        std::fs::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe)).map_err(|error| cannot(&results.folder, error))?;
        Ok(results)
    }

    /// Takes the room that the run's account will need: a recording that fills the disk shall not be the end of the summary too.
    fn reserve(&self, job: &Job) -> Result<(), Failure> {
        let size = 2 * serde_json::to_vec_pretty(job).map_err(Failure::work)?.len() + SUMMARY_BYTES;
        let path = self.folder.join(RESERVE);
        std::fs::write(&path, vec![0; size]).map_err(|error| {
            let _ = std::fs::remove_file(&path);
            Failure::Input(format!("cannot write results to {}: {error}; choose another folder with --out", self.folder.display()))
        })
    }

    fn release(&self) {
        let _ = std::fs::remove_file(self.folder.join(RESERVE));
    }

    /// Writes what makes the run repeatable and readable: the summary, the job, and the scenario with every fault planned that came to pass.
    fn keep(&self, job: &Job, summary: &Summary) -> Result<(), Failure> {
        self.release();
        keep(&self.folder, job, summary)
    }
}

/// Writes into a run's folder what makes it repeatable and readable.
pub(crate) fn keep(folder: &Path, job: &Job, summary: &Summary) -> Result<(), Failure> {
    let cannot = |name: &str, error: std::io::Error| Failure::Work(format!("cannot write {}: {error}", folder.join(name).display()));
    let repeated = repeated(job, summary)?;
    let summary = serde_json::to_vec_pretty(summary).map_err(Failure::work)?;
    let job_text = serde_json::to_vec_pretty(job).map_err(Failure::work)?;
    for (name, text) in [(SUMMARY, summary), (JOB, job_text)].into_iter().chain(repeated) {
        // Whole or not at all: a full disk leaves no half file.
        let (draft, path) = (folder.join(format!(".{name}")), folder.join(name));
        let written = std::fs::write(&draft, text).and_then(|()| std::fs::rename(&draft, &path));
        written.map_err(|error| {
            let _ = std::fs::remove_file(&draft);
            cannot(name, error)
        })?;
    }
    Ok(())
}

impl Drop for Results {
    fn drop(&mut self) {
        self.release();
        if self.made {
            // Fails, as it should, where there is something in it.
            let _ = std::fs::remove_dir(&self.folder);
        }
    }
}

/// The files of the scenario that gives the same bytes again, and the robot beside it where it is not a built-in one.
fn repeated(job: &Job, summary: &Summary) -> Result<Vec<(&'static str, Vec<u8>)>, Failure> {
    let fault = summary.faults.iter().filter_map(|fault| fault.fault.clone()).collect();
    let mut files = Vec::new();
    let mut scenario = Scenario { fault, ..job.scenario.clone() };
    if scenario.robot.ends_with(".urdf") {
        ROBOT_URDF.clone_into(&mut scenario.robot);
        files.push((ROBOT_URDF, job.robot.urdf.clone().into_bytes()));
        if !job.robot.description.is_empty() {
            files.push((ROBOT_TOML, job.robot.description.clone().into_bytes()));
        }
    }
    files.push((SCENARIO, toml::to_string(&scenario).map_err(Failure::work)?.into_bytes()));
    Ok(files)
}

fn tell(summary: &Summary, folder: &Path) {
    say!("{}: {} — {}\n", summary.scenario, summary.outcome, summary.reason);
    let mut rows = table(&["task", "largest", "across ζ", "at the end"]);
    let task = &summary.task;
    rows.add_row([
        "position, mm".into(),
        number(digits(task.position_max_mm)),
        number(digits(task.orthogonal_max_mm)),
        number(digits(task.final_position_mm)),
    ]);
    rows.add_row([
        "orientation, °".into(),
        number(digits(task.orientation_max_deg)),
        number(digits(task.orthogonal_max_deg)),
        number(digits(task.final_orientation_deg)),
    ]);
    say!("{rows}");
    let mut rows = table(&["singularity", "type", "least |s|", "inside, ticks", "ζ turned, °"]);
    for singularity in &summary.singularities {
        rows.add_row([
            singularity.name.clone().into(),
            singularity.class.clone().into(),
            number(digits(singularity.s_min)),
            number(singularity.inside_ticks),
            number(digits(singularity.zeta_turned_deg)),
        ]);
    }
    say!("{rows}");
    for turn in &summary.turns {
        let joints = |moves: &[f64]| moves.iter().map(|by| format!("{by:+.2}")).collect::<Vec<_>>().join(" ");
        say!("ζ turned   {} at tick {}", turn.singularity, turn.tick);
        say!("           said before: joints by {} ° in {:.2} s", joints(&turn.planned_deg), turn.planned_s);
        say!(
            "           done:        joints by {} ° in {:.2} s",
            joints(&turn.moved_deg),
            turn.took_ticks as f64 / f64::from(summary.rate_hz.max(1))
        );
    }
    let percent = |ratio: f64| format!("{:.0} %", ratio * 100.0);
    let joints = &summary.joints;
    say!(
        "joints     torque {} of the limit, largest step in one tick {}; speed {} of the limit",
        percent(joints.torque_max_ratio),
        percent(joints.torque_step_max_ratio),
        percent(joints.speed_max_ratio)
    );
    if joints.switches > 0 {
        say!("switches   {} changes of mode, {} J put in by them", joints.switches, digits(joints.switch_energy_j));
    }
    let simulated_s = summary.ticks as f64 / f64::from(summary.rate_hz.max(1));
    say!(
        "time       {} ticks at {} Hz in {:.2} s: {:.0} ticks/s, {:.1} × real time, {}",
        summary.ticks,
        summary.rate_hz,
        summary.wall_s,
        summary.ticks_per_s,
        simulated_s / summary.wall_s.max(1e-9),
        summary.mode
    );
    if let Some(chain) = summary.latency_us.get("chain") {
        say!("latency    sensor to torque p50 {:.1} µs, p99 {:.1}, p99.9 {:.1}, max {:.1}", chain.p50, chain.p99, chain.p999, chain.max);
    }
    if summary.deadlines.total > 0 {
        say!("deadlines  {} missed of {}", summary.deadlines.missed, summary.deadlines.total);
        for (cause, count) in &summary.deadlines.by_cause {
            say!("           {count} {cause}");
        }
    }
    for fault in summary.faults.iter().filter(|fault| fault.fault.is_some()) {
        let ms = |what: &str, ms: Option<f64>| ms.map(|ms| format!(", {what} after {ms:.2} ms")).unwrap_or_default();
        let became = if fault.struck {
            ms("noticed", fault.detected_ms) + &ms("mended", fault.restored_ms)
        } else {
            ", did not come to pass".into()
        };
        say!("fault      {} ({}){became}", fault.detail, fault.origin);
    }
    if !summary.recorder.error.is_empty() {
        say!("recording  {}", summary.recorder.error);
    }
    say!("\n{}", folder.display());
    if folder.join(SUMMARY).exists() {
        say!("  {SUMMARY}  all of this and more, for machines");
    }
    if !summary.recorder.file.is_empty() {
        say!(
            "  {}       {:.1} MB{}; open it with: armplane view {}",
            summary.recorder.file,
            summary.recorder.bytes as f64 / 1e6,
            if summary.recorder.parts > 1 { format!(" in {} parts", summary.recorder.parts) } else { String::new() },
            folder.display()
        );
    }
    if summary.recorder.messages_bytes > 0 {
        let (messages, megabytes) = (recorder::MESSAGES, summary.recorder.messages_bytes as f64 / 1e6);
        say!("  {messages}/     {megabytes:.1} MB; compute it again with: armplane replay {}", folder.display());
    }
}
