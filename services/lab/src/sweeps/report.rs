//! A sweep read back: outcomes, distributions, a map over two keys, and the worst runs with the commands that repeat them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use session::{Failure, Results, load};
use shared_types::topics::TOPICS;

use super::cell::Cell;
use super::manifest::{Manifest, check_regular};
use super::picture;
use super::read_back::{SHOWN, Table};
use super::row::{COMPLETED, OUTCOME, REASON, REFUSED, RUN, hash_column};
use super::space::Space;
use super::spec::{Spec, unit_of};

/// Shares at which distributions are given.
const SHARES: [f64; 4] = [0.0, 0.5, 0.9, 0.99];
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

/// The distribution of a column.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// The column.
    pub column: String,
    /// How many runs have a value.
    pub runs: usize,
    /// Smallest, median, 90th and 99th percentile, largest.
    pub values: [f64; 5],
}

/// One of the worst runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Worst {
    /// Its number.
    pub run: u64,
    /// The value of the column.
    pub value: f64,
    /// Its outcome.
    pub outcome: String,
    /// Its settings by key.
    pub settings: Vec<(String, String)>,
    /// The hash of each topic, as in `summary.json`.
    pub hashes: BTreeMap<String, String>,
    /// The command that repeats it as a recording.
    pub command: String,
}

/// A sweep's report.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The sweep's name.
    pub name: String,
    /// Where the report's files are.
    pub folder: PathBuf,
    /// Runs in the table, and in the sweep.
    pub runs: [u64; 2],
    /// How many runs had each outcome, the most frequent first.
    pub outcomes: Vec<(String, usize)>,
    /// A reason of those that were refused before their first tick.
    pub refused: Option<String>,
    /// The distributions.
    pub spreads: Vec<Spread>,
    /// The column by which the worst are the worst.
    pub by: String,
    /// The worst runs, the worst first.
    pub worst: Vec<Worst>,
    /// A remark where a command would repeat another run.
    pub remark: String,
}

impl Report {
    /// For machines.
    #[must_use]
    pub fn json(&self) -> Value {
        let spread = |spread: &Spread| {
            let [min, p50, p90, p99, max] = spread.values;
            let unit = unit_of(&spread.column).unwrap_or_default();
            json!({"column": spread.column, "unit": unit, "runs": spread.runs, "min": min, "p50": p50, "p90": p90, "p99": p99, "max": max})
        };
        let worst = |worst: &Worst| {
            let settings: BTreeMap<_, _> = worst.settings.iter().cloned().collect();
            json!({"run": worst.run, "value": worst.value, "outcome": worst.outcome, "settings": settings, "hashes": worst.hashes,
                "command": worst.command})
        };
        json!({
            "sweep": self.name, "folder": self.folder, "runs": self.runs[0], "of": self.runs[1], "remark": self.remark,
            "outcomes": self.outcomes.iter().cloned().collect::<BTreeMap<_, _>>(), "refused": self.refused,
            "distributions": self.spreads.iter().map(spread).collect::<Vec<_>>(),
            "by": self.by, "worst": self.worst.iter().map(worst).collect::<Vec<_>>(),
        })
    }
}

