//! The simulated arm with its world, and the tuning of the state estimator.

use serde::{Deserialize, Serialize};

use crate::file::{Complaint, positive, require, within};

/// The simulated arm and its world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Plant {
    /// `"rapier"` (hybrid, with contact) or `"reference"` (exact integrator, no world).
    pub model: PlantModel,
    /// Sub-steps of a tick in which dry friction acts; half as many near contact and joint stops, and twice as many where their effect changes. Free motion
    /// takes steps of 1 ms at most.
    pub substeps: u32,
    /// Encoder resolution, bits per turn; 0: ideal.
    pub encoder_bits: u32,
    /// Standard deviation of encoder noise, in counts.
    pub encoder_noise_counts: f64,
    /// Whether the robot's own viscous and Coulomb friction acts.
    pub friction: bool,
    /// Factor on every mass and inertia of the simulated arm (the controller's model keeps the true ones).
    pub mass_factor: f64,
    /// Height of the floor in B; m. `"none"`: no floor.
    #[serde(with = "floor")]
    pub floor_m: Option<f64>,
    /// Whether links that are not neighbours, and clear of each other at the start, may collide.
    pub self_collision: bool,
    /// Ticks for which the drive holds the last torque before it stops the arm by itself.
    pub hold_ticks: u32,
}

/// A height, or the word `"none"`: TOML has no null, and a floor left out is the default one.
mod floor {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    const NONE: &str = "none";

    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Floor {
        Height(f64),
        Word(String),
    }

    #[expect(clippy::ref_option, reason = "serde's signature")]
    pub(super) fn serialize<S: Serializer>(
        floor_m: &Option<f64>,
        out: S,
    ) -> Result<S::Ok, S::Error> {
        match floor_m {
            Some(height) => height.serialize(out),
            None => NONE.serialize(out),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
        match Floor::deserialize(from) {
            Ok(Floor::Height(height)) => Ok(Some(height)),
            Ok(Floor::Word(word)) if word == NONE => Ok(None),
            _ => Err(D::Error::custom("floor_m is a height in m, or \"none\"")),
        }
    }
}

/// See [`Plant::model`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlantModel {
    /// rapier3d for contact and limits, dry friction, exact Runge–Kutta for the smooth dynamics.
    #[default]
    Rapier,
    /// Runge–Kutta alone.
    Reference,
}

impl Default for Plant {
    fn default() -> Self {
        Self {
            model: PlantModel::Rapier,
            substeps: 4,
            encoder_bits: 16,
            encoder_noise_counts: 0.5,
            friction: false,
            mass_factor: 1.0,
            floor_m: Some(-0.67183),
            self_collision: false,
            hold_ticks: 3,
        }
    }
}

/// The state estimator's tuning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Estimator {
    /// Bandwidth of the position/velocity observer; rad/s.
    pub bandwidth: f64,
    /// Bandwidth of the disturbance observer, which explains what exceeds the encoders' noise; rad/s. 0: off.
    pub disturbance_bandwidth: f64,
}

impl Default for Estimator {
    fn default() -> Self {
        Self {
            bandwidth: 150.0,
            disturbance_bandwidth: 120.0,
        }
    }
}

impl Plant {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        let Self {
            substeps,
            encoder_bits: bits,
            encoder_noise_counts: counts,
            mass_factor,
            floor_m,
            ..
        } = self;
        let message = format!("{substeps} sub-steps");
        within("plant.substeps", f64::from(*substeps), 1.0..=64.0, message)?;
        require(
            *bits == 0 || (8..=32).contains(bits),
            "plant.encoder_bits",
            format!("an encoder of {bits} bits"),
            "8 to 32, or 0 for an ideal one",
        )?;
        let message = format!("noise of {counts} counts");
        within("plant.encoder_noise_counts", *counts, 0.0..=1e3, message)?;
        let message = format!("a mass factor of {mass_factor}");
        within("plant.mass_factor", *mass_factor, 0.1..=10.0, message)?;
        require(
            floor_m.is_none_or(f64::is_finite),
            "plant.floor_m",
            "the floor's height is not a number",
            "metres in the base frame",
        )
    }
}

impl Estimator {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        positive("estimator.bandwidth", self.bandwidth)?;
        require(
            (0.0..=1e4).contains(&self.disturbance_bandwidth),
            "estimator.disturbance_bandwidth",
            "out of range",
            "0 (off) to 10000 rad/s",
        )
    }
}
