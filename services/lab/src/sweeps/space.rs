//! The runs of a sweep: the settings of each, by its number alone.

use session::Failure;
use session::load::Source;
use shared_types::file::Complaint;
use shared_types::random;

use super::cell::{Cell, Kind};
use super::spec::{Key, Sample, Scale, Spec};

/// Whole numbers up to here are exact as `from` and `to`: 2⁵³.
const MOST_WHOLE: f64 = 9_007_199_254_740_992.0;

/// All runs of a sweep.
#[derive(Debug)]
pub(super) struct Space {
    set: Vec<String>,
    keys: Vec<Axis>,
    sample: Option<Sample>,
    /// How many runs.
    pub(super) runs: u64,
}

/// A key with its values.
#[derive(Debug)]
struct Axis {
    key: String,
    kind: Kind,
    values: Values,
}

#[derive(Debug)]
enum Values {
    /// One by one.
    Listed(Vec<toml::Value>),
    /// Between two numbers.
    Range {
        from: f64,
        to: f64,
        steps: u32,
        scale: Scale,
        whole: bool,
    },
}

impl Space {
    /// The runs, each key's values tried on the scenario: an unknown key, or a value that no scenario accepts, is refused before any run.
    ///
    /// # Errors
    /// [`Complaint`] at the place in the sweep's file; [`Failure`] where the scenario itself is invalid.
    pub(super) fn new(spec: &Spec, source: &Source) -> Result<Self, Refusal> {
        source.parse(&[])?;
        for (i, setting) in spec.set.iter().enumerate() {
            let refused = |failure| {
                Complaint::new(
                    format!("set.{i}"),
                    format!("`{setting}`: {}", sentence(&failure)),
                    "",
                )
            };
            source.parse(&spec.set[..=i]).map_err(refused)?;
        }
        let runs = spec.runs().unwrap_or_default();
        let try_key = |(i, key): (usize, &Key)| {
            Axis::new(key, &spec.set, source)
                .map_err(|complaint| complaint.within(&format!("key.{i}")))
        };
        let keys = spec
            .key
            .iter()
            .enumerate()
            .map(try_key)
            .collect::<Result<Vec<_>, _>>()?;
        let space = Self {
            set: spec.set.clone(),
            keys,
            sample: spec.sample,
            runs,
        };
        // Keys that exclude each other show in the first and in the last run.
        for run in [0, runs - 1] {
            source
                .parse(&space.settings(run))
                .map_err(|failure| Complaint::new("key", sentence(&failure), ""))?;
        }
        Ok(space)
    }

    /// The keys' values in a run, in the order of the keys.
    pub(super) fn values(&self, run: u64) -> Vec<toml::Value> {
        let mut rest = run;
        let mut values = Vec::with_capacity(self.keys.len());
        // The last key varies fastest, as the digits of a number do.
        for (place, axis) in self.keys.iter().enumerate().rev() {
            values.push(match self.sample {
                Some(sample) => axis.drawn(random::at(
                    random::mix(sample.seed.wrapping_add(place as u64)),
                    run,
                )),
                None => {
                    let count = axis.count();
                    let value = axis.at(rest % count);
                    rest /= count;
                    value
                }
            });
        }
        values.reverse();
        values
    }

    /// The settings of a run, as `armplane run --set` takes them.
    pub(super) fn settings(&self, run: u64) -> Vec<String> {
        let own = self
            .keys
            .iter()
            .zip(self.values(run))
            .map(|(axis, value)| format!("{}={value}", axis.key));
        self.set.iter().cloned().chain(own).collect()
    }

    /// Names of the keys, and the kind of their columns.
    pub(super) fn columns(&self) -> impl Iterator<Item = (&str, Kind)> {
        self.keys.iter().map(|axis| (axis.key.as_str(), axis.kind))
    }

    /// The keys' values in a run, as cells of its row.
    pub(super) fn cells(&self, run: u64) -> impl Iterator<Item = Cell> {
        self.keys
            .iter()
            .zip(self.values(run))
            .map(|(axis, value)| axis.cell(&value))
    }

    /// The values listed for a key; none where it has none, or a range.
    pub(super) fn listed(&self, key: &str) -> &[toml::Value] {
        match self
            .keys
            .iter()
            .find(|axis| axis.key == key)
            .map(|axis| &axis.values)
        {
            Some(Values::Listed(values)) => values,
            _ => &[],
        }
    }
}

/// Why a sweep has no runs.
pub(super) enum Refusal {
    /// Something in the sweep's file.
    Sweep(Complaint),
    /// Something else.
    Other(Failure),
}

impl From<Complaint> for Refusal {
    fn from(complaint: Complaint) -> Self {
        Self::Sweep(complaint)
    }
}

impl From<Failure> for Refusal {
    fn from(failure: Failure) -> Self {
        Self::Other(failure)
    }
}

