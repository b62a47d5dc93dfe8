//! `SWEEP.toml`: which scenario, which keys, a grid or a seeded sample.
//!
//! ```toml
//! name = "gains"                       # of the results folder: runs/gains
//! scenario = "fig5-wrist-rotation"     # a built-in scenario, or a file beside this one
//! set = ["plant.friction=true"]        # overrides a value of every run, as `armplane run --set` does it
//!
//! [[key]]                              # a grid: the product of all keys
//! key = "control.k_p"                  # whatever `--set` accepts
//! unit = "1/s²"                        # optional; goes into the table
//! values = [100, 400, 900]
//!
//! [[key]]
//! key = "plant.mass_factor"
//! from = 0.8
//! to = 1.2
//! steps = 5                            # evenly spaced, both ends included; `scale = "log"`: evenly in the logarithm
//!
//! [sample]                             # instead of the product: so many runs, each key drawn from its `values`, or between `from` and `to`
//! runs = 1000
//! seed = 1
//! ```
//!
//! The numbers of a range are whole where the scenario's key takes whole numbers only.

use serde::{Deserialize, Serialize};
use shared_types::file::Complaint;

/// Most runs of a sweep.
pub(super) const MOST_RUNS: u64 = 10_000_000;
/// Most runs of a partition.
const MOST_PARTITION: u64 = 100_000;

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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) sample: Option<Sample>,
    /// Runs of one Parquet file, and of one piece of work of a shard.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) partition: Option<u64>,
}

/// A scenario key and its values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Key {
    /// As for `--set`.
    pub(super) key: String,
    /// Unit of its numbers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) unit: Option<String>,
    /// The values, one by one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) values: Vec<toml::Value>,
    /// The first number of a range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) from: Option<f64>,
    /// The last number of a range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) to: Option<f64>,
    /// How many numbers of a range a grid has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
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

/// A unit at the end of a key's or a column's name, and how it is written.
const SUFFIXES: [(&str, &str); 12] = [
    ("_deg", "°"),
    ("_rad", "rad"),
    ("_mm", "mm"),
    ("_m", "m"),
    ("_kg", "kg"),
    ("_s", "s"),
    ("_ms", "ms"),
    ("_hz", "1/s"),
    ("_nm", "N·m"),
    ("_j", "J"),
    ("_ticks", "ticks"),
    ("_counts", "counts"),
];

/// Units of keys whose names do not end in one; the last names of the path.
const UNITS: [(&str, &str); 12] = [
    ("control.k_p", "1/s²"),
    ("control.k_v", "1/s"),
    ("control.k_aux", "1/s"),
    ("control.aux_rate_max", "rad/s"),
    ("control.aux_slew", "rad/s²"),
    ("control.baseline.hold_and_blend.hold_k_p", "1/s²"),
    ("control.baseline.hold_and_blend.hold_k_v", "1/s"),
    ("control.baseline.hold_and_blend.push_k_v", "1/s"),
    ("plant.encoder_bits", "bits"),
    ("plant.mass_factor", "1"),
    ("estimator.bandwidth", "rad/s"),
    ("estimator.disturbance_bandwidth", "rad/s"),
];

/// Spellings of one unit.
const SPELLINGS: [(&str, &str); 9] = [
    ("deg", "°"),
    ("1/s^2", "1/s²"),
    ("s⁻²", "1/s²"),
    ("Hz", "1/s"),
    ("s⁻¹", "1/s"),
    ("Nm", "N·m"),
    ("rad/s^2", "rad/s²"),
    ("-", "1"),
    ("", "1"),
];

/// The unit that a key or a column has by its name.
pub(super) fn unit_of(name: &str) -> Option<&'static str> {
    let is = |known: &str| {
        name == known
            || name
                .strip_prefix(known)
                .is_some_and(|rest| rest.starts_with('.'))
    };
    if let Some((_, unit)) = UNITS.iter().find(|(known, _)| is(known)) {
        return Some(unit);
    }
    // `start.q_deg.4` is an element of `start.q_deg`.
    let word = name
        .split('.')
        .rfind(|part| part.parse::<usize>().is_err())?;
    if word.ends_with("_ratio") {
        return Some("1");
    }
    SUFFIXES
        .iter()
        .find(|(suffix, _)| word.ends_with(suffix))
        .map(|(_, unit)| *unit)
}

