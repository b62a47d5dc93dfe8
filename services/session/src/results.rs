//! The folder of a run: created before the run starts, filled when it is over.

use std::fs::DirEntry;
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use recorder::{Contents, RecordReader};
use rustix::io::Errno;
use shared_types::codes::TARGET_END;
use shared_types::graph::Graph;
use shared_types::job::{JOB, Job, RobotText};
use shared_types::process::{Process, Program};
use shared_types::scenario::{Layout, Scenario, Servo};
use shared_types::summary::{INTERRUPTED, Summary};
use shared_types::target_file::{self, Row};
use shared_types::{Message, Target, TargetContent};

use crate::failure::Failure;
use crate::load;
use crate::origin;
use crate::runs::Run;
use crate::seal;

/// The folder of runs without `--out`.
pub const RUNS: &str = "runs";
/// Name of the summary in the results folder.
pub const SUMMARY: &str = "summary.json";
pub(crate) const SCENARIO: &str = "scenario.toml";
const GRAPH: &str = "graph.toml";
/// The targets of a steered run.
const TARGETS: &str = "targets.csv";
/// The beginning of the name of a segment's table.
const TABLE: &str = "segment-";
pub(crate) const ROBOT_URDF: &str = "robot.urdf";
const ROBOT_TOML: &str = "robot.toml";
/// The targets of a live session in lockstep while it lasts.
pub const GIVEN_TARGETS: &str = "targets.csv.tmp";
/// Made and removed to see whether the results folder can be written to.
const PROBE: &str = ".armplane";
/// The files of a run, and those that `view`, `report`, `export` and a drill leave beside it, but for tables and layouts.
const FILES: [&str; 15] = [
    SUMMARY,
    JOB,
    SCENARIO,
    GRAPH,
    ROBOT_URDF,
    ROBOT_TOML,
    TARGETS,
    recorder::MESSAGES,
    REPORT,
    viz::RECORDING,
    "signals.csv",
    "signals.parquet",
    "events.csv",
    "events.parquet",
    LINES,
];
/// The page of a run.
pub const REPORT: &str = "report.html";
/// The lines of the processes of a run that broke a guarantee.
pub const LINES: &str = "stderr.txt";
/// More than the numbers and faults of a run add to its summary; bytes.
const SUMMARY_BYTES: usize = 128 * 1024;
/// More than the faults of a run take in its scenario; bytes.
const FAULTS_BYTES: usize = 32 * 1024;

/// The remedies for a results folder that cannot be used.
struct Remedies {
    /// Files of the run that are only read there: a reader that finds one of them irregular says so itself.
    is_read: &'static [&'static str],
    busy: &'static str,
    irregular: &'static str,
    unwritable: &'static str,
}

const FOR_A_RUN: Remedies = Remedies {
    is_read: &[],
    busy: "choose another folder with --out",
    irregular: "remove it, or choose another folder with --out",
    unwritable: "choose another folder with --out",
};

const FOR_A_RECOVERY: Remedies = Remedies {
    is_read: &[JOB],
    busy: "wait until it ends",
    irregular: "remove it, and recover the run again",
    unwritable: "make it writable, or recover a copy of the folder",
};

impl Remedies {
    fn unusable(&self, folder: &Path, error: &io::Error) -> Failure {
        Failure::Input(format!(
            "cannot write results to {}: {error}; {}",
            folder.display(),
            self.unwritable
        ))
    }
}

/// The results folder: made before anything starts, removed again if nothing came of it.
pub struct Results {
    /// Absolute.
    pub folder: PathBuf,
    made: bool,
    /// Room has been taken for this run's account.
    has_reserve: bool,
    /// Files with names of results that were there without a run.
    foreign: Vec<String>,
    /// Held on the folder: one run at a time writes into it.
    _lock: OwnedFd,
}

