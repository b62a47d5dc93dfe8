//! The shards of a sweep, computed anywhere, as one folder.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use session::{Failure, Observer, Progress, Results};

use super::manifest::{Manifest, Shard, open, rows_file, rows_folder};
use super::outcomes::Outcomes;

/// Partitions that a refusal names.
const NAMED: usize = 5;

/// Shards that have become one sweep.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Merged {
    /// The sweep's name.
    #[serde(rename = "sweep")]
    pub name: String,
    /// The folder of the whole sweep.
    pub folder: PathBuf,
    /// Its runs.
    pub runs: u64,
    /// Their outcomes.
    #[serde(flatten)]
    pub outcomes: Outcomes,
}

impl Merged {
    /// The runs of the file that came to nothing.
    #[must_use]
    pub fn lack(&self) -> Option<String> {
        self.outcomes
            .lack()
            .map(|lack| format!("{}: {lack}", self.folder.display()))
    }
}

/// Puts the shards of one sweep into a folder of its own, which then is that of a sweep computed in one piece: the same files.
///
/// # Errors
/// [`Failure::Input`] where a folder is not a shard's, shards are of different sweeps or made by different builds of armplane, a partition is
/// in two of them, or in none; [`Failure::Work`] where the files cannot be written.
pub fn merge(
    folders: &[PathBuf],
    out: Option<&Path>,
    observer: Observer<'_>,
) -> Result<Merged, Failure> {
    let mut shards = Vec::with_capacity(folders.len());
    for folder in folders {
        let manifest = Manifest::read(folder)?;
        let manifest = manifest.ok_or_else(|| {
            Failure::Input(format!(
                "{} is not the folder of a shard: no sweep.json",
                folder.display()
            ))
        })?;
        shards.push((folder.as_path(), manifest));
    }
    let Some(((first, wanted), others)) = shards.split_first() else {
        return Err(Failure::Input("no shard to merge".to_owned()));
    };
    for (folder, manifest) in others {
        let differ = |what: &str, a: &str, b: &str| {
            let (first, folder) = (first.display(), folder.display());
            Err(Failure::Input(format!(
                "{first} and {folder} have different {what} ({a} and {b}): they are not shards of one sweep"
            )))
        };
        if (&manifest.version, &manifest.program) != (&wanted.version, &wanted.program) {
            return differ(
                "builds of armplane",
                &format!("{} {}", wanted.version, wanted.program),
                &format!("{} {}", manifest.version, manifest.program),
            );
        }
        if manifest.name != wanted.name {
            return differ("names", &wanted.name, &manifest.name);
        }
        if manifest.fingerprint != wanted.fingerprint {
            return differ("fingerprints", &wanted.fingerprint, &manifest.fingerprint);
        }
    }
    let from = sources(&shards, wanted)?;
    for (partition, folder) in &from {
        open(folder, wanted, *partition)?;
    }
    let whole = Manifest {
        shard: Shard::WHOLE,
        ..wanted.clone()
    };
    let target = out.map_or_else(
        || Path::new(session::RUNS).join(&whole.name),
        Path::to_owned,
    );
    let results = Results::create(Some(&target), &whole.name)?;
    if let Some(folder) = folders.iter().find(|folder| {
        folder
            .canonicalize()
            .is_ok_and(|folder| folder == results.folder)
    }) {
        return Err(Failure::Input(format!(
            "{} is one of the shards; choose another folder with --out",
            folder.display()
        )));
    }
    whole.take(&results)?;
    let cannot = |path: &Path, error: std::io::Error| {
        Failure::Work(format!("cannot write {}: {error}", path.display()))
    };
    std::fs::create_dir_all(rows_folder(&target))
        .map_err(|error| cannot(&rows_folder(&target), error))?;
    observer(Progress::Begin {
        title: &whole.name,
        length: from.len() as u64,
        unit: "partitions",
    });
    for (partition, folder) in &from {
        let path = rows_file(&target, *partition);
        let draft = target.join(".draft");
        let copied = std::fs::copy(rows_file(folder, *partition), &draft)
            .and_then(|_| std::fs::rename(&draft, &path));
        copied.map_err(|error| {
            let _ = std::fs::remove_file(&draft);
            cannot(&path, error)
        })?;
        observer(Progress::Step);
    }
    observer(Progress::End);
    let outcomes = Outcomes::of(&target, &whole)?;
    Ok(Merged {
        name: whole.name,
        folder: target,
        runs: whole.runs,
        outcomes,
    })
}

/// The folder from which each partition comes.
fn sources<'a>(
    shards: &[(&'a Path, Manifest)],
    whole: &Manifest,
) -> Result<BTreeMap<u64, &'a Path>, Failure> {
    let mut from = BTreeMap::<u64, &Path>::new();
    for (folder, manifest) in shards {
        for partition in manifest
            .own_partitions()
            .filter(|partition| rows_file(folder, *partition).exists())
        {
            if let Some(other) = from.insert(partition, folder) {
                let runs = whole.runs_of(partition);
                let (one, other) = (folder.display(), other.display());
                let sentence = format!(
                    "runs {} to {} are in both {other} and {one}",
                    runs.start,
                    runs.end - 1
                );
                return Err(Failure::Input(format!("{sentence}: give each shard once")));
            }
        }
    }
    let missing: Vec<u64> = (0..whole.partitions())
        .filter(|partition| !from.contains_key(partition))
        .collect();
    if missing.is_empty() {
        return Ok(from);
    }
    let count: u64 = missing
        .iter()
        .map(|partition| whole.runs_of(*partition))
        .map(|runs| runs.end - runs.start)
        .sum();
    let of = shards[0].1.shard.of;
    let mut lacking: Vec<u64> = missing.iter().map(|partition| partition % of + 1).collect();
    lacking.sort_unstable();
    lacking.dedup();
    let named: Vec<_> = lacking
        .iter()
        .take(NAMED)
        .map(|index| format!("{index}/{of}"))
        .collect();
    let more = if lacking.len() > NAMED {
        " and others"
    } else {
        ""
    };
    let sentence = format!("{count} of {} runs are missing", whole.runs);
    Err(Failure::Input(format!(
        "{sentence}: compute shard {}{more} to its end first",
        named.join(", ")
    )))
}
