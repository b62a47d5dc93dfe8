//! The curves of a path: way points, arcs, splines and tables, and the axes that they name.

use serde::{Deserialize, Serialize};

use crate::file::{Complaint, each, require};
use crate::pose_table;

/// Axes and origin of a curve's numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Frame {
    /// The base of the arm.
    #[default]
    Base,
    /// The world, in which `mount` places the base.
    World,
    /// The hand's position when the segment begins, in base axes. Orientations are turns from the
    /// hand's orientation there. A table counts from its first row.
    Start,
    /// The hand's own axes when the segment begins. A table counts from its first row.
    Tool,
}

/// Points that the hand passes after the start of the segment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Points {
    /// The positions, the last of which is the goal; m.
    pub points_m: Vec<[f64; 3]>,
    /// The orientation at each of them, as quaternions `[w, x, y, z]`. None: the hand keeps its
    /// orientation.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub quaternions: Vec<[f64; 4]>,
    /// Distance from a corner at which its rounding begins, at most half of the shorter line
    /// beside it; m. Of `waypoints` only, where it is 0.01 if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blend_m: Option<f64>,
    /// Axes and origin of the points.
    #[serde(default)]
    pub frame: Frame,
}

/// An arc, a circle, a helix or a spiral.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arc {
    /// Any point on the axis of the arc; m.
    pub centre_m: [f64; 3],
    /// The axis, named like the direction of a `slide`.
    pub about: String,
    /// Angle of the arc, 360 for a circle; degrees.
    pub by_deg: f64,
    /// Displacement along the axis by the end; m.
    #[serde(default)]
    pub rise_m: f64,
    /// Growth of the radius by the end; m.
    #[serde(default)]
    pub grow_m: f64,
    /// Whether the hand turns with the arc.
    #[serde(default)]
    pub turn_hand: bool,
    /// Axes and origin of `centre_m`.
    #[serde(default)]
    pub frame: Frame,
}

/// Poses with times, as CSV: `t, x, y, z, qw, qx, qy, qz`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// The file, beside the scenario (docs/paths.md describes the format).
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub file: String,
    /// The rows themselves, in the file's format.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub rows: String,
    /// Axes and origin of the poses.
    #[serde(default)]
    pub frame: Frame,
    /// Largest distance of the smooth curve from a row, and 1 mrad of orientation per mm; mm.
    #[serde(default = "smooth_mm")]
    pub smooth_mm: f64,
}

fn smooth_mm() -> f64 {
    0.1
}

/// A direction as a scenario names it.
#[derive(Clone, Debug, PartialEq)]
pub enum Axis<'a> {
    /// A unit vector in base axes.
    Base([f64; 3]),
    /// A unit vector in the hand's axes when the segment begins.
    Tool([f64; 3]),
    /// ζ of the singularity of this name; `true`: at the start of the run, else when the segment begins.
    Zeta(&'a str, bool),
}

/// Remedy for a text that names no direction.
pub const AXES: &str =
    "x, -y, three numbers such as `1 0 1`, the same after `tool `, zeta:NAME or zeta:NAME@start";

impl<'a> Axis<'a> {
    /// Reads `x`, `-y`, `1 0 1`, `tool z`, `zeta:NAME` or `zeta:NAME@start`; `None` for anything else.
    #[must_use]
    pub fn parse(text: &'a str) -> Option<Self> {
        if let Some(rest) = text.strip_prefix("zeta:") {
            let name = rest.strip_suffix("@start").unwrap_or(rest);
            return (!name.is_empty()).then_some(Self::Zeta(name, name != rest));
        }
        match text.strip_prefix("tool ") {
            Some(rest) => unit(rest).map(Self::Tool),
            None => unit(text).map(Self::Base),
        }
    }
}

