//! Self-motion at one pose: the arm moves, the end-effector stands still.

use super::*;
use crate::linear::Joints;

/// Share of the path's direction that is lost: at a step of the self-motion beside which its least value is looked for, at a neighbour of that step at
/// least, and where it counts as none.
const TOUCHING: (f64, f64, f64) = (0.1, 2e-3, 5e-3);

/// Step of a self-motion in the joint that moves most, rad, and most steps: two full turns.
const STRIDE: f64 = 0.1;
const STRIDES: u32 = 130;

/// A self-motion at one pose.
pub(super) struct AtRest<'a, const N: usize> {
    /// The node it follows on.
    pub(super) node: usize,
    /// The posture it starts from: the node's, or the lock beside it.
    pub(super) q: Joints<N>,
    /// Direction of the joints' motion.
    pub(super) v: Joints<N>,
    /// The pose of C, which rests.
    pub(super) X: &'a Pose,
    /// Where the path goes on to, as a unit task displacement.
    pub(super) onwards: &'a Vector6,
    /// Whether every second posture may be left along the path, or only those where the lost direction allows it.
    pub(super) every: bool,
}

impl<const N: usize> Search<'_, N> {
    /// The part of a task displacement that is lost in this posture.
    pub(super) fn undone(&self, q: &Joints<N>, onwards: &Vector6) -> Vector6 {
        let spectrum = self.arm.spectrum(q);
        let mut rest = *onwards;
        for k in spectrum.free..N {
            if spectrum.sigma[k] > 0.01 {
                let u = spectrum.lost(k) / spectrum.sigma[k];
                rest -= u * u.dot(&rest);
            }
        }
        rest
    }

    /// The postures that a self-motion leads to, as nodes that follow on the one it starts from.
    ///
    /// `t` is the time within the leg, s, at which C rests.
    pub(super) fn self_motion(
        &mut self,
        leg: &Stretch<'_, N>,
        from: &AtRest<'_, N>,
        t: f64,
    ) -> Vec<usize> {
        let node = from.node;
        let (zero, start, parent) = (Joints::zeros(), self.nodes[node].q, self.nodes[node].cost);
        // From a posture beside the path the arm moves beside it, and comes back to it on the way on.
        let fit = if from.q == start && self.nodes[node].is_exact {
            Fit::Exact
        } else {
            Fit::Lax
        };
        let way = Way {
            fit,
            ..Way::exact()
        };
        let mut found = vec![];
        for (q, knots) in self.postures_on(from, leg.from_s + t) {
            let moved = largest_share(&(q - start), &(self.velocity * SPEED));
            if let Some(one) = self.push_node(leg, node, knots, &way) {
                self.nodes[one].cost =
                    parent + STOP_S + 1.875 * moved + self.price(&zero, STOP_S, &q);
                self.nodes[one].heading = zero;
                found.push(one);
            }
        }
        found
    }

    /// The postures to leave a self-motion from, each with the knots that lead there, all at the time `t` on the path's clock.
    fn postures_on(&self, from: &AtRest<'_, N>, t: f64) -> Vec<(Joints<N>, Vec<Knot<N>>)> {
        let AtRest {
            X, onwards, every, ..
        } = *from;
        let (mut at, mut v) = (from.q, from.v / from.v.amax());
        let mut undone = self.undone(&at, onwards);
        let mut out = vec![];
        let waits = true;
        let knot = |q: Joints<N>| Knot { t, q, waits };
        let mut knots: Vec<Knot<N>> = vec![];
        if from.q != self.nodes[from.node].q {
            knots.push(knot(from.q));
        }
        let mut ranks = [f64::INFINITY, self.second(&at)];
        let (mut gaps, mut crossed) = ([f64::INFINITY, undone.norm()], false);
        for k in 1.. {
            self.spent.set(self.spent.get() + 2);
            if self.is_spent(1.0) || self.comes_round(&at, &from.q, k) {
                break;
            }
            if k > STRIDES {
                self.cut();
                break;
            }
            let (next, e) = self.arm.at_rest(X, &(at + v * STRIDE));
            let dq = next - at;
            let is_stride = (0.5 * STRIDE..=2.0 * STRIDE).contains(&dq.amax());
            if e.norm() > 1e-5 || !is_stride || self.outside(&next, &at).is_some() {
                break;
            }
            let rest = self.undone(&next, onwards);
            let mut chosen = if every {
                (k % 2 == 0).then_some(next)
            } else {
                turned(&rest, &undone).map(|half| self.between(from, (&at, &dq), (&undone, half)))
            };
            let (rank, gap) = (self.second(&next), rest.norm());
            let falls = k > 1 && ranks[1] < ranks[0] && ranks[1] <= rank && ranks[1] < 0.1;
            // Where the lost direction touches what the path needs and turns back, a fold opens, too.
            let least = gaps[1] < gaps[0]
                && gaps[1] <= gap
                && gaps[1] < TOUCHING.0
                && gaps[0].max(gap) > TOUCHING.1;
            let touches = k > 1 && !crossed && least;
            crossed = chosen.is_some();
            if !crossed && !every && (falls || touches) {
                chosen = self.opening(from, &at, [&v, &dq], falls);
            }
            (ranks, gaps) = ([ranks[1], rank], [gaps[1], gap]);
            if let Some(q) = chosen {
                let mut knots = knots.clone();
                knots.push(knot(q));
                out.push((q, knots));
            }
            knots.push(knot(next));
            (at, v, undone) = (next, dq / dq.amax(), rest);
        }
        out
    }

    /// The measure of a second direction, which may be lost on the way: where the rank falls further, a fold may open.
    fn second(&self, q: &Joints<N>) -> f64 {
        let Spectrum { sigma, free, .. } = self.arm.spectrum(q);
        sigma.get(free + 1).copied().unwrap_or(1.0)
    }

    /// The posture near `at`, along the direction it was reached in and the motion that leaves it, in which a second direction is lost (`falls`) or nothing of what the path needs.
    fn opening(
        &self,
        from: &AtRest<'_, N>,
        at: &Joints<N>,
        [before, after]: [&Joints<N>; 2],
        falls: bool,
    ) -> Option<Joints<N>> {
        self.spent.set(self.spent.get() + 80);
        let there = |x: f64| {
            let by = if x < 0.0 {
                before * (x * STRIDE)
            } else {
                after * x
            };
            self.arm.at_rest(from.X, &(at + by)).0
        };
        let left = |q: &Joints<N>| self.undone(q, from.onwards).norm();
        let measure = |q: &Joints<N>| if falls { self.second(q) } else { left(q) };
        let q = there(lowest((-1.0, 1.0), 40, |x| measure(&there(x))));
        (falls || left(&q) < TOUCHING.2).then_some(q)
    }

    /// Whether a self-motion is back where it began after `k` strides: a full turn is another posture where a joint has limits.
    fn comes_round(&self, at: &Joints<N>, from: &Joints<N>, k: u32) -> bool {
        use std::f64::consts::TAU;
        let (by, (lower, upper)) = (at - from, self.range());
        k > 5
            && (0..N).all(|i| {
                let is_endless = upper[i] - lower[i] > 1e3;
                let turns = if is_endless {
                    libm::round(by[i] / TAU)
                } else {
                    0.0
                };
                (by[i] - turns * TAU).abs() < 0.6 * STRIDE
            })
    }

    /// The posture between `at` and `at` + `dq` from which the path can be followed: there a half of what is lost of it changes its sign.
    fn between(
        &self,
        from: &AtRest<'_, N>,
        (at, dq): (&Joints<N>, &Joints<N>),
        (undone, half): (&Vector6, usize),
    ) -> Joints<N> {
        self.spent.set(self.spent.get() + 24);
        let there = |x: f64| self.arm.at_rest(from.X, &(at + dq * x)).0;
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..24 {
            let middle = 0.5 * (low + high);
            if dot(&self.undone(&there(middle), from.onwards), undone, half) > 0.0 {
                low = middle
            } else {
                high = middle
            }
        }
        there(high)
    }
}
