//! The task as a path in space and a clock that runs along it.
//!
//! A path is a list of legs, each a way in space over s from 0 to 1, and a time law s(t), at rest at both ends. Where a leg starts is where the one
//! before ended. The way is a straight line with a geodesic turn, or a [`Curve`]. Where a line ends may depend on a singular direction at that moment,
//! so it is settled when the leg begins, and kept in the controller's state; a curve is settled before the run. The clock's speed is the governor's.

use super::curve::{self, Curve, CurveError, Point, Sample};
use super::free_axis::free_axis;
use crate::centre::PoseMotion;
use crate::linear::{Matrix3, Vector3, Vector6, rotation_exp, rotation_log, rotation_of, stack};
use crate::types::{Class, Kind, Report, Singularity};
use model::Pose;
use shared_types::codes;
use shared_types::scenario::{self, Axis, Frame, Scenario};

/// How far ahead the law of a steered run sees its present twist, s.
pub const HORIZON_S: f64 = 0.5;

/// Why a scenario's task is not a path.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PathError {
    /// The arm has no singularity of this name.
    #[error("segment {segment}: there is no singularity '{name}' on this arm; {known}")]
    UnknownSingularity {
        /// Index of the segment.
        segment: usize,
        /// The name.
        name: String,
        /// The names there are.
        known: String,
    },
    /// A direction is not one.
    #[error(
        "segment {segment}: '{direction}' is not a direction; {}",
        scenario::AXES
    )]
    Direction {
        /// Index of the segment.
        segment: usize,
        /// The text.
        direction: String,
    },
    /// A curve whose start depends on the run.
    #[error(
        "segment {segment}: a curve cannot begin where a segment along a ζ has led: lead the hand to a pose (to_m, rotation) first"
    )]
    Loose {
        /// Index of the segment.
        segment: usize,
    },
    /// A curve that has no smooth way.
    #[error("segment {segment}: {why}")]
    Curve {
        /// Index of the segment.
        segment: usize,
        /// The defect and the remedy.
        why: String,
    },
    /// A goal in an axis that the task does not serve.
    #[error(
        "segment {segment} asks for a motion {axis}, which the arm's task does not serve: leave it out, or name the axis in the arm's `task`"
    )]
    Unserved {
        /// Index of the segment.
        segment: usize,
        /// The axis.
        axis: &'static str,
    },
    /// A turn of ζ in a posture where nothing is lost.
    #[error(
        "segment {segment} asks to turn the singular direction of a singularity in whose neighbourhood the start posture is not: start in it, or lead a segment into it first"
    )]
    Outside {
        /// Index of the segment.
        segment: usize,
    },
}

/// What a motion along each axis is called, x to rz.
const MOTIONS: [&str; 6] = [
    "along x", "along y", "along z", "about x", "about y", "about z",
];
/// The most that a goal may have in an axis that is not served, by rounding: m, rad.
const ROUNDING: f64 = 1e-6;

/// How far a table may begin from where its segment does: m, rad.
const BEGINS: (f64, f64) = (1e-4, 3.5e-4);
/// Speed at its ends below which a table is at rest there: m/s, rad/s.
const AT_REST: (f64, f64) = (5e-3, 0.02);
/// Largest deviation of a curve from an arc or from rounded way points: m, rad.
const EXACT: f64 = 1e-5;

/// A direction in B, known now or when the leg begins.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Direction {
    Fixed(Vector3),
    /// In the hand's axes at the leg's start.
    Tool(Vector3),
    /// ζ of the singularity in this place of the report, at the leg's start.
    Zeta(usize),
}