/// Whether a name tells its unit itself.
pub(super) fn is_in_name(name: &str) -> bool {
    SUFFIXES.iter().any(|(suffix, _)| name.ends_with(suffix))
}

/// One spelling for each unit.
fn spelt(unit: &str) -> &str {
    SPELLINGS
        .iter()
        .find(|(other, _)| *other == unit)
        .map_or(unit, |(_, unit)| *unit)
}

impl Key {
    /// The unit of its values; empty where none is known.
    pub(super) fn unit(&self) -> &str {
        unit_of(&self.key)
            .or(self.unit.as_deref().map(spelt))
            .unwrap_or_default()
    }

    fn check(&self, sampled: bool) -> Result<(), Complaint> {
        let key = &self.key;
        if key.is_empty() || key.contains('=') || key.split('.').any(str::is_empty) {
            return Err(Complaint::new(
                "key",
                format!("`{key}` is not a scenario key"),
                "write it as control.k_p",
            ));
        }
        if ["graph", "name"].contains(&key.as_str()) {
            let remedy = "leave it out, or make a sweep for each";
            return Err(Complaint::new(
                "key",
                format!("`{key}` is the same for all runs of a sweep"),
                remedy,
            ));
        }
        if let (Some(known), Some(given)) = (unit_of(key), self.unit.as_deref())
            && spelt(given) != known
        {
            let remedy = format!("convert the values, or leave `unit` out: it is {known}");
            return Err(Complaint::new(
                "unit",
                format!("`{key}` is in {known}, not in {given}"),
                remedy,
            ));
        }
        match (self.values.is_empty(), self.from, self.to) {
            (false, None, None) if self.steps.is_some() => Err(Complaint::new(
                "steps",
                "`values` are counted already",
                "`steps` goes with `from` and `to`",
            )),
            (false, None, None) => self.same_kind(),
            (true, Some(from), Some(to)) => self.check_range(from, to, sampled),
            (false, ..) => {
                let remedy = "give `values`, or `from` and `to`, not both";
                Err(Complaint::new(
                    "key",
                    format!("`{key}` has `values` and a range"),
                    remedy,
                ))
            }
            (true, None, None) => Err(Complaint::new(
                "key",
                format!("`{key}` has no values"),
                "give `values`, or `from` and `to`",
            )),
            (true, from, _) => {
                let (has, lacks) = if from.is_some() {
                    ("from", "to")
                } else {
                    ("to", "from")
                };
                Err(Complaint::new(
                    "key",
                    format!("`{key}` has `{has}` and no `{lacks}`"),
                    "a range has both",
                ))
            }
        }
    }

    /// A column has one type: numbers, texts, booleans or arrays.
    fn same_kind(&self) -> Result<(), Complaint> {
        let kind = |value: &toml::Value| {
            if value.is_integer() {
                "float"
            } else {
                value.type_str()
            }
        };
        let first = kind(&self.values[0]);
        match self.values.iter().find(|value| kind(value) != first) {
            Some(other) => {
                let sentence = format!(
                    "`{}` is {} and {other}, which are not of one kind",
                    self.key, self.values[0]
                );
                Err(Complaint::new(
                    "values",
                    sentence,
                    "a column has numbers only, texts only, booleans only or lists only",
                ))
            }
            None => match self
                .values
                .iter()
                .find(|value| value.as_float().is_some_and(|number| !number.is_finite()))
            {
                Some(value) => Err(Complaint::new(
                    "values",
                    format!("`{}` is {value}", self.key),
                    "its numbers must be finite",
                )),
                None => Ok(()),
            },
        }
    }

    fn check_range(&self, from: f64, to: f64, sampled: bool) -> Result<(), Complaint> {
        if !(from.is_finite() && to.is_finite() && from < to) {
            let sentence = format!("`{}` has no range from {from} to {to}", self.key);
            return Err(Complaint::new(
                "to",
                sentence,
                "both must be finite, and `from` below `to`",
            ));
        }
        if self.scale == Scale::Log && from <= 0.0 {
            let sentence = format!("`{}` begins at {from}, which has no logarithm", self.key);
            return Err(Complaint::new(
                "from",
                sentence,
                "`from` must be positive, or the scale linear",
            ));
        }
        match self.steps {
            None if !sampled => Err(Complaint::new(
                "key",
                format!("`{}` has no `steps`", self.key),
                "a grid needs `steps`, `values`, or a [sample]",
            )),
            Some(_) if sampled => {
                let sentence = format!(
                    "`{}` has `steps`, and a sample is drawn from the whole range",
                    self.key
                );
                Err(Complaint::new("steps", sentence, "leave `steps` out"))
            }
            Some(steps) if steps < 2 => {
                let sentence = format!("`{}` has {steps} `steps`", self.key);
                Err(Complaint::new(
                    "steps",
                    sentence,
                    "a range has 2 or more; for one value give `values`",
                ))
            }
            _ => Ok(()),
        }
    }
}

