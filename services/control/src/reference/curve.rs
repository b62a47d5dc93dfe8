//! Curves: whatever a scenario writes becomes samples of poses over s from 0 to 1, and a smooth curve through them.
//!
//! A curve is a cubic spline of seven coordinates, position and quaternion: twice continuously differentiable, of one evaluator, and without a
//! special case at any sign or turn of the quaternion, which is normalised where the curve is evaluated. The clock that runs along s is the leg's
//! ([`path`](super::path)).

use crate::linear::{Matrix3, Vector3, Vector6, rotation_exp, rotation_log, rotation_of, stack};
use model::Pose;
use nalgebra::{Quaternion, Rotation3, SVector, UnitQuaternion};
use shared_types::pose_table::Row;
use shared_types::scenario::{Frame, Points};
use std::cmp::Ordering;

/// Largest turn between two samples of a line or an arc, rad: the spline through them deviates by less than a millionth of the radius.
const FINE: f64 = 0.05;
/// Samples of a rounded corner.
const CORNER: u32 = 24;
/// Shortest time between two knots of a table, s: rows that lie closer are smoothed, so that rounded decimals are no accelerations.
pub(super) const KNOTS_S: f64 = 0.02;
/// Rounding of corners, if none is stated, m.
const BLEND_M: f64 = 0.01;
/// Length that a turn of one radian counts as, m, where way points are timed.
const TURN_M: f64 = 0.2;
/// Shortest quaternion half-way between samples.
const SHORTEST: f64 = 0.7;

type Vector7 = SVector<f64, 7>;

/// A pose at a share of the curve.
pub(super) type Sample = (f64, Pose);

/// A smooth curve in space.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Curve {
    /// Where each piece begins, and the last one ends.
    knots: Vec<f64>,
    /// Coefficients of x⁰ to x³, x from 0 to 1 in each piece: position, and quaternion w, x, y, z.
    pieces: Vec<[Vector7; 4]>,
}

/// A place on a curve: the pose and its derivatives by s, in base axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    pub(super) pose: Pose,
    pub(super) slope: Vector6,
    pub(super) bend: Vector6,
}

/// Why there is no smooth curve through the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum CurveError {
    /// Two of them coincide, or turn by half a turn: the index of the second.
    Sample(usize),
    /// The curve stays off this one by m, rad.
    Off(usize, f64, f64),
}

impl Curve {
    /// The spline through samples, knots at least `apart` from each other; within `bound_m` (and as many rad) of all that lie between. At its ends it
    /// `rests`, or goes on as further inside.
    pub(super) fn through(
        samples: &[Sample],
        apart: f64,
        bound_m: f64,
        rests: bool,
    ) -> Result<Self, CurveError> {
        let mut last = coordinates(&samples[0].1);
        let mut rows: Vec<(f64, Vector7)> = Vec::with_capacity(samples.len().max(4));
        for (s, pose) in samples {
            let mut row = coordinates(pose);
            if row.fixed_rows::<4>(3).dot(&last.fixed_rows::<4>(3)) < 0.0 {
                row.fixed_rows_mut::<4>(3).neg_mut();
            }
            rows.push((*s, row));
            last = row;
        }
        if let Some(i) = (1..rows.len())
            .find(|i| rows[*i].0.partial_cmp(&rows[i - 1].0) != Some(Ordering::Greater))
        {
            return Err(CurveError::Sample(i));
        }
        if rows.len() < 4 && !rests {
            rows = completed(&rows);
        }
        let curve = spline(&rows, apart, rests);
        let middle = |pair: &[f64]| {
            curve
                .value(0.5 * (pair[0] + pair[1]))
                .fixed_rows::<4>(3)
                .norm()
        };
        if let Some(i) = curve
            .knots
            .windows(2)
            .position(|pair| middle(pair) < SHORTEST)
        {
            return Err(CurveError::Sample(i + 1));
        }
        let off = |(s, pose): &Sample| {
            let at = curve.at(*s).pose;
            (
                (at.p - pose.p).norm(),
                rotation_log(&(at.R * pose.R.transpose())).norm(),
            )
        };
        let offs = samples.iter().map(off).enumerate();
        let worst = offs.max_by(|(_, a), (_, b)| a.0.max(a.1).total_cmp(&b.0.max(b.1)));
        match worst {
            Some((i, (m, rad))) if m.max(rad) > bound_m => Err(CurveError::Off(i, m, rad)),
            _ => Ok(curve),
        }
    }

