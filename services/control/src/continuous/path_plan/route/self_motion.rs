//! Self-motion at one pose: the arm moves, the end-effector stands still.

use super::*;

/// Share of the path's direction that is lost: at a step of the self-motion beside which its least value is looked for, at a neighbour of that step at
/// least, and where it counts as none.
const TOUCHING: (f64, f64, f64) = (0.1, 2e-3, 5e-3);

/// Where `f` is lowest within [−1, 1], by golden section.
fn lowest(f: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (-1.0, 1.0);
    for _ in 0..40 {
        let (c, d) = (high - 0.618 * (high - low), low + 0.618 * (high - low));
        if f(c) < f(d) { high = d } else { low = c }
    }
    0.5 * (low + high)
}

impl<const N: usize> Search<'_, N> {
    /// The part of a task displacement that is lost in this posture.
    pub(super) fn undone(&self, q: &SVector<f64, N>, onwards: &Vector6<f64>) -> Vector6<f64> {
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

    pub(super) fn self_motion(
        &mut self,
        leg: &Stretch<'_, N>,
        node: usize,
        (t, X): (f64, &Pose),
        v: &SVector<f64, N>,
        onwards: &Vector6<f64>,
        every: bool,
    ) -> Vec<usize> {
        const STRIDE: f64 = 0.1;
        let zero = SVector::zeros();
        let start = self.nodes[node].q;
        let mut knots: Vec<Knot<N>> = vec![];
        let (mut at, mut v) = (start, *v / v.amax());
        let mut undone = self.undone(&at, onwards);
        let mut out: Vec<(SVector<f64, N>, Vec<Knot<N>>)> = vec![];
        // A second direction may be lost on the way: where the rank falls further, a fold may open.
        let second = |q: &SVector<f64, N>| {
            let spectrum = self.arm.spectrum(q);
            spectrum.sigma.get(spectrum.free + 1).copied().unwrap_or(1.0)
        };
        let mut ranks = [f64::INFINITY, second(&at)];
        let (mut gaps, mut crossed) = ([f64::INFINITY, undone.norm()], false);
        for k in 1..=40 {
            self.spent.set(self.spent.get() + 2);
            if self.is_exhausted() {
                break;
            }
            let (next, e) = self.arm.solve(X, &(at + v * STRIDE), &zero, 0.0, SOLVED);
            let dq = next - at;
            if e.norm() > 1e-5 || dq.amax() < 0.5 * STRIDE || dq.amax() > 2.0 * STRIDE || self.outside(&next, &at).is_some() {
                break;
            }
            let rest = self.undone(&next, onwards);
            let chosen = if every {
                (k % 2 == 0).then_some(next)
            } else if let Some(half) = turned(&rest, &undone) {
                // Between the two lies a posture that the path can be followed from.
                self.spent.set(self.spent.get() + 24);
                let (mut low, mut high) = (0.0, 1.0);
                for _ in 0..24 {
                    let middle = 0.5 * (low + high);
                    let there = self.arm.solve(X, &(at + dq * middle), &zero, 0.0, SOLVED).0;
                    if dot(&self.undone(&there, onwards), &undone, half) > 0.0 { low = middle } else { high = middle }
                }
                Some(self.arm.solve(X, &(at + dq * high), &zero, 0.0, SOLVED).0)
            } else {
                None
            };
            let (rank, gap) = (second(&next), rest.norm());
            let falls = k > 1 && ranks[1] < ranks[0] && ranks[1] <= rank && ranks[1] < 0.1;
            // Where the lost direction touches what the path needs and turns back, a fold opens, too.
            let least = gaps[1] < gaps[0] && gaps[1] <= gap && gaps[1] < TOUCHING.0 && gaps[0].max(gap) > TOUCHING.1;
            let touches = k > 1 && !crossed && least;
            crossed = chosen.is_some();
            let chosen = if !crossed && !every && (falls || touches) {
                self.spent.set(self.spent.get() + 80);
                let there = |x: f64| self.arm.solve(X, &(at + if x < 0.0 { v * (x * STRIDE) } else { dq * x }), &zero, 0.0, SOLVED).0;
                let left = |q: &SVector<f64, N>| self.undone(q, onwards).norm();
                let q = there(lowest(|x| if falls { second(&there(x)) } else { left(&there(x)) }));
                (falls || left(&q) < TOUCHING.2).then_some(q)
            } else {
                chosen
            };
            (ranks, gaps) = ([ranks[1], rank], [gaps[1], gap]);
            if let Some(q) = chosen {
                let mut knots = knots.clone();
                knots.push(Knot { t: leg.from_s + t, q, waits: true });
                out.push((q, knots));
            }
            knots.push(Knot { t: leg.from_s + t, q: next, waits: true });
            (at, v, undone) = (next, dq / dq.amax(), rest);
        }
        let parent = self.nodes[node].cost;
        let mut found = vec![];
        for (q, knots) in out {
            let moved = (0..N).fold(0.0_f64, |time, i| time.max((q[i] - start[i]).abs() / (SPEED * self.bounds.velocity[i])));
            if let Some(one) = self.push_node(leg, node, knots, &Way { damping: 0.0, drift: zero }) {
                self.nodes[one].cost = parent + STOP_S + 1.875 * moved + self.price(&zero, STOP_S, &q);
                self.nodes[one].heading = zero;
                found.push(one);
            }
        }
        found
    }
}
