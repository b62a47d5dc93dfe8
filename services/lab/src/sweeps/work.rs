//! Computes a sweep's runs on all cores, and goes on where it was stopped.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use serde::Serialize;
use session::{Failure, Observer, Progress, RUNS, Results};

use super::cell::Cell;
use super::journal::{Finished, Journal};
use super::manifest::{Shard, Sweep, journal_file, journals_folder, open, rows_file, rows_folder};
use super::outcomes::Outcomes;
use super::{row, table};

/// How often a signal is looked for.
const LOOK: Duration = Duration::from_millis(50);

/// Which sweep, and where its results go.
pub struct Request<'a> {
    /// The sweep's file.
    pub file: &'a Path,
    /// The results folder; `runs/NAME` where it is `None`.
    pub out: Option<&'a Path>,
    /// The part to compute; all of it where it is `None`.
    pub shard: Option<Shard>,
}

/// A sweep whose runs are all in the folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Done {
    /// The sweep's name.
    #[serde(rename = "sweep")]
    pub name: String,
    /// The part that was computed; `None`: all of it.
    #[serde(serialize_with = "in_words")]
    pub shard: Option<Shard>,
    /// The results folder.
    pub folder: PathBuf,
    /// Runs in the folder.
    pub runs: u64,
    /// Runs that were there already.
    pub found: u64,
    /// Simulated time of the runs computed now; s.
    pub simulated_s: f64,
    /// Wall-clock time; s.
    pub wall_s: f64,
    /// Cores that worked.
    pub cores: usize,
    /// The outcomes of the runs in the folder.
    #[serde(flatten)]
    pub outcomes: Outcomes,
}

impl Done {
    /// The runs of the file that came to nothing, where that is for this folder to say: a shard is judged when all of them are put together.
    #[must_use]
    pub fn lack(&self) -> Option<String> {
        self.outcomes
            .lack()
            .filter(|_| self.shard.is_none())
            .map(|lack| format!("{}: {lack}", self.folder.display()))
    }
}

/// As in `--shard`: `3/16`.
fn in_words<S: serde::Serializer>(shard: &Option<Shard>, serializer: S) -> Result<S::Ok, S::Error> {
    shard.map(|shard| shard.to_string()).serialize(serializer)
}

/// Computes every run that is not in the results folder yet.
///
/// # Errors
/// [`Failure::Input`] or [`Failure::File`] before anything is computed, where sweep, scenario, robot, shard or folder cannot be used;
/// [`Failure::Work`] where results cannot be written, or a signal stops it: the runs finished until then are kept.
pub fn run(request: &Request<'_>, observer: Observer<'_>) -> Result<Done, Failure> {
    let mut signals = session::interrupts()?;
    let mut sweep = Sweep::read(request.file)?;
    if let Some(shard) = request.shard {
        let partitions = sweep.manifest.partitions();
        if shard.of > partitions {
            let sentence = format!(
                "{} shards of {partitions} partitions: some would be empty",
                shard.of
            );
            return Err(Failure::Input(format!(
                "{sentence}; take at most {partitions}, or a smaller `partition` in the sweep's file"
            )));
        }
        sweep.manifest.shard = shard;
    }
    let manifest = &sweep.manifest;
    let usual = match manifest.shard {
        Shard::WHOLE => manifest.name.clone(),
        Shard { index, of } => format!("{}-{index}-of-{of}", manifest.name),
    };
    let folder = request
        .out
        .map_or_else(|| Path::new(RUNS).join(usual), Path::to_owned);
    let results = Results::create(Some(&folder), &manifest.name)?;
    manifest.take(&results)?;
    let cannot = |error: std::io::Error| {
        Failure::Work(format!("cannot write to {}: {error}", folder.display()))
    };
    for made in [rows_folder(&folder), journals_folder(&folder)] {
        std::fs::create_dir_all(made).map_err(cannot)?;
    }
    let work = Work::begin(&sweep, &folder)?;
    let (runs, pending) = (work.runs, work.pending.len() as u64);
    let cores = thread::available_parallelism()
        .map_or(1, usize::from)
        .min(work.pending.len());
    let began = Instant::now();
    observer(Progress::Begin {
        title: &manifest.name,
        length: pending,
        unit: "runs",
    });
    thread::scope(|scope| {
        let workers: Vec<_> = (0..cores)
            .map(|_| scope.spawn(|| work.work(observer)))
            .collect();
        while workers.iter().any(|worker| !worker.is_finished()) {
            if let Some(signal) = signals.pending() {
                let kept = "the runs finished so far are kept, the same command goes on";
                work.stop(Failure::Work(format!("stopped by {signal}: {kept}")));
            }
            thread::sleep(LOOK.min(Duration::from_millis(
                1 + began.elapsed().as_millis() as u64 / 20,
            )));
        }
    });
    observer(Progress::End);
    let simulated_s = work.simulated_ns.load(Ordering::Relaxed) as f64 * 1e-9;
    work.failure
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner)
        .map_or(Ok(()), Err)?;
    std::fs::remove_dir(journals_folder(&folder)).map_err(cannot)?;
    let (name, wall_s) = (manifest.name.clone(), began.elapsed().as_secs_f64());
    let outcomes = Outcomes::of(&folder, manifest)?;
    Ok(Done {
        name,
        shard: request.shard,
        folder,
        runs,
        found: runs - pending,
        simulated_s,
        wall_s,
        cores,
        outcomes,
    })
}