    /// The seven coordinates.
    fn value(&self, s: f64) -> Vector7 {
        let (piece, x, _) = self.piece(s);
        let [a, b, c, d] = piece;
        a + (b + (c + d * x) * x) * x
    }

    fn piece(&self, s: f64) -> (&[Vector7; 4], f64, f64) {
        let last = self.pieces.len() - 1;
        let i = self.knots.partition_point(|knot| *knot <= s);
        let i = i.saturating_sub(1).min(last);
        let per = 1.0 / (self.knots[i + 1] - self.knots[i]);
        (&self.pieces[i], (s - self.knots[i]) * per, per)
    }

    /// The place at s, 0 to 1. Cost about 0.1 µs, no allocation
    pub(super) fn at(&self, s: f64) -> Point {
        let ([a, b, c, d], x, per) = self.piece(s);
        let value = a + (b + (c + d * x) * x) * x;
        let slope = (b + (c * 2.0 + d * (3.0 * x)) * x) * per;
        let bend = (c * 2.0 + d * (6.0 * x)) * (per * per);
        let half = |v: &Vector7| Quaternion::new(v[3], v[4], v[5], v[6]);
        let (q, dq, ddq) = (half(&value), half(&slope), half(&bend));
        // With w = q̇q⁻¹ = (a, v): ω = 2v, and ω̇ = 2·vec(q̈q⁻¹ − w²) with vec(w²) = 2av. The norm of q does not count.
        let inverse = q.conjugate() / q.norm_squared();
        let (w, z) = (dq * inverse, ddq * inverse);
        let alpha = (z.imag() - w.imag() * (2.0 * w.scalar())) * 2.0;
        let part = |v: &Vector7| Vector3::new(v[0], v[1], v[2]);
        Point {
            pose: Pose {
                R: UnitQuaternion::from_quaternion(q)
                    .to_rotation_matrix()
                    .into_inner(),
                p: part(&value),
            },
            slope: stack(&part(&slope), &(w.imag() * 2.0)),
            bend: stack(&part(&bend), &alpha),
        }
    }

    /// The places at which its pieces begin, and its end.
    pub(super) fn places(&self) -> impl Iterator<Item = Point> {
        self.knots.iter().map(|s| self.at(*s))
    }
}

fn coordinates(pose: &Pose) -> Vector7 {
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(pose.R));
    let (p, q) = (pose.p, q.quaternion());
    Vector7::from([p.x, p.y, p.z, q.w, q.i, q.j, q.k])
}

/// Two or three samples, and others on the line or parabola through them.
fn completed(rows: &[(f64, Vector7)]) -> Vec<(f64, Vector7)> {
    let (from, to) = (rows[0].0, rows[rows.len() - 1].0);
    let lagrange = |s: f64| {
        let weight = |i: usize| {
            let others = rows.iter().enumerate().filter(|(j, _)| *j != i);
            others.fold(1.0, |w, (_, (at, _))| w * (s - at) / (rows[i].0 - at))
        };
        (0..rows.len()).fold(Vector7::zeros(), |sum, i| sum + rows[i].1 * weight(i))
    };
    (0..=6)
        .map(|k| from + (to - from) * f64::from(k) / 6.0)
        .map(|s| (s, lagrange(s)))
        .collect()
}

