//! The simulated arm and its surroundings, and the state estimator.

use serde::{Deserialize, Serialize};

use super::force::Surface;
use super::mount::{Payload, Push};
use crate::file::{Complaint, each, key_within, positive, require, within};

/// The simulated arm and its surroundings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Plant {
    /// The simulator.
    pub model: PlantModel,
    /// Steps per tick while dry friction acts, 1 to 64. Near contact and joint stops the plant
    /// takes half as many. It takes twice as many where halving the step would change the result.
    /// Free motion takes steps of at most 1 ms.
    pub substeps: u32,
    /// Encoder resolution, 8 to 32 bits per turn. 0: ideal encoders.
    pub encoder_bits: u32,
    /// Standard deviation of the encoder noise; counts.
    pub encoder_noise_counts: f64,
    /// Simulate the robot's viscous and Coulomb friction.
    pub friction: bool,
    /// Factor on all masses and inertias of the simulated arm. The controller's model does not
    /// change.
    pub mass_factor: f64,
    /// A load that the controller's model does not have.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub payload: Option<Payload>,
    /// Pushes on the hand.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub push: Vec<Push>,
    /// Height of the floor in the base frame; m. `"none"`: no floor.
    #[serde(with = "floor")]
    pub floor_m: Option<f64>,
    /// Links may collide with each other, if they are not neighbours and do not touch at the start.
    pub self_collision: bool,
    /// Ticks for which the drives hold the last torque when none arrives. Then they brake the arm.
    pub hold_ticks: u32,
    /// A sensor at the wrist measures the force on the hand. `false`: it is estimated from the
    /// joints' disturbance torques.
    pub wrist_sensor: bool,
    /// Standard deviation of that sensor's noise, per axis; N.
    pub wrist_noise_n: f64,
    /// The same of its moments; N·m.
    pub wrist_noise_nm: f64,
    /// Radius of the hand's flat face, which is at right angles to its z axis, around the point that it is
    /// seen at; m. 0: the hand touches surfaces with that point.
    pub face_radius_m: f64,
    /// Surfaces that the hand can touch.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub surface: Vec<Surface>,
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

/// The simulators.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlantModel {
    /// Exact Runge–Kutta for smooth motion; rapier3d for contact and joint stops; dry friction.
    #[default]
    Rapier,
    /// Runge–Kutta only: no contact, no floor.
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
            payload: None,
            push: Vec::new(),
            floor_m: Some(-0.67183),
            self_collision: false,
            hold_ticks: 3,
            wrist_sensor: true,
            wrist_noise_n: 0.1,
            wrist_noise_nm: 0.002,
            face_radius_m: 0.0,
            surface: Vec::new(),
        }
    }
}

/// The state estimator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Estimator {
    /// Bandwidth of the observer of position and velocity; rad/s.
    pub bandwidth: f64,
    /// Bandwidth of the observer of disturbance torques; rad/s. It ignores motion within the
    /// encoders' noise. 0: off.
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
            payload,
            push,
            floor_m,
            ..
        } = self;
        let mut load = payload.iter();
        load.try_for_each(|load| load.check("plant.payload"))?;
        each("plant.push", push, |_, push| push.check())?;
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
        let message = format!("mass_factor = {mass_factor}");
        within("plant.mass_factor", *mass_factor, 0.1..=10.0, message)?;
        require(
            floor_m.is_none_or(f64::is_finite),
            "plant.floor_m",
            "the floor's height is not a number",
            "metres in the base frame",
        )?;
        for (key, value, range) in [
            ("wrist_noise_n", self.wrist_noise_n, 0.0..=1e3),
            ("wrist_noise_nm", self.wrist_noise_nm, 0.0..=1e3),
            ("face_radius_m", self.face_radius_m, 0.0..=1.0),
        ] {
            key_within("plant.", key, value, range)?;
        }
        each("plant.surface", &self.surface, |_, one| one.check())
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
