//! The posture of one spare joint along a leg, chosen for time (+).
//!
//! Of all routes q_k + α_k·n_k, where n_k moves the joints while the hand stands still, the one with the least
//!
//! ```text
//! Σ_k Δt_k·Σ_j (ε·r_kj² + r_kj⁸)        r_kj = |Δq_kj|/(Δt_k·v_j), the share of a joint's planned speed
//! ```
//!
//! and a price for being near a joint limit. The high power stands for the quickest joint, which the clock waits for. Each Newton step solves one
//! tridiagonal system for all α; the postures then return to their poses, and the step is kept where the sum has fallen. The route ends wherever that
//! takes least time.

use super::kinematics::{Kinematics, SOLVED};
use super::request::Request;
use super::route::{BEND, CLEAR_SPARE, Knot, SPEED};
use crate::linear::Joints;
use model::Pose;

/// The weight of the square beside the power.
const SQUARE: f64 = 0.02;
/// Distance from a joint limit within which it counts, rad (m), and by how much.
const NEAR: f64 = 0.15;
const PRICE: f64 = 10.0;
/// Most steps, the largest motion of a posture in one, and the smallest, rad (m).
const STEPS: u32 = 30;
const STRIDE: (f64, f64) = (0.15, 1e-3);
/// Knots that a leg has at least.
const KNOTS: f64 = 120.0;

/// The limits by which the postures of a leg are judged.
struct Judge<const N: usize> {
    speeds: Joints<N>,
    lower: Joints<N>,
    upper: Joints<N>,
}

/// A leg whose spare joint moves otherwise, and so takes less time; `None` where there is not one spare joint, where its posture is commanded, where the
/// path waits, or where nothing is gained. `pose` is that of C at a time, s.
pub(super) fn eased<const N: usize>(
    request: &Request<'_, N>,
    arm: &Kinematics<'_, N>,
    knots: &[Knot<N>],
    pose: &dyn Fn(f64) -> Pose,
) -> Option<Vec<Knot<N>>> {
    let is_free = request.postures.iter().all(Option::is_none);
    let has_one = arm.spectrum(&request.q_start).spare().len() == 1;
    if !is_free || !has_one || knots.iter().any(|knot| knot.waits) {
        return None;
    }
    let judge = Judge {
        speeds: request.velocity() * SPEED,
        lower: *request.model.lower(),
        upper: *request.model.upper(),
    };
    let mut knots = refined(arm, knots, pose);
    let mut least = judge.sum(&knots);
    let (first, mut stride) = (least, STRIDE.0);
    for _ in 0..STEPS {
        let n = directions(arm, &knots);
        let alpha = judge.newton(&knots, &n);
        let share = stride / alpha.iter().fold(stride, |size, a| size.max(a.abs()));
        let moved = knots
            .iter()
            .zip(n.iter().zip(&alpha))
            .map(|(knot, (n, a))| {
                let by = n * (a * share);
                on_path(
                    arm,
                    &Knot {
                        q: knot.q + by,
                        ..*knot
                    },
                    pose,
                )
                .unwrap_or(*knot)
            });
        let moved: Vec<_> = moved.collect();
        let now = judge.sum(&moved);
        if now < least {
            let is_settled = now > least * (1.0 - STRIDE.1);
            (knots, least, stride) = (moved, now, STRIDE.0.min(2.0 * stride));
            if is_settled {
                break;
            }
        } else if stride > STRIDE.1 {
            stride *= 0.25;
        } else {
            break;
        }
    }
    (least < first && is_smooth(arm, &knots, pose)).then_some(knots)
}

/// A knot with the posture of its pose that is next to its own.
fn on_path<const N: usize>(
    arm: &Kinematics<'_, N>,
    knot: &Knot<N>,
    pose: &dyn Fn(f64) -> Pose,
) -> Option<Knot<N>> {
    let (q, e) = arm.solve(&pose(knot.t), &knot.q, &Joints::zeros(), 0.0, SOLVED);
    (e.norm() < 1e-7).then_some(Knot { q, ..*knot })
}

/// The knots with more between them.
fn refined<const N: usize>(
    arm: &Kinematics<'_, N>,
    knots: &[Knot<N>],
    pose: &dyn Fn(f64) -> Pose,
) -> Vec<Knot<N>> {
    let longest = knots.last().map_or(0.0, |knot| knot.t) / KNOTS;
    let mut out: Vec<_> = knots[..1].to_vec();
    for pair in knots.windows(2) {
        let (from, dt) = (pair[0], pair[1].t - pair[0].t);
        let pieces = (dt / longest).ceil();
        for k in 1..=pieces as u32 {
            let x = f64::from(k) / pieces;
            let between = Knot::moving(from.t + dt * x, from.q + (pair[1].q - from.q) * x);
            out.push(on_path(arm, &between, pose).unwrap_or(between));
        }
    }
    out
}

