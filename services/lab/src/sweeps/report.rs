//! A sweep read back: outcomes, distributions, a map over two keys, and the worst runs with the commands that repeat them.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;
use session::{Failure, load};
use shared_types::topics::TOPICS;
use toml::Value;
use viz::plot::digits;

use super::columns::{Columns, OUTCOME, REASON, REFUSED, RUN, hash_column, number};
use super::folder::{Manifest, open, parts};
use super::picture::{self, SHOWN};
use super::space::Space;
use super::spec::Spec;
use super::units::unit_of;
use crate::text::{Columns as Printed, quantile};

/// The column of runs that came to their task's end.
const COMPLETED: &str = "completed";

/// The report that is asked for.
pub struct ReportRequest<'a> {
    /// The results folder of the sweep.
    pub folder: &'a Path,
    /// The column by which runs are ordered, largest first, and which the map shows.
    pub by: &'a str,
    /// Two keys of the map; the first two that vary where there are none.
    pub map: &'a [String],
    /// How many of the worst runs are listed.
    pub worst: usize,
}

/// The distribution of a column: values that occurred.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Spread {
    column: String,
    unit: &'static str,
    runs: usize,
    min: f64,
    p50: f64,
    p90: f64,
    p99: f64,
    max: f64,
}

/// One of the worst runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Worst {
    run: u64,
    value: f64,
    outcome: String,
    settings: BTreeMap<String, String>,
    /// Of each topic, as in `summary.json`.
    hashes: BTreeMap<String, String>,
    /// Repeats it as a recording.
    command: String,
}

/// A sweep's report.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    sweep: String,
    folder: PathBuf,
    /// Runs in the table ...
    runs: u64,
    /// ... and in the sweep.
    of: u64,
    /// How many runs had each outcome.
    outcomes: BTreeMap<String, usize>,
    /// A reason of those that were refused before their first tick.
    refused: Option<String>,
    distributions: Vec<Spread>,
    /// The column by which the worst are the worst.
    by: String,
    /// The worst first.
    worst: Vec<Worst>,
    /// Where a command would repeat another run.
    remark: String,
}

/// Reads a sweep's folder, and saves `report.json` and pictures in it.
///
/// # Errors
/// [`Failure::Input`] where it is not a sweep's folder, no part is complete, or a column or key is unknown; [`Failure::Work`] where a
/// file cannot be written.
pub fn report(request: &ReportRequest<'_>) -> Result<Report, Failure> {
    let ReportRequest { folder, by, .. } = *request;
    let manifest = Manifest::expect(folder)?;
    let spec: Spec = shared_types::file::parse("sweep.toml", &manifest.sweep_toml, &[])?;
    let keys: Vec<&str> = spec.key.iter().map(|key| key.key.as_str()).collect();
    let map = map_keys(&keys, request.map)?;
    let table = read(folder, &manifest, &keys, by)?;
    let mut outcomes = BTreeMap::<String, usize>::new();
    let mut refused = None;
    for row in 0..table.rows() {
        let outcome = table.shown(OUTCOME, row);
        if outcome == REFUSED {
            refused.get_or_insert_with(|| table.shown(REASON, row));
        }
        *outcomes.entry(outcome).or_default() += 1;
    }
    let more = Some(by).filter(|by| !SHOWN.contains(by));
    let shown = SHOWN.into_iter().chain(more);
    let is_as_it_was = load::Source::read(&manifest.scenario)
        .is_ok_and(|source| source.text == manifest.scenario_toml);
    let remark = match is_as_it_was {
        true => String::new(),
        false => format!(
            "{} has changed since the sweep, so the commands repeat other runs",
            manifest.scenario
        ),
    };
    let original = load::Source {
        file: manifest.scenario.clone(),
        text: manifest.scenario_toml.clone(),
        folder: None,
    };
    let damaged = || format!("{} is damaged: its scenario is invalid", folder.display());
    let space = Space::new(spec.clone(), &original, &Failure::input)
        .map_err(|_| Failure::Input(damaged()))?;
    let report = Report {
        sweep: manifest.name.clone(),
        folder: folder.to_owned(),
        runs: table.rows() as u64,
        of: manifest.runs,
        outcomes,
        refused,
        distributions: shown
            .filter_map(|column| spread(column, table.ordered(column)))
            .collect(),
        by: by.to_owned(),
        worst: worst(&table, request, &space, &manifest),
        remark,
    };
    let results = session::Results::create(Some(folder), &manifest.name)?;
    let counted = report.counted();
    let title = format!("{}: {} in {counted}", report.sweep, spec.scenario);
    let page = picture::page(title, report.listed(), &table, &spec, &map, by);
    page.save(&folder.join("report")).map_err(Failure::work)?;
    let value = serde_json::to_value(&report).map_err(Failure::work)?;
    results.save("report.json", &value)?;
    Ok(report)
}

/// The columns of all complete parts that the report needs.
fn read(folder: &Path, manifest: &Manifest, keys: &[&str], by: &str) -> Result<Columns, Failure> {
    let hashes = TOPICS.map(hash_column);
    let hashes: Vec<&str> = hashes.iter().map(String::as_str).collect();
    let names = [
        keys,
        &SHOWN,
        &hashes,
        &[RUN, OUTCOME, REASON, COMPLETED, by],
    ]
    .concat();
    let mut table = Columns::named(&names);
    for (part, path) in parts(folder, manifest)? {
        let read = open(&path, part, manifest)?.read(&mut table);
        read.map_err(|error| Failure::Input(format!("{}: {error}", folder.display())))?;
    }
    if table.rows() == 0 {
        let folder = folder.display();
        return Err(Failure::Input(format!(
            "no partition in {folder} is complete: run the sweep first"
        )));
    }
    if table.ordered(by).is_empty() {
        return Err(Failure::Input(format!(
            "the column `{by}` has no numbers; take one such as {}",
            SHOWN[0]
        )));
    }
    Ok(table)
}