impl Spec {
    /// The checks that do not need the scenario.
    pub(super) fn check(&self) -> Result<(), Complaint> {
        if self.name.is_empty()
            || !self
                .name
                .chars()
                .all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c))
            || self.name.starts_with('.')
        {
            let remedy = "it names a folder: ASCII letters, digits, `-`, `_` and `.`, which is not the first";
            return Err(Complaint::new(
                "name",
                format!("`{}` cannot be a name", self.name),
                remedy,
            ));
        }
        if self.key.is_empty() {
            return Err(Complaint::new(
                "key",
                "the grid is empty: no key differs between runs",
                "add a [[key]]",
            ));
        }
        for (i, key) in self.key.iter().enumerate() {
            key.check(self.sample.is_some())
                .map_err(|complaint| complaint.within(&format!("key.{i}")))?;
            let holds = |outer: &str, inner: &str| {
                inner == outer
                    || inner
                        .strip_prefix(outer)
                        .is_some_and(|rest| rest.starts_with('.'))
            };
            let overlap = |other: &str| holds(other, &key.key) || holds(&key.key, other);
            let set = self
                .set
                .iter()
                .filter_map(|setting| setting.split_once('='))
                .map(|(path, _)| path.trim());
            if let Some(other) = self.key[..i]
                .iter()
                .map(|other| other.key.as_str())
                .chain(set)
                .find(|other| overlap(other))
            {
                let sentence = format!("`{}` is given twice: `{other}` sets it too", key.key);
                return Err(Complaint::new(
                    format!("key.{i}.key"),
                    sentence,
                    "leave one of them out",
                ));
            }
        }
        match self.runs() {
            Some(0) => Err(Complaint::new(
                "sample.runs",
                "the sample is empty: `runs` is 0",
                format!("1 to {MOST_RUNS}"),
            )),
            Some(runs) if runs <= MOST_RUNS => Ok(()),
            runs if self.sample.is_some() => {
                let sentence = format!("the sample has {} `runs`", runs.unwrap_or_default());
                Err(Complaint::new(
                    "sample.runs",
                    sentence,
                    format!("1 to {MOST_RUNS}"),
                ))
            }
            runs => {
                let runs = runs.map_or_else(|| "more than 2⁶⁴".to_owned(), |runs| runs.to_string());
                let remedy = format!("at most {MOST_RUNS}: give fewer values, or a [sample]");
                Err(Complaint::new(
                    "key",
                    format!("the product of all keys has {runs} runs"),
                    remedy,
                ))
            }
        }?;
        match self.partition {
            Some(runs) if !(1..=MOST_PARTITION).contains(&runs) => Err(Complaint::new(
                "partition",
                format!("`partition` is {runs} runs"),
                format!("1 to {MOST_PARTITION}"),
            )),
            _ => Ok(()),
        }
    }

    /// How many runs; `None` beyond what can be counted.
    pub(super) fn runs(&self) -> Option<u64> {
        match self.sample {
            Some(sample) => Some(sample.runs),
            None => self
                .key
                .iter()
                .try_fold(1u64, |runs, key| runs.checked_mul(key.count())),
        }
    }

    /// Runs of one partition: 64 partitions of a large sweep, but no fewer than 8 runs.
    pub(super) fn partition_runs(&self) -> u64 {
        self.partition.unwrap_or_else(|| {
            self.runs()
                .unwrap_or(MOST_RUNS)
                .div_ceil(64)
                .clamp(8, MOST_PARTITION)
        })
    }
}

