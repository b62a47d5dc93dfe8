//! The task: the start posture, and the segments of the path.

use serde::{Deserialize, Serialize};

use super::curve::{AXES, Arc, Axis, Points, Table, check_position, check_quaternion};
use super::force::Force;
use super::plant::Plant;
use crate::file::{Complaint, each, require};

/// The start posture, by exactly one of these keys.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Joint positions, if all joints rotate; degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub q_deg: Option<Vec<f64>>,
    /// Joint positions; rad (sliding joints: m).
    #[serde(alias = "q_rad", skip_serializing_if = "Option::is_none")]
    pub q: Option<Vec<f64>>,
    /// Name of a posture in the robot's description.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub posture: Option<String>,
}

/// One piece of the path: a goal position, a goal rotation, both, a curve (`waypoints`, `arc`,
/// `spline` or `table`), or a `reorient`. With none of them, the hand holds still.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// Planned duration, at most 600, required without a `table`; s. A table has its own times; they
    /// are scaled to this one if it is given, which may then be longer.
    #[serde(default)]
    pub duration_s: f64,
    /// Time in which the hand gets up to a constant speed, and comes to rest again, at most half of
    /// the duration; s. Left out: one smooth motion, which is fastest in its middle. A table that
    /// does not begin and end at rest needs one, and takes longer by it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ramp_s: Option<f64>,
    /// Goal position in the base frame; m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to_m: Option<[f64; 3]>,
    /// Displacement from the segment's start, in base axes; m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_m: Option<[f64; 3]>,
    /// Displacement along a named direction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slide: Option<Slide>,
    /// Goal rotation in the base frame, as matrix rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[[f64; 3]; 3]>,
    /// Goal rotation in the base frame, as a quaternion `[w, x, y, z]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quaternion: Option<[f64; 4]>,
    /// Rotation from the segment's start about an axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turn: Option<Turn>,
    /// Straight lines from point to point, with rounded corners.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub waypoints: Option<Points>,
    /// A smooth curve through points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spline: Option<Points>,
    /// An arc, a circle, a helix or a spiral.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub arc: Option<Arc>,
    /// Poses with times, from a CSV file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table: Option<Table>,
    /// Turn a singular direction by null-space motion while the hand stands still.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reorient: Option<Reorient>,
    /// A force that the hand keeps along one direction meanwhile; the path does not move it that way.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<Force>,
    /// Posture to which a redundant arm's null space is drawn meanwhile, if all joints rotate;
    /// degrees. Default: the start posture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub posture_deg: Option<Vec<f64>>,
    /// The same for any arm; rad (sliding joints: m).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub posture_q: Option<Vec<f64>>,
    /// Shape of the path from start to goal.
    #[serde(default)]
    pub path: Path,
    /// Side on which to leave a Type 1 singularity: the sign of s, −1 or 1. 0: the present side.
    #[serde(default)]
    pub branch: i32,
}

/// Shapes of a path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Path {
    /// To the goal.
    #[default]
    Line,
    /// To the goal and back on the same way.
    ThereAndBack,
}

/// A displacement along a named direction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slide {
    /// `"x"`, `"-y"` or three numbers such as `"1 0 1"` (base axes), the same after `"tool "` (the
    /// hand's axes at the segment's start), `"zeta:NAME"` (ζ of that singularity at the segment's
    /// start) or `"zeta:NAME@start"` (at the start of the run).
    pub along: String,
    /// Distance; m.
    pub by_m: f64,
}

/// A rotation about a named axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// The axis, named like the direction of a `slide`.
    pub about: String,
    /// Angle; degrees.
    pub by_deg: f64,
}

/// A turn of a singular direction (Type 2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reorient {
    /// Name of the singularity, such as `"wrist"` or `"overhead"`.
    pub singularity: String,
    /// Angle by which ζ turns; degrees. If joint limits forbid this way round and the other one
    /// ends at the same line, ζ turns the other way.
    pub by_deg: f64,
}

/// Longest time of a segment, and of a table without `duration_s`: longer ones are more often milliseconds; s.
const LONGEST_S: f64 = 600.0;

