//! The arm's surroundings that its model has to know: how its base stands, its tool and its load.

use serde::{Deserialize, Serialize};

use super::curve::{check_position, is_near};
use crate::file::{Complaint, key_within, require};

/// How the base stands, and what the hand carries.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Mount {
    /// Position of the base in the world, for curves in the frame `world`; m.
    pub base_m: [f64; 3],
    /// Roll, pitch and yaw of the base in the world, whose z axis points up; degrees. `[180, 0, 0]`
    /// hangs the arm upside down.
    pub base_rpy_deg: [f64; 3],
    /// A tool on the hand, whose tip becomes the end-effector.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tool: Option<Tool>,
    /// A load that the law knows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub payload: Option<Payload>,
}

/// A tool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tool {
    /// Position of its tip on the hand, in the hand's axes; m.
    pub tip_m: [f64; 3],
    /// Roll, pitch and yaw of its tip on the hand; degrees.
    pub rpy_deg: [f64; 3],
    /// Its mass; kg.
    pub mass_kg: f64,
    /// Its centre of mass, in the hand's axes; m.
    pub com_m: [f64; 3],
}

/// A load, taken as a point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Payload {
    /// Its mass; kg.
    pub mass_kg: f64,
    /// Its centre of mass, in the axes of the end-effector (of the tool's tip, if there is one); m.
    pub com_m: [f64; 3],
}

/// A push on the hand of the simulated arm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Push {
    /// Its beginning; s.
    pub at_s: f64,
    /// How long it lasts; s.
    pub for_s: f64,
    /// The force at the end-effector, base axes; N.
    #[serde(default)]
    pub force_n: [f64; 3],
    /// The torque, base axes; N·m.
    #[serde(default)]
    pub torque_nm: [f64; 3],
}

/// A mass of something that an arm carries.
fn check_load(key: &str, mass_kg: f64, com_m: &[f64; 3]) -> Result<(), Complaint> {
    key_within(&format!("{key}."), "mass_kg", mass_kg, 0.0..=1e4)?;
    check_position(&format!("{key}.com_m"), com_m)
}

impl Payload {
    pub(super) fn check(&self, key: &str) -> Result<(), Complaint> {
        check_load(key, self.mass_kg, &self.com_m)
    }
}

impl Mount {
    /// Whether the base is not level.
    #[must_use]
    pub fn is_tilted(&self) -> bool {
        self.base_rpy_deg[..2] != [0.0, 0.0]
    }

    pub(super) fn check(&self, has_frame: bool, has_floor: bool) -> Result<(), Complaint> {
        let tool = self.tool.unwrap_or_default();
        for (key, values) in [
            ("base_m", &self.base_m),
            ("base_rpy_deg", &self.base_rpy_deg),
            ("tool.tip_m", &tool.tip_m),
            ("tool.rpy_deg", &tool.rpy_deg),
        ] {
            require(
                values.iter().all(is_near),
                format!("mount.{key}"),
                "the place is not one of an arm",
                "three numbers, in metres or degrees",
            )?;
        }
        check_load("mount.tool", tool.mass_kg, &tool.com_m)?;
        let mut payload = self.payload.iter();
        payload.try_for_each(|payload| payload.check("mount.payload"))?;
        require(
            self.tool.is_none() || !has_frame,
            "mount.tool",
            "the tool's tip is the end-effector, and `frame` names another one",
            "leave out `frame`, or name it `default_frame` in the arm's description",
        )?;
        require(
            !(self.is_tilted() && has_floor),
            "mount.base_rpy_deg",
            "the floor is level in the axes of the base, which is tilted",
            "floor_m = \"none\" below [plant]",
        )
    }
}

impl Push {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        let Self {
            at_s,
            for_s,
            force_n,
            torque_nm,
        } = self;
        for (key, value) in [("at_s", at_s), ("for_s", for_s)] {
            key_within("", key, *value, 0.0..=36_000.0)?;
        }
        require(
            force_n.iter().chain(torque_nm).all(|x| x.abs() <= 1e6),
            "force_n",
            "the push is not one of an arm",
            "three numbers each, N and N·m, at most 1e6",
        )?;
        require(
            *for_s > 0.0 && force_n.iter().chain(torque_nm).any(|x| *x != 0.0),
            "for_s",
            "the push does nothing: it has no force and no torque, or lasts 0 s",
            "give it force_n or torque_nm, and a positive for_s",
        )
    }
}
