//! The wrist of an arm whose last two axes meet at a right angle: measure, and the direction of ζ from the desired direction of the last axis.
//!
//! In the terms of a PUMA: z4 is the axis with which z6 is parallel at the singularity. On an arm of parallel axes it is their direction n.

use super::family::{Posture, Situation};
use crate::linear::{angular, stack, wrap_line};
use crate::paper::reference::Memory;
use crate::paper::type_2::Direction;
use crate::types::{Class, Kind, Singularity};
use model::Terms;
use nalgebra::{Matrix3, SVector, Vector2, Vector3};

/// Damping on the sine of the desired wrist angle, a hundred times encoder noise.
pub(super) const MU: f64 = 0.02;

/// Closest approach to the singularity below which it is passed through with ζ off the direction of travel, rad: the orientation error that costs.
const PASS: f64 = 0.004;

/// Sine of the desired wrist angle below which passing through may begin.
const NEAR: f64 = 0.22;

/// Speed of the desired direction below which it is not going anywhere, rad/s.
const MOVING: f64 = 0.01;

/// Without a governor: predicted rate over the largest one above which the singularity is passed through.
const PASS_RATIO: f64 = 1.8;

/// Distance that passing through keeps from the limits of the joint that turns ζ, rad.
const MARGIN: f64 = 0.02;

/// Squared length of a segment below which it counts as a point; rounding of unit vectors squared is 1e-32.
const SEGMENT_MIN: f64 = 1e-18;

/// Wrist: the end-effector cannot turn about n = z4×z5 when z6 is parallel to z4 (of a spherical wrist, whose axes are the last three).
///
/// z6 = c5 z4 + (n·z6) n, so with φ̇ = z4·ω₄ and the turn about z4 kept, nᵀω = −(n·z6/c5)·φ̇ modulo the other rows. Type 2: φ only turns ζ.
#[inline]
pub(super) fn measure<const N: usize>(at: &Posture<'_, N>) -> Singularity<N> {
    let forearm = N - 3;
    let [z4, z5, z6] = [at.terms.z[forearm], at.terms.z[N - 2], at.terms.z[N - 1]];
    let n = z4.cross(&z5);
    // sin q5 = −n·z6, whatever the zero of joint 5.
    let (sin, cos) = (-n.dot(&z6), z4.dot(&z6));
    let c5 = if cos.abs() > 0.1 {
        cos
    } else {
        0.1_f64.copysign(cos)
    };
    Singularity {
        kind: Kind::Wrist,
        class: Class::Type2,
        angular: true,
        s: sin,
        s_rate: cos * at.qdot[N - 2],
        zeta_B: stack(&Vector3::zeros(), &n),
        R_BS: Matrix3::from_columns(&[n, z4, z5]),
        gain: sin / c5,
        aux: at.q[forearm],
        aux_rate: z4.dot(&at.terms.omega[forearm]),
        aux_bias: z4.dot(&at.terms.alpha_bias[forearm]),
        aux_row: SVector::from_fn(|i, _| {
            if i <= forearm {
                z4.dot(&at.terms.z[i])
            } else {
                0.0
            }
        }),
        kappa_2: 1.0,
        ..Singularity::none()
    }
}

/// A wrist: the three axes, and what moves the first of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wrist {
    pub(super) z4: Vector3<f64>,
    pub(super) z5: Vector3<f64>,
    pub(super) z6: Vector3<f64>,
    /// Planned change of z4, 1/s.
    pub(super) z4_rate: Vector3<f64>,
    /// Planned φ̇ while the joint that φ counts from stands still, rad/s.
    pub(super) carried: f64,
    /// Joints that turn with ζ, and against it; the first none where several share the turn.
    pub(super) joints: (Option<usize>, usize),
}

impl Wrist {
    /// A spherical wrist: the last three axes.
    pub(super) fn spherical<const N: usize>(
        terms: &Terms<N>,
        qdot_planned: &SVector<f64, N>,
    ) -> Self {
        let (z, forearm) = (&terms.z, N - 3);
        let z4 = z[forearm];
        let omega = (0..forearm).fold(Vector3::zeros(), |omega, i| omega + z[i] * qdot_planned[i]);
        Self {
            z4,
            z5: z[N - 2],
            z6: z[N - 1],
            z4_rate: omega.cross(&z4),
            carried: z4.dot(&omega),
            joints: (Some(forearm), N - 1),
        }
    }

    /// Whether the joints have room for ζ to turn so far.
    fn fits<const N: usize>(&self, turn: f64, at: &Situation<'_, N>) -> bool {
        let inside = |i: usize, by: f64| at.q[i] + by > at.lower[i] && at.q[i] + by < at.upper[i];
        self.joints.0.is_none_or(|i| inside(i, turn))
            && inside(self.joints.1, -turn.copysign(turn * self.z4.dot(&self.z6)))
    }

    /// The same line reached the other way round, where the joints allow only that.
    fn within_limits<const N: usize>(&self, error: f64, at: &Situation<'_, N>) -> f64 {
        let other = error - std::f64::consts::PI.copysign(error);
        if !self.fits(error, at) && self.fits(other, at) {
            other
        } else {
            error
        }
    }
}