fn are_finite<'a>(values: impl IntoIterator<Item = &'a f64>) -> bool {
    values.into_iter().all(|value| value.is_finite())
}

fn count<const N: usize>(given: [bool; N]) -> usize {
    given.into_iter().filter(|given| *given).count()
}

impl Start {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        let Self { q_deg, q, posture } = self;
        let given = count([q_deg.is_some(), q.is_some(), posture.is_some()]);
        require(
            given == 1,
            "start",
            format!("the start posture is given {given} times"),
            "give one of q, q_deg, posture; a setting replaces all of them as start={q_deg = [0, 90]}",
        )?;
        for (name, values) in [("q_deg", q_deg), ("q", q)] {
            let path = format!("start.{name}");
            let values = values.as_deref();
            each(&path, values.unwrap_or_default(), |_, value| {
                let message = "a joint position is not a number";
                require(value.is_finite(), "", message, "finite numbers")
            })?;
        }
        Ok(())
    }
}

impl Segment {
    /// The posture to which the null space is drawn, if the segment gives one.
    #[must_use]
    pub fn posture(&self) -> Option<Start> {
        let q = self.posture_q.clone();
        let q_deg = self.posture_deg.clone();
        let is_given = q.is_some() || q_deg.is_some();
        is_given.then_some(Start {
            q,
            q_deg,
            posture: None,
        })
    }

    /// The path is relative to the segment.
    pub(super) fn check(&self, plant: &Plant) -> Result<(), Complaint> {
        self.check_time()?;
        self.check_goals()?;
        self.check_curve()?;
        self.check_rotation()?;
        self.check_directions()?;
        self.force.iter().try_for_each(|force| force.check(plant))
    }

    /// Gives a segment whose table has been read, and which states no duration, that of the table.
    ///
    /// # Errors
    /// [`Complaint`] about a table that takes so long that its times are hardly seconds.
    pub fn take_times(&mut self) -> Result<(), Complaint> {
        let rows = self.table.as_ref().and_then(|table| table.poses().ok());
        if let Some([first, .., last]) = rows.as_deref().filter(|_| self.duration_s == 0.0) {
            let time = last.t_s - first.t_s;
            require(
                time <= LONGEST_S,
                "table",
                format!("the table takes {:.0} min: its times are in s", time / 60.0),
                format!(
                    "did you mean {:.3} s? Then write that as duration_s; duration_s = {time} takes the times as they are",
                    time * 1e-3
                ),
            )?;
            self.duration_s = time + self.ramp_s.unwrap_or(0.0);
        }
        Ok(())
    }

    fn check_time(&self) -> Result<(), Complaint> {
        let time = self.duration_s;
        let is_tables = self.table.is_some() && time == 0.0;
        require(
            time.is_finite() && time > 0.0 || is_tables,
            "duration_s",
            format!("the segment takes {time} s"),
            "give it a positive time, such as duration_s = 2.0",
        )?;
        require(
            time <= LONGEST_S || self.table.is_some(),
            "duration_s",
            format!("the segment takes {:.0} min: its time is in s", time / 60.0),
            format!("did you mean {}? Split one that takes so long", time * 1e-3),
        )?;
        let Some(ramp) = self.ramp_s else {
            return Ok(());
        };
        require(
            ramp > 0.0 && (is_tables || ramp <= 0.5 * time),
            "ramp_s",
            format!("`ramp_s` is {ramp}"),
            "a positive time, at most half of duration_s",
        )?;
        require(
            self.path == Path::Line,
            "ramp_s",
            "a way there and back has no constant speed",
            "leave out ramp_s, or write two segments",
        )
    }

