//! The outcomes of a sweep's runs, and whether anything that its file asks for came to nothing.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use session::Failure;

use super::cell::Cell;
use super::manifest::{Manifest, open};
use super::row::{FAILED, OUTCOME, REASON, REFUSED};
use super::spec::Spec;

/// Listed values that a sentence names.
const NAMED: usize = 3;

/// The outcomes of a folder's runs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Outcomes {
    /// Runs that were computed, whatever their outcome.
    pub computed: u64,
    /// Runs that scenario, robot or law refused before the first tick.
    pub refused: u64,
    /// Runs that a defect of this program ended.
    pub failed: u64,
    /// Why the first of those runs has no result; empty where each has one.
    pub reason: String,
    /// `KEY = VALUE`, and why the first of its runs has no result: the listed values with which no run has one.
    pub barren: Vec<(String, String)>,
}

/// The runs with one value of a key.
#[derive(Default)]
struct Tally {
    computed: u64,
    reason: String,
}

impl Outcomes {
    /// Counts the rows of a folder, partition by partition.
    ///
    /// # Errors
    /// [`Failure::Input`] where a partition is missing or damaged.
    pub(super) fn of(folder: &Path, manifest: &Manifest) -> Result<Self, Failure> {
        let spec: Spec = shared_types::file::parse("sweep.toml", &manifest.sweep_toml, &[])?;
        let listed: Vec<&str> = spec
            .key
            .iter()
            .filter(|key| !key.values.is_empty())
            .map(|key| key.key.as_str())
            .collect();
        let mut tallies: Vec<BTreeMap<String, Tally>> =
            listed.iter().map(|_| BTreeMap::new()).collect();
        let mut outcomes = Self::default();
        for partition in manifest.own_partitions() {
            let opened = open(folder, manifest, partition)?;
            let column = |name: &str| {
                opened
                    .column(name)
                    .map_err(|sentence| Failure::Input(format!("{}: {sentence}", folder.display())))
            };
            let keys = listed
                .iter()
                .map(|key| column(key))
                .collect::<Result<Vec<_>, _>>()?;
            for (row, (outcome, reason)) in column(OUTCOME)?.iter().zip(column(REASON)?).enumerate()
            {
                let is_computed = outcomes.count(outcome, &reason);
                for (cells, tallies) in keys.iter().zip(&mut tallies) {
                    let tally = tallies.entry(cells[row].to_string()).or_default();
                    tally.computed += u64::from(is_computed);
                    if !is_computed && tally.reason.is_empty() {
                        tally.reason = reason.to_string();
                    }
                }
            }
        }
        for (key, tallies) in listed.iter().zip(tallies) {
            let barren = tallies.into_iter().filter(|(_, tally)| tally.computed == 0);
            outcomes
                .barren
                .extend(barren.map(|(value, tally)| (format!("{key} = {value}"), tally.reason)));
        }
        Ok(outcomes)
    }

    /// Takes a run in; whether it was computed.
    fn count(&mut self, outcome: &Cell, reason: &Cell) -> bool {
        let is = |name: &str| matches!(outcome, Cell::Text(text) if text == name);
        let count = match (is(REFUSED), is(FAILED)) {
            (true, _) => &mut self.refused,
            (_, true) => &mut self.failed,
            _ => &mut self.computed,
        };
        *count += 1;
        let is_computed = !is(REFUSED) && !is(FAILED);
        if !is_computed && self.reason.is_empty() {
            self.reason = reason.to_string();
        }
        is_computed
    }

    /// The lack of a whole sweep, in one sentence without an end; `None` where everything that its file lists has a result.
    pub(super) fn lack(&self) -> Option<String> {
        let Self {
            computed,
            refused,
            failed,
            reason,
            barren,
        } = self;
        let mut clauses = Vec::new();
        if *failed > 0 {
            clauses.push(format!(
                "{failed} of {} runs ended in a defect of this program, which `reason` in the table tells",
                computed + refused + failed
            ));
        }
        if *computed == 0 {
            clauses.push(format!(
                "no run of {} has a result: {reason}",
                refused + failed
            ));
        } else {
            clauses.extend(
                barren
                    .iter()
                    .take(NAMED)
                    .map(|(value, reason)| format!("no run with {value} has a result: {reason}")),
            );
            if barren.len() > NAMED {
                clauses.push(format!(
                    "{} more values are without a result",
                    barren.len() - NAMED
                ));
            }
        }
        (!clauses.is_empty()).then(|| clauses.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcomes(rows: &[(&str, &str)]) -> Outcomes {
        let mut outcomes = Outcomes::default();
        let cell = |text: &str| Cell::Text(text.to_owned());
        for (outcome, reason) in rows {
            outcomes.count(&cell(outcome), &cell(reason));
        }
        outcomes
    }

    #[test]
    fn a_sweep_lacks_something_where_a_run_failed_or_none_has_a_result() {
        let reached = ("goal reached", "");
        assert_eq!(
            outcomes(&[reached, (REFUSED, "the start")]).lack(),
            None,
            "a refused run is a row"
        );
        let none = outcomes(&[(REFUSED, "the start"), (REFUSED, "the law")]);
        assert_eq!(none.lack().unwrap(), "no run of 2 has a result: the start");
        let failed = outcomes(&[reached, (FAILED, "a panic")]);
        assert!(
            failed
                .lack()
                .unwrap()
                .starts_with("1 of 2 runs ended in a defect of this program")
        );
        let barren = (1..=5)
            .map(|value| (format!("seed = {value}"), "too large".to_owned()))
            .collect();
        let barren = Outcomes {
            barren,
            ..outcomes(&[reached])
        }
        .lack()
        .unwrap();
        assert!(
            barren.starts_with("no run with seed = 1 has a result: too large; ")
                && barren.ends_with("2 more values are without a result")
        );
    }
}