/// The keys of the map: those asked for, or the first two.
fn map_keys<'a>(keys: &[&'a str], wanted: &[String]) -> Result<Vec<&'a str>, Failure> {
    let known = |wanted: &String| {
        let found = keys.iter().find(|key| **key == wanted.as_str()).copied();
        let unknown = || load::unknown("key of this sweep", wanted, keys.iter().copied(), "");
        found.ok_or_else(|| Failure::Input(unknown()))
    };
    match wanted {
        [] => Ok(keys.iter().copied().take(2).collect()),
        [one, other] if one != other => Ok(vec![known(one)?, known(other)?]),
        _ => Err(Failure::input("a map needs two keys: --map KEY,KEY")),
    }
}

fn spread(column: &str, ordered: Vec<f64>) -> Option<Spread> {
    let at = |share| quantile(ordered.iter().copied(), share);
    (!ordered.is_empty()).then(|| Spread {
        column: column.to_owned(),
        unit: unit_of(column).unwrap_or_default(),
        runs: ordered.len(),
        min: at(0.0),
        p50: at(0.5),
        p90: at(0.9),
        p99: at(0.99),
        max: at(1.0),
    })
}

/// The worst runs: first those that did not come to their task's end, then by the column, the largest first; a number that is none is larger.
fn worst(
    table: &Columns,
    request: &ReportRequest<'_>,
    space: &Space,
    manifest: &Manifest,
) -> Vec<Worst> {
    let of_row = |row: usize| {
        let completed = table.value(COMPLETED, row) == Some(&Value::Boolean(true));
        Some((completed, number(table.value(request.by, row))?, row))
    };
    let mut order: Vec<(bool, f64, usize)> = (0..table.rows()).filter_map(of_row).collect();
    order.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)).then(a.2.cmp(&b.2)));
    let of = |(_, value, row): &(bool, f64, usize)| {
        let run = number(table.value(RUN, *row)).unwrap_or_default() as u64;
        let settings = space.settings(run).into_iter();
        let settings: String = settings
            .map(|setting| format!(" --set {}", quoted(&setting)))
            .collect();
        let hash = |topic: &str| (topic.to_owned(), table.shown(&hash_column(topic), *row));
        let (scenario, name) = (quoted(&manifest.scenario), &manifest.name);
        let values = space.values(run).into_iter();
        Worst {
            run,
            value: *value,
            outcome: table.shown(OUTCOME, *row),
            settings: values
                .map(|(key, value)| (key.to_owned(), value.to_string()))
                .collect(),
            hashes: TOPICS.map(hash).into(),
            command: format!("armplane run {scenario}{settings} --out {name}-run-{run}"),
        }
    };
    order.iter().take(request.worst).map(of).collect()
}

/// A word of a shell's command line.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

impl Report {
    fn counted(&self) -> String {
        match (self.runs, self.of) {
            (runs, of) if runs == of => format!("{runs} runs"),
            (runs, of) => format!("{runs} of {of} runs, those of complete partitions"),
        }
    }

    /// "goal reached 12, stopped 1".
    fn listed(&self) -> String {
        let outcomes = self.outcomes.iter();
        let outcomes: Vec<_> = outcomes
            .map(|(outcome, count)| format!("{outcome} {count}"))
            .collect();
        outcomes.join(", ")
    }
}

/// Outcomes, distributions, and the worst runs with their commands.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {}; {}", self.sweep, self.counted(), self.listed())?;
        if let Some(reason) = &self.refused {
            writeln!(f, "refused    for example: {reason}")?;
        }
        let columns = Printed::<&Spread>::new()
            .text("", |one| one.column.clone())
            .number("runs", |one| one.runs)
            .number("smallest", |one| digits(one.min))
            .number("median", |one| digits(one.p50))
            .number("90 %", |one| digits(one.p90))
            .number("99 %", |one| digits(one.p99))
            .number("largest", |one| digits(one.max));
        writeln!(f, "{}", columns.print(&self.distributions))?;
        let by = &self.by;
        writeln!(
            f,
            "The worst by {by}, each with the command that repeats it as a recording:"
        )?;
        for Worst {
            run,
            value,
            outcome,
            settings,
            command,
            ..
        } in &self.worst
        {
            let settings: Vec<_> = settings
                .iter()
                .map(|(key, value)| format!("{key} = {value}"))
                .collect();
            let (value, settings) = (digits(*value), settings.join(", "));
            writeln!(f, "run {run}: {value}, {outcome}; {settings}\n  {command}")?;
        }
        if !self.remark.is_empty() {
            writeln!(f, "{}", self.remark)?;
        }
        writeln!(
            f,
            "\n{}\n  report.svg, report.png  distributions and map\n  report.json             all numbers, for programs",
            self.folder.display()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_come_through_a_shell_unharmed() {
        for word in [
            "control.k_p=900.5",
            "robot=\"ur5\"",
            "it's",
            "$HOME `x` \\",
            "",
        ] {
            let command = format!("printf %s {}", quoted(word));
            let said = std::process::Command::new("sh")
                .args(["-c", &command])
                .output()
                .unwrap();
            assert_eq!(String::from_utf8(said.stdout).unwrap(), word);
        }
    }
}
