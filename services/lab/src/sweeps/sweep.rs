//! A sweep that can be computed: its file, its scenario, its robots and targets, all read once.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use model::Robot;
use session::Failure;
use session::load::{self, Source};
use shared_types::file::Complaint;
use shared_types::graph::Graph;
use shared_types::scenario::Scenario;
use toml::{Table, Value};
use xxhash_rust::xxh3::xxh3_64;

use super::columns::{self, Column, FAILED, OUTCOME, REASON, REFUSED, RUN};
use super::folder::{FINGERPRINT, Manifest};
use super::space::Space;
use super::spec::Spec;
use crate::row::Row;
use crate::trial::Trial;

/// A sweep that can be computed.
pub(super) struct Sweep {
    pub(super) manifest: Manifest,
    space: Space,
    columns: Vec<Column>,
    source: Source,
    graph: Graph,
    robots: BTreeMap<String, Robot>,
    /// The texts of the files of targets: no run sees another one.
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
        let located = |complaint: Complaint| Failure::from(complaint.locate(&name, &text));
        spec.check().map_err(located)?;
        let mut scenario = spec.scenario.clone();
        if scenario.ends_with(".toml") {
            let beside = file.parent().unwrap_or(Path::new("")).join(&scenario);
            let beside = std::path::absolute(&beside).map_err(Failure::work)?;
            scenario = beside.display().to_string();
        }
        let source = Source::read(&scenario)?;
        let space = Space::new(spec, &source, &located)?;
        let spec = &space.spec;
        let targets = targets(&space, &source, &located)?;
        let mut base = source.parse(&spec.set)?;
        give_targets(&targets, &source, &mut base)?;
        chain::planned_faults(&base).map_err(Failure::input)?;
        let own_graph = Some(&base.graph).filter(|file| !file.is_empty());
        let own_graph = own_graph.map(|file| source.beside(file));
        let graph = load::graph_of(&base, own_graph.as_deref())?;
        if graph.process.iter().any(|one| one.program().is_none()) {
            return Err(Failure::Input(format!(
                "{scenario} runs in programs of its graph, and a sweep is computed without processes; remove `graph`"
            )));
        }
        let robots = robots(&space, &source, &base, &located)?;
        let columns = columns::columns(space.columns()).map_err(Failure::Work)?;
        let own = Path::new("/proc/self/exe");
        let program = std::fs::read(own).map_err(Failure::cannot("read", own))?;
        let hash = |bytes: &[u8]| format!("{:016x}", xxh3_64(bytes));
        let (version, program) = (env!("CARGO_PKG_VERSION"), hash(&program));
        let texts = robots.iter().map(|(name, robot)| (name, &robot.source));
        let texts: Vec<_> = texts.collect();
        let inputs = (spec, &source.text, &graph, texts, &targets);
        let all = serde_json::to_vec(&(version, &program, inputs)).map_err(Failure::work)?;
        let manifest = Manifest {
            version: version.to_owned(),
            program,
            fingerprint: hash(&all),
            name: spec.name.clone(),
            scenario,
            sweep_toml: text.clone(),
            scenario_toml: source.text.clone(),
            runs: space.runs,
            part_runs: spec.part_runs(),
        };
        Ok(Self {
            manifest,
            columns,
            source,
            graph,
            robots,
            targets,
            space,
        })
    }

    /// Computes a run; its row, and its simulated time, s.
    pub(super) fn row(&self, run: u64) -> (Table, f64) {
        let loaded = self.trial(run).map_err(|failure| failure.to_string());
        let computed = loaded.and_then(|trial| {
            let row = guarded(|| compute(&trial))?;
            let seconds = row.ticks as f64 * trial.scenario.dt_s();
            Ok((columns::cells(&row)?, seconds))
        });
        let (mut cells, seconds) = computed.unwrap_or_else(|reason| (without(reason), 0.0));
        cells.insert(RUN.to_owned(), Value::Integer(run as i64));
        let keys = self.space.values(run).into_iter();
        cells.extend(keys.map(|(key, value)| (key.to_owned(), value)));
        (cells, seconds)
    }

    fn trial(&self, run: u64) -> Result<Trial<'_>, Failure> {
        let mut scenario = self.source.parse(&self.space.settings(run))?;
        give_targets(&self.targets, &self.source, &mut scenario)?;
        let unknown = || Failure::Input(format!("no robot `{}`", scenario.robot));
        let robot = self.robots.get(&scenario.robot).ok_or_else(unknown)?;
        self.source.check(&scenario, robot, &self.graph)?;
        Ok(Trial {
            robot,
            scenario,
            graph: None,
        })
    }

    /// A part's file.
    ///
    /// # Errors
    /// [`Failure::Work`] where it cannot be made.
    pub(super) fn part(&self, part: u64, rows: &[Table]) -> Result<Vec<u8>, Failure> {
        let of = |value: fn(&Column) -> &str| {
            let named = self
                .columns
                .iter()
                .map(|column| (&column.name, value(column)));
            serde_json::to_string(&named.collect::<BTreeMap<_, _>>()).map_err(Failure::work)
        };
        let manifest = &self.manifest;
        let metadata = [
            ("armplane.version", manifest.version.clone()),
            ("armplane.program", manifest.program.clone()),
            (FINGERPRINT, manifest.fingerprint.clone()),
            ("armplane.sweep", manifest.sweep_toml.clone()),
            ("armplane.scenario", manifest.scenario_toml.clone()),
            ("armplane.units", of(|column| &column.unit)?),
            ("armplane.columns", of(|column| column.about)?),
            (
                "armplane.partition",
                format!("{} of {}", part + 1, manifest.parts()),
            ),
        ];
        let metadata = metadata.map(|(key, value)| (key.to_owned(), value));
        columns::write(&self.columns, rows, metadata.into()).map_err(Failure::work)
    }
}

