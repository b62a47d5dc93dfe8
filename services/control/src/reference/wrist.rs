//! Type 2 reference of a wrist: the direction of its middle axis from the desired direction of its last one.
//!
//! In the words of a PUMA: z4 is the axis with which z6 is parallel at the lock. On an arm of parallel axes it is their direction n.

use super::forearm::Forearm;
use super::planar::PlanarArm;
use super::{Charts, Memory, Situation, Target, line_angle};
use crate::linear::{angular, wrap_line};
use crate::singular::Geometry;
use crate::types::{Mode, Singularity};
use nalgebra::{Vector2, Vector3};

/// Damping on the sine of the desired wrist angle, a hundred times encoder noise.
const MU: f64 = 0.02;

/// Closest approach to the lock below which it is passed through with ζ off the direction of travel, rad: the orientation error that costs.
pub(super) const PASS: f64 = 0.004;

/// Sine of the desired wrist angle below which passing through may begin.
const NEAR: f64 = 0.22;

/// Speed of the desired direction below which it is not going anywhere, rad/s.
const MOVING: f64 = 0.01;

/// Without a governor: predicted rate over the largest one above which the lock is passed through.
const PASS_RATIO: f64 = 1.8;

/// Distance that passing through keeps from the limits of the joint that turns ζ, rad.
const MARGIN: f64 = 0.02;

/// A wrist: the three axes, and what moves the first of them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Hand {
    z4: Vector3<f64>,
    z5: Vector3<f64>,
    z6: Vector3<f64>,
    /// Change of z4, 1/s.
    z4_rate: Vector3<f64>,
    /// φ̇ while the joint that φ counts from stands still, rad/s.
    carried: f64,
    /// Joints that turn with ζ, and against it; the first none where several share the turn.
    joints: (Option<usize>, usize),
}

impl Hand {
    fn new<const N: usize>(charts: &Charts, at: &Situation<'_, N>) -> Self {
        let (z, omega) = (&at.terms.z, &at.terms.omega);
        let (z5, z6) = (z[N - 2], z[N - 1]);
        if *charts == Charts::Geometric(Geometry::ParallelAxes) {
            return Self { z4: z[1], z5, z6, z4_rate: omega[0].cross(&z[1]), carried: 0.0, joints: (None, N - 1) };
        }
        let forearm = N - 3;
        let (z4, carried) = (z[forearm], z[forearm].dot(&omega[forearm - 1]));
        Self { z4, z5, z6, z4_rate: omega[forearm].cross(&z4), carried, joints: (Some(forearm), N - 1) }
    }

    /// Whether the joints have room for ζ to turn so far.
    fn fits<const N: usize>(&self, turn: f64, at: &Situation<'_, N>) -> bool {
        let inside = |i: usize, by: f64| at.q[i] + by > at.lower[i] && at.q[i] + by < at.upper[i];
        self.joints.0.is_none_or(|i| inside(i, turn)) && inside(self.joints.1, -turn.copysign(turn * self.z4.dot(&self.z6)))
    }

    /// The same line reached the other way round, where the joints allow only that.
    fn within_limits<const N: usize>(&self, error: f64, at: &Situation<'_, N>) -> f64 {
        let other = error - std::f64::consts::PI.copysign(error);
        if !self.fits(error, at) && self.fits(other, at) { other } else { error }
    }
}

/// z5 → ±z4×z6_d: with z5 there, a turn of joint 5 alone reaches z6_d.
///
/// With w = z4×z6_d, |w| the sine of the desired wrist angle: e = angle from z5 to the line of w, believed by |w|²/(|w|² + μ²);
/// φ̇_ff = z4·(w×ẇ)/(|w|² + μ²). Passing: z5 is held in the forearm along the direction in which w will pass the lock, so that z6 travels in the
/// plane normal to z5; done where w passes so near that the error this makes is negligible, and where joint 4 has not the room to follow.
pub(super) fn target<const N: usize>(charts: &Charts, wrist: &Singularity<N>, at: &Situation<'_, N>, memory: &mut Memory) -> Target {
    let terms = at.terms;
    let hand = Hand::new(charts, at);
    let Hand { z4, z5, z4_rate, .. } = hand;
    let z6_E = terms.X_BE.R.transpose() * hand.z6;
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
    let near = size < NEAR * NEAR && wrist.s.abs() < wrist.eta_out;
    if !memory.passing && approaching && w_rate.norm() > MOVING && near {
        if let Some(outlook) = Outlook::new(charts, at, &z6_E) {
            let worst = rate_of(angular(at.V_nominal)).norm() / outlook.miss.max(1e-9);
            let hasty = !at.governed && worst > PASS_RATIO * at.rate_max;
            let room = hand.joints.0.is_none_or(|i| {
                let there = at.q[i] + tracked;
                there + outlook.lowest > at.lower[i] + MARGIN && there + outlook.highest < at.upper[i] - MARGIN
            });
            memory.passing = outlook.miss < PASS || hasty || !room;
            memory.passage = wrist.aux + tracked + outlook.crossing;
        }
    } else if memory.passing && (!approaching && turning.abs() < 0.7 * at.rate_max * size || w_rate.norm() < 0.3 * MOVING) {
        memory.passing = false;
    }
    memory.holding = size < MU * MU * if memory.holding { 4.0 } else { 1.0 };
    let (error, rate, weight, mode) = if memory.passing {
        (wrap_line(memory.passage - wrist.aux), hand.carried, 1.0, Mode::Pass)
    } else {
        let rate = turning / (size + MU * MU);
        (tracked, rate, size / (size + MU * MU), if memory.holding { Mode::Hold } else { Mode::Track })
    };
    Target { error: hand.within_limits(error, at), rate, weight, mode, clipped: false }
}

/// How the rest of the leg passes the lock, seen from the forearm: w as a polygon in the plane normal to z4.
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

    /// From the path and the arm's closed-form inverse kinematics; what is beyond reach is taken at the edge. Cost about 2 µs.
    ///
    /// `None` for an arm without one.
    fn new<const N: usize>(charts: &Charts, at: &Situation<'_, N>, z6_E: &Vector3<f64>) -> Option<Self> {
        match charts {
            Charts::Puma(puma) => {
                let forearm = Forearm::new(puma, at.q, at.terms, &at.at.p);
                Some(Self::along(at, z6_E, |p, z6_d| forearm.at(p).sees(z6_d)))
            }
            Charts::Geometric(Geometry::ParallelAxes) => {
                let arm = PlanarArm::new(at.terms, &at.at.p);
                Some(Self::along(at, z6_E, |p, z6_d| arm.at(p).sees(z6_d)))
            }
            _ => None,
        }
    }

    fn along<const N: usize>(
        at: &Situation<'_, N>,
        z6_E: &Vector3<f64>,
        sees: impl Fn(&Vector3<f64>, &Vector3<f64>) -> Vector2<f64>,
    ) -> Self {
        let seen = |share: f64| {
            let X = at.ahead.pose(share);
            sees(&X.p, &(X.R * z6_E))
        };
        let start = seen(0.0);
        let mut from = start;
        let mut turned = 0.0;
        let mut out = Self { miss: start.norm(), crossing: 0.0, lowest: 0.0, highest: 0.0 };
        for k in 1..=Self::SIDES {
            let to = seen(f64::from(k) / f64::from(Self::SIDES));
            let side = to - from;
            let along = (-from.dot(&side) / side.norm_squared().max(1e-18)).clamp(0.0, 1.0);
            let nearest = (from + side * along).norm();
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