impl Results {
    /// The folder asked for, or the next free `runs/NAME-NNN`.
    ///
    /// # Errors
    /// [`Failure::Input`] if it cannot be written to.
    pub fn create(wanted: Option<&Path>, name: &str) -> Result<Self, Failure> {
        let remedies = &FOR_A_RUN;
        let (folder, lock, made) = match wanted {
            Some(folder) => {
                let unusable = |error: io::Error| remedies.unusable(folder, &error);
                let above = folder.parent().map_or(Ok(()), std::fs::create_dir_all);
                above.map_err(unusable)?;
                let made = std::fs::create_dir(folder).is_ok();
                files::make_folder(folder).map_err(unusable)?;
                (folder.to_owned(), lock(folder).map_err(unusable)?, made)
            }
            None => next_free(name).map_err(|error| remedies.unusable(Path::new(RUNS), &error))?,
        };
        Self::hold(&folder, lock, made, remedies)
    }

    /// The folder `name` in the user's folder, for one of many runs; nothing of a former run is in it.
    ///
    /// # Errors
    /// As [`create`](Self::create) and [`clear`](Self::clear), and where it is a link: the user has named another place.
    pub fn within(folder: &Path, name: &str) -> Result<Self, Failure> {
        let folder = folder.join(name);
        if folder.is_symlink() {
            let (folder, remedy) = (folder.display(), FOR_A_RUN.irregular);
            return Err(Failure::Input(format!(
                "{folder} has the name of a run's folder and is a symbolic link: {remedy}"
            )));
        }
        let results = Self::create(Some(&folder), name)?;
        results.clear()?;
        Ok(results)
    }

    /// The folder of a run that is to be recovered.
    ///
    /// # Errors
    /// [`Failure::Input`] if it cannot be written to, or its run goes on.
    pub(crate) fn of_run(folder: &Path) -> Result<Self, Failure> {
        let remedies = &FOR_A_RECOVERY;
        let lock = lock(folder).map_err(|error| remedies.unusable(folder, &error))?;
        Self::hold(folder, lock, false, remedies)
    }