impl Key {
    /// Values of a grid.
    pub(super) fn count(&self) -> u64 {
        if self.values.is_empty() {
            u64::from(self.steps.unwrap_or_default())
        } else {
            self.values.len() as u64
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "name = \"x\"\nscenario = \"fig5-wrist-rotation\"\n[[key]]\nkey = \"control.k_p\"\nvalues = [100, 400.5]\n";

    fn checked(text: &str) -> Result<Spec, String> {
        let spec: Spec = shared_types::file::parse("sweep.toml", text, &[])
            .map_err(|error| error.to_string())?;
        spec.check()
            .map_err(|complaint| complaint.locate("sweep.toml", text).to_string())?;
        Ok(spec)
    }

    #[test]
    fn the_runs_are_the_product_or_the_sample() {
        let more = "[[key]]\nkey = \"plant.mass_factor\"\nfrom = 0.5\nto = 2\nsteps = 4\nscale = \"log\"\n";
        assert_eq!(checked(&format!("{TEXT}{more}")).unwrap().runs(), Some(8));
        let sample = "[sample]\nruns = 1000\n";
        let spec = checked(&format!("{TEXT}{sample}")).unwrap();
        assert_eq!((spec.runs(), spec.partition_runs()), (Some(1000), 16));
    }

    #[test]
    fn a_spec_that_makes_no_sense_is_refused_with_its_line() {
        let key = |more: &str| {
            format!("name = \"x\"\nscenario = \"y\"\n[[key]]\nkey = \"start.q_deg.4\"\n{more}\n")
        };
        let cases = [
            (
                "name = \"x\"\nscenario = \"y\"\n".to_owned(),
                "the grid is empty",
            ),
            (
                key("values = []"),
                "sweep.toml:4: `start.q_deg.4` has no values",
            ),
            (
                key("values = [1.0]\nunit = \"rad\""),
                "sweep.toml:6: `start.q_deg.4` is in °, not in rad",
            ),
            (key("values = [1.0, \"a\"]"), "not of one kind"),
            (
                key("from = 1.0\nto = 0.0\nsteps = 3"),
                "`start.q_deg.4` has no range from 1 to 0 (both must be finite, and `from` below `to`)",
            ),
            (key("from = 1.0"), "`start.q_deg.4` has `from` and no `to`"),
            (
                key("values = [nan]"),
                "`start.q_deg.4` is nan (its numbers must be finite)",
            ),
            (
                key("from = 0.0\nto = 1.0\nsteps = 1000000000000"),
                "`key.0.steps`: the whole number `1000000000000` does not fit here (it must be a whole number from 0 to 4294967295)",
            ),
            (
                key("from = 0.0\nto = 1.0\nsteps = 4000000000"),
                "the product of all keys has 4000000000 runs (at most 10000000",
            ),
            (
                key("values = [1.0]\n[sample]\nruns = 99999999999"),
                "the sample has 99999999999 `runs` (1 to 10000000)",
            ),
            (
                key("values = [1.0]\npartition = 0.5"),
                "unknown field `partition`",
            ),
            (
                key("values = [1.0]").replace("[[key]]", "sample = 5\n[[key]]"),
                "`sample`: the whole number `5` does not fit here (it must be a table)",
            ),
            (
                key("from = 0.0\nto = 1.0\nsteps = 3\nscale = \"log\""),
                "no logarithm",
            ),
            (key("from = 0.0\nto = 1.0"), "has no `steps` (a grid needs"),
            (
                key("from = 0.0\nto = 1.0\nsteps = 3\nvalues = [1.0]"),
                "not both",
            ),
            (
                key("values = [1.0]\n[[key]]\nkey = \"start.q_deg\"\nvalues = [[1.0]]"),
                "given twice",
            ),
            (
                key("values = [1.0]\n[sample]\nruns = 0"),
                "the sample is empty",
            ),
            (key("valeus = [1.0]"), "did you mean `values`?"),
        ];
        for (text, expected) in cases {
            let error = checked(&text).unwrap_err();
            assert!(error.contains(expected), "{error}\n{text}");
        }
    }

    #[test]
    fn units_come_from_names_and_spellings_are_one() {
        let names = [
            "start.q_deg.4",
            "control.k_p",
            "control.aux_slew.wrist",
            "position_max_mm",
            "speed_max_ratio",
            "seed",
            "plant.floor_m",
        ];
        let units = [
            Some("°"),
            Some("1/s²"),
            Some("rad/s²"),
            Some("mm"),
            Some("1"),
            None,
            Some("m"),
        ];
        assert_eq!(names.map(unit_of), units);
        let text = TEXT.replace("values", "unit = \"1/s^2\"\nvalues");
        assert_eq!(checked(&text).unwrap().key[0].unit(), "1/s²");
    }
}
