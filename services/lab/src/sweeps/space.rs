//! The runs of a sweep: the settings of each, by its number alone.

use session::Failure;
use session::load::Source;
use shared_types::file::Complaint;
use shared_types::random;
use toml::Value;

use super::spec::{Key, Scale, Spec};

/// Whole numbers up to here are exact as `from` and `to`: 2⁵³.
const MOST_WHOLE: f64 = 9_007_199_254_740_992.0;

/// All runs of a sweep.
#[derive(Debug)]
pub(super) struct Space {
    pub(super) spec: Spec,
    /// Of each key, whether its range is of whole numbers.
    is_whole: Vec<bool>,
    /// How many runs.
    pub(super) runs: u64,
}

/// The complaint about a setting at a place in the sweep's file: the refusal's own place is in text that the user has not written.
fn about(place: &str, setting: &str, failure: &Failure) -> Complaint {
    let sentence = match failure {
        Failure::File(invalid) if invalid.remedy.is_empty() => invalid.message.clone(),
        Failure::File(invalid) => format!("{} ({})", invalid.message, invalid.remedy),
        other => other.to_string(),
    };
    let setting = match setting {
        "" => String::new(),
        setting => format!("{setting}: "),
    };
    Complaint::new(place, setting + &sentence, "")
}

impl Space {
    /// The runs, each key's values tried on the scenario: an unknown key, or a value that no scenario accepts, is refused before any run.
    ///
    /// # Errors
    /// [`Failure`], by `located` at the place in the sweep's file, or where the scenario itself is invalid.
    pub(super) fn new(
        spec: Spec,
        source: &Source,
        located: &dyn Fn(Complaint) -> Failure,
    ) -> Result<Self, Failure> {
        source.parse(&[])?;
        for (i, setting) in spec.set.iter().enumerate() {
            source.parse(&spec.set[..=i]).map_err(|failure| {
                located(about(
                    &format!("set.{i}"),
                    &format!("`{setting}`"),
                    &failure,
                ))
            })?;
        }
        let try_key = |(i, key): (usize, &Key)| {
            let tried = key.try_on(&spec.set, source);
            tried.map_err(|complaint| located(complaint.within(&format!("key.{i}"))))
        };
        let tried = spec.key.iter().enumerate().map(try_key);
        let space = Self {
            is_whole: tried.collect::<Result<_, _>>()?,
            runs: spec.runs().unwrap_or_default(),
            spec,
        };
        // Keys that exclude each other show in the first and in the last run.
        for run in [0, space.runs - 1] {
            let tried = source.parse(&space.settings(run));
            tried.map_err(|failure| located(about("key", "", &failure)))?;
        }
        Ok(space)
    }

    /// The keys with their values in a run.
    pub(super) fn values(&self, run: u64) -> Vec<(&str, Value)> {
        let mut rest = run;
        let keys = self.spec.key.iter().zip(&self.is_whole).enumerate().rev();
        // The last key varies fastest, as the digits of a number do.
        let value = |(place, (key, is_whole)): (usize, (&Key, &bool))| match self.spec.sample {
            Some(sample) => {
                let seed = random::mix(sample.seed.wrapping_add(place as u64));
                key.drawn(*is_whole, random::at(seed, run))
            }
            None => {
                let index = rest % key.count();
                rest /= key.count();
                key.at(*is_whole, index)
            }
        };
        let mut values: Vec<Value> = keys.map(value).collect();
        values.reverse();
        self.names().zip(values).collect()
    }

    /// The settings of a run, as `armplane run --set` takes them.
    pub(super) fn settings(&self, run: u64) -> Vec<String> {
        let own = self.values(run).into_iter();
        let own = own.map(|(key, value)| format!("{key}={value}"));
        self.spec.set.iter().cloned().chain(own).collect()
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.spec.key.iter().map(|key| key.key.as_str())
    }

    /// Of each key its name, a value of its column's type, and its unit.
    pub(super) fn columns(&self) -> impl Iterator<Item = (&str, Value, &str)> {
        let keys = self.spec.key.iter().zip(&self.is_whole);
        keys.map(|(key, is_whole)| {
            let is_integer = key.values.iter().all(Value::is_integer);
            let example = match key.values.first() {
                None => number(0.0, *is_whole),
                Some(Value::Integer(_)) if !is_integer => Value::Float(0.0),
                Some(value) => value.clone(),
            };
            (key.key.as_str(), example, key.unit())
        })
    }

    /// The values listed for a key; none where it has none, or a range.
    pub(super) fn listed(&self, name: &str) -> &[Value] {
        let found = self.spec.key.iter().find(|key| key.key == name);
        found.map_or(&[], |key| &key.values)
    }
}