    /// A folder that is locked for this run, checked; `made`: it was not there before.
    fn hold(
        folder: &Path,
        lock: Option<OwnedFd>,
        made: bool,
        remedies: &Remedies,
    ) -> Result<Self, Failure> {
        let Some(lock) = lock else {
            let folder = folder.display();
            return Err(Failure::Input(format!(
                "another run writes its results into {folder}: {}",
                remedies.busy
            )));
        };
        let folder = folder
            .canonicalize()
            .map_err(|error| remedies.unusable(folder, &error))?;
        let mut results = Self {
            folder,
            made,
            has_reserve: false,
            foreign: Vec::new(),
            _lock: lock,
        };
        if !holds_run(&results.folder) {
            let names = entries(&results.folder).map(|(name, _)| name);
            results.foreign = names.filter(|name| is_result(name)).collect();
        }
        if let Some(path) = results.irregular(remedies.is_read) {
            let path = path.display();
            return Err(Failure::Input(format!(
                "{path} is in the way of a result and is not an ordinary file: {}",
                remedies.irregular
            )));
        }
        let probe = results.folder.join(PROBE);
        let probed = files::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe));
        probed.map_err(|error| remedies.unusable(&results.folder, &error))?;
        Ok(results)
    }

    /// A link, pipe, device or folder with the name of a result. A result written there would end
    /// up elsewhere, or wait for a reader.
    fn irregular(&self, is_read: &[&str]) -> Option<PathBuf> {
        let is_ours = |name: &str| is_result(name) && !is_read.contains(&name);
        let mut entries = entries(&self.folder);
        let found = entries.find(|(name, entry)| {
            is_ours(name) && entry.file_type().is_ok_and(|kind| !kind.is_file())
        });
        found.map(|(_, entry)| entry.path())
    }

    /// Writes a JSON file into the folder.
    ///
    /// # Errors
    /// [`Failure::Work`] if it cannot be written.
    pub fn save(&self, name: &str, value: &serde_json::Value) -> Result<(), Failure> {
        let path = self.folder.join(name);
        let text = serde_json::to_vec_pretty(value).map_err(Failure::work)?;
        files::write(&path, text).map_err(Failure::cannot("write", &path))
    }

    /// Takes the room that the run's account will need: a recording that fills the disk shall not be the end of the summary too.
    pub(crate) fn reserve(&mut self, job: &Job) -> Result<(), Failure> {
        self.has_reserve = true;
        for (name, text) in account(job, &Summary::default())? {
            let more = match name.as_str() {
                SUMMARY => SUMMARY_BYTES,
                _ => FAULTS_BYTES,
            };
            runtime::reserve(&self.folder.join(name), text.len() + more).map_err(|error| {
                release(&self.folder);
                FOR_A_RUN.unusable(&self.folder, &error)
            })?;
        }
        Ok(())
    }

    /// Removes all that armplane has written of a former run, so that nothing is taken for the next one's. A folder without a run is left as it is.
    ///
    /// # Errors
    /// [`Failure::Input`] if a file cannot be removed, or one with the name of a run's summary or job is not armplane's.
    pub fn clear(&self) -> Result<(), Failure> {
        self.clear_but(&[])
    }

    /// As [`clear`](Self::clear), except the files that this run writes anew.
    ///
    /// # Errors
    /// As there; and [`Failure::Input`] for somebody's own file that this run would write over.
    pub(crate) fn remove_old(&self, job: &Job) -> Result<(), Failure> {
        let again = account(job, &Summary::default())?;
        let again = again.iter().map(|(name, _)| name.as_str());
        let kept: Vec<_> = again.filter(|name| *name != SUMMARY).collect();
        let record = [recorder::MESSAGES, viz::RECORDING].into_iter();
        let mut written = kept.iter().copied().chain(record.filter(|_| job.record));
        if let Some(own) = written.find(|name| self.foreign.iter().any(|own| own == name)) {
            return Err(Failure::Input(format!(
                "{} is of no run, and the results would replace it: {}",
                self.folder.join(own).display(),
                FOR_A_RUN.busy
            )));
        }
        let _ = std::fs::remove_file(self.folder.join(GIVEN_TARGETS));
        self.clear_but(&kept)
    }

    fn clear_but(&self, kept: &[&str]) -> Result<(), Failure> {
        if !holds_run(&self.folder) {
            return Ok(());
        }
        let run = Run {
            folder: self.folder.clone(),
        };
        let (summary, job) = (run.summary_if_any(), run.read_job());
        let is_ours = matches!(summary, Ok(Some(_))) || job.is_ok();
        if let Some(defect) = summary.err().or(job.err()).filter(|_| !is_ours) {
            let remedy = FOR_A_RUN.irregular;
            return Err(Failure::Input(format!("{defect}; {remedy}")));
        }
        // Room that is reserved is this run's.
        let is_old = |name: &String| {
            is_result(name)
                && !kept.contains(&name.as_str())
                && !name.ends_with(".reserved")
                && !self.foreign.contains(name)
        };
        let old: Vec<_> = entries(&self.folder)
            .filter(|(name, _)| is_old(name))
            .map(|(_, entry)| entry.path())
            .collect();
        let remove = |old: &PathBuf| match std::fs::remove_file(old) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(Failure::Input(format!(
                "cannot replace {}: {error}",
                old.display()
            ))),
            _ => Ok(()),
        };
        old.iter().try_for_each(remove)
    }

    /// Writes the files that make the run repeatable and readable: summary, job, and the scenario
    /// with every fault that occurred.
    ///
    /// # Errors
    /// [`Failure::Work`] if a file cannot be written.
    pub(crate) fn keep(&self, job: &Job, summary: &Summary) -> Result<(), Failure> {
        let mut files = account(job, summary)?.into_iter();
        let written = files.try_for_each(|(name, text)| {
            let path = self.folder.join(name);
            // Whole or not at all: a full disk leaves no half file.
            runtime::write_reserved(&path, &text).map_err(Failure::cannot("write", &path))
        });
        release(&self.folder);
        written
    }
}

/// Whether a folder holds a run, ended or not.
pub fn holds_run(folder: &Path) -> bool {
    [SUMMARY, JOB].iter().any(|name| folder.join(name).exists())
}

fn entries(folder: &Path) -> impl Iterator<Item = (String, DirEntry)> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| (entry.file_name().to_string_lossy().into_owned(), entry))
}