impl Direction {
    fn resolve<const N: usize>(&self, start: &Pose, report: &Report<N>) -> Vector3 {
        match *self {
            Self::Fixed(direction) => direction,
            Self::Tool(direction) => start.R * direction,
            Self::Zeta(i) => report
                .listed()
                .get(i)
                .map_or_else(Vector3::zeros, |singularity| singularity.axis()),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Translation {
    Stay,
    To(Vector3),
    By(Vector3),
    Along(Direction, f64),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Rotation {
    Stay,
    To(Matrix3),
    About(Direction, f64),
}

/// The time law s(t) of a leg.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Law {
    /// A quintic.
    Rest,
    /// To s = 1 and back, a quintic each.
    ThereAndBack,
    /// A constant rate, reached and left within so many s.
    Ramped(f64),
}

/// One piece of the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// s of the path's own clock.
    pub duration_s: f64,
    translation: Translation,
    rotation: Rotation,
    law: Law,
    /// Place of its curve in the path.
    curve: Option<usize>,
    /// Place of the singularity whose ζ is turned, and by how much, rad.
    pub reorient: Option<(usize, f64)>,
    /// Posture to leave a Type 1 singularity in: −1, +1, or 0 to keep.
    pub branch: i32,
}

impl Leg {
    /// Whether its goal depends on a singular direction at the moment when it begins.
    pub fn is_relative(&self) -> bool {
        self.reorient.is_some()
            || matches!(self.translation, Translation::Along(Direction::Zeta(_), _))
            || matches!(self.rotation, Rotation::About(Direction::Zeta(_), _))
    }

    /// Whether the leg follows a curve.
    pub fn is_curved(&self) -> bool {
        self.curve.is_some()
    }

    /// Largest rate of its time law over the mean.
    pub fn peak(&self) -> f64 {
        match self.law {
            Law::Rest | Law::ThereAndBack => 1.875,
            Law::Ramped(ramp_s) => self.duration_s / (self.duration_s - ramp_s),
        }
    }
}

/// The whole task.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    legs: Vec<Leg>,
    curves: Vec<Curve>,
}

/// Where the clock is, and what the present leg starts from and adds up to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// Index of the leg; the number of legs once the path is finished.
    pub leg: usize,
    /// Time in the leg, s of the path's clock; after the path, time since its end.
    pub time_s: f64,
    /// Whether the leg's goal has been settled.
    pub begun: bool,
    /// Desired pose at the leg's start.
    pub start: Pose,
    /// Translation over the leg, m.
    pub by: Vector3,
    /// Rotation vector over the leg, rad.
    pub turn: Vector3,
}

impl Progress {
    /// At the beginning, at rest in `X_BE`.
    pub fn at(X_BE: Pose) -> Self {
        Self {
            start: X_BE,
            ..Self::default()
        }
    }

    /// The pose at a share of the leg's straight way.
    #[inline]
    fn along(&self, x: f64) -> Pose {
        Pose {
            R: rotation_exp(&(self.turn * x)) * self.start.R,
            p: self.start.p + self.by * x,
        }
    }
}

/// The rest of a leg, as a path in space without time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ahead<'a> {
    progress: Progress,
    curve: Option<&'a Curve>,
    p_E: Vector3,
    from: f64,
    to: f64,
}

impl Ahead<'_> {
    /// The pose of the point at `share` of what is left, 0 to 1.
    pub fn pose(&self, share: f64) -> Pose {
        let x = self.from + share * (self.to - self.from);
        let way = |curve: &Curve| curve.at(x).pose;
        let Pose { R, p } = self.curve.map_or_else(|| self.progress.along(x), way);
        Pose {
            R,
            p: p + R * self.p_E,
        }
    }
}

impl Path {
    /// The path of a scenario from the pose `start` on, with directions at the start of the run taken from `report`, the analysis of the start posture.
    ///
    /// # Errors
    /// [`PathError`] for a direction or a singularity that does not exist, and for a curve that cannot be followed.
    pub fn new<const N: usize>(
        scenario: &Scenario,
        start: Pose,
        report: &Report<N>,
    ) -> Result<Self, PathError> {
        let mut path = Self {
            legs: vec![],
            curves: vec![],
        };
        if scenario.servo.is_some() {
            let horizon = scenario::Segment {
                duration_s: HORIZON_S,
                ..Default::default()
            };
            // A constant twist from the leg's start on.
            path.legs.push(Leg {
                law: Law::Ramped(0.0),
                ..leg(0, &horizon, report)?
            });
            return Ok(path);
        }
        let (mut place, mut is_loose) = (Progress::at(start), false);
        for (i, segment) in scenario.segment.iter().enumerate() {
            let mut leg = leg(i, segment, report)?;
            let X_WB = origin(scenario, segment);
            let samples = samples(i, segment, &(X_WB * place.start), report)?;
            if let Some((mut samples, apart, bound_m)) = samples {
                let X_BW = X_WB.inverse();
                samples.iter_mut().for_each(|(_, X)| *X = X_BW * *X);
                if is_loose {
                    return Err(PathError::Loose { segment: i });
                }
                let rests = segment.table.is_some() && segment.ramp_s.is_none();
                if rests {
                    at_rest(i, &samples, apart, leg.duration_s)?;
                }
                let curve = Curve::through(&samples, apart, bound_m, rests);
                let curve = curve.map_err(|error| not_smooth(i, segment, &error))?;
                leg.curve = Some(path.curves.len());
                path.curves.push(curve);
            }
            is_loose |= leg.is_relative();
            path.legs.push(leg);
            path.advance(&mut place, 0.0, report);
            path.advance(&mut place, leg.duration_s, report);
            place.time_s = 0.0;
        }
        Ok(path)
    }