/// Reads a sweep's folder, and saves `report.json` and pictures in it.
///
/// # Errors
/// [`Failure::Input`] where it is not a sweep's folder, no partition is complete, or a column or key is unknown; [`Failure::Work`] where a
/// file cannot be written.
pub fn report(request: &ReportRequest<'_>) -> Result<Report, Failure> {
    let folder = request.folder;
    let manifest = Manifest::read(folder)?.ok_or_else(|| {
        Failure::Input(format!(
            "{} is not the folder of a sweep: there is no sweep.json in it; give the one that `armplane sweep` has named",
            folder.display()
        ))
    })?;
    let spec: Spec = shared_types::file::parse("sweep.toml", &manifest.sweep_toml, &[])?;
    let keys: Vec<&str> = spec.key.iter().map(|key| key.key.as_str()).collect();
    let map = map_keys(&keys, request.map)?;
    let hashes = TOPICS.map(hash_column);
    let hashes: Vec<&str> = hashes.iter().map(String::as_str).collect();
    let mut names = [
        &keys[..],
        &SHOWN[..],
        &hashes[..],
        &[RUN, OUTCOME, REASON, COMPLETED, request.by],
    ]
    .concat();
    names.sort_unstable();
    names.dedup();
    let table = Table::read(folder, &manifest, &names)?;
    if table.rows == 0 {
        return Err(Failure::Input(format!(
            "no partition in {} is complete yet: run the sweep first",
            folder.display()
        )));
    }
    let by = table.ordered(request.by);
    if by.is_empty() {
        return Err(Failure::Input(format!(
            "the column `{}` has no numbers; take one such as {}",
            request.by, SHOWN[0]
        )));
    }
    let texts = |name: &str| {
        table
            .column(name)
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>()
    };
    let (outcome, reason) = (texts(OUTCOME), texts(REASON));
    let mut outcomes = Vec::<(String, usize)>::new();
    for one in &outcome {
        match outcomes.iter_mut().find(|(known, _)| known == one) {
            Some((_, count)) => *count += 1,
            None => outcomes.push((one.clone(), 1)),
        }
    }
    outcomes.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let refused = outcome
        .iter()
        .zip(&reason)
        .find(|(outcome, _)| *outcome == REFUSED)
        .map(|(_, reason)| reason.clone());
    let mut shown = SHOWN.to_vec();
    if !shown.contains(&request.by) {
        shown.push(request.by);
    }
    let spreads = shown
        .iter()
        .filter_map(|column| spread(column, &table.ordered(column)))
        .collect();
    let source = load::Source::read(&manifest.scenario).ok();
    let has_changed = source
        .as_ref()
        .is_none_or(|source| source.text != manifest.scenario_toml);
    let remark = match has_changed {
        true => format!(
            "{} is not as it was for the sweep: the commands repeat other runs",
            manifest.scenario
        ),
        false => String::new(),
    };
    let original = load::Source {
        file: manifest.scenario.clone(),
        text: manifest.scenario_toml.clone(),
        folder: None,
    };
    let space = Space::new(&spec, &original).map_err(|_| {
        Failure::Input(format!(
            "{} is damaged: its scenario is invalid",
            folder.display()
        ))
    })?;
    let worst = worst(&table, request, |run| {
        let values = space
            .values(run)
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>();
        let settings: Vec<_> = keys
            .iter()
            .map(|key| (*key).to_owned())
            .zip(values)
            .collect();
        (settings, command(&manifest, &space.settings(run), run))
    });
    let report = Report {
        name: manifest.name.clone(),
        folder: folder.to_owned(),
        runs: [
            table.rows as u64,
            manifest
                .own_partitions()
                .map(|partition| manifest.runs_of(partition))
                .map(|runs| runs.end - runs.start)
                .sum(),
        ],
        outcomes,
        refused,
        spreads,
        by: request.by.to_owned(),
        worst,
        remark,
    };
    let results = Results::create(Some(folder), &manifest.name)?;
    check_regular(folder)?;
    let page = picture::page(
        title(&report, &spec),
        listed(&report.outcomes),
        &table,
        &spec,
        &map,
        &report.by,
    );
    page.save(&folder.join("report")).map_err(Failure::work)?;
    results.save("report.json", &report.json())?;
    Ok(report)
}

fn title(report: &Report, spec: &Spec) -> String {
    let [runs, of] = report.runs;
    let counted = if runs == of {
        format!("{runs} runs")
    } else {
        format!("{runs} of {of} runs")
    };
    format!("{}: {} in {counted}", report.name, spec.scenario)
}

