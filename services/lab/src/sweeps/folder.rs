//! The results folder of a sweep: `sweep.json`, its identity, and `runs/part-NNNNN-CHECKSUM.parquet`, a file for each complete part.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use session::{Failure, Results};
use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed};

use super::columns::Part;

const FILE: &str = "sweep.json";
const RUNS: &str = "runs";
/// Metadata of each Parquet file.
pub(super) const FINGERPRINT: &str = "armplane.fingerprint";

/// A share of a sweep's work: parts `index - 1`, `index - 1 + of`, and so on.
#[derive(Clone, Copy, Debug)]
pub struct Shard {
    /// From 1.
    pub index: u64,
    /// How many shards there are.
    pub of: u64,
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

/// `sweep.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    /// Version of armplane.
    pub(super) version: String,
    /// XXH3-64 of the program's file: two builds are two versions.
    pub(super) program: String,
    /// XXH3-64 over everything that the rows depend on.
    pub(super) fingerprint: String,
    /// Name of the sweep.
    pub(super) name: String,
    /// The scenario, as `armplane run` takes it.
    pub(super) scenario: String,
    /// The sweep's file.
    pub(super) sweep_toml: String,
    /// The scenario's file.
    pub(super) scenario_toml: String,
    /// How many runs there are.
    pub(super) runs: u64,
    /// Runs of one part.
    pub(super) part_runs: u64,
}

/// The text of `sweep.json`: the manifest and its checksum.
#[derive(Serialize, Deserialize)]
struct Sealed {
    /// XXH3-64 of the manifest as JSON without spaces.
    checksum: String,
    #[serde(flatten)]
    manifest: Manifest,
}

impl Manifest {
    /// # Errors
    /// [`Failure::Work`] where it is no JSON, which does not happen.
    fn seal(self) -> Result<Sealed, Failure> {
        let bytes = serde_json::to_vec(&self).map_err(Failure::work)?;
        Ok(Sealed {
            checksum: format!("{:016x}", xxh3_64(&bytes)),
            manifest: self,
        })
    }

    /// How many parts there are.
    pub(super) fn parts(&self) -> u64 {
        self.runs.div_ceil(self.part_runs)
    }

    /// The runs of a part.
    pub(super) fn runs_of(&self, part: u64) -> std::ops::Range<u64> {
        let begin = part * self.part_runs;
        begin..(begin + self.part_runs).min(self.runs)
    }

    /// How many runs these parts have.
    pub(super) fn count(&self, parts: impl Iterator<Item = u64>) -> u64 {
        let runs = parts.map(|part| self.runs_of(part));
        runs.map(|runs| runs.end - runs.start).sum()
    }

    /// Reads the manifest of a results folder; `None` where there is none.
    ///
    /// # Errors
    /// [`Failure::Input`] where it is not one of a sweep.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>, Failure> {
        let path = folder.join(FILE);
        if !path.exists() {
            return Ok(None);
        }
        let text = files::read(&path).map_err(|error| error.to_string());
        let read = text.and_then(|text| {
            let found: Sealed = serde_json::from_slice(&text).map_err(|error| error.to_string())?;
            let sealed = found.manifest.seal().map_err(|error| error.to_string())?;
            (sealed.checksum == found.checksum)
                .then_some(sealed.manifest)
                .ok_or_else(|| "its checksum is another one".to_owned())
        });
        read.map(Some).map_err(|error| {
            Failure::Input(format!(
                "{} does not describe a sweep of this version ({error}); restore it, or compute the sweep again in another folder",
                path.display()
            ))
        })
    }

    /// The manifest of a folder that must have one.
    ///
    /// # Errors
    /// As [`read`](Self::read), and where there is none.
    pub(super) fn expect(folder: &Path) -> Result<Self, Failure> {
        Self::read(folder)?.ok_or_else(|| {
            Failure::Input(format!(
                "{} is not the folder of a sweep: there is no sweep.json in it",
                folder.display()
            ))
        })
    }

    /// What another sweep has that this one has not, in words; `None` where both are shards of one.
    pub(super) fn difference(&self, other: &Self) -> Option<String> {
        let of = |one: &Self| {
            [
                ("name", one.name.clone()),
                (
                    "build of armplane",
                    format!("{} {}", one.version, one.program),
                ),
                (
                    "fingerprint of file, scenario, robots and targets",
                    one.fingerprint.clone(),
                ),
            ]
        };
        let both = of(self).into_iter().zip(of(other));
        let ((what, ours), (_, theirs)) = both.into_iter().find(|(ours, theirs)| ours != theirs)?;
        Some(format!("another {what}: {theirs}, not {ours}"))
    }

    /// Takes a results folder for this sweep: an empty one, or one in which it has begun.
    ///
    /// # Errors
    /// [`Failure::Input`] where the folder is another sweep's, or has other files in it.
    pub(super) fn take(&self, folder: &Path) -> Result<Results, Failure> {
        let results = Results::create(Some(folder), &self.name)?;
        let refuse = |sentence: &str| {
            let folder = folder.display();
            Err(Failure::Input(format!(
                "{folder} has {sentence}; choose another folder with --out"
            )))
        };
        match Self::read(folder)? {
            Some(found) => {
                if let Some(other) = self.difference(&found) {
                    return refuse(&other);
                }
            }
            None if std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) => {
                return refuse("files in it, but not of a sweep");
            }
            None => {
                let sealed = self.clone().seal()?;
                results.save(FILE, &serde_json::to_value(sealed).map_err(Failure::work)?)?;
            }
        }
        Ok(results)
    }
}