    /// Checks what can be checked before the start: no leg asks for what the task does not serve, and a path that begins
    /// with a turn of ζ begins where the direction is lost. Legs along or about a ζ are what the posture makes of them.
    ///
    /// `start`: pose at the start; `report`: the analysis of the start posture.
    ///
    /// # Errors
    /// [`PathError::Unserved`], [`PathError::Outside`].
    pub(crate) fn check<const N: usize>(
        &self,
        task: &[bool; 6],
        start: Pose,
        report: &Report<N>,
    ) -> Result<(), PathError> {
        let turned = self.legs.first().and_then(|leg| leg.reorient);
        if turned.is_some_and(|(place, _)| !report.singularities[place].inside) {
            return Err(PathError::Outside { segment: 0 });
        }
        // An orientation is met up to the one rotation that is free.
        let has_free_axis = free_axis(task).is_some();
        let mut place = Progress::at(start);
        for (segment, leg) in self.legs.iter().enumerate() {
            self.advance(&mut place, 0.0, report);
            let way = self.way(leg, &place, has_free_axis);
            let unserved = (0..6).find(|i| !task[*i] && way[*i] > ROUNDING);
            if let Some(i) = unserved.filter(|_| !leg.is_relative()) {
                let axis = MOTIONS[i];
                return Err(PathError::Unserved { segment, axis });
            }
            self.advance(&mut place, leg.duration_s, report);
        }
        Ok(())
    }

    /// How far a leg that begins leads along and about each axis; a turn to a given orientation does not count where an axis is free.
    fn way(&self, leg: &Leg, place: &Progress, has_free_axis: bool) -> Vector6 {
        let is_met = has_free_axis && (matches!(leg.rotation, Rotation::To(_)) || leg.is_curved());
        let turn = |turn: Vector3| if is_met { Vector3::zeros() } else { turn };
        let Some(curve) = self.curve(leg) else {
            return stack(&place.by, &turn(place.turn)).abs();
        };
        curve.places().fold(Vector6::zeros(), |most, at| {
            let (by, to) = between(&place.start, &at.pose);
            most.sup(&stack(&by, &turn(to)).abs())
        })
    }

    fn curve(&self, leg: &Leg) -> Option<&Curve> {
        leg.curve.and_then(|place| self.curves.get(place))
    }

    /// Whether the present leg, which has begun, leaves the hand where it is.
    pub fn is_still(&self, progress: &Progress) -> bool {
        let is_curved = self.legs.get(progress.leg).is_some_and(Leg::is_curved);
        !is_curved && progress.by == Vector3::zeros() && progress.turn == Vector3::zeros()
    }

    /// Length of a curve at this index, m, and its turn, rad; zero for any other leg.
    pub fn extent(&self, index: usize) -> (f64, f64) {
        let curve = self.legs.get(index).and_then(|leg| self.curve(leg));
        let mut before: Option<Pose> = None;
        curve.map_or((0.0, 0.0), |curve| {
            curve.places().fold((0.0, 0.0), |(length, angle), at| {
                let last = before.replace(at.pose).unwrap_or(at.pose);
                let (by, turn) = between(&last, &at.pose);
                (length + by.norm(), angle + turn.norm())
            })
        })
    }

    /// All of its legs.
    pub fn legs(&self) -> &[Leg] {
        &self.legs
    }

    /// The leg at this index, while the path lasts.
    pub fn leg(&self, index: usize) -> Option<&Leg> {
        self.legs.get(index)
    }

    /// The time that all legs take by the path's clock, s.
    pub fn duration_s(&self) -> f64 {
        self.legs.iter().map(|leg| leg.duration_s).sum()
    }

    /// Moves the clock on by `dt_s` and settles the goal of a leg that begins.
    ///
    /// Ensures `progress.begun` while a leg is left. `report` is the analysis of the present posture.
    pub fn advance<const N: usize>(&self, progress: &mut Progress, dt_s: f64, report: &Report<N>) {
        progress.time_s += dt_s;
        while let Some(leg) = self.legs.get(progress.leg) {
            if let Some(curve) = self.curve(leg).filter(|_| !progress.begun) {
                progress.begun = true;
                (progress.by, progress.turn) = between(&progress.start, &curve.at(1.0).pose);
            } else if !progress.begun {
                progress.begun = true;
                let start = &progress.start;
                progress.by = match leg.translation {
                    Translation::Stay => Vector3::zeros(),
                    Translation::To(p) => p - start.p,
                    Translation::By(by) => by,
                    Translation::Along(direction, distance) => {
                        direction.resolve(start, report) * distance
                    }
                };
                progress.turn = match leg.rotation {
                    Rotation::Stay => Vector3::zeros(),
                    Rotation::To(R) => rotation_log(&(R * start.R.transpose())),
                    Rotation::About(direction, angle) => direction.resolve(start, report) * angle,
                };
            }
            if progress.time_s < leg.duration_s {
                return;
            }
            if leg.law != Law::ThereAndBack {
                progress.start = progress.along(1.0);
            }
            progress.time_s -= leg.duration_s;
            progress.leg += 1;
            progress.begun = false;
            (progress.by, progress.turn) = (Vector3::zeros(), Vector3::zeros());
        }
    }