fn unit(text: &str) -> Option<[f64; 3]> {
    let (sign, name) = text
        .strip_prefix('-')
        .map_or((1.0, text), |name| (-1.0, name));
    if let Some(i) = ["x", "y", "z"].iter().position(|one| *one == name) {
        return Some(std::array::from_fn(|k| if k == i { sign } else { 0.0 }));
    }
    let numbers: Vec<f64> = text
        .split_whitespace()
        .map(|part| part.parse().ok())
        .collect::<Option<_>>()?;
    let [x, y, z] = numbers.try_into().ok()?;
    let norm = (x * x + y * y + z * z).sqrt();
    (norm.is_finite() && norm > 1e-6).then(|| [x / norm, y / norm, z / norm])
}

/// Whether a distance is one within which there are arms: at most 1 km.
pub(super) fn is_near(metres: &f64) -> bool {
    metres.abs() <= 1000.0
}

/// Refuses a position where there are no arms.
pub(super) fn check_position(path: &str, position: &[f64; 3]) -> Result<(), Complaint> {
    require(
        position.iter().all(is_near),
        path,
        "the position is not one of an arm",
        "three numbers from -1000 to 1000, in metres",
    )
}

/// Refuses a quaternion whose norm is not 1, to 1e-6.
pub(super) fn check_quaternion(path: &str, quaternion: &[f64; 4]) -> Result<(), Complaint> {
    require(
        (quaternion.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() <= 1e-6,
        path,
        "the quaternion's norm is not 1",
        "[w, x, y, z] with norm 1, to 1e-6",
    )
}

impl Points {
    pub(super) fn check(&self, key: &str, has_corners: bool) -> Result<(), Complaint> {
        let within = |name: &str| format!("{key}.{name}");
        let points = self.points_m.len();
        let turns = self.quaternions.len();
        require(
            (1..=10_000).contains(&points),
            within("points_m"),
            format!("there are {points} points"),
            "1 to 10000, each [x, y, z] in metres",
        )?;
        each(&within("points_m"), &self.points_m, |_, point| {
            check_position("", point)
        })?;
        require(
            turns == 0 || turns == points,
            within("quaternions"),
            format!("there are {turns} quaternions for {points} points"),
            "one for each point, or none",
        )?;
        each(&within("quaternions"), &self.quaternions, |_, one| {
            check_quaternion("", one)
        })?;
        require(
            self.blend_m
                .is_none_or(|blend| has_corners && blend > 0.0 && is_near(&blend)),
            within("blend_m"),
            "there is no such rounding",
            "a positive distance of `waypoints`; a spline has no corners",
        )
    }
}

impl Arc {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        require(
            Axis::parse(&self.about).is_some_and(|axis| !matches!(axis, Axis::Zeta(_, false))),
            "arc.about",
            format!("`{}` is not an axis of an arc", self.about),
            "x, -y, three numbers such as `1 0 1`, the same after `tool `, or zeta:NAME@start",
        )?;
        require(
            self.by_deg != 0.0 && self.by_deg.abs() <= 36_000.0,
            "arc.by_deg",
            format!("the arc has {}°", self.by_deg),
            "degrees, not 0, at most 36000",
        )?;
        let lengths = self.centre_m.iter().chain([&self.rise_m, &self.grow_m]);
        require(
            lengths.copied().all(|length| is_near(&length)),
            "arc",
            "the arc is not one of an arm",
            "lengths from -1000 to 1000, in metres",
        )
    }
}

impl Table {
    /// Its poses.
    ///
    /// # Errors
    /// The first line that is none.
    pub fn poses(&self) -> Result<Vec<pose_table::Row>, pose_table::InvalidRow> {
        pose_table::parse(&self.rows)
    }

    pub(super) fn check(&self) -> Result<(), Complaint> {
        require(
            self.smooth_mm > 0.0 && self.smooth_mm <= 100.0,
            "table.smooth_mm",
            format!("`smooth_mm` is {}", self.smooth_mm),
            "above 0, at most 100",
        )?;
        require(
            !(self.file.is_empty() && self.rows.is_empty()),
            "table",
            "the table is empty",
            "file = \"NAME.csv\"",
        )?;
        if self.rows.is_empty() {
            return Ok(());
        }
        self.poses().map(drop).map_err(|error| {
            let remedy = "docs/paths.md has the format";
            Complaint::new("table.rows", error.to_string(), remedy)
        })
    }
}