/// The cubic spline through rows whose knots lie at least `apart`, by least squares where rows lie between them. At its ends it `rests`; else it has no
/// knots at the second and the second last one ("not a knot"), and there are at least four rows.
fn spline(rows: &[(f64, Vector7)], apart: f64, rests: bool) -> Curve {
    let end = rows[rows.len() - 1].0;
    let mut knots = vec![rows[0].0];
    for (s, _) in &rows[1..rows.len() - 1] {
        if s - knots[knots.len() - 1] >= apart && end - s >= apart {
            knots.push(*s);
        }
    }
    knots.push(end);
    let bare = if rests { 1 } else { 2 };
    let inner = knots.get(bare..knots.len().saturating_sub(bare));
    let inner = inner.unwrap_or_default().iter().copied();
    let ends = |s: f64| [s; 4].into_iter();
    let all: Vec<f64> = ends(knots[0]).chain(inner).chain(ends(end)).collect();
    let count = all.len() - 4;
    // A spline rests where its first two weights, and its last two, are the same.
    let weight = |i: usize| {
        if rests {
            i.saturating_sub(1).min(count - 3)
        } else {
            i
        }
    };
    // Normal equations, of which four diagonals are not zero.
    let free = weight(count - 1) + 1;
    let mut band = vec![[0.0; 4]; free];
    let mut right = vec![Vector7::zeros(); free];
    for (s, row) in rows {
        let span = (all.partition_point(|knot| knot <= s) - 1).clamp(3, count - 1);
        let (first, basis) = (weight(span - 3), basis(&all, *s, span));
        let mut merged = [0.0; 4];
        (0..4).for_each(|i| merged[weight(span - 3 + i) - first] += basis[i]);
        for i in (0..4).filter(|i| first + i < free) {
            for j in i..4 {
                band[first + i][j - i] += merged[i] * merged[j];
            }
            right[first + i] += row * merged[i];
        }
    }
    let weights = solved(band, right);
    let value = |s: f64, span: usize| {
        let basis = basis(&all, s, span);
        (0..4).fold(Vector7::zeros(), |sum, i| {
            sum + weights[weight(span - 3 + i)] * basis[i]
        })
    };
    let mut curve = Curve {
        knots: vec![knots[0]],
        pieces: vec![],
    };
    for span in 3..count {
        let (from, to) = (all[span], all[span + 1]);
        let at = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0].map(|x| value(from + (to - from) * x, span));
        curve.pieces.push(cubic(&at));
        curve.knots.push(to);
    }
    curve
}

/// The coefficients of a cubic from its values at 0, 1/3, 2/3 and 1.
fn cubic([a, b, c, d]: &[Vector7; 4]) -> [Vector7; 4] {
    [
        *a,
        (a * -11.0 + b * 18.0 + c * -9.0 + d * 2.0) * 0.5,
        (a * 18.0 + b * -45.0 + c * 36.0 + d * -9.0) * 0.5,
        (a * -9.0 + b * 27.0 + c * -27.0 + d * 9.0) * 0.5,
    ]
}

/// The four cubic B-splines that are not zero in a span of the knots, at s: Cox's and de Boor's recursion.
fn basis(knots: &[f64], s: f64, span: usize) -> [f64; 4] {
    let mut out = [1.0, 0.0, 0.0, 0.0];
    for degree in 1..4 {
        let mut saved = 0.0;
        for i in 0..degree {
            let (right, left) = (knots[span + 1 + i], knots[span + 1 + i - degree]);
            let share = out[i] / (right - left);
            out[i] = saved + (right - s) * share;
            saved = (s - left) * share;
        }
        out[degree] = saved;
    }
    out
}

/// The solution of a symmetric positive definite system, given by its diagonals from the main one up.
fn solved(mut band: Vec<[f64; 4]>, mut right: Vec<Vector7>) -> Vec<Vector7> {
    let count = band.len();
    for i in 0..count {
        for d in 1..4.min(count - i) {
            let factor = band[i][d] / band[i][0];
            for e in d..4.min(count - i) {
                band[i + d][e - d] -= factor * band[i][e];
            }
            let row = right[i];
            right[i + d] -= row * factor;
        }
    }
    for i in (0..count).rev() {
        let known =
            (1..4.min(count - i)).fold(Vector7::zeros(), |sum, d| sum + right[i + d] * band[i][d]);
        right[i] = (right[i] - known) / band[i][0];
    }
    right
}

