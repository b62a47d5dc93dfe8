//! Detection of singularities, and numbers per singularity.

use serde::de::value::SeqAccessDeserializer;
use serde::de::{MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::codes;
use crate::file::{Complaint, require};

/// Detection of singularities.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Analysis {
    /// Threshold η_in: the arm enters the neighbourhood of a singularity at |s| = η_in.
    #[serde(deserialize_with = "BySingularity::eta_in")]
    pub eta_in: BySingularity,
    /// Threshold η_out > η_in: the arm leaves the neighbourhood at |s| = η_out.
    #[serde(deserialize_with = "BySingularity::eta_out")]
    pub eta_out: BySingularity,
    /// Find all singularities numerically, even on an arm with closed forms.
    pub numeric: bool,
}

impl Default for Analysis {
    fn default() -> Self {
        Self {
            eta_in: BySingularity::ETA_IN,
            eta_out: BySingularity::ETA_OUT,
            numeric: false,
        }
    }
}

/// One number for each singularity, by its name, in the order of [`NAMES`].
///
/// A table like `{ wrist = 0.12 }` changes only the names in it. An array of three is read as
/// elbow, wrist, overhead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BySingularity([f64; NAMES.len()]);

/// The names of [`codes::KINDS`], and last that of a singularity that was found numerically.
const NAMES: [&str; 5] = ["elbow", "wrist", "overhead", "shoulder", "numeric"];

/// One of [`NAMES`], by its place.
#[derive(Deserialize)]
#[serde(field_identifier, rename_all = "lowercase")]
enum Name {
    Elbow,
    Wrist,
    Overhead,
    Shoulder,
    Numeric,
}

impl BySingularity {
    const ETA_IN: Self = Self([0.10, 0.10, 0.08, 0.10, 0.10]);
    const ETA_OUT: Self = Self([0.20, 0.20, 0.16, 0.20, 0.20]);
    pub(super) const RATE_MAX: Self = Self([1.5, 3.0, 1.2, 1.5, 1.5]);
    pub(super) const SLEW: Self = Self([20.0, 50.0, 12.0, 20.0, 20.0]);

    /// The number for a singularity of this kind ([`codes::KINDS`]).
    #[must_use]
    pub fn of(&self, kind: u32) -> f64 {
        // The codes of kinds with a name count from 1.
        let [.., numeric] = &self.0;
        let place = (kind as usize).wrapping_sub(codes::KIND_ELBOW as usize);
        *self.0.get(place).unwrap_or(numeric)
    }

    /// The numbers with their names.
    #[must_use]
    pub fn named(&self) -> [(&'static str, f64); NAMES.len()] {
        std::array::from_fn(|i| (NAMES[i], self.0[i]))
    }

    /// The largest of them.
    #[must_use]
    pub fn largest(&self) -> f64 {
        self.0.into_iter().fold(0.0, f64::max)
    }

    fn eta_in<'de, D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::ETA_IN, from)
    }

    fn eta_out<'de, D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::ETA_OUT, from)
    }

    pub(super) fn rate_max<'de, D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::RATE_MAX, from)
    }

    pub(super) fn slew<'de, D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::SLEW, from)
    }

    /// The file's values over the defaults.
    fn over<'de, D: Deserializer<'de>>(default: Self, from: D) -> Result<Self, D::Error> {
        struct Either(BySingularity);
        impl<'de> Visitor<'de> for Either {
            type Value = BySingularity;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("numbers by the names elbow, wrist, overhead, shoulder, numeric, or an array of the first three")
            }
            fn visit_map<A: MapAccess<'de>>(mut self, mut map: A) -> Result<Self::Value, A::Error> {
                while let Some((name, value)) = map.next_entry::<Name, f64>()? {
                    self.0.0[name as usize] = value;
                }
                Ok(self.0)
            }
            fn visit_seq<A: SeqAccess<'de>>(mut self, seq: A) -> Result<Self::Value, A::Error> {
                let three = <[f64; 3]>::deserialize(SeqAccessDeserializer::new(seq))?;
                self.0.0[..3].copy_from_slice(&three);
                Ok(self.0)
            }
        }
        from.deserialize_any(Either(default))
    }
}

impl Serialize for BySingularity {
    fn serialize<S: Serializer>(&self, out: S) -> Result<S::Ok, S::Error> {
        out.collect_map(self.named())
    }
}

impl Analysis {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        for ((name, inner), (_, outer)) in self.eta_in.named().into_iter().zip(self.eta_out.named())
        {
            require(
                inner > 0.0 && outer > inner && outer < 1.0,
                format!("analysis.eta_out.{name}"),
                format!("η_in = {inner} and η_out = {outer} do not bound a neighbourhood"),
                "0 < η_in < η_out < 1",
            )?;
        }
        Ok(())
    }
}