/// The sentence of a refused setting, without the settings: they are not the user's own words.
fn sentence(failure: &Failure) -> String {
    match failure {
        Failure::File(invalid) if invalid.remedy.is_empty() => invalid.message.clone(),
        Failure::File(invalid) => format!("{} ({})", invalid.message, invalid.remedy),
        other => other.to_string(),
    }
}

impl Axis {
    fn new(key: &Key, set: &[String], source: &Source) -> Result<Self, Complaint> {
        let laid = |value: &toml::Value| {
            let setting = format!("{}={value}", key.key);
            source.parse(&[set, &[setting]].concat())
        };
        let (Some(from), Some(to)) = (key.from, key.to) else {
            for value in &key.values {
                laid(value).map_err(|failure| {
                    Complaint::new(
                        "key",
                        format!("`{} = {value}`: {}", key.key, sentence(&failure)),
                        "",
                    )
                })?;
            }
            let kind = match &key.values[0] {
                toml::Value::Boolean(_) => Kind::Boolean,
                _ if key.values.iter().all(toml::Value::is_integer) => Kind::Whole,
                toml::Value::Integer(_) | toml::Value::Float(_) => Kind::Number,
                _ => Kind::Text,
            };
            return Ok(Self {
                key: key.key.clone(),
                kind,
                values: Values::Listed(key.values.clone()),
            });
        };
        let ends = |whole: bool| {
            [from, to]
                .iter()
                .try_for_each(|end| laid(&number(*end, whole)).map(drop))
        };
        let has_exact_ends = [from, to]
            .iter()
            .all(|end| end.fract() == 0.0 && end.abs() <= MOST_WHOLE);
        let whole = match (ends(false), ends(true)) {
            (Ok(()), _) => false,
            (Err(_), Ok(())) if has_exact_ends => true,
            (Err(_), Ok(())) => {
                let sentence = format!(
                    "`{}` from {from:?} to {to:?}: it takes whole numbers only",
                    key.key
                );
                return Err(Complaint::new(
                    "key",
                    sentence,
                    format!("both ends must be whole, and within ±{MOST_WHOLE}"),
                ));
            }
            (Err(failure), _) => {
                let sentence = format!("`{}` from {from} to {to}: {}", key.key, sentence(&failure));
                return Err(Complaint::new("key", sentence, ""));
            }
        };
        let steps = key.steps.unwrap_or_default();
        if whole
            && key.scale == Scale::Linear
            && steps > 1
            && (to - from) % f64::from(steps - 1) != 0.0
        {
            let sentence = format!(
                "`{}` takes whole numbers only, and {steps} steps from {from} to {to} are no whole numbers",
                key.key
            );
            let remedy = format!("{} must be a multiple of `steps` - 1", to - from);
            return Err(Complaint::new("steps", sentence, remedy));
        }
        let kind = if whole { Kind::Whole } else { Kind::Number };
        Ok(Self {
            key: key.key.clone(),
            kind,
            values: Values::Range {
                from,
                to,
                steps,
                scale: key.scale,
                whole,
            },
        })
    }

    fn count(&self) -> u64 {
        match &self.values {
            Values::Listed(values) => values.len() as u64,
            Values::Range { steps, .. } => u64::from(*steps),
        }
    }

    /// A value of the grid.
    fn at(&self, index: u64) -> toml::Value {
        match &self.values {
            Values::Listed(values) => values[index as usize].clone(),
            Values::Range {
                from, to, steps, ..
            } if index + 1 == u64::from(*steps) => self.number(*from, *to, 1.0),
            Values::Range {
                from, to, steps, ..
            } => self.number(*from, *to, index as f64 / f64::from(steps - 1)),
        }
    }

    /// A value by 64 random bits.
    fn drawn(&self, bits: u64) -> toml::Value {
        let share = (bits >> 11) as f64 / (1u64 << 53) as f64;
        match &self.values {
            Values::Listed(values) => values[(share * values.len() as f64) as usize].clone(),
            // Each whole number as often as every other, the ends included.
            Values::Range {
                from,
                to,
                scale: Scale::Linear,
                whole: true,
                ..
            } => number(from + (share * (to - from + 1.0)).floor(), true),
            Values::Range { from, to, .. } => self.number(*from, *to, share),
        }
    }

    /// The number at a share of a range.
    fn number(&self, from: f64, to: f64, share: f64) -> toml::Value {
        let Values::Range { scale, whole, .. } = self.values else {
            return number(from, false);
        };
        number(
            match (scale, share) {
                (_, 0.0) => from,
                (_, 1.0) => to,
                (Scale::Linear, share) => from + (to - from) * share,
                // libm: the same bits on every machine.
                (Scale::Log, share) => from * libm::pow(to / from, share),
            },
            whole,
        )
    }