    /// Fraction of the present leg's way, its rate and acceleration, per unit of the path's clock.
    pub fn fraction(&self, progress: &Progress) -> [f64; 3] {
        let Some(leg) = self.legs.get(progress.leg) else {
            return [0.0; 3];
        };
        let (t, T) = (progress.time_s, leg.duration_s);
        match leg.law {
            Law::Rest => quintic(t, T),
            Law::ThereAndBack if t < 0.5 * T => quintic(t, 0.5 * T),
            Law::ThereAndBack => {
                let [x, v, a] = quintic(t - 0.5 * T, 0.5 * T);
                [1.0 - x, -v, -a]
            }
            Law::Ramped(0.0) => [(t / T).clamp(0.0, 1.0), 1.0 / T, 0.0],
            Law::Ramped(ramp_s) => ramped(t, T, ramp_s),
        }
    }

    /// Fraction of the present leg's time law from 0 to 1, whatever the shape of its way: for what goes along with it.
    pub fn ramp(&self, progress: &Progress) -> f64 {
        self.legs
            .get(progress.leg)
            .map_or(1.0, |leg| quintic(progress.time_s, leg.duration_s)[0])
    }

    /// The rest of the present leg, for a point fixed at `p_E` in the end-effector.
    pub fn ahead(&self, progress: &Progress, p_E: Vector3) -> Ahead<'_> {
        let [x, v, _] = self.fraction(progress);
        let leg = self.legs.get(progress.leg);
        Ahead {
            progress: *progress,
            curve: leg.and_then(|leg| self.curve(leg)),
            p_E,
            from: x,
            to: if v < 0.0 { 0.0 } else { 1.0 },
        }
    }

    /// Desired motion of E, where the clock runs at `rate` and changes at `rate_dot` (1/s).
    pub fn desired(&self, progress: &Progress, rate: f64, rate_dot: f64) -> PoseMotion {
        self.place(progress).moving(rate, rate_dot)
    }

    /// The place on the path where the clock is.
    #[inline]
    pub fn place(&self, progress: &Progress) -> Place {
        let fraction = self.fraction(progress);
        let [x, ..] = fraction;
        let leg = self.legs.get(progress.leg);
        if let Some(curve) = leg.and_then(|leg| self.curve(leg)) {
            let Point { pose, slope, bend } = curve.at(x);
            return Place {
                pose,
                slope,
                bend: Some(bend),
                fraction,
            };
        }
        Place {
            pose: progress.along(x),
            slope: stack(&progress.by, &progress.turn),
            bend: None,
            fraction,
        }
    }
}

/// A place on the path: E's desired pose there, and where the present leg leads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pose: Pose,
    /// First derivative by s, and the second one of a curve.
    slope: Vector6,
    bend: Option<Vector6>,
    fraction: [f64; 3],
}

impl Place {
    /// Desired motion of E here, where the clock runs at `rate` and changes at `rate_dot` (1/s).
    #[inline]
    pub fn moving(&self, rate: f64, rate_dot: f64) -> PoseMotion {
        let [_, v, a] = self.fraction;
        let (xdot, xddot) = (v * rate, a * rate * rate + v * rate_dot);
        let along = self.slope * xddot;
        PoseMotion {
            R: self.pose.R,
            p: self.pose.p,
            V: self.slope * xdot,
            a: self.bend.map_or(along, |bend| along + bend * (xdot * xdot)),
        }
    }
}

/// Translation and rotation vector from one pose to another.
fn between(from: &Pose, to: &Pose) -> (Vector3, Vector3) {
    let turn = rotation_log(&(to.R * from.R.transpose()));
    (to.p - from.p, turn)
}

/// Quintic time law: position, velocity, acceleration of x(t) = 10τ³ − 15τ⁴ + 6τ⁵, τ = t/T; at rest at both ends.
pub fn quintic(t: f64, T: f64) -> [f64; 3] {
    let x = (t / T).clamp(0.0, 1.0);
    [
        x * x * x * (10.0 + x * (-15.0 + 6.0 * x)),
        30.0 * x * x * (1.0 - x) * (1.0 - x) / T,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (T * T),
    ]
}

