//! Detection of singularities, and numbers per singularity.

use serde::{Deserialize, Serialize};

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

/// One number for each singularity, by its name.
///
/// A table like `{ wrist = 0.12 }` changes only the names in it. An array of three is read as
/// elbow, wrist, overhead.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BySingularity {
    /// For an elbow singularity.
    pub elbow: f64,
    /// For a wrist singularity.
    pub wrist: f64,
    /// For an overhead singularity.
    pub overhead: f64,
    /// For a shoulder singularity: axes 1 and 3 of a seven-joint arm are parallel.
    pub shoulder: f64,
    /// For a singularity that was found numerically and has no name.
    pub numeric: f64,
}

impl BySingularity {
    const ETA_IN: Self = Self::new([0.10, 0.10, 0.08, 0.10, 0.10]);
    const ETA_OUT: Self = Self::new([0.20, 0.20, 0.16, 0.20, 0.20]);
    pub(super) const RATE_MAX: Self = Self::new([1.5, 3.0, 1.2, 1.5, 1.5]);
    pub(super) const SLEW: Self = Self::new([20.0, 50.0, 12.0, 20.0, 20.0]);

    /// In the order of the fields.
    const fn new([elbow, wrist, overhead, shoulder, numeric]: [f64; 5]) -> Self {
        Self {
            elbow,
            wrist,
            overhead,
            shoulder,
            numeric,
        }
    }

    /// The number for a singularity of this kind ([`codes::KINDS`](crate::codes::KINDS)).
    #[must_use]
    pub fn of(&self, kind: u32) -> f64 {
        match kind {
            codes::KIND_ELBOW => self.elbow,
            codes::KIND_WRIST => self.wrist,
            codes::KIND_OVERHEAD => self.overhead,
            codes::KIND_SHOULDER => self.shoulder,
            _ => self.numeric,
        }
    }

    /// The numbers with their names.
    #[must_use]
    pub fn named(&self) -> [(&'static str, f64); 5] {
        [
            ("elbow", self.elbow),
            ("wrist", self.wrist),
            ("overhead", self.overhead),
            ("shoulder", self.shoulder),
            ("numeric", self.numeric),
        ]
    }

    /// The largest of them.
    #[must_use]
    pub fn largest(&self) -> f64 {
        self.named()
            .iter()
            .fold(0.0, |largest, (_, value)| value.max(largest))
    }

    fn eta_in<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::ETA_IN, from)
    }

    fn eta_out<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::ETA_OUT, from)
    }

    pub(super) fn rate_max<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::RATE_MAX, from)
    }

    pub(super) fn slew<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::SLEW, from)
    }

    /// The file's values over the defaults.
    fn over<'de, D: serde::Deserializer<'de>>(default: Self, from: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Named {
            elbow: Option<f64>,
            wrist: Option<f64>,
            overhead: Option<f64>,
            shoulder: Option<f64>,
            numeric: Option<f64>,
        }
        struct Either(BySingularity);
        impl<'de> serde::de::Visitor<'de> for Either {
            type Value = BySingularity;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("numbers by the names elbow, wrist, overhead, shoulder, numeric, or an array of the first three")
            }
            fn visit_map<A: serde::de::MapAccess<'de>>(
                self,
                map: A,
            ) -> Result<Self::Value, A::Error> {
                let given = Named::deserialize(serde::de::value::MapAccessDeserializer::new(map))?;
                Ok(BySingularity {
                    elbow: given.elbow.unwrap_or(self.0.elbow),
                    wrist: given.wrist.unwrap_or(self.0.wrist),
                    overhead: given.overhead.unwrap_or(self.0.overhead),
                    shoulder: given.shoulder.unwrap_or(self.0.shoulder),
                    numeric: given.numeric.unwrap_or(self.0.numeric),
                })
            }
            fn visit_seq<A: serde::de::SeqAccess<'de>>(
                self,
                seq: A,
            ) -> Result<Self::Value, A::Error> {
                let [elbow, wrist, overhead] =
                    Deserialize::deserialize(serde::de::value::SeqAccessDeserializer::new(seq))?;
                Ok(BySingularity {
                    elbow,
                    wrist,
                    overhead,
                    ..self.0
                })
            }
        }
        from.deserialize_any(Either(default))
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