/// The files of the complete parts in a folder.
///
/// # Errors
/// [`Failure::Input`] where something else is among them: a link, a file of another name, the same part twice.
pub(super) fn parts(folder: &Path, manifest: &Manifest) -> Result<BTreeMap<u64, PathBuf>, Failure> {
    let runs = folder.join(RUNS);
    let refuse = |path: &Path| {
        let path = path.display();
        Failure::Input(format!(
            "{path} does not belong to this sweep: remove it, or choose another folder with --out"
        ))
    };
    let mut parts = BTreeMap::new();
    match std::fs::symlink_metadata(&runs) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(parts),
        // What is written through a link goes elsewhere.
        Ok(found) if found.is_dir() => {}
        _ => return Err(refuse(&runs)),
    }
    let entries = std::fs::read_dir(&runs).map_err(Failure::cannot("read", &runs))?;
    for entry in entries.flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        let name = name.to_string_lossy();
        if name.starts_with('.') {
            continue; // a file that was not finished
        }
        let number = name
            .strip_prefix("part-")
            .and_then(|rest| rest.split_once('-'));
        let part = number.and_then(|(number, _)| number.parse().ok());
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        let own = part.filter(|part| is_file && *part < manifest.parts());
        let doubled = own.and_then(|part| parts.insert(part, path.clone()));
        if own.is_none() || doubled.is_some() {
            return Err(refuse(&path));
        }
    }
    Ok(parts)
}

/// The name of a part's file: its number, and XXH3-64 of its bytes, seeded with the number.
fn name(part: u64, bytes: &[u8]) -> String {
    let checksum = xxh3_64_with_seed(bytes, part);
    format!("part-{part:05}-{checksum:016x}.parquet")
}

/// Opens a part's file, and checks that it is this sweep's, whole, and as it was written.
///
/// # Errors
/// [`Failure::Input`] where it is not.
pub(super) fn open(path: &Path, part: u64, manifest: &Manifest) -> Result<Part, Failure> {
    let read = || {
        let bytes = files::read(path).map_err(|error| error.to_string())?;
        if path.file_name() != Some(name(part, &bytes).as_ref()) {
            return Err("its bytes are not those of the checksum in its name".to_owned());
        }
        let opened = Part::open(bytes).map_err(|error| error.to_string())?;
        match opened.metadata(FINGERPRINT) == Some(&manifest.fingerprint) {
            true => Ok(opened),
            false => Err("it is not of this sweep".to_owned()),
        }
    };
    read().map_err(|error| {
        let path = path.display();
        Failure::Input(format!(
            "cannot read {path}: {error}; remove it, and run the sweep again"
        ))
    })
}

/// Writes a part's file: it has its name when it is whole.
///
/// # Errors
/// [`Failure::Work`] where it cannot be written.
pub(super) fn write(folder: &Path, part: u64, bytes: &[u8]) -> Result<(), Failure> {
    let runs = folder.join(RUNS);
    let path = runs.join(name(part, bytes));
    let written = std::fs::create_dir_all(&runs).and_then(|()| {
        let mut draft = tempfile::Builder::new()
            .prefix(".part-")
            .tempfile_in(&runs)?;
        draft.write_all(bytes)?;
        draft.as_file().sync_all()?;
        draft.persist(&path).map_err(|error| error.error)
    });
    written.map(drop).map_err(Failure::cannot("write", &path))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn manifest() -> Manifest {
        Manifest {
            version: "1.0.0".into(),
            program: "0123456789abcdef".into(),
            fingerprint: "fedcba9876543210".into(),
            name: "mine".into(),
            scenario: "mine.toml".into(),
            sweep_toml: "name = \"mine\"\n".into(),
            scenario_toml: String::new(),
            runs: 12,
            part_runs: 4,
        }
    }

    #[test]
    fn a_manifest_with_a_damaged_byte_is_read_as_it_was_or_refused() {
        let folder = tempfile::tempdir().unwrap();
        manifest().take(folder.path()).unwrap();
        let path = folder.path().join(FILE);
        let whole = std::fs::read(&path).unwrap();
        let mut refused = 0;
        for (at, bit) in (0..whole.len()).flat_map(|at| (0..8).map(move |bit| (at, bit))) {
            let mut damaged = whole.clone();
            damaged[at] ^= 1 << bit;
            std::fs::write(&path, damaged).unwrap();
            match Manifest::read(folder.path()) {
                Ok(read) => assert_eq!(read, Some(manifest()), "byte {at}, bit {bit}"),
                Err(failure) => {
                    assert!(failure.to_string().contains(FILE));
                    refused += 1;
                }
            }
        }
        assert!(refused > 7 * whole.len());
    }

    #[test]
    fn another_build_of_armplane_is_another_sweep() {
        let mut other = manifest();
        assert_eq!(manifest().difference(&other), None);
        other.program = "1".into();
        assert!(manifest().difference(&other).is_some());
    }
}