/// A constant rate that is reached, and left, by a smoothstep over `ramp_s`: position, velocity, acceleration of x(t).
pub(crate) fn ramped(t: f64, T: f64, ramp_s: f64) -> [f64; 3] {
    let top = 1.0 / (T - ramp_s);
    let rise = |t: f64| {
        let x = (t / ramp_s).clamp(0.0, 1.0);
        let (rate, change) = (x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) / ramp_s);
        let way = ramp_s * x * x * x * (1.0 - 0.5 * x) + (t - ramp_s).max(0.0);
        [way * top, rate * top, change * top]
    };
    if t < 0.5 * T {
        return rise(t.max(0.0));
    }
    let [x, v, a] = rise((T - t).max(0.0));
    [1.0 - x, v, -a]
}

/// The base in the axes of a segment's curve: the identity, but for a curve in the world.
fn origin(scenario: &Scenario, segment: &scenario::Segment) -> Pose {
    let points = segment.waypoints.as_ref().or(segment.spline.as_ref());
    let frame = points.map(|points| points.frame);
    let frame = frame.or(segment.arc.as_ref().map(|arc| arc.frame));
    let frame = frame.or(segment.table.as_ref().map(|table| table.frame));
    match (&scenario.mount, frame) {
        (Some(mount), Some(Frame::World)) => {
            Pose::from_xyz_rpy(mount.base_m, mount.base_rpy_deg.map(f64::to_radians))
        }
        _ => Pose::identity(),
    }
}

/// The samples of a segment's curve from the pose `start` on, the least distance of knots in s, and the largest deviation, m; `None` for a line.
fn samples<const N: usize>(
    i: usize,
    segment: &scenario::Segment,
    start: &Pose,
    report: &Report<N>,
) -> Result<Option<(Vec<Sample>, f64, f64)>, PathError> {
    let wrong = |why: String| PathError::Curve { segment: i, why };
    let exactly = |samples| Ok(Some((samples, 0.0, EXACT)));
    if let Some(points) = &segment.waypoints {
        return exactly(curve::rounded(&curve::poses(points, start), points.blend_m));
    }
    if let Some(points) = &segment.spline {
        return exactly(curve::by_length(&curve::poses(points, start)));
    }
    if let Some(arc) = &segment.arc {
        let axis = direction(i, &arc.about, report)?.resolve(start, report);
        let samples = curve::arc(arc, &axis, start).map_err(|radius| {
            wrong(format!(
                "the arc begins with a radius of {radius:.6} m and grows by {} m: move centre_m away from the hand, or correct grow_m",
                arc.grow_m
            ))
        });
        return exactly(samples?);
    }
    let Some(table) = &segment.table else {
        return Ok(None);
    };
    let rows = table
        .poses()
        .map_err(|error| wrong(format!("table: {error}")))?;
    let samples = curve::of_rows(&rows, table.frame, start);
    let (by, turn) = between(start, &samples[0].1);
    if by.norm() > BEGINS.0 || turn.norm() > BEGINS.1 {
        let ([x, y, z], [a, b, c, d]) = (rows[0].p_m, rows[0].quaternion);
        return Err(wrong(format!(
            "the table begins {:.1} mm and {:.2}° from the hand: lead the hand there by a segment before it, to_m = [{x}, {y}, {z}], quaternion = [{a}, \
             {b}, {c}, {d}], or let it count from the hand, frame = \"start\"",
            by.norm() * 1e3,
            turn.norm().to_degrees()
        )));
    }
    let all_s = rows[rows.len() - 1].t_s - rows[0].t_s;
    Ok(Some((
        samples,
        curve::KNOTS_S / all_s,
        table.smooth_mm * 1e-3,
    )))
}

/// The reason why a segment's curve is none.
fn not_smooth(i: usize, segment: &scenario::Segment, error: &CurveError) -> PathError {
    let lines = segment.table.as_ref().and_then(|table| table.poses().ok());
    let line = |k: usize| {
        lines
            .as_ref()
            .and_then(|rows| rows.get(k))
            .map_or(k, |row| row.line)
    };
    let why = match error {
        CurveError::Sample(k) if lines.is_some() => format!(
            "table: about line {}: from one row to the next the hand turns by half a turn: add rows between them",
            line(*k)
        ),
        CurveError::Sample(_) => {
            "two points in a row are the same, or half a turn apart: leave one out, or add points between them".to_owned()
        }
        CurveError::Off(k, m, rad) => format!(
            "table: line {}: the row lies {:.2} mm and {:.2}° off the smooth curve through the rows about it: correct the row, or allow more by smooth_mm",
            line(*k),
            m * 1e3,
            rad.to_degrees()
        ),
    };
    PathError::Curve { segment: i, why }
}

