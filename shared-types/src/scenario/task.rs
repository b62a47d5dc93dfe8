//! The task: where the arm starts, and the segments it moves through.

use serde::{Deserialize, Serialize};

use crate::file::Complaint;

/// Start posture: exactly one of the fields.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Joint positions; degrees (mm for prismatic joints).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q_deg: Option<Vec<f64>>,
    /// Joint positions; rad (m for prismatic joints).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q_rad: Option<Vec<f64>>,
    /// A posture that the robot's description names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posture: Option<String>,
}

/// One piece of the task. At most one of `reorient` and (`to`, `by`, `turn`, `rotation`) families; none of them: hold.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// Duration; s.
    pub duration_s: f64,
    /// Goal position in B; m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to_m: Option<[f64; 3]>,
    /// Goal position relative to the segment's start, base axes; m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by_m: Option<[f64; 3]>,
    /// Goal position relative to the segment's start, along a named direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slide: Option<Slide>,
    /// Goal rotation in B, matrix rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[[f64; 3]; 3]>,
    /// Goal rotation in B, quaternion `[w, x, y, z]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quaternion: Option<[f64; 4]>,
    /// Goal rotation relative to the segment's start, about an axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn: Option<Turn>,
    /// Turn a singular direction by null-space motion, end-effector held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reorient: Option<Reorient>,
    /// Posture that the null space of a redundant arm is driven to meanwhile (the start posture where absent); degrees (mm for prismatic joints).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posture_deg: Option<Vec<f64>>,
    /// Shape of the path between start and goal.
    #[serde(default)]
    pub path: Path,
    /// Which posture to leave a Type 1 singularity in: −1, +1, or 0 to keep the present one.
    #[serde(default)]
    pub branch: i32,
}

/// The shape of a segment's path in space; quintic in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Path {
    /// Straight line with geodesic rotation.
    #[default]
    Line,
    /// The same there and back again.
    ThereAndBack,
}

/// A translation along a named direction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slide {
    /// `"x"`, `"y"`, `"z"` (base), `"zeta:NAME@start"` (that singularity's ζ at the start of the run) or `"zeta:NAME"` (at the segment's start).
    pub along: String,
    /// Distance; m.
    pub by_m: f64,
}

/// A rotation about a named axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// As [`Slide::along`].
    pub about: String,
    /// Angle; degrees.
    pub by_deg: f64,
}

/// Turning a singular direction (Type 2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reorient {
    /// The singularity's name (`"wrist"`, `"overhead"`).
    pub singularity: String,
    /// Angle through which ζ turns; degrees. Its sign is a preference: the other way is taken where joint limits force it and the goal is the same line.
    pub by_deg: f64,
}

impl Start {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        let given = [
            self.q_deg.is_some(),
            self.q_rad.is_some(),
            self.posture.is_some(),
        ]
        .iter()
        .filter(|given| **given)
        .count();
        if given != 1 {
            return Err(Complaint::new(
                "start",
                format!("the start posture is given {given} times"),
                "give one of q_deg, q_rad, posture",
            ));
        }
        for (name, values) in [("q_deg", &self.q_deg), ("q_rad", &self.q_rad)] {
            if let Some(i) = values.iter().flatten().position(|value| !value.is_finite()) {
                return Err(Complaint::new(
                    format!("start.{name}.{i}"),
                    "a joint position is not a number",
                    "finite numbers",
                ));
            }
        }
        Ok(())
    }
}