    fn cell(&self, value: &toml::Value) -> Cell {
        match (self.kind, value) {
            (Kind::Boolean, toml::Value::Boolean(so)) => Cell::Boolean(*so),
            (Kind::Whole, toml::Value::Integer(number)) => Cell::Whole(*number),
            (Kind::Number, toml::Value::Integer(number)) => Cell::Number(*number as f64),
            (Kind::Number, toml::Value::Float(number)) => Cell::Number(*number),
            (_, toml::Value::String(text)) => Cell::Text(text.clone()),
            (_, other) => Cell::Text(other.to_string()),
        }
    }
}

fn number(value: f64, whole: bool) -> toml::Value {
    if whole {
        toml::Value::Integer(value.round() as i64)
    } else {
        toml::Value::Float(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn space(keys: &str) -> Result<Space, String> {
        let text = format!("name = \"x\"\nscenario = \"fig5-wrist-rotation\"\n{keys}");
        let spec: Spec = toml::from_str(&text).unwrap();
        spec.check().unwrap();
        Space::new(&spec, &Source::read(&spec.scenario).unwrap()).map_err(|refusal| match refusal {
            Refusal::Sweep(complaint) => complaint.to_string(),
            Refusal::Other(failure) => failure.to_string(),
        })
    }

    #[test]
    fn a_grid_counts_like_a_number_and_has_both_ends() {
        let range = "[[key]]\nkey = \"plant.mass_factor\"\nfrom = 0.5\nto = 2\nsteps = 3\nscale = \"log\"\n";
        let grid = space(&format!(
            "[[key]]\nkey = \"control.k_p\"\nvalues = [100, 400.5]\n{range}"
        ))
        .unwrap();
        assert_eq!(grid.runs, 6);
        let settings: Vec<String> = (0..6).map(|run| grid.settings(run).join(" ")).collect();
        assert_eq!(settings[0], "control.k_p=100 plant.mass_factor=0.5");
        assert_eq!(settings[1], "control.k_p=100 plant.mass_factor=1.0");
        assert_eq!(settings[5], "control.k_p=400.5 plant.mass_factor=2.0");
        assert_eq!(
            grid.columns().collect::<Vec<_>>(),
            [
                ("control.k_p", Kind::Number),
                ("plant.mass_factor", Kind::Number)
            ]
        );
    }

    #[test]
    fn a_range_is_whole_where_the_scenario_takes_whole_numbers_only() {
        let keys = "[[key]]\nkey = \"seed\"\nfrom = 1\nto = 3\nsteps = 3\n[[key]]\nkey = \"control.k_p\"\nfrom = 100\nto = 200\nsteps = 3\n";
        assert_eq!(
            space(keys).unwrap().settings(4).join(" "),
            "seed=2 control.k_p=150.0"
        );
        assert!(
            space(&keys.replace("to = 3", "to = 4"))
                .unwrap_err()
                .contains("no whole numbers")
        );
    }

    #[test]
    fn a_sample_is_seeded_and_fills_its_range() {
        let keys = "[[key]]\nkey = \"seed\"\nfrom = 1\nto = 4\n[[key]]\nkey = \"plant.mass_factor\"\nfrom = 0.5\nto = 1.5\n";
        let draw =
            |seed: u64| space(&format!("{keys}[sample]\nruns = 4000\nseed = {seed}\n")).unwrap();
        let (one, other) = (draw(1), draw(2));
        assert_eq!(one.settings(17), draw(1).settings(17));
        assert_ne!(one.settings(17), other.settings(17));
        let drawn: Vec<_> = (0..4000).map(|run| one.values(run)).collect();
        for seed in 1..=4 {
            let count = drawn
                .iter()
                .filter(|values| values[0].as_integer() == Some(seed))
                .count();
            // Binomial: standard deviation 27; six of them.
            assert!((840..1160).contains(&count), "{seed}: {count}");
        }
        let mean = drawn
            .iter()
            .filter_map(|values| values[1].as_float())
            .sum::<f64>()
            / 4000.0;
        assert!(
            (mean - 1.0).abs() < 0.03
                && drawn
                    .iter()
                    .all(|values| (0.5..1.5).contains(&values[1].as_float().unwrap())),
            "{mean}"
        );
    }

    #[test]
    fn unknown_keys_and_refused_values_are_found_before_any_run() {
        let refused = |key: &str, values: &str| {
            space(&format!("[[key]]\nkey = \"{key}\"\nvalues = {values}\n")).unwrap_err()
        };
        assert!(
            refused("control.kp", "[1.0]").contains("did you mean `k_p`?"),
            "{}",
            refused("control.kp", "[1.0]")
        );
        assert!(refused("control.k_p", "[100, -1]").contains("`control.k_p` is -1"));
        assert!(
            refused("start.q_rad", "[[0, 0, 0, 0, 0, 0]]").contains("given 2 times"),
            "q_deg is the scenario's own"
        );
    }
}