/// Checks that a table which is played without a ramp begins and ends at rest.
fn at_rest(i: usize, samples: &[Sample], apart: f64, duration_s: f64) -> Result<(), PathError> {
    for (is_last, end) in [(false, "begins"), (true, "ends")] {
        let speed = curve::end_speed(samples, apart, is_last);
        let (v, w) = speed.map_or((0.0, 0.0), |(v, w)| (v / duration_s, w / duration_s));
        if v > AT_REST.0 || w > AT_REST.1 {
            let why = format!(
                "the table {end} with {v:.3} m/s and {:.1}°/s, and the hand is at rest there: let it get up to speed by ramp_s = 0.2",
                w.to_degrees()
            );
            return Err(PathError::Curve { segment: i, why });
        }
    }
    Ok(())
}

fn leg<const N: usize>(
    i: usize,
    segment: &scenario::Segment,
    report: &Report<N>,
) -> Result<Leg, PathError> {
    let translation = if let Some(to) = segment.to_m {
        Translation::To(to.into())
    } else if let Some(by) = segment.by_m {
        Translation::By(by.into())
    } else if let Some(slide) = &segment.slide {
        Translation::Along(direction(i, &slide.along, report)?, slide.by_m)
    } else {
        Translation::Stay
    };
    let rotation = if let Some(rows) = segment.rotation {
        Rotation::To(Matrix3::from_row_iterator(rows.into_iter().flatten()))
    } else if let Some(q) = segment.quaternion {
        Rotation::To(rotation_of(q))
    } else if let Some(turn) = &segment.turn {
        Rotation::About(direction(i, &turn.about, report)?, turn.by_deg.to_radians())
    } else {
        Rotation::Stay
    };
    let reorient = match &segment.reorient {
        Some(reorient) => Some((
            place(i, &reorient.singularity, report)?,
            reorient.by_deg.to_radians(),
        )),
        None => None,
    };
    Ok(Leg {
        duration_s: segment.duration_s,
        translation,
        rotation,
        law: match (segment.path, segment.ramp_s, &segment.table) {
            (scenario::Path::ThereAndBack, ..) => Law::ThereAndBack,
            (_, Some(ramp_s), _) => Law::Ramped(ramp_s),
            (_, None, Some(_)) => Law::Ramped(0.0),
            (_, None, None) => Law::Rest,
        },
        curve: None,
        reorient,
        branch: segment.branch,
    })
}

fn direction<const N: usize>(
    segment: usize,
    text: &str,
    report: &Report<N>,
) -> Result<Direction, PathError> {
    Ok(match Axis::parse(text) {
        Some(Axis::Base(direction)) => Direction::Fixed(direction.into()),
        Some(Axis::Tool(direction)) => Direction::Tool(direction.into()),
        Some(Axis::Zeta(name, true)) => {
            Direction::Fixed(report.singularities[place(segment, name, report)?].axis())
        }
        Some(Axis::Zeta(name, false)) => Direction::Zeta(place(segment, name, report)?),
        None => {
            let direction = text.to_owned();
            return Err(PathError::Direction { segment, direction });
        }
    })
}

