//! The identity of a sweep: everything its rows depend on. `sweep.json` in the results folder holds it, and each Parquet file its hash.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use model::Robot;
use serde::{Deserialize, Serialize};
use session::load::{self, Source};
use session::{Failure, Results};
use shared_types::file::Complaint;
use shared_types::graph::Graph;
use shared_types::scenario::Scenario;
use xxhash_rust::xxh3::xxh3_64;

use super::cell::Cell;
use super::row::{self, Column, RUN};
use super::space::{Refusal, Space};
use super::spec::Spec;

/// Format of folder and rows; a change of either changes it.
const FORMAT: u32 = 1;
const FILE: &str = "sweep.json";
const ROWS: &str = "runs";
const JOURNAL: &str = "journal";
/// Metadata of each Parquet file.
pub(super) const FINGERPRINT: &str = "armplane.fingerprint";

/// A part of a sweep: partitions `index - 1`, `index - 1 + of`, and so on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shard {
    /// From 1.
    pub index: u64,
    /// How many shards there are.
    pub of: u64,
}

impl Shard {
    /// The whole sweep.
    pub(super) const WHOLE: Self = Self { index: 1, of: 1 };

    /// Whether a partition belongs to it.
    pub(super) fn has(self, partition: u64) -> bool {
        partition % self.of == self.index - 1
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

/// `sweep.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    /// See [`FORMAT`].
    pub(super) format: u32,
    /// Version of armplane.
    pub(super) version: String,
    /// XXH3-64 of the program's file.
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
    /// How many runs there are, those of other shards included.
    pub(super) runs: u64,
    /// Runs of one partition.
    pub(super) partition_runs: u64,
    /// Which part of it is in the folder.
    pub(super) shard: Shard,
}

/// A sweep that can be computed.
pub(super) struct Sweep {
    /// Its identity.
    pub(super) manifest: Manifest,
    /// Its runs.
    pub(super) space: Space,
    /// Columns of its table.
    pub(super) columns: Vec<Column>,
    source: Source,
    graph: Graph,
    robots: BTreeMap<String, Robot>,
    /// The texts of the files of targets, read once: no run sees another one.
    targets: BTreeMap<PathBuf, String>,
}

impl Sweep {
    /// Reads a sweep's file, its scenario and its robots.
    ///
    /// # Errors
    /// [`Failure::Input`] or [`Failure::File`] for whatever in them cannot be used.
    pub(super) fn read(file: &Path) -> Result<Self, Failure> {
        let name = file.display().to_string();
        let text = load::read(file)?;
        let spec: Spec = shared_types::file::parse(&name, &text, &[])?;
        spec.check()
            .map_err(|complaint| complaint.locate(&name, &text))?;
        let is_file = spec.scenario.ends_with(".toml");
        let beside = file.parent().unwrap_or(Path::new("")).join(&spec.scenario);
        let scenario = match is_file {
            true => std::path::absolute(&beside)
                .map_err(Failure::work)?
                .display()
                .to_string(),
            false => spec.scenario.clone(),
        };
        let source = Source::read(&scenario)?;
        Self::of(spec, text.clone(), scenario, source).map_err(|refusal| match refusal {
            Refusal::Sweep(complaint) => complaint.locate(&name, &text).into(),
            Refusal::Other(failure) => failure,
        })
    }

