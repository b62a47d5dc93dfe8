//! `SWEEP.toml`: which scenario, which keys, a grid or a seeded sample. `docs/sweeps.md` has an example.

use serde::{Deserialize, Serialize};
use shared_types::file::{Complaint, require};
use shared_types::scenario::is_name;

use super::units::{is_within, spelt, unit_of};

/// Most runs of a sweep.
const MOST_RUNS: u64 = 10_000_000;
/// Most runs of a part.
const MOST_PART: u64 = 100_000;

/// The file, as people write it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Spec {
    /// Names the results folder.
    pub(super) name: String,
    /// A built-in scenario's name, or a file beside this one.
    pub(super) scenario: String,
    /// Values that override those of the scenario in every run.
    #[serde(default)]
    pub(super) set: Vec<String>,
    /// The keys that differ from run to run.
    #[serde(default)]
    pub(super) key: Vec<Key>,
    /// Runs drawn at random instead of the product of all keys.
    #[serde(default)]
    pub(super) sample: Option<Sample>,
    /// Runs of one Parquet file, and of one part of a shard.
    #[serde(default)]
    partition: Option<u64>,
}

/// A scenario key, and its values: listed, or a range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Key {
    /// As for `--set`.
    pub(super) key: String,
    /// Unit of its numbers.
    #[serde(default)]
    unit: Option<String>,
    /// The values, one by one.
    #[serde(default)]
    pub(super) values: Vec<toml::Value>,
    /// The first number of a range.
    #[serde(default)]
    pub(super) from: Option<f64>,
    /// The last number of a range.
    #[serde(default)]
    pub(super) to: Option<f64>,
    /// How many numbers of a range a grid has.
    #[serde(default)]
    pub(super) steps: Option<u32>,
    /// How a range is spaced.
    #[serde(default)]
    pub(super) scale: Scale,
}

/// Spacing of a range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Scale {
    /// Evenly.
    #[default]
    Linear,
    /// Evenly in the logarithm.
    Log,
}

/// A seeded sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sample {
    /// How many runs.
    pub(super) runs: u64,
    /// Seed of the values drawn; the runs' own noise has the scenario's `seed`.
    #[serde(default)]
    pub(super) seed: u64,
}

impl Key {
    /// The unit of its values; empty where none is known.
    pub(super) fn unit(&self) -> &str {
        let known = unit_of(&self.key).or(self.unit.as_deref().map(spelt));
        known.unwrap_or_default()
    }

    /// Values of a grid.
    pub(super) fn count(&self) -> u64 {
        match self.values.len() {
            0 => u64::from(self.steps.unwrap_or_default()),
            listed => listed as u64,
        }
    }

    fn check(&self, is_sampled: bool) -> Result<(), Complaint> {
        let Self { key, values, .. } = self;
        let (known, given) = (self.unit(), self.unit.as_deref().map(spelt));
        let given = given.unwrap_or(known);
        let is_nameless = key.is_empty() || key.contains('=') || key.split('.').any(str::is_empty);
        let named = |sentence: &str| format!("`{key}` {sentence}");
        require(
            !is_nameless,
            "key",
            named("is not a scenario key"),
            "write it as control.k_p",
        )?;
        require(
            !["graph", "name"].contains(&key.as_str()),
            "key",
            named("cannot vary within a sweep"),
            "leave it out, or write one sweep per value",
        )?;
        require(
            known == given,
            "unit",
            named(&format!("is in {known}, not in {given}")),
            "convert the values, or leave `unit` out",
        )?;
        let complain = |sentence: &str, remedy| Err(Complaint::new("key", named(sentence), remedy));
        match (values.is_empty(), self.from, self.to) {
            (true, Some(from), Some(to)) => self.check_range(from, to, is_sampled),
            (false, None, None) => self.check_values(),
            (false, ..) => complain("has `values` and a range", "give only one of them"),
            (true, None, None) => complain("has no values", "give `values`, or `from` and `to`"),
            (true, Some(_), None) => complain("has `from` and no `to`", "a range needs both"),
            (true, None, Some(_)) => complain("has `to` and no `from`", "a range needs both"),
        }
    }

    /// A column has one type: numbers, texts, booleans or arrays.
    fn check_values(&self) -> Result<(), Complaint> {
        let (key, values) = (&self.key, &self.values);
        let kind = |value: &toml::Value| match value {
            toml::Value::Integer(_) => "float",
            other => other.type_str(),
        };
        let other = values.iter().find(|value| kind(value) != kind(&values[0]));
        let is_infinite =
            |value: &&toml::Value| value.as_float().is_some_and(|number| !number.is_finite());
        let infinite = values.iter().find(is_infinite);
        let named =
            |value: Option<&toml::Value>| value.map(ToString::to_string).unwrap_or_default();
        require(
            self.steps.is_none(),
            "steps",
            "`values` are counted already",
            "`steps` goes with `from` and `to`",
        )?;
        require(
            other.is_none(),
            "values",
            format!("`{key}` mixes {} and {}", values[0], named(other)),
            "use only numbers, only texts, only booleans or only lists",
        )?;
        require(
            infinite.is_none(),
            "values",
            format!("`{key}` is {}", named(infinite)),
            "its numbers must be finite",
        )
    }