/// Where in the report the singularity of this name is ([`codes::singularity_name`]).
fn place<const N: usize>(
    segment: usize,
    name: &str,
    report: &Report<N>,
) -> Result<usize, PathError> {
    let mut names = report
        .listed()
        .iter()
        .enumerate()
        .map(|(i, singularity)| codes::singularity_name(singularity.kind.code(), i));
    // A singularity found by number has no name; the one fold in which the arm starts is named elbow, as elsewhere.
    let is_elbow = |s: &Singularity<N>| {
        s.kind == Kind::Numeric && s.class == Class::Type1 && !s.angular && s.inside
    };
    let elbow = || {
        report
            .listed()
            .iter()
            .position(is_elbow)
            .filter(|_| name == codes::name_of(codes::KINDS, codes::KIND_ELBOW))
    };
    names
        .clone()
        .position(|known| known == name)
        .or_else(elbow)
        .ok_or_else(|| {
            let known = names.by_ref().collect::<Vec<_>>().join(", ");
            let known = if known.is_empty() {
                "it reports none".to_owned()
            } else {
                format!("it has {known}")
            };
            PathError::UnknownSingularity {
                segment,
                name: name.to_owned(),
                known,
            }
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, UnitQuaternion};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn desired_motion_is_consistent_at_any_clock_speed(t in 0.1..1.9_f64, rate in 0.1..1.0_f64) {
            for segment in [
                "by_m = [0.1, -0.2, 0.05]\nturn = { about = \"y\", by_deg = 120 }",
                "slide = { along = \"tool z\", by_m = 0.2 }\nturn = { about = \"tool 0 1 1\", by_deg = -50 }\nramp_s = 0.6",
                "arc = { centre_m = [0.2, 0, 0], about = \"1 0 2\", by_deg = 500, rise_m = 0.1, grow_m = 0.1, turn_hand = true }",
                "ramp_s = 0.4\nwaypoints = { points_m = [[0.3, 0, 0], [0.3, 0.2, 0], [0, 0.2, 0.1]], quaternions = [[1, 0, 0, 0], [0.8, 0.6, 0, 0], [0, 0, 0.6, -0.8]], blend_m = 0.1 }",
                "spline = { points_m = [[0.3, 0, 0], [0.3, 0.2, 0]], quaternions = [[1, 0, 0, 0], [0.8, 0.6, 0, 0]], frame = \"tool\" }",
            ] {
                let path = path_of(segment);
                let at = |t: f64| at(&path, t, rate);
                let h = 1e-5;
                let (before, now, after) = (at(t - h * rate), at(t), at(t + h * rate));
                let v = (after.p - before.p) / (2.0 * h);
                let w = rotation_log(&(after.R * before.R.transpose())) / (2.0 * h);
                prop_assert!((stack(&v, &w) - now.V).amax() < 1e-6, "{segment}");
                prop_assert!(((after.V - before.V) / (2.0 * h) - now.a).amax() < 1e-4 * (1.0 + now.a.amax()), "{segment}");
            }
        }
    }

    /// A path of one segment from [`begin`] on, of 2 s if it states no time.
    fn path_of(segment: &str) -> Path {
        let time = if segment.contains("duration_s") {
            ""
        } else {
            "duration_s = 2.0\n"
        };
        let text =
            format!("name = \"x\"\nrobot = \"x\"\n[start]\nq = []\n[[segment]]\n{time}{segment}\n");
        let scenario = Scenario::parse("x.toml", &text, &[]).unwrap();
        Path::new(&scenario, begin(), &crate::testing::empty_report::<6>()).unwrap()
    }

    fn begin() -> Pose {
        Pose {
            R: rotation_exp(&Vector3::new(0.3, -0.2, 0.9)),
            p: Vector3::zeros(),
        }
    }

    fn at(path: &Path, t: f64, rate: f64) -> PoseMotion {
        let mut progress = Progress::at(begin());
        path.advance(&mut progress, t, &crate::testing::empty_report::<6>());
        path.desired(&progress, rate, 0.0)
    }

    #[test]
    fn an_arc_is_an_arc_at_rest_at_both_ends() {
        let path =
            path_of("arc = { centre_m = [0.2, 0, 0], about = \"z\", by_deg = 360, rise_m = 0.3 }");
        for k in 0..=400 {
            let t = f64::from(k) * 0.005;
            let [s, ..] = quintic(t, 2.0);
            let (X, angle) = (at(&path, t, 1.0), std::f64::consts::TAU * s);
            let on = Vector3::new(
                0.2 - 0.2 * libm::cos(angle),
                -0.2 * libm::sin(angle),
                0.3 * s,
            );
            assert!(
                (X.p - on).norm() < 1e-7 && (X.R - begin().R).amax() < 1e-12,
                "{t}"
            );
        }
        for t in [0.0, 2.0] {
            assert!(at(&path, t, 1.0).V.norm() < 1e-9);
        }
    }

    #[test]
    fn a_curve_in_the_world_is_seen_from_the_base() {
        let path = path_of(
            "waypoints = { points_m = [[1.1, 2.0, 3.0]], quaternions = [[0, 1, 0, 0]], frame = \"world\" }\n\
             [mount]\nbase_m = [1, 2, 3]\nbase_rpy_deg = [180, 0, 0]\n[plant]\nfloor_m = \"none\"",
        );
        let end = at(&path, 2.0, 1.0);
        assert!((end.p - Vector3::new(0.1, 0.0, 0.0)).norm() < 1e-12);
        assert!((end.R - Matrix3::identity()).amax() < 1e-9);
    }

    #[test]
    fn way_points_are_joined_by_lines_but_for_the_rounding() {
        let path = path_of(
            "waypoints = { points_m = [[0.3, 0, 0], [0.3, 0.2, 0]], blend_m = 0.05 }\nramp_s = 0.2",
        );
        let mut nearest = f64::INFINITY;
        for k in 0..=400 {
            let p = at(&path, f64::from(k) * 0.005, 1.0).p;
            let corner = (p - Vector3::new(0.3, 0.0, 0.0)).norm();
            nearest = nearest.min(corner);
            let off = p.y.abs().min((p.x - 0.3).abs());
            assert!(corner <= 0.05 || off < 1e-6, "{p}");
        }
        assert!((0.005..0.02).contains(&nearest), "{nearest}");
        assert!((at(&path, 2.0, 1.0).p - Vector3::new(0.3, 0.2, 0.0)).norm() < 1e-9);
    }

    /// The rows of a smooth motion, with every second quaternion negative and six decimals.
    fn table(rate_hz: u32, motion: &dyn Fn(f64) -> PoseMotion) -> String {
        let row = |k: u32| {
            let t = f64::from(k) / f64::from(rate_hz);
            let X = motion(t);
            let R = Rotation3::from_matrix_unchecked(X.R);
            let q = UnitQuaternion::from_rotation_matrix(&R);
            let q = q.quaternion() * if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            format!(
                "{t:.4}, {:.6}, {:.6}, {:.6}, {:.6}, {:.6}, {:.6}, {:.6}",
                X.p.x, X.p.y, X.p.z, q.w, q.i, q.j, q.k
            )
        };
        (0..=4 * rate_hz).map(row).collect::<Vec<_>>().join("\n")
    }

    #[test]
    fn a_table_is_the_curve_that_it_was_sampled_from() {
        let curve = "duration_s = 4.0\nspline = { points_m = [[0.1, 0, 0], [0.15, 0.1, 0.1], [0.1, 0.2, 0], [0, 0.2, -0.1]], \
                     quaternions = [[0.96, 0.28, 0, 0], [0.8, 0.6, 0, 0], [0.8, 0, 0.6, 0], [0.6, 0, 0.8, 0]] }";
        let path = path_of(curve);
        for rate_hz in [10, 100, 1000] {
            let rows = table(rate_hz, &|t| at(&path, t, 1.0));
            let table = path_of(&format!(
                "duration_s = 4.0\ntable = {{ rows = \"\"\"\n{rows}\"\"\" }}"
            ));
            let mut worst = (0.0_f64, 0.0_f64, 0.0_f64);
            for k in 0..=1000 {
                let t = f64::from(k) * 0.004;
                let (wanted, got) = (at(&path, t, 1.0), at(&table, t, 1.0));
                let turn = rotation_log(&(wanted.R * got.R.transpose()));
                worst.0 = worst.0.max((wanted.p - got.p).norm());
                worst.1 = worst.1.max(turn.norm());
                worst.2 = worst.2.max((wanted.a - got.a).fixed_rows::<3>(0).norm());
            }
            assert!(worst.0 < 1e-5 && worst.1 < 1e-4, "{rate_hz} Hz: {worst:?}");
            assert!(worst.2 < 0.2, "decimals are no accelerations: {worst:?}");
        }
    }

    #[test]
    fn a_table_that_cannot_be_followed_is_refused() {
        let text = |rows: &str, keys: &str| {
            format!(
                "name = \"x\"\nrobot = \"x\"\n[start]\nq = []\n[[segment]]\n{keys}\n[segment.table]\nframe = \"start\"\nrows = \"\"\"\n{rows}\"\"\"\n"
            )
        };
        let path = |rows: &str, keys: &str| {
            let mut scenario = Scenario::parse("x.toml", &text(rows, keys), &[]).unwrap();
            scenario.segment[0].take_times().unwrap();
            Path::new(&scenario, begin(), &crate::testing::empty_report::<6>())
        };
        let rows = |motion: &dyn Fn(f64) -> f64| {
            let row = |k: i32| {
                format!(
                    "{}, {}, 0, 0, 1, 0, 0, 0\n",
                    0.01 * f64::from(k),
                    motion(0.01 * f64::from(k))
                )
            };
            (0..=200).map(row).collect::<String>()
        };
        // It begins and ends at speed.
        assert!(path(&rows(&|t| 0.1 * t), "").is_err());
        let ramped = path(&rows(&|t| 0.1 * t), "ramp_s = 0.3").unwrap();
        assert!((ramped.duration_s() - 2.3).abs() < 1e-9);
        assert!((at(&ramped, 1.15, 1.0).V.x - 0.1).abs() < 1e-6);
        // A step that is too small for a jump.
        let step = |t: f64| quintic(t, 2.0)[0] * 0.1 + if t > 1.0 { 0.003 } else { 0.0 };
        assert!(path(&rows(&|t| quintic(t, 2.0)[0] * 0.1), "").is_ok());
        assert!(path(&rows(&step), "").is_err());
    }

    #[test]
    fn there_and_back_ends_where_it_began() {
        let segment = scenario::Segment {
            duration_s: 1.0,
            by_m: Some([0.1, 0.0, 0.0]),
            path: scenario::Path::ThereAndBack,
            ..Default::default()
        };
        let report = crate::testing::empty_report::<6>();
        let path = Path {
            legs: vec![leg(0, &segment, &report).unwrap()],
            curves: vec![],
        };
        let mut progress = Progress::at(Pose::identity());
        path.advance(&mut progress, 0.5, &report);
        assert!((path.desired(&progress, 1.0, 0.0).p.x - 0.1).abs() < 1e-12);
        path.advance(&mut progress, 0.6, &report);
        assert_eq!(progress.leg, 1);
        assert!(path.desired(&progress, 1.0, 0.0).p.norm() < 1e-12);
    }
}
