//! Forces: the set-point of a segment, and the surfaces that it presses on.

use serde::{Deserialize, Serialize};

use super::curve::{Axis, check_position, is_near};
use super::plant::Plant;
use crate::file::{Complaint, each, key_within, require};

/// A force that the hand keeps along one direction while it follows the segment's path in all others.
///
/// The segment begins with an approach: the hand moves along the direction until it meets a surface,
/// and the path waits until the force is reached.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Force {
    /// Direction in which the hand presses: `"x"`, `"-y"` or three numbers such as `"0 0 -1"` (base
    /// axes), or the same after `"tool "` (the hand's axes).
    pub axis: String,
    /// Set-point; N.
    pub newtons: f64,
    /// About the stiffness of the surface, within a factor of 2; N/m.
    #[serde(default = "stiffness_n_m")]
    pub stiffness_n_m: f64,
    /// Measured force at which the segment's motion begins; N. Default: when the force has been
    /// within a tenth of `newtons` for 50 ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub until_newtons: Option<f64>,
    /// Time in which the set-point rises from 0 to `newtons`; s.
    #[serde(default = "ramp_s")]
    pub ramp_s: f64,
    /// Speed of the approach, less where the impact on a surface of `stiffness_n_m` would double the
    /// force; m/s.
    #[serde(default = "approach_m_s")]
    pub approach_m_s: f64,
    /// How far a surface is looked for; m. Beyond it the controller refuses to go on.
    #[serde(default = "reach_m")]
    pub reach_m: f64,
    /// Moments that the hand keeps about axes at right angles to each other, from its first contact on;
    /// in all other rotations it follows the path. They need a `plant.face_radius_m`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub moments: Vec<Moment>,
}

/// A moment with which the hand twists what it presses on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Moment {
    /// Its axis, given as that of the force.
    pub axis: String,
    /// Set-point; N·m. With 0 the hand lies flat.
    #[serde(default)]
    pub newton_metres: f64,
}

/// A direction: a unit vector, and whether it is in the hand's axes.
pub type Direction = ([f64; 3], bool);

fn direction(axis: &str) -> Option<Direction> {
    match Axis::parse(axis)? {
        Axis::Base(axis) => Some((axis, false)),
        Axis::Tool(axis) => Some((axis, true)),
        Axis::Zeta(..) => None,
    }
}

impl Moment {
    /// Its axis; `None` where the text is none.
    #[must_use]
    pub fn direction(&self) -> Option<Direction> {
        direction(&self.axis)
    }
}

fn ramp_s() -> f64 {
    0.3
}
fn approach_m_s() -> f64 {
    0.02
}
fn reach_m() -> f64 {
    0.05
}

impl Force {
    /// Least set-point; N.
    pub const LEAST_N: f64 = 0.1;

    /// The terms of a force that a target asks for, on a surface of so many N/m.
    #[must_use]
    pub fn on(stiffness_n_m: f64) -> Self {
        Self {
            axis: String::new(),
            newtons: 0.0,
            stiffness_n_m,
            until_newtons: None,
            ramp_s: ramp_s(),
            approach_m_s: approach_m_s(),
            reach_m: reach_m(),
            moments: Vec::new(),
        }
    }

    /// The direction in which the hand presses; `None` where the text is none.
    #[must_use]
    pub fn direction(&self) -> Option<Direction> {
        direction(&self.axis)
    }

    pub(super) fn check(&self, plant: &Plant) -> Result<(), Complaint> {
        check_axis("force.axis", &self.axis)?;
        let newtons = self.newtons;
        for (key, value, range) in [
            ("newtons", newtons, Self::LEAST_N..=1e4),
            (
                "until_newtons",
                self.until_newtons.unwrap_or(newtons),
                Self::LEAST_N..=newtons.max(Self::LEAST_N),
            ),
            ("stiffness_n_m", self.stiffness_n_m, 10.0..=1e6),
            ("ramp_s", self.ramp_s, 1e-3..=60.0),
            ("approach_m_s", self.approach_m_s, 1e-4..=1.0),
            ("reach_m", self.reach_m, 1e-3..=10.0),
        ] {
            key_within("force.", key, value, range)?;
        }
        self.check_moments(plant)
    }