    fn of(spec: Spec, text: String, scenario: String, source: Source) -> Result<Self, Refusal> {
        let space = Space::new(&spec, &source)?;
        let targets = targets(&spec, &source, &space)?;
        let mut base = source.parse(&spec.set)?;
        give_targets(&targets, &source, &mut base)?;
        chain::planned_faults(&base).map_err(Failure::input)?;
        let own_graph = Some(&base.graph)
            .filter(|file| !file.is_empty())
            .map(|file| source.beside(file));
        let graph = load::graph_of(&base, own_graph.as_deref())?;
        if graph
            .process
            .iter()
            .any(|process| process.program().is_none())
        {
            let sentence = format!(
                "{scenario} runs in programs of its graph, and a sweep is computed without processes; remove `graph`"
            );
            return Err(Failure::Input(sentence).into());
        }
        let mut robots = BTreeMap::new();
        let robot = |name: &str| {
            source.robot(&Scenario {
                robot: name.to_owned(),
                ..base.clone()
            })
        };
        robots.insert(base.robot.clone(), robot(&base.robot)?);
        let place = spec
            .key
            .iter()
            .position(|key| key.key == "robot")
            .unwrap_or_default();
        for name in space.listed("robot").iter().filter_map(toml::Value::as_str) {
            let found = robot(name).map_err(|failure| match failure {
                Failure::File(invalid) => Refusal::from(Complaint::new(
                    format!("key.{place}.values"),
                    invalid.message,
                    "",
                )),
                other => other.into(),
            })?;
            robots.insert(name.to_owned(), found);
        }
        let units: BTreeMap<_, _> = spec
            .key
            .iter()
            .map(|key| (key.key.as_str(), key.unit()))
            .collect();
        let keys = space
            .columns()
            .map(|(key, kind)| (key, kind, units.get(key).copied().unwrap_or_default()));
        let columns = row::columns(keys);
        let texts: Vec<_> = robots
            .iter()
            .map(|(name, robot)| {
                (
                    name,
                    &robot.source.name,
                    &robot.source.description,
                    &robot.source.urdf,
                )
            })
            .collect();
        let (version, program) = (env!("CARGO_PKG_VERSION").to_owned(), program()?);
        let partition_runs = spec.partition_runs();
        let all = (
            FORMAT,
            &version,
            &program,
            &spec,
            partition_runs,
            &source.text,
            &graph,
            texts,
            &targets,
        );
        let all = serde_json::to_vec(&all).map_err(Failure::work)?;
        let manifest = Manifest {
            format: FORMAT,
            version,
            program,
            fingerprint: format!("{:016x}", xxh3_64(&all)),
            name: spec.name,
            scenario,
            sweep_toml: text,
            scenario_toml: source.text.clone(),
            runs: space.runs,
            partition_runs,
            shard: Shard::WHOLE,
        };
        Ok(Self {
            manifest,
            space,
            columns,
            source,
            graph,
            robots,
            targets,
        })
    }

    /// The robot and the scenario of a run.
    ///
    /// # Errors
    /// Why there is none, in words.
    pub(super) fn load(&self, run: u64) -> Result<(&Robot, Scenario), String> {
        let load = || {
            let mut scenario = self.source.parse(&self.space.settings(run))?;
            give_targets(&self.targets, &self.source, &mut scenario)?;
            let robot = self
                .robots
                .get(&scenario.robot)
                .ok_or_else(|| Failure::Input(format!("no robot `{}`", scenario.robot)))?;
            self.source.check(&scenario, robot, &self.graph)?;
            Ok((robot, scenario))
        };
        load().map_err(|failure: Failure| failure.to_string())
    }

    /// The metadata of each Parquet file, but for its own partition.
    pub(super) fn metadata(&self, partition: u64) -> Vec<(String, String)> {
        let of = |value: fn(&Column) -> &String| {
            let named: BTreeMap<_, _> = self
                .columns
                .iter()
                .map(|column| (&column.name, value(column)))
                .collect();
            serde_json::to_string(&named).unwrap_or_default()
        };
        let manifest = &self.manifest;
        let pairs = [
            ("armplane.version", manifest.version.clone()),
            ("armplane.program", manifest.program.clone()),
            (FINGERPRINT, manifest.fingerprint.clone()),
            ("armplane.sweep", manifest.sweep_toml.clone()),
            ("armplane.scenario", manifest.scenario_toml.clone()),
            ("armplane.units", of(|column| &column.unit)),
            ("armplane.columns", of(|column| &column.about)),
            (
                "armplane.partition",
                format!("{} of {}", partition + 1, manifest.partitions()),
            ),
        ];
        pairs
            .into_iter()
            .map(|(key, value)| (key.to_owned(), value))
            .collect()
    }

    /// The whole row of a run.
    pub(super) fn row(&self, run: u64, results: Vec<Cell>) -> Vec<Cell> {
        std::iter::once(Cell::Whole(run as i64))
            .chain(self.space.cells(run))
            .chain(results)
            .collect()
    }

