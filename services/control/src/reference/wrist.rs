//! Type 2 reference of a PUMA's wrist: the direction of z5 from the desired direction of z6.

use super::forearm::Forearm;
use super::{Memory, Situation, Target, line_angle};
use crate::linear::{angular, wrap_line};
use crate::singular::PumaFactors;
use crate::types::{Mode, Singularity};
use nalgebra::Vector3;

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

/// Distance that passing through keeps from the limits of joint 4, rad.
const MARGIN: f64 = 0.02;

/// z5 → ±z4×z6_d: with z5 there, a turn of joint 5 alone reaches z6_d.
///
/// With w = z4×z6_d, |w| the sine of the desired wrist angle: e = angle from z5 to the line of w, believed by |w|²/(|w|² + μ²);
/// φ̇_ff = z4·(w×ẇ)/(|w|² + μ²). Passing: z5 is held in the forearm along the direction in which w will pass the lock, so that z6 travels in the
/// plane normal to z5; done where w passes so near that the error this makes is negligible, and where joint 4 has not the room to follow.
pub(super) fn target<const N: usize>(puma: &PumaFactors, wrist: &Singularity<N>, at: &Situation<'_, N>, memory: &mut Memory) -> Target {
    let terms = at.terms;
    let [z4, z5] = [terms.z[3], terms.z[4]];
    let z6_E = terms.X_BE.R.transpose() * terms.z[5];
    let z6_d = at.desired.R * z6_E;
    let w = z4.cross(&z6_d);
    let size = w.norm_squared();
    let tracked = line_angle(&z5, &w, &z4);
    let z4_rate = terms.omega[3].cross(&z4);
    let rate_of = |omega_d: Vector3<f64>| {
        let rate = z4_rate.cross(&z6_d) + z4.cross(&omega_d.cross(&z6_d));
        rate - z4 * z4.dot(&rate)
    };
    let w_rate = rate_of(angular(&at.desired.V));
    let approaching = w.dot(&w_rate) < 0.0;
    let turning = z4.dot(&w.cross(&w_rate));
    if !memory.passing && approaching && w_rate.norm() > MOVING && size < NEAR * NEAR && wrist.s.abs() < wrist.eta_out {
        let outlook = Outlook::new(puma, at, &z6_E);
        let worst = rate_of(angular(at.V_nominal)).norm() / outlook.miss.max(1e-9);
        let hasty = !at.governed && worst > PASS_RATIO * at.rate_max;
        let q4 = at.q[3] + tracked;
        let room = q4 + outlook.lowest > at.lower[3] + MARGIN && q4 + outlook.highest < at.upper[3] - MARGIN;
        memory.passing = outlook.miss < PASS || hasty || !room;
        memory.passage = at.q[3] + tracked + outlook.crossing;
    } else if memory.passing && (!approaching && turning.abs() < 0.7 * at.rate_max * size || w_rate.norm() < 0.3 * MOVING) {
        memory.passing = false;
    }
    memory.holding = size < MU * MU * if memory.holding { 4.0 } else { 1.0 };
    let (error, rate, weight, mode) = if memory.passing {
        (wrap_line(memory.passage - at.q[3]), z4.dot(&terms.omega[2]), 1.0, Mode::Pass)
    } else {
        let rate = turning / (size + MU * MU);
        (tracked, rate, size / (size + MU * MU), if memory.holding { Mode::Hold } else { Mode::Track })
    };
    Target { error: within_limits(error, at), rate, weight, mode, clipped: false }
}

/// The same line reached the other way round, where joints 4 and 6 allow only that.
fn within_limits<const N: usize>(error: f64, at: &Situation<'_, N>) -> f64 {
    let other = error - std::f64::consts::PI.copysign(error);
    if !fits(error, at) && fits(other, at) { other } else { error }
}

/// Whether joints 4 and 6 have room for ζ to turn so far.
fn fits<const N: usize>(turn: f64, at: &Situation<'_, N>) -> bool {
    let (q4, q6) = (at.q[3] + turn, at.q[5] - turn);
    q4 > at.lower[3] && q4 < at.upper[3] && q6 > at.lower[5] && q6 < at.upper[5]
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
    fn new<const N: usize>(puma: &PumaFactors, at: &Situation<'_, N>, z6_E: &Vector3<f64>) -> Self {
        let forearm = Forearm::new(puma, at.q, at.terms, &at.at.p);
        let seen = |share: f64| {
            let X = at.ahead.pose(share);
            forearm.at(&X.p).sees(&(X.R * z6_E))
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