/// "goal reached 12, stopped 1".
fn listed(outcomes: &[(String, usize)]) -> String {
    outcomes
        .iter()
        .map(|(outcome, count)| format!("{outcome} {count}"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// The keys of the map: those asked for, or the first two.
fn map_keys<'a>(keys: &[&'a str], wanted: &[String]) -> Result<Vec<&'a str>, Failure> {
    let known = |wanted: &String| {
        let found = keys.iter().find(|key| **key == wanted.as_str()).copied();
        found.ok_or_else(|| {
            Failure::Input(load::unknown(
                "key of this sweep",
                wanted,
                keys.iter().copied(),
                "",
            ))
        })
    };
    match wanted {
        [] => Ok(keys.iter().copied().take(2).collect()),
        [one, other] if one != other => Ok(vec![known(one)?, known(other)?]),
        _ => Err(Failure::Input(
            "a map has two keys: --map KEY,KEY".to_owned(),
        )),
    }
}

fn spread(column: &str, ordered: &[f64]) -> Option<Spread> {
    let last = *ordered.last()?;
    let at = |share: f64| {
        ordered[((share * ordered.len() as f64).ceil() as usize).clamp(1, ordered.len()) - 1]
    };
    let [min, p50, p90, p99] = SHARES.map(at);
    Some(Spread {
        column: column.to_owned(),
        runs: ordered.len(),
        values: [min, p50, p90, p99, last],
    })
}

/// The worst runs: first those that did not come to their task's end, then by the column, the largest first; a number that is none is larger.
fn worst(
    table: &Table,
    request: &ReportRequest<'_>,
    of: impl Fn(u64) -> (Vec<(String, String)>, String),
) -> Vec<Worst> {
    let (by, completed) = (table.column(request.by), table.column(COMPLETED));
    let rows = by.iter().zip(completed).enumerate();
    let mut order: Vec<(bool, f64, usize)> = rows
        .filter_map(|(row, (by, done))| Some((done == &Cell::Boolean(true), by.number()?, row)))
        .collect();
    order.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)).then(a.2.cmp(&b.2)));
    let of_row = |(_, value, row): &(bool, f64, usize)| {
        let run = table.column(RUN)[*row].number().unwrap_or_default() as u64;
        let (settings, command) = of(run);
        let text = |name: &str| table.column(name)[*row].to_string();
        let hashes = TOPICS
            .iter()
            .map(|topic| ((*topic).to_owned(), text(&hash_column(topic))))
            .collect();
        Worst {
            run,
            value: *value,
            outcome: text(OUTCOME),
            settings,
            hashes,
            command,
        }
    };
    order.iter().take(request.worst).map(of_row).collect()
}

/// The command that repeats a run as a recording.
fn command(manifest: &Manifest, settings: &[String], run: u64) -> String {
    let settings: String = settings
        .iter()
        .map(|setting| format!(" --set {}", quoted(setting)))
        .collect();
    format!(
        "armplane run {}{settings} --out {}-run-{run}",
        quoted(&manifest.scenario),
        manifest.name
    )
}

/// A word of a shell's command line.
fn quoted(word: &str) -> String {
    let is_plain = !word.is_empty()
        && word
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || "-_./=:,+".contains(c));
    if is_plain {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
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
            "start.q_deg=[1, 2]",
            "it's",
            "$HOME `x` \\",
            "",
        ] {
            let said = std::process::Command::new("sh")
                .args(["-c", &format!("printf %s {}", quoted(word))])
                .output()
                .unwrap();
            assert_eq!(String::from_utf8(said.stdout).unwrap(), word);
        }
    }

    #[test]
    fn percentiles_are_values_that_occurred() {
        let ordered: Vec<f64> = (1..=1000).map(f64::from).collect();
        assert_eq!(
            spread("x", &ordered).unwrap().values,
            [1.0, 500.0, 900.0, 990.0, 1000.0]
        );
        assert_eq!(spread("x", &[3.0]).unwrap().values, [3.0; 5]);
        assert_eq!(spread("x", &[]), None);
    }
}