fn compute(trial: &Trial<'_>) -> Result<Row, String> {
    // As `armplane run` does it: a start that the control law refuses is no run.
    let started = chain::try_first_tick(trial.robot, &trial.scenario);
    started
        .and_then(|_| trial.run())
        .map_err(|refused| refused.to_string())
}

/// A run's row, or the reason why there is none; a panic leaves no further detail.
fn guarded<T>(run: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|_| Err(String::new()))
}

/// The values of a run without a result.
fn without(reason: String) -> Table {
    let (outcome, reason) = match reason.is_empty() {
        true => (
            FAILED,
            "the program ended this run by a panic: a defect, please report it".to_owned(),
        ),
        false => (REFUSED, reason),
    };
    let cells = [(OUTCOME, outcome.into()), (REASON, Value::String(reason))];
    cells
        .into_iter()
        .map(|(name, value)| (name.to_owned(), value))
        .collect()
}

/// The robots of all runs: the scenario's own, and those that a key lists.
fn robots(
    space: &Space,
    source: &Source,
    base: &Scenario,
    located: &dyn Fn(Complaint) -> Failure,
) -> Result<BTreeMap<String, Robot>, Failure> {
    let robot = |name: &str| {
        let robot = name.to_owned();
        source.robot(&Scenario {
            robot,
            ..base.clone()
        })
    };
    let mut robots = BTreeMap::from([(base.robot.clone(), robot(&base.robot)?)]);
    let place = space
        .names()
        .position(|key| key == "robot")
        .unwrap_or_default();
    for name in space.listed("robot").iter().filter_map(Value::as_str) {
        let found = robot(name).map_err(|failure| match failure {
            Failure::File(invalid) => located(Complaint::new(
                format!("key.{place}.values"),
                invalid.message,
                "",
            )),
            other => other,
        })?;
        robots.insert(name.to_owned(), found);
    }
    Ok(robots)
}

/// The texts of all files of targets that the runs have: the scenario's own, and those that a key lists.
fn targets(
    space: &Space,
    source: &Source,
    located: &dyn Fn(Complaint) -> Failure,
) -> Result<BTreeMap<PathBuf, String>, Failure> {
    let set = &space.spec.set;
    let mut targets = BTreeMap::new();
    let mut read = |settings: &[String]| {
        if let Some(path) = source.targets_file(&source.parse(settings)?) {
            let text = load::read_targets(&path)?;
            targets.insert(path, text);
        }
        Ok::<(), Failure>(())
    };
    read(set)?;
    for (place, key) in space.names().enumerate() {
        if !["servo", "servo.input"].contains(&key) {
            continue;
        }
        for value in space.listed(key) {
            read(&[&set[..], &[format!("{key}={value}")]].concat()).map_err(|failure| {
                let place = format!("key.{place}.values");
                located(Complaint::new(place, failure.to_string(), ""))
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
        let path = path.display();
        Failure::Input(format!(
            "{path} was not read when the sweep began: list it as `servo.input`"
        ))
    };
    source.give_targets(scenario, targets.get(&path).ok_or_else(unread)?.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_a_row_and_not_the_end_of_the_sweep() {
        let ended: Result<(), String> = guarded(|| panic!("planted"));
        let outcome = |reason: String| without(reason)[OUTCOME].clone();
        assert_eq!(outcome(ended.unwrap_err()), FAILED.into());
        assert_eq!(outcome("no such posture".to_owned()), REFUSED.into());
    }
}