/// Whether armplane writes a file of this name for a run, of it, or on the way to such a file.
fn is_result(name: &str) -> bool {
    let whole = [".reserved", ".tmp"]
        .iter()
        .find_map(|end| name.strip_suffix(end))
        .unwrap_or(name);
    FILES.contains(&whole)
        || whole.starts_with(TABLE) && whole.ends_with(".csv")
        || whole
            .strip_suffix(".rbl")
            .is_some_and(|layout| Layout::ALL.iter().any(|one| one.name() == layout))
}

/// Gives the room back that no file has taken.
fn release(folder: &Path) {
    for (name, _) in entries(folder).filter(|(name, _)| is_result(name)) {
        if let Some(whole) = name.strip_suffix(".reserved") {
            runtime::release_reserve(&folder.join(whole));
        }
    }
}

/// Takes the folder for this run; `None` if another run has it, or its owner has removed it meanwhile.
fn lock(folder: &Path) -> io::Result<Option<OwnedFd>> {
    use rustix::fs::{FlockOperation, Mode, OFlags, flock, fstat, open, stat};
    let held = open(
        folder,
        OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC,
        Mode::empty(),
    )?;
    match flock(&held, FlockOperation::NonBlockingLockExclusive) {
        // A file system without locks has no way to tell.
        Ok(()) | Err(Errno::NOSYS | Errno::OPNOTSUPP | Errno::NOLCK) => {}
        Err(Errno::WOULDBLOCK) => return Ok(None),
        Err(errno) => return Err(errno.into()),
    }
    let (ours, there) = (fstat(&held)?, stat(folder).ok());
    Ok(there
        .is_some_and(|there| (there.st_dev, there.st_ino) == (ours.st_dev, ours.st_ino))
        .then_some(held))
}

/// The next `runs/NAME-NNN` that does not exist yet.
fn next_free(name: &str) -> io::Result<(PathBuf, Option<OwnedFd>, bool)> {
    std::fs::create_dir_all(RUNS)?;
    let mut n = 0;
    loop {
        n += 1;
        let folder = Path::new(RUNS).join(format!("{name}-{n:03}"));
        match std::fs::create_dir(&folder) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
            made => made?,
        }
        if let Some(lock) = lock(&folder)? {
            return Ok((folder, Some(lock), true));
        }
    }
}

impl Drop for Results {
    fn drop(&mut self) {
        if self.has_reserve {
            release(&self.folder);
            let _ = std::fs::remove_file(self.folder.join(GIVEN_TARGETS));
        }
        if self.made {
            // Fails, as it should, where there is something in it.
            let _ = std::fs::remove_dir(&self.folder);
        }
    }
}

/// The arm's description; of one with meshes it names their folder, which is not that of the run.
fn description(robot: &RobotText) -> Result<String, Failure> {
    if !robot.urdf.contains("<mesh") {
        return Ok(robot.description.clone());
    }
    let mut table: toml::Table = robot.description.parse().map_err(Failure::work)?;
    let from = table.get("meshes").and_then(toml::Value::as_str);
    let folder = robot.folder.join(from.unwrap_or_default());
    table.insert("meshes".to_owned(), folder.display().to_string().into());
    Ok(table.to_string())
}

/// The files that make a run repeatable and readable: its job, those that repeat it, and its summary.
fn account(job: &Job, summary: &Summary) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let job_text = serde_json::to_vec_pretty(job).map_err(Failure::work)?;
    let mut files = vec![(JOB.to_owned(), job_text)];
    files.extend(repeated(job, summary)?);
    let summary = serde_json::to_vec_pretty(summary).map_err(Failure::work)?;
    // The last one: a folder that has it is whole, and `recover` leaves it.
    files.push((SUMMARY.to_owned(), summary));
    Ok(files)
}