impl Segment {
    pub(super) fn check(&self, i: usize) -> Result<(), Complaint> {
        let at = |key: &str| format!("segment.{i}.{key}");
        if !(self.duration_s.is_finite() && self.duration_s > 0.0) {
            return Err(Complaint::new(
                at("duration_s"),
                format!("the segment takes {} s", self.duration_s),
                "a positive time",
            ));
        }
        let translations = [
            self.to_m.is_some(),
            self.by_m.is_some(),
            self.slide.is_some(),
        ]
        .iter()
        .filter(|given| **given)
        .count();
        let rotations = [
            self.rotation.is_some(),
            self.quaternion.is_some(),
            self.turn.is_some(),
        ]
        .iter()
        .filter(|given| **given)
        .count();
        if translations > 1 {
            return Err(Complaint::new(
                format!("segment.{i}"),
                "the goal position is given more than once",
                "one of to_m, by_m, slide",
            ));
        }
        if rotations > 1 {
            return Err(Complaint::new(
                format!("segment.{i}"),
                "the goal rotation is given more than once",
                "one of rotation, quaternion, turn",
            ));
        }
        if let Some(reorient) = &self.reorient {
            if translations + rotations > 0 {
                return Err(Complaint::new(
                    at("reorient"),
                    "a segment cannot move and reorient at once",
                    "split it into two segments",
                ));
            }
            if !reorient.by_deg.is_finite() {
                return Err(Complaint::new(
                    at("reorient.by_deg"),
                    "the angle is not a number",
                    "degrees",
                ));
            }
        }
        for (key, position) in [("to_m", &self.to_m), ("by_m", &self.by_m)] {
            if position.iter().flatten().any(|x| !x.is_finite()) {
                return Err(Complaint::new(
                    at(key),
                    "the position is not a number",
                    "three finite numbers, in metres",
                ));
            }
        }
        if let Some(rows) = &self.rotation {
            let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let determinant = rows[0][0] * (rows[1][1] * rows[2][2] - rows[1][2] * rows[2][1])
                - rows[0][1] * (rows[1][0] * rows[2][2] - rows[1][2] * rows[2][0])
                + rows[0][2] * (rows[1][0] * rows[2][1] - rows[1][1] * rows[2][0]);
            let orthonormal = (0..3).all(|a| {
                (0..3).all(|b| (dot(&rows[a], &rows[b]) - f64::from(u8::from(a == b))).abs() < 1e-6)
            });
            if !orthonormal || determinant < 0.0 {
                return Err(Complaint::new(
                    at("rotation"),
                    "the matrix is not a rotation",
                    "orthonormal rows, determinant +1, to 1e-6",
                ));
            }
        }
        if let Some(quaternion) = &self.quaternion {
            let norm = quaternion.iter().map(|x| x * x).sum::<f64>();
            if (norm - 1.0).abs() > 1e-6 || norm.is_nan() {
                return Err(Complaint::new(
                    at("quaternion"),
                    format!("the quaternion's norm² is {norm}"),
                    "[w, x, y, z] with norm 1, to 1e-6",
                ));
            }
        }
        for (key, direction, amount) in [
            (
                "slide.along",
                self.slide.as_ref().map(|slide| &slide.along),
                self.slide.as_ref().map(|slide| slide.by_m),
            ),
            (
                "turn.about",
                self.turn.as_ref().map(|turn| &turn.about),
                self.turn.as_ref().map(|turn| turn.by_deg),
            ),
        ] {
            let Some(direction) = direction else { continue };
            let named = direction
                .strip_prefix("zeta:")
                .map(|rest| rest.strip_suffix("@start").unwrap_or(rest));
            if !["x", "y", "z"].contains(&direction.as_str()) && named.is_none_or(str::is_empty) {
                return Err(Complaint::new(
                    at(key),
                    format!("`{direction}` is not a direction"),
                    "x, y, z, zeta:NAME or zeta:NAME@start, for example zeta:wrist@start",
                ));
            }
            if amount.is_some_and(|amount| !amount.is_finite()) {
                return Err(Complaint::new(
                    at(key),
                    "the amount is not a number",
                    "by_m in metres, by_deg in degrees",
                ));
            }
        }
        if !(-1..=1).contains(&self.branch) {
            return Err(Complaint::new(
                at("branch"),
                format!("there is no posture {}", self.branch),
                "-1, 0 (keep) or 1",
            ));
        }
        Ok(())
    }
}