/// The pose that a position and a quaternion of a scenario mean in a frame, from the pose at the segment's start.
fn placed(frame: Frame, start: &Pose, p: Vector3, q: Option<&[f64; 4]>) -> Pose {
    let R = q.map_or_else(Matrix3::identity, |q| rotation_of(*q));
    match frame {
        Frame::Base | Frame::World => Pose {
            R: if q.is_some() { R } else { start.R },
            p,
        },
        Frame::Start => Pose {
            R: R * start.R,
            p: start.p + p,
        },
        Frame::Tool => Pose {
            R: start.R * R,
            p: start.p + start.R * p,
        },
    }
}

/// The poses that a segment's points mean, its start first.
pub(super) fn poses(points: &Points, start: &Pose) -> Vec<Pose> {
    let turn = |i: usize| points.quaternions.get(i);
    let given = points.points_m.iter().enumerate();
    let given = given.map(|(i, p)| placed(points.frame, start, (*p).into(), turn(i)));
    [*start].into_iter().chain(given).collect()
}

/// How far two poses lie apart, a turn counted as a length, m.
fn apart(a: &Pose, b: &Pose) -> f64 {
    let turn = rotation_log(&(b.R * a.R.transpose())).norm();
    (b.p - a.p).norm().max(TURN_M * turn)
}

/// Poses over the length of the way along them, as a share of all.
pub(super) fn by_length(poses: &[Pose]) -> Vec<Sample> {
    let mut length = 0.0;
    let mut before = &poses[0];
    let mut samples: Vec<Sample> = vec![];
    for pose in poses {
        length += apart(before, pose);
        samples.push((length, *pose));
        before = pose;
    }
    samples.iter_mut().for_each(|(s, _)| *s /= length);
    samples
}

/// Straight lines from pose to pose with rounded corners.
///
/// In a corner the direction goes from that of the one line, u, to that of the next, w, by a smoothstep over as much of the length as the round
/// takes of both lines: with c the corner, p = c + u·a + w·b, a′ = 1 − b′ and b′ = 3σ² − 2σ³. So do the turns. The second derivative is
/// continuous everywhere.
pub(super) fn rounded(poses: &[Pose], blend_m: Option<f64>) -> Vec<Sample> {
    let lines: Vec<(f64, Vector3, Vector3)> = poses
        .windows(2)
        .map(|pair| {
            let length = apart(&pair[0], &pair[1]).max(f64::MIN_POSITIVE);
            let turn = rotation_log(&(pair[1].R * pair[0].R.transpose()));
            (length, (pair[1].p - pair[0].p) / length, turn / length)
        })
        .collect();
    let blend = |i: usize| {
        let stated = blend_m.unwrap_or(BLEND_M);
        let shorter = lines[i].0.min(lines[i + 1].0);
        stated.min(0.5 * shorter)
    };
    let mut samples = vec![(0.0, poses[0])];
    let (mut at, mut left_off) = (0.0, 0.0);
    for (i, (length, along, turn)) in lines.iter().enumerate() {
        let is_last = i + 1 == lines.len();
        let reach = if is_last { 0.0 } else { blend(i) };
        let straight = length - left_off - reach;
        let count = (turn.norm() * straight / FINE).ceil().max(4.0) as u32;
        for k in (1..=count).filter(|_| straight > 1e-9 * length) {
            let way = left_off + straight * f64::from(k) / f64::from(count);
            let R = rotation_exp(&(turn * way)) * poses[i].R;
            let p = poses[i].p + along * way;
            samples.push((at + way, Pose { R, p }));
        }
        if !is_last {
            let (_, next_along, next_turn) = lines[i + 1];
            for k in 1..=CORNER {
                let x = f64::from(k) / f64::from(CORNER);
                let b = 2.0 * reach * x * x * x * (1.0 - 0.5 * x);
                let a = 2.0 * reach * x - reach - b;
                let turned = rotation_exp(&(next_turn * b)) * rotation_exp(&(turn * a));
                let R = turned * poses[i + 1].R;
                let p = poses[i + 1].p + along * a + next_along * b;
                samples.push((at + length - reach + 2.0 * reach * x, Pose { R, p }));
            }
        }
        (at, left_off) = (at + length, reach);
    }
    samples.iter_mut().for_each(|(s, _)| *s /= at);
    samples
}