/// The runs to compute, and those that are finished in partitions that are not.
struct Work<'a> {
    sweep: &'a Sweep,
    folder: &'a Path,
    /// Runs of this shard, finished or not.
    runs: u64,
    pending: Vec<u64>,
    next: AtomicUsize,
    open: Mutex<BTreeMap<u64, Open>>,
    is_stopped: AtomicBool,
    failure: Mutex<Option<Failure>>,
    simulated_ns: AtomicU64,
}

/// A partition with some of its runs finished.
struct Open {
    journal: Journal,
    finished: Vec<Finished>,
}

impl<'a> Work<'a> {
    fn begin(sweep: &'a Sweep, folder: &'a Path) -> Result<Self, Failure> {
        let (mut runs, mut pending, mut all) = (0, Vec::new(), BTreeMap::new());
        for partition in sweep.manifest.own_partitions() {
            let (own, journal) = (
                sweep.manifest.runs_of(partition),
                journal_file(folder, partition),
            );
            runs += own.end - own.start;
            if rows_file(folder, partition).exists() {
                open(folder, &sweep.manifest, partition)?;
                // A kill may have come between the two.
                let _ = std::fs::remove_file(&journal);
            } else if journal.exists() {
                let mut begun = Open::begin(&journal)?;
                begun
                    .finished
                    .retain(|(run, cells)| own.contains(run) && cells.len() == sweep.results());
                let known: BTreeSet<u64> = begun.finished.iter().map(|(run, _)| *run).collect();
                pending.extend(own.clone().filter(|run| !known.contains(run)));
                if begun.finished.len() as u64 == own.end - own.start {
                    complete(sweep, folder, partition, begun.finished)?;
                } else {
                    all.insert(partition, begun);
                }
            } else {
                pending.extend(own);
            }
        }
        Ok(Self {
            sweep,
            folder,
            runs,
            pending,
            next: AtomicUsize::new(0),
            open: Mutex::new(all),
            is_stopped: AtomicBool::new(false),
            failure: Mutex::new(None),
            simulated_ns: AtomicU64::new(0),
        })
    }

    fn stop(&self, failure: Failure) {
        self.failure
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get_or_insert(failure);
        self.is_stopped.store(true, Ordering::Relaxed);
    }

    /// Computes one pending run after the other.
    fn work(&self, observer: Observer<'_>) {
        while !self.is_stopped.load(Ordering::Relaxed)
            && let Some(run) = self.pending.get(self.next.fetch_add(1, Ordering::Relaxed))
        {
            let loaded = self.sweep.load(*run);
            let rate_hz = loaded.as_ref().map_or(1, |(_, scenario)| scenario.rate_hz);
            let (cells, ticks) = row::results(
                loaded
                    .as_ref()
                    .map(|(robot, scenario)| (*robot, scenario))
                    .map_err(Clone::clone),
            );
            self.simulated_ns.fetch_add(
                ticks * 1_000_000_000 / u64::from(rate_hz),
                Ordering::Relaxed,
            );
            match self.finish(*run, cells) {
                Ok(()) => observer(Progress::Step),
                Err(failure) => return self.stop(failure),
            }
        }
    }

    /// Takes a finished run down, and writes its partition where it was the last one.
    fn finish(&self, run: u64, cells: Vec<Cell>) -> Result<(), Failure> {
        let partition = run / self.sweep.manifest.partition_runs;
        let own = self.sweep.manifest.runs_of(partition);
        let path = journal_file(self.folder, partition);
        let mut all = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        let open = match all.entry(partition) {
            std::collections::btree_map::Entry::Occupied(entry) => entry.into_mut(),
            std::collections::btree_map::Entry::Vacant(entry) => entry.insert(Open::begin(&path)?),
        };
        open.journal
            .append(run, &cells)
            .map_err(|error| Failure::Work(format!("cannot write {}: {error}", path.display())))?;
        open.finished.push((run, cells));
        let is_complete = open.finished.len() as u64 == own.end - own.start;
        let whole = if is_complete {
            all.remove(&partition)
        } else {
            None
        };
        drop(all);
        whole.map_or(Ok(()), |open| {
            complete(self.sweep, self.folder, partition, open.finished)
        })
    }
}

impl Open {
    fn begin(path: &Path) -> Result<Self, Failure> {
        let (journal, finished) = Journal::open(path)
            .map_err(|error| Failure::Work(format!("cannot use {}: {error}", path.display())))?;
        Ok(Self { journal, finished })
    }
}

/// Writes a partition all of whose runs are finished; its journal goes.
fn complete(
    sweep: &Sweep,
    folder: &Path,
    partition: u64,
    mut finished: Vec<Finished>,
) -> Result<(), Failure> {
    finished.sort_by_key(|(run, _)| *run);
    let rows: Vec<_> = finished
        .into_iter()
        .map(|(run, cells)| sweep.row(run, cells))
        .collect();
    let journal = journal_file(folder, partition);
    table::write(
        &rows_file(folder, partition),
        &journal.with_extension("draft"),
        &sweep.columns,
        &rows,
        &sweep.metadata(partition),
    )?;
    std::fs::remove_file(&journal)
        .map_err(|error| Failure::Work(format!("cannot remove {}: {error}", journal.display())))
}