    fn check_range(&self, from: f64, to: f64, is_sampled: bool) -> Result<(), Complaint> {
        let (key, steps) = (&self.key, self.steps);
        require(
            from.is_finite() && to.is_finite() && from < to,
            "to",
            format!("`{key}` has no range from {from} to {to}"),
            "both must be finite, and `from` below `to`",
        )?;
        require(
            self.scale != Scale::Log || from > 0.0,
            "from",
            format!("`{key}` begins at {from}, which has no logarithm"),
            "`from` must be positive, or the scale linear",
        )?;
        require(
            !is_sampled || steps.is_none(),
            "steps",
            format!("`{key}` has `steps`, and a sample is drawn from the whole range"),
            "leave `steps` out",
        )?;
        require(
            is_sampled || steps.is_some(),
            "key",
            format!("`{key}` has no `steps`"),
            "a grid needs `steps`, `values`, or a [sample]",
        )?;
        require(
            steps.is_none_or(|steps| steps >= 2),
            "steps",
            format!("`{key}` has {} `steps`", steps.unwrap_or_default()),
            "a range needs 2 or more; for one value use `values`",
        )
    }
}

impl Spec {
    /// The checks that do not need the scenario.
    pub(super) fn check(&self) -> Result<(), Complaint> {
        let is_name = is_name(&self.name) && !self.name.starts_with('.');
        require(
            is_name,
            "name",
            format!("`{}` cannot be a name", self.name),
            "it names a folder: ASCII letters, digits, `-`, `_` and `.`, which is not the first",
        )?;
        require(
            !self.key.is_empty(),
            "key",
            "the grid is empty: no key differs between runs",
            "add a [[key]]",
        )?;
        let set = self
            .set
            .iter()
            .filter_map(|setting| setting.split_once('='));
        let mut taken: Vec<&str> = set.map(|(path, _)| path.trim()).collect();
        for (i, key) in self.key.iter().enumerate() {
            let checked = key.check(self.sample.is_some());
            checked.map_err(|complaint| complaint.within(&format!("key.{i}")))?;
            let name = key.key.as_str();
            let overlaps = |other: &&&str| is_within(other, name) || is_within(name, other);
            if let Some(other) = taken.iter().find(overlaps) {
                let sentence = format!("`{name}` is given twice: `{other}` sets it too");
                return Err(Complaint::new(
                    format!("key.{i}.key"),
                    sentence,
                    "leave one of them out",
                ));
            }
            taken.push(name);
        }
        self.check_size()
    }

    /// How many runs there are, and how they are divided.
    fn check_size(&self) -> Result<(), Complaint> {
        let runs = self.runs();
        let (place, counted) = match (self.sample, runs) {
            (Some(sample), _) => (
                "sample.runs",
                format!("the sample has {} `runs`", sample.runs),
            ),
            (None, Some(runs)) => ("key", format!("the product of all keys has {runs} runs")),
            (None, None) => (
                "key",
                "the product of all keys has more runs than can be counted".to_owned(),
            ),
        };
        let part = self.part_runs();
        require(
            runs != Some(0),
            place,
            "the sample is empty: `runs` is 0",
            "1 to 10000000",
        )?;
        require(
            runs.is_some_and(|runs| runs <= MOST_RUNS),
            place,
            counted,
            "at most 10000000",
        )?;
        require(
            (1..=MOST_PART).contains(&part),
            "partition",
            format!("`partition` is {part} runs"),
            "1 to 100000",
        )
    }

    /// How many runs; `None` beyond what can be counted.
    pub(super) fn runs(&self) -> Option<u64> {
        let count = |runs: u64, key: &Key| runs.checked_mul(key.count());
        self.sample.map_or_else(
            || self.key.iter().try_fold(1, count),
            |sample| Some(sample.runs),
        )
    }

    /// Runs of one part: 64 parts of a large sweep, but no fewer than 8 runs.
    pub(super) fn part_runs(&self) -> u64 {
        let most = self.runs().unwrap_or(MOST_RUNS);
        self.partition
            .unwrap_or_else(|| most.div_ceil(64).clamp(8, MOST_PART))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(text: &str) -> Result<Spec, shared_types::file::InvalidFile> {
        let spec: Spec = shared_types::file::parse("sweep.toml", text, &[])?;
        spec.check()
            .map_err(|complaint| complaint.locate("sweep.toml", text))?;
        Ok(spec)
    }

    #[test]
    fn a_spec_that_makes_no_sense_is_refused_at_its_line() {
        let range = "from = 0.0\nto = 1.0\nsteps = 3";
        for (line, more) in [
            (4, "values = []"),
            (6, "values = [1.0]\nunit = \"rad\""),
            (5, "values = [1.0, \"a\"]"),
            (6, "from = 1.0\nto = 0.0\nsteps = 3"),
            (4, "from = 1.0"),
            (5, "values = [nan]"),
            (7, "from = 0.0\nto = 1.0\nsteps = 1000000000000"),
            (3, "from = 0.0\nto = 1.0\nsteps = 4000000000"),
            (7, "values = [1.0]\n[sample]\nruns = 99999999999"),
            (6, "values = [1.0]\npartition = 0.5"),
            (5, &format!("{range}\nscale = \"log\"")),
            (4, "from = 0.0\nto = 1.0"),
            (4, &format!("{range}\nvalues = [1.0]")),
            (
                7,
                "values = [1.0]\n[[key]]\nkey = \"start.q_deg\"\nvalues = [[1.0]]",
            ),
            (7, "values = [1.0]\n[sample]\nruns = 0"),
            (5, "valeus = [1.0]"),
        ] {
            let text = format!(
                "name = \"x\"\nscenario = \"y\"\n[[key]]\nkey = \"start.q_deg.4\"\n{more}\n"
            );
            let error = checked(&text).unwrap_err();
            assert_eq!(error.line(), Some(line), "{error}\n{text}");
        }
        let error = checked("name = \"x\"\nscenario = \"y\"\n").unwrap_err();
        assert!(error.to_string().contains("the grid is empty"));
    }
}