/// An arc about a unit vector in base axes.
///
/// # Errors
/// The radius at which it begins, m, where it has none there or at its end.
pub(super) fn arc(
    arc: &shared_types::scenario::Arc,
    axis: &Vector3,
    start: &Pose,
) -> Result<Vec<Sample>, f64> {
    let centre = placed(arc.frame, start, arc.centre_m.into(), None).p;
    let from = start.p - centre;
    let radial = from - axis * from.dot(axis);
    let (foot, radius) = (start.p - radial, radial.norm());
    if radius < 1e-6 || radius + arc.grow_m <= 0.0 {
        return Err(radius);
    }
    let angle = arc.by_deg.to_radians();
    let count = (angle.abs() / FINE).ceil().max(8.0) as u32;
    let sample = |k: u32| {
        let s = f64::from(k) / f64::from(count);
        let turn = rotation_exp(&(axis * (angle * s)));
        let size = 1.0 + arc.grow_m / radius * s;
        let p = foot + axis * (arc.rise_m * s) + turn * radial * size;
        let R = if arc.turn_hand {
            turn * start.R
        } else {
            start.R
        };
        (s, Pose { R, p })
    };
    Ok((0..=count).map(sample).collect())
}

/// The poses of a table, over its time as a share of all.
pub(super) fn of_rows(rows: &[Row], frame: Frame, start: &Pose) -> Vec<Sample> {
    let pose = |row: &Row| placed(Frame::Base, start, row.p_m.into(), Some(&row.quaternion));
    let (first, from_s) = (pose(&rows[0]), rows[0].t_s);
    let all_s = rows[rows.len() - 1].t_s - from_s;
    let moved = |X: Pose| match frame {
        Frame::Base | Frame::World => X,
        Frame::Start => Pose {
            R: X.R * first.R.transpose() * start.R,
            p: start.p + X.p - first.p,
        },
        Frame::Tool => *start * (first.inverse() * X),
    };
    rows.iter()
        .map(|row| ((row.t_s - from_s) / all_s, moved(pose(row))))
        .collect()
}

/// Speed at the first or the last of the samples, m/s and rad/s per s, by the parabola through it and two that lie at least `apart` and twice as far;
/// `None` where it is less than a third of that between these two, as after a start from rest.
pub(super) fn end_speed(samples: &[Sample], apart: f64, is_last: bool) -> Option<(f64, f64)> {
    let nth = |k: usize| samples[if is_last { samples.len() - 1 - k } else { k }];
    let beyond = |from: f64| {
        let far = |k: &usize| (nth(*k).0 - from).abs() >= apart;
        (1..samples.len()).find(far).map(nth)
    };
    let one = nth(0);
    let two = beyond(one.0).filter(|two| two.0 != one.0)?;
    let after = |k: &usize| {
        let s = (nth(*k).0 - one.0).abs();
        s > (two.0 - one.0).abs() && s >= 2.0 * apart
    };
    let three = (1..samples.len()).find(after).map(nth)?;
    let rate = |a: &Sample, b: &Sample| {
        let turn = rotation_log(&(b.1.R * a.1.R.transpose()));
        stack(&(b.1.p - a.1.p), &turn) / (b.0 - a.0)
    };
    let (near, far) = (rate(&one, &two), rate(&two, &three));
    let share = (two.0 - one.0) / (three.0 - one.0);
    let end = near - (far - near) * share;
    let norms = |V: &Vector6| (V.fixed_rows::<3>(0).norm(), V.fixed_rows::<3>(3).norm());
    let ((v, w), (far_v, far_w)) = (norms(&end), norms(&far));
    let is_moving = 3.0 * v > far_v || 3.0 * w > far_w;
    is_moving.then_some((
        if 3.0 * v > far_v { v } else { 0.0 },
        if 3.0 * w > far_w { w } else { 0.0 },
    ))
}