    /// The axes of the moments by themselves, and whether a hand with this face and sensor can keep them.
    fn check_moments(&self, plant: &Plant) -> Result<(), Complaint> {
        const KEY: &str = "force.moments";
        each(KEY, &self.moments, |i, moment| {
            check_axis("axis", &moment.axis)?;
            key_within("", "newton_metres", moment.newton_metres, -1e3..=1e3)?;
            let crosses = |other: &Moment| match (moment.direction(), other.direction()) {
                (Some((a, true)), Some((b, true))) | (Some((a, false)), Some((b, false))) => {
                    (0..3).map(|k| a[k] * b[k]).sum::<f64>().abs() < 1e-6
                }
                _ => false,
            };
            require(
                self.moments[..i].iter().all(crosses),
                "",
                "the axes of the moments are not at right angles, or not all in base axes or all in the hand's",
                "axes such as `tool x` and `tool y`",
            )
        })?;
        if self.moments.is_empty() {
            return Ok(());
        }
        require(
            plant.face_radius_m > 0.0,
            KEY,
            "a hand that touches with a point cannot be twisted by what it presses on",
            "give the hand a face: plant.face_radius_m, such as 0.03",
        )?;
        let rim_nm = self.newtons * plant.face_radius_m;
        let squares = self.moments.iter().map(|one| one.newton_metres.powi(2));
        let asked_nm = squares.sum::<f64>().sqrt();
        require(
            asked_nm < rim_nm,
            KEY,
            format!("moments of {asked_nm} N·m would roll the hand over the rim of its face"),
            format!("less than {rim_nm} N·m together, the force times plant.face_radius_m"),
        )?;
        require(
            plant.wrist_sensor,
            KEY,
            "a moment is controlled by the sensor at the wrist, and there is none",
            "plant.wrist_sensor = true",
        )
    }
}

fn check_axis(key: &str, axis: &str) -> Result<(), Complaint> {
    require(
        direction(axis).is_some(),
        key,
        format!("`{axis}` is not a direction of a force or a moment"),
        "x, -y, three numbers such as `0 0 -1`, or the same after `tool `",
    )
}

/// A surface of a spring with a damper: the hand touches it with one point, that at which it is seen,
/// or with the rim of its face.
///
/// At depth δ it presses back with k·δ·(1 + c·δ̇) (Hunt & Crossley 1975), never less than 0, and rubs
/// with μ times that.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surface {
    /// A point of the plane, or the centre of the sphere, in the base frame; m.
    pub point_m: [f64; 3],
    /// Normal of the plane, out of the material, of any length. A sphere has none.
    #[serde(default = "upwards")]
    pub normal: [f64; 3],
    /// Radius of a sphere; m. Without one it is a plane.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_m: Option<f64>,
    /// Stiffness k, of a face that lies on it whole; N/m.
    #[serde(default = "stiffness_n_m")]
    pub stiffness_n_m: f64,
    /// Damping c per depth: the force grows by this share for each m/s of δ̇; s/m.
    #[serde(default = "damping_s_m")]
    pub damping_s_m: f64,
    /// Coulomb friction coefficient μ.
    #[serde(default = "friction")]
    pub friction: f64,
}

fn upwards() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}
pub(super) fn stiffness_n_m() -> f64 {
    20_000.0
}
fn damping_s_m() -> f64 {
    5.0
}
fn friction() -> f64 {
    0.2
}

impl Surface {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        check_position("point_m", &self.point_m)?;
        require(
            self.normal.iter().all(is_near) && self.normal != [0.0; 3],
            "normal",
            "the normal is no direction",
            "three numbers, out of the material, such as [0, 0, 1]",
        )?;
        for (key, value, range) in [
            ("radius_m", self.radius_m.unwrap_or(1.0), 1e-3..=1e3),
            ("stiffness_n_m", self.stiffness_n_m, 10.0..=1e6),
            ("damping_s_m", self.damping_s_m, 0.0..=1e3),
            ("friction", self.friction, 0.0..=2.0),
        ] {
            key_within("", key, value, range)?;
        }
        Ok(())
    }
}
