//! Computes the runs of a sweep that are not in its folder yet, on all cores; puts shards together.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use serde::Serialize;
use session::{Failure, Observer, Progress, RUNS};
use toml::Table;

use super::folder::{Manifest, Shard, open, parts, write};
use super::outcomes::Outcomes;
use super::sweep::Sweep;
use crate::pool::on_all_cores;

/// Which sweep, and where its results go.
pub struct Request<'a> {
    /// The sweep's file.
    pub file: &'a Path,
    /// The results folder; `runs/NAME` where it is `None`.
    pub out: Option<&'a Path>,
    /// The part to compute; all of it where it is `None`.
    pub shard: Option<Shard>,
}

/// A sweep, or a shard of one, whose runs are all in the folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Done {
    /// The sweep's name.
    #[serde(rename = "sweep")]
    pub name: String,
    /// The part that was computed, as in `--shard`; `None`: all of it.
    pub shard: Option<String>,
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
    /// The outcomes of the runs in the folder.
    #[serde(flatten)]
    pub outcomes: Outcomes,
}

impl Done {
    /// The runs of the file that came to nothing, where that is for this folder to say: a shard is judged when all of them are put together.
    pub fn lack(&self) -> Option<String> {
        let lack = self.outcomes.lack().filter(|_| self.shard.is_none());
        lack.map(|lack| format!("{}: {lack}", self.folder.display()))
    }
}

/// Runs and their rate.
impl fmt::Display for Done {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shard = self.shard.as_ref().map(|shard| format!(", shard {shard}"));
        let (name, shard) = (&self.name, shard.unwrap_or_default());
        writeln!(
            f,
            "{name}{shard}: {} runs, {} of them already done",
            self.runs, self.found
        )?;
        let (computed, wall_s) = (self.runs - self.found, self.wall_s);
        if computed > 0 {
            let (rate, speed) = (computed as f64 / wall_s, self.simulated_s / wall_s);
            writeln!(
                f,
                "time       {computed} runs in {wall_s:.1} s: {rate:.1} runs/s, {speed:.0} × real time"
            )?;
        }
        self.outcomes.fmt(f)
    }
}

/// Rows by their run, by their partition.
type Begun = Mutex<BTreeMap<u64, BTreeMap<u64, Table>>>;

/// Adds the row of a run; its partition and all rows of it, once the last one is there.
fn completed(begun: &Begun, of: &Manifest, run: u64, row: Table) -> Option<(u64, Vec<Table>)> {
    let (mut begun, part) = (locked(begun), run / of.part_runs);
    let rows = begun.entry(part).or_default();
    rows.insert(run, row);
    let is_whole = rows.len() as u64 == of.count([part].into_iter());
    let rows = is_whole.then(|| begun.remove(&part)).flatten()?;
    Some((part, rows.into_values().collect()))
}

/// Computes every run that is not in the results folder yet.
///
/// # Errors
/// [`Failure::Input`] or [`Failure::File`] before anything is computed, where sweep, scenario, robot, shard or folder cannot be used;
/// [`Failure::Work`] where results cannot be written, or a signal stops it: the parts that are complete by then are kept.
pub fn run(request: &Request<'_>, observer: Observer<'_>) -> Result<Done, Failure> {
    // Before anything is made: a signal ends it at once.
    let sweep = Sweep::read(request.file)?;
    let signals = Mutex::new(session::interrupts()?);
    let manifest = &sweep.manifest;
    let (name, count) = (&manifest.name, manifest.parts());
    let (usual, Shard { index, of }) = match request.shard {
        None => (name.clone(), Shard { index: 1, of: 1 }),
        Some(shard) => (format!("{name}-{}-of-{}", shard.index, shard.of), shard),
    };
    if of > count {
        return Err(Failure::Input(format!(
            "{of} shards of {count} partitions: some would be empty; take at most {count}, or a smaller `partition` in the sweep's file"
        )));
    }
    let usual = Path::new(RUNS).join(usual);
    let folder = request.out.unwrap_or(&usual);
    let _results = manifest.take(folder)?;
    let there = parts(folder, manifest)?;
    there
        .iter()
        .try_for_each(|(part, path)| open(path, *part, manifest).map(drop))?;
    let own = (index - 1..count).step_by(of as usize);
    let missing = own.filter(|part| !there.contains_key(part));
    let pending: Vec<u64> = missing.flat_map(|part| manifest.runs_of(part)).collect();
    let began = Instant::now();
    // Rows of the parts that are not complete.
    let begun = Begun::default();
    let is_stopped = AtomicBool::new(false);
    let compute = |run: &u64| {
        if let Some(signal) = locked(&signals).pending() {
            let kept = "complete partitions are kept; the same command continues";
            return Err(Failure::Work(format!("stopped by {signal}: {kept}")));
        }
        let (row, seconds) = sweep.row(*run);
        if let Some((part, rows)) = completed(&begun, manifest, *run, row) {
            write(folder, part, &sweep.part(part, &rows)?)?;
        }
        Ok(seconds)
    };
    let done = on_all_cores(
        &manifest.name,
        &pending,
        |run| {
            let is_over = is_stopped.load(Ordering::Relaxed);
            let done = if is_over { Ok(0.0) } else { compute(run) };
            is_stopped.fetch_or(done.is_err(), Ordering::Relaxed);
            done
        },
        observer,
    );
    let simulated_s = done.into_iter().sum::<Result<f64, Failure>>()?;
    let wall_s = began.elapsed().as_secs_f64();
    let found = manifest.count(there.into_keys());
    Ok(Done {
        simulated_s,
        wall_s,
        ..finished(manifest, request.shard, folder, found)?
    })
}