    /// How many cells a row has after its keys.
    pub(super) fn results(&self) -> usize {
        self.columns.len() - 1 - self.space.columns().count()
    }
}

/// The texts of all files of targets that the runs have: the scenario's own, and those that a key lists.
fn targets(
    spec: &Spec,
    source: &Source,
    space: &Space,
) -> Result<BTreeMap<PathBuf, String>, Refusal> {
    let mut targets = BTreeMap::new();
    let mut read = |settings: &[String]| {
        if let Some(path) = source.targets_file(&source.parse(settings)?)
            && !targets.contains_key(&path)
        {
            let text = load::read(&path)?;
            targets.insert(path, text);
        }
        Ok::<(), Failure>(())
    };
    read(&spec.set)?;
    for (place, key) in spec
        .key
        .iter()
        .enumerate()
        .filter(|(_, key)| ["servo", "servo.input"].contains(&key.key.as_str()))
    {
        for value in space.listed(&key.key) {
            let settings = [&spec.set[..], &[format!("{}={value}", key.key)]].concat();
            read(&settings).map_err(|failure| {
                Complaint::new(format!("key.{place}.values"), failure.to_string(), "")
            })?;
        }
    }
    Ok(targets)
}

/// Gives a scenario the text of its file of targets, where it names one.
fn give_targets(
    targets: &BTreeMap<PathBuf, String>,
    source: &Source,
    scenario: &mut Scenario,
) -> Result<(), Failure> {
    let Some(path) = source.targets_file(scenario) else {
        return Ok(());
    };
    let unread = || {
        Failure::Input(format!(
            "{} was not read when the sweep began: list it as `servo.input`",
            path.display()
        ))
    };
    source.give_targets(scenario, targets.get(&path).ok_or_else(unread)?.clone())
}

/// XXH3-64 of this program's file: two builds are two versions.
fn program() -> Result<String, Failure> {
    let bytes = std::fs::read("/proc/self/exe")
        .map_err(|error| Failure::Work(format!("cannot read this program's file: {error}")))?;
    Ok(format!("{:016x}", xxh3_64(&bytes)))
}

impl Manifest {
    /// How many partitions there are, those of other shards included.
    pub(super) fn partitions(&self) -> u64 {
        self.runs.div_ceil(self.partition_runs)
    }

    /// The runs of a partition.
    pub(super) fn runs_of(&self, partition: u64) -> std::ops::Range<u64> {
        let begin = partition * self.partition_runs;
        begin..(begin + self.partition_runs).min(self.runs)
    }

    /// The partitions in the folder, finished or not.
    pub(super) fn own_partitions(&self) -> impl Iterator<Item = u64> {
        (0..self.partitions()).filter(|partition| self.shard.has(*partition))
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
        let refuse = |sentence: String| {
            Failure::Input(format!(
                "{sentence}; restore it, or compute the sweep again in another folder"
            ))
        };
        let text = files::read(&path)
            .map_err(|error| refuse(format!("cannot read {}: {error}", path.display())))?;
        let manifest: Self = serde_json::from_slice(&text).map_err(|error| {
            refuse(format!(
                "{} is not the description of a sweep: {error}",
                path.display()
            ))
        })?;
        let sound = manifest.format == FORMAT && manifest.partition_runs > 0 && manifest.runs > 0;
        if !sound || !(1..=manifest.shard.of).contains(&manifest.shard.index) {
            return Err(refuse(format!(
                "{} is of another version of armplane, or damaged",
                path.display()
            )));
        }
        Ok(Some(manifest))
    }

