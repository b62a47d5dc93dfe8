//! The task as a path in space and a clock that runs along it.
//!
//! A path is a list of legs. Where a leg starts is where the one before ended; where it ends may depend on a singular direction at
//! that moment, so it is settled when the leg begins, and kept in the controller's state. Position follows a straight line, rotation a
//! geodesic, both by the same quintic time law; the clock's speed is the governor's.

use super::free_axis::free_axis;
use crate::centre::PoseMotion;
use crate::linear::{rotation_exp, rotation_log, stack};
use crate::types::{Class, Kind, Report, Singularity};
use model::Pose;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use shared_types::codes;
use shared_types::scenario::{self, Scenario};

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
        "segment {segment}: '{direction}' is not a direction; x, y, z, zeta:NAME or zeta:NAME@start"
    )]
    Direction {
        /// Index of the segment.
        segment: usize,
        /// The text.
        direction: String,
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

/// A direction in B, known now or when the leg begins.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Direction {
    Fixed(Vector3<f64>),
    /// ζ of the singularity in this place of the report, at the leg's start.
    Zeta(usize),
}

impl Direction {
    fn resolve<const N: usize>(&self, report: &Report<N>) -> Vector3<f64> {
        match *self {
            Self::Fixed(direction) => direction,
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
    To(Vector3<f64>),
    By(Vector3<f64>),
    Along(Direction, f64),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Rotation {
    Stay,
    To(Matrix3<f64>),
    About(Direction, f64),
}

/// One piece of the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// s of the path's own clock.
    pub duration_s: f64,
    translation: Translation,
    rotation: Rotation,
    shape: scenario::Path,
    /// The horizon of a steered run: a constant twist from the leg's start on.
    steady: bool,
    /// Place of the singularity whose ζ is turned, and by how much, rad.
    pub reorient: Option<(usize, f64)>,
    /// Posture to leave a Type 1 singularity in: −1, +1, or 0 to keep.
    pub branch: i32,
}

impl Leg {
    /// Whether its goal depends on a singular direction at the moment when it begins.
    #[must_use]
    pub fn is_relative(&self) -> bool {
        self.reorient.is_some()
            || matches!(self.translation, Translation::Along(Direction::Zeta(_), _))
            || matches!(self.rotation, Rotation::About(Direction::Zeta(_), _))
    }
}

/// The whole task.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    legs: Vec<Leg>,
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
    pub by: Vector3<f64>,
    /// Rotation vector over the leg, rad.
    pub turn: Vector3<f64>,
}

impl Progress {
    /// At the beginning, at rest in `X_BE`.
    #[must_use]
    pub fn at(X_BE: Pose) -> Self {
        Self {
            start: X_BE,
            ..Self::default()
        }
    }

    /// The pose at the leg's end.
    #[must_use]
    pub fn goal(&self) -> Pose {
        Pose {
            R: rotation_exp(&self.turn) * self.start.R,
            p: self.start.p + self.by,
        }
    }
}

/// The rest of a leg, as a path in space without time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ahead {
    progress: Progress,
    p_E: Vector3<f64>,
    from: f64,
    to: f64,
}

impl Ahead {
    /// The pose of the point at `share` of what is left, 0 to 1.
    #[must_use]
    pub fn pose(&self, share: f64) -> Pose {
        let x = self.from + share * (self.to - self.from);
        let R = rotation_exp(&(self.progress.turn * x)) * self.progress.start.R;
        Pose {
            R,
            p: self.progress.start.p + self.progress.by * x + R * self.p_E,
        }
    }
}