impl Key {
    /// Whether its range is of whole numbers; its values have been tried on the scenario.
    fn try_on(&self, set: &[String], source: &Source) -> Result<bool, Complaint> {
        let Self { key, steps, .. } = self;
        let laid = |value: &Value| source.parse(&[set, &[format!("{key}={value}")]].concat());
        let (Some(from), Some(to)) = (self.from, self.to) else {
            for value in &self.values {
                laid(value)
                    .map_err(|failure| about("key", &format!("`{key} = {value}`"), &failure))?;
            }
            return Ok(false);
        };
        let refused = |is_whole| {
            let ends = [from, to].map(|end| laid(&number(end, is_whole)));
            ends.into_iter().find_map(Result::err)
        };
        let Some(failure) = refused(false) else {
            return Ok(false);
        };
        if refused(true).is_some() {
            return Err(about(
                "key",
                &format!("`{key}` from {from} to {to}"),
                &failure,
            ));
        }
        if [from, to]
            .iter()
            .any(|end| end.fract() != 0.0 || end.abs() > MOST_WHOLE)
        {
            return Err(Complaint::new(
                "key",
                format!("`{key}` from {from:?} to {to:?}: it takes whole numbers only"),
                format!("both ends must be whole, and within ±{MOST_WHOLE}"),
            ));
        }
        match steps {
            Some(steps)
                if self.scale == Scale::Linear && (to - from) % f64::from(steps - 1) != 0.0 =>
            {
                Err(Complaint::new(
                    "steps",
                    format!(
                        "`{key}` takes whole numbers only, and {steps} steps from {from} to {to} are no whole numbers"
                    ),
                    format!("{} must be a multiple of `steps` - 1", to - from),
                ))
            }
            _ => Ok(true),
        }
    }

    /// A value of the grid.
    fn at(&self, is_whole: bool, index: u64) -> Value {
        match self.values.get(index as usize) {
            Some(value) => value.clone(),
            None => {
                let last = self.count().saturating_sub(1).max(1);
                self.share(is_whole, index as f64 / last as f64)
            }
        }
    }

    /// A value by 64 random bits.
    fn drawn(&self, is_whole: bool, bits: u64) -> Value {
        let share = (bits >> 11) as f64 / (1u64 << 53) as f64;
        match (self.values.len(), self.from, self.to) {
            // Each whole number as often as every other, the ends included.
            (0, Some(from), Some(to)) if is_whole && self.scale == Scale::Linear => {
                number(from + (share * (to - from + 1.0)).floor(), true)
            }
            (0, ..) => self.share(is_whole, share),
            (listed, ..) => self.values[(share * listed as f64) as usize].clone(),
        }
    }

    /// The number at a share of its range.
    fn share(&self, is_whole: bool, share: f64) -> Value {
        let (from, to) = (self.from.unwrap_or_default(), self.to.unwrap_or_default());
        let value = match (self.scale, share) {
            (_, 0.0) => from,
            (_, 1.0) => to,
            (Scale::Linear, share) => from + (to - from) * share,
            // libm: the same bits on every machine.
            (Scale::Log, share) => from * libm::pow(to / from, share),
        };
        number(value, is_whole)
    }
}

fn number(value: f64, is_whole: bool) -> Value {
    if is_whole {
        Value::Integer(value.round() as i64)
    } else {
        Value::Float(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn space(keys: &str) -> Option<Space> {
        let text = format!("name = \"x\"\nscenario = \"fig5-wrist-rotation\"\n{keys}");
        let spec: Spec = toml::from_str(&text).unwrap();
        spec.check().unwrap();
        let source = Source::read(&spec.scenario).unwrap();
        Space::new(spec, &source, &Failure::input).ok()
    }

    #[test]
    fn a_grid_counts_like_a_number_and_has_both_ends() {
        let seeds = "[[key]]\nkey = \"seed\"\nfrom = 1\nto = 3\nsteps = 3\n";
        let grid = space(&format!(
            "[[key]]\nkey = \"control.k_p\"\nvalues = [100, 400.5]\n{seeds}[[key]]\nkey = \"plant.mass_factor\"\nfrom = 0.5\nto = 2\nsteps = 3\nscale = \"log\"\n"
        ))
        .unwrap();
        let settings = |run| grid.settings(run).join(" ");
        assert_eq!(grid.runs, 18);
        assert_eq!(settings(0), "control.k_p=100 seed=1 plant.mass_factor=0.5");
        assert_eq!(settings(4), "control.k_p=100 seed=2 plant.mass_factor=1.0");
        assert_eq!(
            settings(17),
            "control.k_p=400.5 seed=3 plant.mass_factor=2.0"
        );
        let examples: Vec<_> = grid
            .columns()
            .map(|(_, example, _)| example.type_str())
            .collect();
        assert_eq!(examples, ["float", "integer", "float"]);
        assert!(
            space(&seeds.replace("to = 3", "to = 4")).is_none(),
            "no whole steps"
        );
    }

    #[test]
    fn a_sample_is_seeded_and_fills_its_range() {
        let keys = "[[key]]\nkey = \"seed\"\nfrom = 1\nto = 4\n[[key]]\nkey = \"plant.mass_factor\"\nfrom = 0.5\nto = 1.5\n";
        let draw =
            |seed: u64| space(&format!("{keys}[sample]\nruns = 4000\nseed = {seed}\n")).unwrap();
        let one = draw(1);
        assert_eq!(one.settings(17), draw(1).settings(17));
        assert_ne!(one.settings(17), draw(2).settings(17));
        let (mut seeds, mut sum) = ([0; 5], 0.0);
        for run in 0..one.runs {
            let values = one.values(run);
            seeds[values[0].1.as_integer().unwrap() as usize] += 1;
            sum += values[1]
                .1
                .as_float()
                .filter(|mass| (0.5..1.5).contains(mass))
                .unwrap();
        }
        // Binomial: standard deviation 27; six of them.
        assert!(
            seeds[1..].iter().all(|count| (840..1160).contains(count)),
            "{seeds:?}"
        );
        assert!((sum / 4000.0 - 1.0).abs() < 0.03, "{sum}");
    }
}