    /// Takes a results folder for this sweep: an empty one, or one in which it has begun.
    ///
    /// # Errors
    /// [`Failure::Input`] where the folder is another sweep's, or has other files in it.
    pub(super) fn take(&self, results: &Results) -> Result<(), Failure> {
        let folder = &results.folder;
        check_regular(folder)?;
        let refuse = |sentence: String| {
            Failure::Input(format!(
                "{} {sentence}; choose another folder with --out",
                folder.display()
            ))
        };
        match Self::read(folder)? {
            None if std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) => {
                Err(refuse("has files in it, but not of a sweep".to_owned()))
            }
            None => results.save(FILE, &serde_json::to_value(self).map_err(Failure::work)?),
            Some(found) if found.name != self.name => Err(refuse(format!(
                "has the results of the sweep `{}` in it",
                found.name
            ))),
            Some(found) if found.program != self.program || found.version != self.version => {
                Err(refuse(format!(
                    "has runs of another build of armplane in it (version {}, program {}, this is {})",
                    found.version, found.program, self.program
                )))
            }
            Some(found) if found.shard != self.shard => Err(refuse(format!(
                "has shard {} in it, not {}",
                found.shard, self.shard
            ))),
            Some(found) if found.fingerprint != self.fingerprint => Err(refuse(format!(
                "has runs of `{}` in it from before its file, its scenario, its robot or its targets changed",
                self.name
            ))),
            Some(_) => Ok(()),
        }
    }
}

/// Refuses a link, pipe, device or folder that has the name of a result: what is written there would go elsewhere, or wait for a reader.
///
/// # Errors
/// [`Failure::Input`] with the remedy.
pub(super) fn check_regular(folder: &Path) -> Result<(), Failure> {
    let kind = |path: &Path| {
        std::fs::symlink_metadata(path)
            .ok()
            .map(|found| found.file_type())
    };
    let folders = [rows_folder(folder), journals_folder(folder)];
    let parts = folders
        .iter()
        .filter(|inner| kind(inner).is_some_and(|kind| kind.is_dir()));
    let parts = parts
        .filter_map(|inner| std::fs::read_dir(inner).ok())
        .flatten()
        .flatten()
        .map(|entry| entry.path());
    let mut files = [FILE, "report.json", "report.svg", "report.png", ".draft"]
        .map(|name| folder.join(name))
        .into_iter()
        .chain(parts);
    let file = files.find(|path| kind(path).is_some_and(|kind| !kind.is_file()));
    match file.or_else(|| {
        folders
            .into_iter()
            .find(|path| kind(path).is_some_and(|kind| !kind.is_dir()))
    }) {
        None => Ok(()),
        Some(path) => Err(Failure::Input(format!(
            "{} has the name of a result and is none: remove it, or choose another folder with --out",
            path.display()
        ))),
    }
}

/// The folder of the Parquet files.
pub(super) fn rows_folder(folder: &Path) -> PathBuf {
    folder.join(ROWS)
}

/// The folder of the journals.
pub(super) fn journals_folder(folder: &Path) -> PathBuf {
    folder.join(JOURNAL)
}

/// A partition's Parquet file.
pub(super) fn rows_file(folder: &Path, partition: u64) -> PathBuf {
    rows_folder(folder).join(format!("part-{partition:05}.parquet"))
}

/// A partition's journal.
pub(super) fn journal_file(folder: &Path, partition: u64) -> PathBuf {
    journals_folder(folder).join(format!("part-{partition:05}.journal"))
}

/// Opens a partition's Parquet file, and checks that it is this sweep's, whole.
///
/// # Errors
/// [`Failure::Input`] where it is not.
pub(super) fn open(
    folder: &Path,
    manifest: &Manifest,
    partition: u64,
) -> Result<super::table::Partition, Failure> {
    let path = rows_file(folder, partition);
    let damaged = |sentence: String| {
        Failure::Input(format!("{sentence}; remove it, and run the sweep again"))
    };
    let opened = super::table::Partition::open(&path).map_err(damaged)?;
    let runs = manifest.runs_of(partition);
    if opened.metadata(FINGERPRINT) != Some(manifest.fingerprint.as_str())
        || opened.rows != runs.end - runs.start
    {
        return Err(Failure::Input(format!(
            "{} is not of this sweep: remove it, and run the sweep again",
            path.display()
        )));
    }
    let numbers = opened
        .column(RUN)
        .map_err(|error| damaged(format!("cannot read {}: {error}", path.display())))?;
    match numbers
        .iter()
        .map(|cell| cell.number().map(|run| run as u64))
        .eq(runs.map(Some))
    {
        true => Ok(opened),
        false => Err(Failure::Input(format!(
            "{} lacks runs of its partition: remove it, and run the sweep again",
            path.display()
        ))),
    }
}