fn locked<T>(shared: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

fn finished(
    manifest: &Manifest,
    shard: Option<Shard>,
    folder: &Path,
    found: u64,
) -> Result<Done, Failure> {
    let outcomes = Outcomes::of(folder, manifest)?;
    Ok(Done {
        name: manifest.name.clone(),
        shard: shard.map(|shard| shard.to_string()),
        folder: folder.to_owned(),
        runs: outcomes.runs(),
        found,
        simulated_s: 0.0,
        wall_s: 0.0,
        outcomes,
    })
}

/// Puts the shards of one sweep into a folder of its own, which then is that of a sweep computed in one piece: the same files.
///
/// # Errors
/// [`Failure::Input`] where a folder is not a shard's, shards are of different sweeps or made by different builds of armplane, a part is
/// in two of them, or in none; [`Failure::Work`] where the files cannot be written.
pub fn merge(
    folders: &[PathBuf],
    out: Option<&Path>,
    observer: Observer<'_>,
) -> Result<Done, Failure> {
    let mut from = BTreeMap::<u64, (PathBuf, &PathBuf)>::new();
    let mut first = None;
    for folder in folders {
        let manifest = Manifest::expect(folder)?;
        let (one, whole): &(&PathBuf, Manifest) =
            first.get_or_insert_with(|| (folder, manifest.clone()));
        let (one, other) = (one.display(), folder.display());
        if let Some(difference) = whole.difference(&manifest) {
            return Err(Failure::Input(format!(
                "{one} and {other} are not shards of one sweep: {other} has {difference}"
            )));
        }
        for (part, path) in parts(folder, &manifest)? {
            open(&path, part, &manifest)?;
            if let Some((_, other)) = from.insert(part, (path, folder)) {
                let (runs, one, other) =
                    (manifest.runs_of(part), folder.display(), other.display());
                return Err(Failure::Input(format!(
                    "runs {} to {} are in both {other} and {one}: give each shard only once",
                    runs.start,
                    runs.end - 1
                )));
            }
        }
    }
    let (_, whole) = first.ok_or_else(|| Failure::input("no shard to merge"))?;
    let missing = (0..whole.parts()).filter(|part| !from.contains_key(part));
    let missing: Vec<u64> = missing.collect();
    if let Some(part) = missing.first() {
        let (count, runs) = (whole.count(missing.iter().copied()), whole.runs);
        return Err(Failure::Input(format!(
            "{count} of {runs} runs are missing, the first is {}: finish its shard first",
            whole.runs_of(*part).start
        )));
    }
    let usual = Path::new(RUNS).join(&whole.name);
    let target = out.unwrap_or(&usual);
    let _results = whole.take(target)?;
    observer(Progress::Begin {
        title: &whole.name,
        length: from.len() as u64,
        unit: "partitions",
    });
    for (part, (path, _)) in &from {
        let bytes = files::read(path).map_err(Failure::cannot("read", path))?;
        write(target, *part, &bytes)?;
        observer(Progress::Step);
    }
    observer(Progress::End);
    finished(&whole, None, target, whole.runs)
}