impl Path {
    /// The path of a scenario, with directions at the start of the run taken from `report`, the analysis of the start posture.
    ///
    /// # Errors
    /// [`PathError`] for a direction or a singularity that does not exist.
    pub fn new<const N: usize>(scenario: &Scenario, report: &Report<N>) -> Result<Self, PathError> {
        if scenario.servo.is_some() {
            let horizon = scenario::Segment {
                duration_s: HORIZON_S,
                ..Default::default()
            };
            return Ok(Self {
                legs: vec![Leg {
                    steady: true,
                    ..leg(0, &horizon, report)?
                }],
            });
        }
        let legs = scenario
            .segment
            .iter()
            .enumerate()
            .map(|(i, segment)| leg(i, segment, report));
        Ok(Self {
            legs: legs.collect::<Result<_, _>>()?,
        })
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
            let turn = match leg.rotation {
                Rotation::To(_) if has_free_axis => Vector3::zeros(),
                _ => place.turn,
            };
            let way = stack(&place.by, &turn);
            let unserved = (0..6).find(|i| !task[*i] && way[*i].abs() > ROUNDING);
            if let Some(i) = unserved.filter(|_| !leg.is_relative()) {
                let axis = MOTIONS[i];
                return Err(PathError::Unserved { segment, axis });
            }
            self.advance(&mut place, leg.duration_s, report);
        }
        Ok(())
    }

    /// The leg at this index, while the path lasts.
    #[must_use]
    pub fn leg(&self, index: usize) -> Option<&Leg> {
        self.legs.get(index)
    }

    /// The time that all legs take by the path's clock, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.legs.iter().map(|leg| leg.duration_s).sum()
    }

    /// Moves the clock on by `dt_s` and settles the goal of a leg that begins.
    ///
    /// Ensures `progress.begun` while a leg is left. `report` is the analysis of the present posture.
    pub fn advance<const N: usize>(&self, progress: &mut Progress, dt_s: f64, report: &Report<N>) {
        progress.time_s += dt_s;
        while let Some(leg) = self.legs.get(progress.leg) {
            if !progress.begun {
                progress.begun = true;
                progress.by = match leg.translation {
                    Translation::Stay => Vector3::zeros(),
                    Translation::To(p) => p - progress.start.p,
                    Translation::By(by) => by,
                    Translation::Along(direction, distance) => direction.resolve(report) * distance,
                };
                progress.turn = match leg.rotation {
                    Rotation::Stay => Vector3::zeros(),
                    Rotation::To(R) => rotation_log(&(R * progress.start.R.transpose())),
                    Rotation::About(direction, angle) => direction.resolve(report) * angle,
                };
            }
            if progress.time_s < leg.duration_s {
                return;
            }
            if leg.shape == scenario::Path::Line {
                progress.start = progress.goal();
            }
            progress.time_s -= leg.duration_s;
            progress.leg += 1;
            progress.begun = false;
            (progress.by, progress.turn) = (Vector3::zeros(), Vector3::zeros());
        }
    }

    /// Fraction of the present leg's way, its rate and acceleration, per unit of the path's clock.
    #[must_use]
    pub fn fraction(&self, progress: &Progress) -> [f64; 3] {
        let Some(leg) = self.legs.get(progress.leg) else {
            return [0.0; 3];
        };
        let T = leg.duration_s;
        match leg.shape {
            scenario::Path::Line if leg.steady => {
                [(progress.time_s / T).clamp(0.0, 1.0), 1.0 / T, 0.0]
            }
            scenario::Path::Line => quintic(progress.time_s, T),
            scenario::Path::ThereAndBack if progress.time_s < 0.5 * T => {
                quintic(progress.time_s, 0.5 * T)
            }
            scenario::Path::ThereAndBack => {
                let [x, v, a] = quintic(progress.time_s - 0.5 * T, 0.5 * T);
                [1.0 - x, -v, -a]
            }
        }
    }

    /// Fraction of the present leg's time law from 0 to 1, whatever the shape of its way: for what goes along with it.
    #[must_use]
    pub fn ramp(&self, progress: &Progress) -> f64 {
        self.legs
            .get(progress.leg)
            .map_or(1.0, |leg| quintic(progress.time_s, leg.duration_s)[0])
    }

    /// The rest of the present leg, for a point fixed at `p_E` in the end-effector.
    #[must_use]
    pub fn ahead(&self, progress: &Progress, p_E: Vector3<f64>) -> Ahead {
        let [x, v, _] = self.fraction(progress);
        Ahead {
            progress: *progress,
            p_E,
            from: x,
            to: if v < 0.0 { 0.0 } else { 1.0 },
        }
    }

    /// Desired motion of E, where the clock runs at `rate` and changes at `rate_dot` (1/s).
    #[must_use]
    pub fn desired(&self, progress: &Progress, rate: f64, rate_dot: f64) -> PoseMotion {
        self.place(progress).moving(rate, rate_dot)
    }

    /// The place on the path where the clock is.
    #[must_use]
    #[inline]
    pub fn place(&self, progress: &Progress) -> Place {
        let fraction = self.fraction(progress);
        let [x, ..] = fraction;
        let Progress { by, turn, .. } = *progress;
        Place {
            R: rotation_exp(&(turn * x)) * progress.start.R,
            p: progress.start.p + by * x,
            by,
            turn,
            fraction,
        }
    }
}