/// The files of the scenario that repeats the run, with robot and graph beside it if they are not
/// built in.
fn repeated(job: &Job, summary: &Summary) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let fault = summary
        .faults
        .iter()
        .filter_map(|fault| fault.plan.clone())
        .collect();
    let mut files = Vec::new();
    let mut scenario = Scenario {
        fault,
        ..job.scenario.clone()
    };
    if load::is_arm_file(&scenario.robot) {
        ROBOT_URDF.clone_into(&mut scenario.robot);
        files.push((ROBOT_URDF.to_owned(), job.robot.urdf.clone().into_bytes()));
        let text = description(&job.robot)?;
        if !text.is_empty() {
            files.push((ROBOT_TOML.to_owned(), text.into_bytes()));
        }
    }
    for (i, segment) in scenario.segment.iter_mut().enumerate() {
        if let Some(table) = &mut segment.table {
            table.file = format!("{TABLE}{i}.csv");
            let rows = std::mem::take(&mut table.rows);
            files.push((table.file.clone(), rows.into_bytes()));
        }
    }
    let built_in = load::graph_of(&scenario, None)?;
    let mut graph = job.graph.clone();
    if let Some(session) = &mut scenario.servo {
        let targets = targets(job, session, summary)?;
        files.push((TARGETS.to_owned(), targets.into_bytes()));
        (session.input, session.live) = (TARGETS.to_owned(), false);
        session.targets.clear();
        // An interrupted session ends where it did.
        if summary.outcome == INTERRUPTED {
            session.ticks = summary.ticks;
        }
        let operator = built_in.process.iter().find(|one| operates(one));
        operator.iter().for_each(|ours| operate(&mut graph, ours));
    }
    if graph != built_in {
        GRAPH.clone_into(&mut scenario.graph);
        files.push((
            GRAPH.to_owned(),
            toml::to_string(&graph).map_err(Failure::work)?.into_bytes(),
        ));
    }
    let branch = job.from.iter().filter(|branch| !branch.settings.is_empty());
    let note = branch.map(|branch| {
        let command = origin::command(branch);
        format!(
            "# Of a branch: `{command}` repeats it. From tick 0 on, this file makes another run.\n"
        )
    });
    let text = note.collect::<String>() + &toml::to_string(&scenario).map_err(Failure::work)?;
    let sealed = seal::line(&text, &files) + &text;
    files.push((SCENARIO.to_owned(), sealed.into_bytes()));
    Ok(files)
}

fn operates(one: &Process) -> bool {
    one.writes.iter().any(|topic| topic == Target::TOPIC)
}

/// Lets our operator, which reads a file, take the place of the program that gave the targets.
fn operate(graph: &mut Graph, ours: &Process) {
    let theirs = graph.process.iter_mut().filter(|one| operates(one));
    theirs.for_each(|one| one.clone_from(ours));
    if graph.process.iter().all(|one| one.command.is_empty()) {
        graph.folder = None;
    }
}

/// The targets of a steered run as a file: as they were given, or of a run whose targets came while it lasted as they are kept with its messages.
fn targets(job: &Job, session: &Servo, summary: &Summary) -> Result<String, Failure> {
    let is_given = !session.targets.is_empty()
        && job
            .graph
            .process(Program::Operator.name())
            .is_some_and(|one| one.program().is_some());
    if is_given {
        return Ok(session.targets.clone());
    }
    let mut rows: Vec<Row> = Vec::new();
    // Before the first tick there are none, and a record that is there may be another run's.
    if summary.ticks > 0 {
        let record = RecordReader::open(&job.out.join(recorder::MESSAGES), &Contents::of(job));
        let record = record.map_err(|error| {
            Failure::Work(format!(
                "the targets of the run were not saved, so it cannot be repeated: {error}"
            ))
        })?;
        for message in record.messages::<Target>() {
            let last = rows
                .last()
                .map_or_else(TargetContent::default, |row| row.target);
            if last != message.target {
                rows.push(Row {
                    tick: message.header.tick,
                    target: message.target,
                });
            }
        }
    }
    if rows.is_empty() {
        // No target came; a file has at least one. It comes after the last tick.
        rows.push(Row {
            tick: summary.ticks,
            target: TargetContent {
                kind: TARGET_END,
                ..Default::default()
            },
        });
    }
    Ok(target_file::write(&rows, job.scenario.rate_hz))
}