/// z5 → ±z4×z6_d: with z5 there, a turn of joint 5 alone reaches z6_d.
///
/// With w = z4×z6_d, |w| the sine of the desired wrist angle: e = angle from z5 to the line of w, weighted by |w|²/(|w|² + μ²);
/// φ̇_ff = z4·(w×ẇ)/(|w|² + μ²). Passing: z5 is held in the forearm along the direction in which w will pass the singularity, so that z6 travels in the
/// plane normal to z5; done where w passes so near that the error this makes is negligible, and where joint 4 has not the room to follow.
///
/// `bend_at(p, z6_d)` gives w in the forearm's own plane for C at `p`, on the side where the arm is.
pub(super) fn direction<const N: usize>(
    wrist: &Wrist,
    s: &Singularity<N>,
    at: &Situation<'_, N>,
    memory: &mut Memory,
    bend_at: impl Fn(&Vector3<f64>, &Vector3<f64>) -> Vector2<f64>,
) -> Direction {
    let Wrist {
        z4, z5, z4_rate, ..
    } = *wrist;
    let z6_E = at.terms.X_BE.R.transpose() * wrist.z6;
    let z6_d = at.desired.R * z6_E;
    let w = z4.cross(&z6_d);
    let size = w.norm_squared();
    let tracked = line_angle(&z5, &w, &z4);
    let rate_of = |omega_d: Vector3<f64>| {
        let rate = z4_rate.cross(&z6_d) + z4.cross(&omega_d.cross(&z6_d));
        rate - z4 * z4.dot(&rate)
    };
    let w_rate = rate_of(angular(&at.desired.V));
    let approaching = w.dot(&w_rate) < 0.0;
    let turning = z4.dot(&w.cross(&w_rate));
    let near = size < NEAR * NEAR && s.s.abs() < s.eta_out;
    if !memory.passing && approaching && w_rate.norm() > MOVING && near {
        let outlook = Outlook::along(at, &z6_E, bend_at);
        let worst = rate_of(angular(at.V_nominal)).norm() / outlook.miss.max(1e-9);
        let hasty = !at.governed && worst > PASS_RATIO * at.rate_max;
        let room = wrist.joints.0.is_none_or(|i| {
            let there = at.q[i] + tracked;
            there + outlook.lowest > at.lower[i] + MARGIN
                && there + outlook.highest < at.upper[i] - MARGIN
        });
        memory.passing = outlook.miss < PASS || hasty || !room;
        memory.passage = s.aux + tracked + outlook.crossing;
    } else if memory.passing
        && (!approaching && turning.abs() < 0.7 * at.rate_max * size
            || w_rate.norm() < 0.3 * MOVING)
    {
        memory.passing = false;
    }
    memory.holding = size < MU * MU * if memory.holding { 4.0 } else { 1.0 };
    let (error, rate, weight) = if memory.passing {
        (wrap_line(memory.passage - s.aux), wrist.carried, 1.0)
    } else {
        (tracked, turning / (size + MU * MU), size / (size + MU * MU))
    };
    let error = wrist.within_limits(error, at);
    Direction {
        error,
        rate,
        weight,
        passing: memory.passing,
        holding: memory.holding,
        clipped: false,
    }
}

/// How the rest of the leg passes the singularity, seen from the forearm: w as a polygon in the plane normal to z4.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Outlook {
    /// Closest approach, rad.
    miss: f64,
    /// Direction of w there, as a turn of the line from where it is now, rad.
    crossing: f64,
    /// Smallest turn of w's direction from now on, rad.
    lowest: f64,
    /// Largest one, rad.
    highest: f64,
}

impl Outlook {
    /// Sides of the polygon.
    const SIDES: u32 = 12;

    /// From the path and the arm's closed-form inverse kinematics; what is beyond reach is taken at the boundary. Cost about 2 µs.
    fn along<const N: usize>(
        at: &Situation<'_, N>,
        z6_E: &Vector3<f64>,
        bend_at: impl Fn(&Vector3<f64>, &Vector3<f64>) -> Vector2<f64>,
    ) -> Self {
        let bend = |share: f64| {
            let X = at.ahead.pose(share);
            bend_at(&X.p, &(X.R * z6_E))
        };
        let start = bend(0.0);
        let mut from = start;
        let mut turned = 0.0;
        let mut out = Self {
            miss: start.norm(),
            crossing: 0.0,
            lowest: 0.0,
            highest: 0.0,
        };
        for k in 1..=Self::SIDES {
            let to = bend(f64::from(k) / f64::from(Self::SIDES));
            let side = to - from;
            let nearest = nearest_to_origin(&from, &to).norm();
            if nearest < out.miss {
                out.miss = nearest;
                out.crossing = wrap_line(libm::atan2(start.perp(&side), start.dot(&side)));
            }
            turned += libm::atan2(from.perp(&to), from.dot(&to));
            out.lowest = out.lowest.min(turned);
            out.highest = out.highest.max(turned);
            from = to;
        }
        out
    }
}

/// The point of the segment from `from` to `to` that is nearest to the origin; `from` where the two are one.
fn nearest_to_origin(from: &Vector2<f64>, to: &Vector2<f64>) -> Vector2<f64> {
    let side = to - from;
    from + side * (-from.dot(&side) / side.norm_squared().max(SEGMENT_MIN)).clamp(0.0, 1.0)
}

/// The smallest turn that brings the direction `from` onto the line of `to`, about `normal`, in (−π/2, π/2].
fn line_angle(from: &Vector3<f64>, to: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
    wrap_line(libm::atan2(normal.dot(&from.cross(to)), from.dot(to)))
}