/// A place on the path: E's desired pose there, and where the present leg leads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    R: Matrix3<f64>,
    p: Vector3<f64>,
    by: Vector3<f64>,
    turn: Vector3<f64>,
    fraction: [f64; 3],
}

impl Place {
    /// Desired motion of E here, where the clock runs at `rate` and changes at `rate_dot` (1/s).
    #[must_use]
    #[inline]
    pub fn moving(&self, rate: f64, rate_dot: f64) -> PoseMotion {
        let [_, v, a] = self.fraction;
        let (xdot, xddot) = (v * rate, a * rate * rate + v * rate_dot);
        PoseMotion {
            R: self.R,
            p: self.p,
            V: stack(&(self.by * xdot), &(self.turn * xdot)),
            a: stack(&(self.by * xddot), &(self.turn * xddot)),
        }
    }
}

/// Quintic time law: position, velocity, acceleration of x(t) = 10τ³ − 15τ⁴ + 6τ⁵, τ = t/T; at rest at both ends.
#[must_use]
pub fn quintic(t: f64, T: f64) -> [f64; 3] {
    let x = (t / T).clamp(0.0, 1.0);
    [
        x * x * x * (10.0 + x * (-15.0 + 6.0 * x)),
        30.0 * x * x * (1.0 - x) * (1.0 - x) / T,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (T * T),
    ]
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
    } else if let Some([w, x, y, z]) = segment.quaternion {
        Rotation::To(
            UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
                .to_rotation_matrix()
                .into_inner(),
        )
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
        shape: segment.path,
        steady: false,
        reorient,
        branch: segment.branch,
    })
}

fn direction<const N: usize>(
    segment: usize,
    text: &str,
    report: &Report<N>,
) -> Result<Direction, PathError> {
    match text {
        "x" => return Ok(Direction::Fixed(Vector3::x())),
        "y" => return Ok(Direction::Fixed(Vector3::y())),
        "z" => return Ok(Direction::Fixed(Vector3::z())),
        _ => {}
    }
    let name = text
        .strip_prefix("zeta:")
        .ok_or_else(|| PathError::Direction {
            segment,
            direction: text.to_owned(),
        })?;
    match name.strip_suffix("@start") {
        Some(name) => Ok(Direction::Fixed(
            report.singularities[place(segment, name, report)?].axis(),
        )),
        None => Ok(Direction::Zeta(place(segment, name, report)?)),
    }
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
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_quintic_is_its_own_derivative(t in 0.01..1.99_f64) {
            let h = 1e-5;
            let [x0, v0, _] = quintic(t - h, 2.0);
            let [x1, v1, _] = quintic(t + h, 2.0);
            let [_, v, a] = quintic(t, 2.0);
            prop_assert!(((x1 - x0) / (2.0 * h) - v).abs() < 1e-7);
            prop_assert!(((v1 - v0) / (2.0 * h) - a).abs() < 1e-7);
        }

        #[test]
        fn desired_motion_is_consistent_at_any_clock_speed(t in 0.1..1.9_f64, rate in 0.1..1.0_f64) {
            let segment = scenario::Segment {
                duration_s: 2.0,
                by_m: Some([0.1, -0.2, 0.05]),
                turn: Some(scenario::Turn { about: "y".into(), by_deg: 120.0 }),
                ..Default::default()
            };
            let report = crate::testing::empty_report::<6>();
            let path = Path { legs: vec![leg(0, &segment, &report).unwrap()] };
            let at = |t: f64| {
                let mut progress = Progress::at(Pose::identity());
                path.advance(&mut progress, t, &report);
                path.desired(&progress, rate, 0.0)
            };
            let h = 1e-5;
            let (before, now, after) = (at(t - h * rate), at(t), at(t + h * rate));
            let v = (after.p - before.p) / (2.0 * h);
            let w = rotation_log(&(after.R * before.R.transpose())) / (2.0 * h);
            prop_assert!((stack(&v, &w) - now.V).amax() < 1e-6);
            prop_assert!(((after.V - before.V) / (2.0 * h) - now.a).amax() < 1e-6);
        }
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
        };
        let mut progress = Progress::at(Pose::identity());
        path.advance(&mut progress, 0.5, &report);
        assert!((path.desired(&progress, 1.0, 0.0).p.x - 0.1).abs() < 1e-12);
        path.advance(&mut progress, 0.6, &report);
        assert_eq!(progress.leg, 1);
        assert!(path.desired(&progress, 1.0, 0.0).p.norm() < 1e-12);
    }
}
