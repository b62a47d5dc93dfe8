//! The outcomes of a sweep's runs, and whether anything that its file asks for came to nothing.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use serde::Serialize;
use session::Failure;

use super::columns::{Columns, FAILED, OUTCOME, REASON, REFUSED};
use super::folder::{Manifest, open, parts};
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

impl Outcomes {
    /// Counts the rows of a folder, part by part.
    ///
    /// # Errors
    /// [`Failure::Input`] where a part is damaged.
    pub(super) fn of(folder: &Path, manifest: &Manifest) -> Result<Self, Failure> {
        let spec: Spec = shared_types::file::parse("sweep.toml", &manifest.sweep_toml, &[])?;
        let listed = spec.key.iter().filter(|key| !key.values.is_empty());
        let listed: Vec<&str> = listed.map(|key| key.key.as_str()).collect();
        let names = [&listed[..], &[OUTCOME, REASON]].concat();
        let mut outcomes = Self::default();
        // Of each listed value, why its runs have no result; empty where one has.
        let mut values = BTreeMap::<String, String>::new();
        for (part, path) in parts(folder, manifest)? {
            let mut table = Columns::named(&names);
            open(&path, part, manifest)?
                .read(&mut table)
                .map_err(Failure::work)?;
            for row in 0..table.rows() {
                let reason = outcomes.count(&table.shown(OUTCOME, row), table.shown(REASON, row));
                for key in &listed {
                    let value = format!("{key} = {}", table.shown(key, row));
                    let known = values.entry(value).or_insert_with(|| reason.clone());
                    if reason.is_empty() {
                        known.clear();
                    }
                }
            }
        }
        let barren = values.into_iter().filter(|(_, reason)| !reason.is_empty());
        outcomes.barren = barren.collect();
        Ok(outcomes)
    }

    /// How many runs there are.
    pub(super) fn runs(&self) -> u64 {
        self.computed + self.refused + self.failed
    }

    /// Takes a run in; why it has no result, empty where it has one.
    fn count(&mut self, outcome: &str, reason: String) -> String {
        let count = match outcome {
            REFUSED => &mut self.refused,
            FAILED => &mut self.failed,
            _ => {
                self.computed += 1;
                return String::new();
            }
        };
        *count += 1;
        if self.reason.is_empty() {
            self.reason.clone_from(&reason);
        }
        reason
    }

    /// The lack of a whole sweep, in one sentence without an end; `None` where everything that its file lists has a result.
    pub(super) fn lack(&self) -> Option<String> {
        let (without, failed, reason) = (self.refused + self.failed, self.failed, &self.reason);
        let mut clauses = Vec::new();
        if failed > 0 {
            let runs = self.runs();
            clauses.push(format!(
                "{failed} of {runs} runs failed by a defect of armplane; see `reason` in the table"
            ));
        }
        if self.computed == 0 {
            clauses.push(format!("no run of {without} has a result: {reason}"));
        } else {
            let barren = self.barren.iter().take(NAMED);
            clauses.extend(
                barren.map(|(value, reason)| format!("no run with {value} has a result: {reason}")),
            );
            let more = self.barren.len().saturating_sub(NAMED);
            clauses.extend((more > 0).then(|| format!("{more} more values are without a result")));
        }
        (!clauses.is_empty()).then(|| clauses.join("; "))
    }
}

/// The runs that have no result; nothing where all have one.
impl fmt::Display for Outcomes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (refused, failed, reason) = (self.refused, self.failed, &self.reason);
        let runs = self.runs();
        let defects = match failed {
            0 => String::new(),
            _ => format!("; {failed} ended in a defect of this program"),
        };
        match refused + failed {
            0 => Ok(()),
            _ => writeln!(
                f,
                "refused    {refused} of {runs} runs{defects}, for example: {reason}"
            ),
        }
    }
}