    /// A curve is a segment's only goal.
    fn check_curve(&self) -> Result<(), Complaint> {
        let Self {
            waypoints,
            spline,
            arc,
            table,
            ..
        } = self;
        let given = count([
            waypoints.is_some(),
            spline.is_some(),
            arc.is_some(),
            table.is_some(),
            self.to_m.is_some() || self.by_m.is_some() || self.slide.is_some(),
            self.rotation.is_some() || self.quaternion.is_some() || self.turn.is_some(),
        ]);
        let is_curve = waypoints.is_some() || spline.is_some() || arc.is_some() || table.is_some();
        require(
            !is_curve || given == 1 && self.reorient.is_none(),
            "",
            "a curve has a further goal beside it",
            "one of waypoints, spline, arc, table; the orientation is part of them",
        )?;
        require(
            table.is_none() || self.path == Path::Line,
            "path",
            "a table has its own times",
            "write the way back into the table",
        )?;
        let curves = [("waypoints", waypoints), ("spline", spline)];
        for (key, points) in curves {
            let has_corners = key == "waypoints";
            let mut points = points.iter();
            points.try_for_each(|points| points.check(key, has_corners))?;
        }
        arc.iter().try_for_each(Arc::check)?;
        table.iter().try_for_each(Table::check)
    }

    /// At most one goal of each kind; the path is relative to the segment.
    fn check_goals(&self) -> Result<(), Complaint> {
        let [to, by] = [&self.to_m, &self.by_m].map(Option::is_some);
        let positions = count([to, by, self.slide.is_some()]);
        require(
            positions <= 1,
            "",
            "the goal position is given more than once",
            "one of to_m, by_m, slide",
        )?;
        let turn = self.turn.is_some();
        let rotations = count([self.rotation.is_some(), self.quaternion.is_some(), turn]);
        require(
            rotations <= 1,
            "",
            "the goal rotation is given more than once",
            "one of rotation, quaternion, turn",
        )?;
        require(
            self.reorient.is_none() || positions + rotations == 0,
            "reorient",
            "a segment cannot move and reorient at once",
            "split it into two segments",
        )?;
        require(
            self.posture_q.is_none() || self.posture_deg.is_none(),
            "posture_q",
            "the posture is given more than once",
            "one of posture_q, posture_deg",
        )?;
        let angle = self.reorient.iter().map(|reorient| &reorient.by_deg);
        require(
            are_finite(angle),
            "reorient.by_deg",
            "the angle is not a number",
            "degrees",
        )?;
        for (key, position) in [("to_m", &self.to_m), ("by_m", &self.by_m)] {
            let mut position = position.iter();
            position.try_for_each(|position| check_position(key, position))?;
        }
        require(
            (-1..=1).contains(&self.branch),
            "branch",
            format!("there is no posture {}", self.branch),
            "-1, 0 (keep) or 1",
        )
    }

    fn check_rotation(&self) -> Result<(), Complaint> {
        if let Some(rows) = &self.rotation {
            let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let determinant = rows[0][0] * (rows[1][1] * rows[2][2] - rows[1][2] * rows[2][1])
                - rows[0][1] * (rows[1][0] * rows[2][2] - rows[1][2] * rows[2][0])
                + rows[0][2] * (rows[1][0] * rows[2][1] - rows[1][1] * rows[2][0]);
            let is_unit = |a: usize, b: usize| {
                (dot(&rows[a], &rows[b]) - f64::from(u8::from(a == b))).abs() < 1e-6
            };
            require(
                (0..9).all(|i| is_unit(i / 3, i % 3)) && determinant > 0.0,
                "rotation",
                "the matrix is not a rotation",
                "orthonormal rows, determinant +1, to 1e-6",
            )?;
        }
        let mut quaternion = self.quaternion.iter();
        quaternion.try_for_each(|one| check_quaternion("quaternion", one))
    }

    fn check_directions(&self) -> Result<(), Complaint> {
        let slide = self
            .slide
            .iter()
            .map(|slide| ("slide.along", &slide.along, slide.by_m));
        let turn = self
            .turn
            .iter()
            .map(|turn| ("turn.about", &turn.about, turn.by_deg));
        for (key, direction, amount) in slide.chain(turn) {
            require(
                Axis::parse(direction).is_some(),
                key,
                format!("`{direction}` is not a direction"),
                AXES,
            )?;
            require(
                amount.abs() <= 10_000.0,
                key,
                "the amount is not one of an arm",
                "by_m in metres, by_deg in degrees, at most 10000",
            )?;
        }
        Ok(())
    }
}