/// r⁶.
fn sixth(r: f64) -> f64 {
    let square = r * r;
    square * square * square
}

/// The direction of the spare joint at each knot, without a jump.
fn directions<const N: usize>(arm: &Kinematics<'_, N>, knots: &[Knot<N>]) -> Vec<Joints<N>> {
    let mut last = Joints::zeros();
    let aligned = knots.iter().map(|knot| {
        let n = arm.spectrum(&knot.q).spare()[0];
        last = if n.dot(&last) < 0.0 { -n } else { n };
        last
    });
    aligned.collect()
}

/// Whether the posture half-way between two knots is next to their mean everywhere.
fn is_smooth<const N: usize>(
    arm: &Kinematics<'_, N>,
    knots: &[Knot<N>],
    pose: &dyn Fn(f64) -> Pose,
) -> bool {
    knots.windows(2).all(|pair| {
        let dq = pair[1].q - pair[0].q;
        let mean = Knot::moving(0.5 * (pair[0].t + pair[1].t), pair[0].q + dq * 0.5);
        let half_way = on_path(arm, &mean, pose);
        half_way.is_some_and(|there| (there.q - mean.q).norm() < BEND * dq.norm() + 1e-4)
    })
}

impl<const N: usize> Judge<N> {
    /// How far joint j is within its lower and its upper limit's reach.
    fn near(&self, q: &Joints<N>, j: usize) -> [f64; 2] {
        let part = |gap: f64| {
            if gap < CLEAR_SPARE {
                f64::INFINITY
            } else {
                (1.0 - gap / NEAR).max(0.0)
            }
        };
        [part(q[j] - self.lower[j]), part(self.upper[j] - q[j])]
    }

    fn sum(&self, knots: &[Knot<N>]) -> f64 {
        let part = |pair: &[Knot<N>], j: usize| {
            let dt = pair[1].t - pair[0].t;
            let r = (pair[1].q[j] - pair[0].q[j]) / (dt * self.speeds[j]);
            let [low, high] = self.near(&pair[1].q, j);
            dt * (SQUARE * r * r + sixth(r) * r * r + PRICE * (low * low + high * high))
        };
        let of = |pair| (0..N).map(|j| part(pair, j)).sum::<f64>();
        knots.windows(2).map(of).sum()
    }

    /// The Newton step of all α; the first posture is where the arm stands.
    fn newton(&self, knots: &[Knot<N>], n: &[Joints<N>]) -> Vec<f64> {
        let count = knots.len();
        let (mut diagonal, mut beside) = (vec![1e-9; count], vec![0.0; count]);
        let mut right = vec![0.0; count];
        for k in 1..count {
            let dt = knots[k].t - knots[k - 1].t;
            for (j, (a, b)) in n[k - 1].iter().zip(&n[k]).enumerate() {
                let scale = 1.0 / (dt * self.speeds[j]);
                let r = (knots[k].q[j] - knots[k - 1].q[j]) * scale;
                let slope = dt * scale * (2.0 * SQUARE * r + 8.0 * sixth(r) * r);
                let bend = 2.0 * SQUARE + 56.0 * sixth(r);
                let bend = dt * scale * scale * bend;
                let [low, high] = self.near(&knots[k].q, j);
                let wall = 2.0 * dt * PRICE / NEAR;
                right[k - 1] += slope * a;
                right[k] += (wall * (low - high) - slope) * b;
                diagonal[k - 1] += bend * a * a;
                diagonal[k] += (bend + if low + high > 0.0 { wall / NEAR } else { 0.0 }) * b * b;
                beside[k - 1] -= bend * a * b;
            }
        }
        (diagonal[0], beside[0], right[0]) = (1.0, 0.0, 0.0);
        for k in 1..count {
            let share = beside[k - 1] / diagonal[k - 1];
            diagonal[k] -= share * beside[k - 1];
            right[k] -= share * right[k - 1];
        }
        for k in (0..count).rev() {
            let next = right.get(k + 1).map_or(0.0, |next| beside[k] * next);
            right[k] = (right[k] - next) / diagonal[k];
        }
        right
    }
}
