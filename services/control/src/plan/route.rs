//! The search: layers along the path, postures that continue one another, the cheapest chain through them (+).
//!
//! Every posture is reached from the start posture by continuous motion, so that no jump between branches can hide in a route. A layer's postures are
//! followed to the next layer by Newton steps of adaptive length; where the arm is singular there are more ways on: past the lock with ζ off the
//! direction of travel (within what the user allows), out of a fold on either side, and a self-motion that turns ζ while the path waits.

mod closing;
mod self_motion;

use self_motion::AtRest;

use super::kinematics::{Kinematics, LOCKED, PLAIN_DAMPING, SOLVED, Spectrum, lowest};
use super::request::{Deviation, Request};
use crate::limits::speed::largest_share;
use crate::linear::{Joints, Vector6};
use model::Pose;
use std::cell::Cell;

/// Largest joint motion between two knots, rad (m); deviation of the posture half-way from their mean, over that motion: more is no smooth motion.
const STEP: f64 = 0.12;
pub(super) const BEND: f64 = 0.25;
/// Unit-scaled pose error half-way between two knots that is none.
const STRAIGHT: f64 = 1e-4;
/// Shortest step of the path, as a share of a leg.
const SHORTEST: f64 = 1e-7;
/// Most knots between two layers.
const KNOTS: usize = 150;
/// Most steps of a search for each leg that is a line, and for all of them: about 35 µs each, so that the three searches of a plan end within 10 s on a core
/// of their own; and of a search for advice, of which there are up to eight.
const BUDGET: u32 = 40_000;
pub(super) const STEPS: u32 = 100_000;
pub(super) const ADVICE: u32 = 25_000;
/// Share of them for routes beside the path: along a lock there are many, and a route on the path is not to fail for their sake.
const BESIDE: f64 = 0.75;
/// Most postures kept in a layer, and how far apart they are to lie at first, rad: half as far until there are enough.
const WIDTH: usize = 20;
const WIDEST: f64 = 1.6;
/// Postures nearer to each other than this are one, rad.
const SAME: f64 = 0.03;
/// Most steps back from beside a fold to the fold.
const RETURNS: u32 = 60;
/// Two solutions of a pose that lie further apart, off the self-motion, are the two sides of a fold, rad.
const TWIN: f64 = 1e-3;
/// σ below which a route passes a lock so near that other ways may begin there, and below which the lock itself is looked for.
const PASSED: f64 = 0.05;
const BESIDE_LOCK: f64 = 0.03;
/// σ below which other ways on are looked for.
const NEAR: f64 = 0.2;
/// Dampings of a step that may leave the path: a weak one goes around a lock as far as it can, a strong one straight past it; that one grows with the
/// orientation that is allowed.
const DAMPING: f64 = 0.03;
const STRONG_DAMPING: f64 = 0.1;
const DAMPING_PER_RAD: f64 = 3.0;
/// Largest deviation of the plain continuation as a share of what the user allows, and at most.
const PLAIN: f64 = 0.02;
const PLAIN_MOST: Deviation = Deviation {
    position_m: 2e-5,
    orientation_rad: 2e-4,
};
/// Share of the deviation allowed that a route takes at its knots, and half-way between. The law follows only the auxiliary coordinate of a route and
/// keeps the path in every other direction: the arm deviates less than the damped postures do.
const LEFT: (f64, f64) = (1.0, 1.2);
/// Rest of a leg with which a route counts as being at its end, as a share of the deviation allowed.
pub(super) const ARRIVED: f64 = 0.1;
/// Distance that a route keeps from every joint limit, rad (m): encoder noise and the cost of tracking; more where spare joints are tried both ways,
/// which are tracked less closely than the path.
const CLEAR: f64 = 2e-3;
pub(super) const CLEAR_SPARE: f64 = 2e-2;
/// Distance from a limit at which it begins to cost, rad (m).
const MARGIN: f64 = 0.2;
/// Largest speed at which spare joints go back to the start posture, rad/s (m/s), and the price of being away, per rad: a task that returns to its start
/// pose returns to its posture, too.
const HOMEWARD: f64 = 0.5;
const AWAY: f64 = 0.01;
/// Share of a speed limit that is planned with.
pub(super) const SPEED: f64 = 0.8;
/// Cost per time from which on a way is slow.
const SLOW: f64 = 2.0;
/// Time that a self-motion costs beside its motion, s.
const STOP_S: f64 = 0.15;

/// Why a route ends where it does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Block {
    /// A joint would leave its limits.
    Limit {
        /// Index of the joint.
        joint: usize,
        /// Its position there, rad (m).
        value: f64,
    },
    /// No posture continues the motion.
    End,
}

/// A posture on the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Knot<const N: usize> {
    /// Time on the path's clock, s.
    pub(super) t: f64,
    pub(super) q: Joints<N>,
    /// Reached by a self-motion while the path waits.
    pub(super) waits: bool,
}

impl<const N: usize> Knot<N> {
    /// Reached along the path.
    pub(super) fn moving(t: f64, q: Joints<N>) -> Self {
        let waits = false;
        Self { t, q, waits }
    }
}

/// A posture of a layer.
#[derive(Clone, Debug)]
pub(super) struct Node<const N: usize> {
    parent: Option<usize>,
    pub(super) q: Joints<N>,
    /// Joint motion per path time with which it was reached, rad/s.
    heading: Joints<N>,
    pub(super) cost: f64,
    /// On the path, not beside it.
    is_exact: bool,
    /// In a lock.
    is_locked: bool,
    /// From the parent's posture to this one, the parent's not included.
    knots: Vec<Knot<N>>,
}

/// One leg as the search sees it.
pub(super) struct Stretch<'a, const N: usize> {
    /// Time on the path's clock at which it begins, s.
    pub(super) from_s: f64,
    pub(super) duration_s: f64,
    /// The pose of C at a time within the leg.
    pub(super) pose: &'a dyn Fn(f64) -> Pose,
    /// Side of the fold on which to leave an elbow's lock, and the side a posture is on.
    pub(super) branch: i32,
    pub(super) side: &'a dyn Fn(&Joints<N>) -> f64,
    /// Posture that spare joints are drawn to.
    pub(super) posture: Option<&'a dyn Fn(f64) -> Joints<N>>,
    /// Times of the layers within the leg, s.
    pub(super) layers: &'a [f64],
    /// How many lines it counts as.
    pub(super) lines: u32,
    /// The branches that are searched.
    pub(super) effort: Effort,
}

/// The branches that a search looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Effort {
    /// The start posture's own: the plain continuation, which also stays in a lock.
    Plain,
    /// Those that locks and folds open.
    Branches,
    /// And spare joints both ways.
    Fan,
}

impl<const N: usize> Stretch<'_, N> {
    /// Whether spare joints are tried both ways.
    fn fans(&self) -> bool {
        self.effort == Effort::Fan
    }

    /// Whether a posture is on the other side of the fold than the one on which to leave it.
    fn is_across(&self, q: &Joints<N>) -> bool {
        self.branch != 0 && (self.side)(q) * f64::from(self.branch) < 0.0
    }
}

/// The furthest place that any route came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Furthest<const N: usize> {
    pub(super) t: f64,
    pub(super) q: Joints<N>,
    pub(super) block: Block,
}

/// How closely an edge keeps to the path.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fit {
    /// Exactly.
    Exact,
    /// As far as anybody sees: a lost direction that the path does not need stands still.
    Plain,
    /// Within the deviation that the user allows.
    Lax,
}

/// How an edge is followed.
#[derive(Clone, Copy, Debug)]
struct Way<const N: usize> {
    fit: Fit,
    damping: f64,
    /// Null-space motion over the edge.
    drift: Joints<N>,
}

impl<const N: usize> Way<N> {
    /// On the path, with no null-space motion.
    fn exact() -> Self {
        Self {
            fit: Fit::Exact,
            damping: 0.0,
            drift: Joints::zeros(),
        }
    }

    /// Damped, with a null-space motion.
    fn plain(drift: Joints<N>) -> Self {
        Self {
            fit: Fit::Plain,
            damping: PLAIN_DAMPING,
            drift,
        }
    }

    /// Unit-scaled pose error at which a step is solved.
    fn enough(&self) -> f64 {
        match self.fit {
            Fit::Plain => 1e-7,
            Fit::Exact | Fit::Lax => SOLVED,
        }
    }

    /// Whether the path may be left.
    fn is_lax(&self) -> bool {
        self.fit == Fit::Lax
    }
}

/// The search and all postures it found.
pub(super) struct Search<'a, const N: usize> {
    request: Request<'a, N>,
    arm: Kinematics<'a, N>,
    /// Fastest joint motion that is planned, rad/s.
    velocity: Joints<N>,
    nodes: Vec<Node<N>>,
    pub(super) furthest: Option<Furthest<N>>,
    /// Steps taken in the present leg, and in those before it.
    spent: Cell<u32>,
    spent_before: u32,
    /// Most steps in the present leg, and in all.
    budget: u32,
    most: u32,
    /// Whether a way on has been left out, so that a dead end proves nothing.
    cut: Cell<bool>,
    /// Times of locks that lie between two layers, s.
    pub(super) locks: Vec<f64>,
    /// Distance kept from every joint limit, rad (m).
    clear: f64,
    /// Whether a route came near a lock without being in it: within the deviation allowed there may be ways that are not searched.
    pub(super) passes_locks: Cell<bool>,
}

impl<'a, const N: usize> Search<'a, N> {
    pub(super) fn new(request: Request<'a, N>, arm: Kinematics<'a, N>, most: u32) -> Self {
        let q_start = request.q_start;
        let start = Node {
            parent: None,
            q: q_start,
            heading: Joints::zeros(),
            cost: 0.0,
            is_exact: true,
            is_locked: false,
            knots: vec![Knot::moving(0.0, q_start)],
        };
        Self {
            arm,
            velocity: request.velocity(),
            request,
            nodes: vec![start],
            furthest: None,
            spent: Cell::new(0),
            spent_before: 0,
            budget: BUDGET,
            most,
            cut: Cell::new(false),
            locks: vec![],
            clear: CLEAR,
            passes_locks: Cell::new(false),
        }
    }

    /// The joints' lower and upper limits, rad (m).
    fn range(&self) -> (&'a Joints<N>, &'a Joints<N>) {
        let model = self.request.model;
        (model.lower(), model.upper())
    }

    /// Whether a way on has been left out, so that a dead end proves nothing: by the budget, by the most postures of a layer, by the longest
    /// self-motion, or because a lock lies between two layers.
    pub(super) fn is_cut(&self) -> bool {
        self.cut.get() || !self.locks.is_empty()
    }

    /// Leaves out a way on.
    pub(super) fn cut(&self) {
        self.cut.set(true);
    }

    /// Whether the search has to give up a share of its steps.
    fn is_spent(&self, share: f64) -> bool {
        let spent = self.spent.get();
        let is_over = |spent: u32, most: u32| f64::from(spent) > share * f64::from(most);
        let is_spent = is_over(spent, self.budget) || is_over(spent + self.spent_before, self.most);
        self.cut.set(self.cut.get() || is_spent);
        is_spent
    }

    /// The posture furthest along the path.
    pub(super) fn deepest(&self) -> usize {
        let time = |node: &Node<N>| node.knots.last().map_or(0.0, |knot| knot.t);
        (0..self.nodes.len())
            .max_by(|a, b| time(&self.nodes[*a]).total_cmp(&time(&self.nodes[*b])))
            .unwrap_or_default()
    }

    pub(super) fn node(&self, index: usize) -> &Node<N> {
        &self.nodes[index]
    }

    /// All knots from the start to a node.
    pub(super) fn chain(&self, mut index: usize) -> Vec<Knot<N>> {
        let mut parts = vec![];
        loop {
            parts.push(&self.nodes[index].knots);
            match self.nodes[index].parent {
                Some(parent) => index = parent,
                None => break,
            }
        }
        parts.into_iter().rev().flatten().copied().collect()
    }

    /// The cheapest node of a layer.
    pub(super) fn best(&self, layer: &[usize]) -> Option<usize> {
        layer
            .iter()
            .copied()
            .min_by(|a, b| self.nodes[*a].cost.total_cmp(&self.nodes[*b].cost))
    }

    /// Adds a posture that follows on another by a given motion.
    pub(super) fn append(&mut self, parent: usize, knots: Vec<Knot<N>>) -> Option<usize> {
        let end = knots.last()?;
        let (q, cost) = (
            end.q,
            self.nodes[parent].cost + (end.t - self.nodes[parent].knots.last()?.t),
        );
        self.nodes.push(Node {
            parent: Some(parent),
            q,
            heading: Joints::zeros(),
            cost,
            is_exact: true,
            is_locked: false,
            knots,
        });
        Some(self.nodes.len() - 1)
    }

    /// Follows a leg from the layer `from`; returns the layer at its end, empty where no route leads there.
    pub(super) fn leg(&mut self, leg: &Stretch<'_, N>, from: &[usize]) -> Vec<usize> {
        self.spent_before += self.spent.take();
        self.budget = BUDGET * leg.lines;
        self.clear = if leg.fans() { CLEAR_SPARE } else { CLEAR };
        let mut layer = from.to_vec();
        for node in &mut layer {
            self.nodes[*node].heading = Joints::zeros();
        }
        if leg.effort == Effort::Plain {
            return layer
                .iter()
                .filter_map(|node| self.plain(leg, *node))
                .collect();
        }
        let mut t = 0.0;
        for (k, next) in leg.layers.iter().enumerate() {
            layer = self.prune(layer);
            let (mut onwards, mut opened) = (vec![], vec![]);
            for node in layer {
                let on = self.extend(leg, node, t, *next);
                // A leg goes on in another direction than the one before. What stays in a lock has the same self-motions in every layer.
                if k == 0 || !self.stays_locked(node) || self.is_slow(node, &on, next - t) {
                    opened.extend(self.waits(leg, node, t, k == 0 && leg.from_s == 0.0));
                } else {
                    self.cut();
                }
                onwards.extend(on);
            }
            for node in self.prune(opened) {
                onwards.extend(self.extend(leg, node, t, *next));
            }
            layer = self.prune(onwards);
            if layer.is_empty() {
                return layer;
            }
            t = *next;
        }
        // A leg ends on the path, however it was left meanwhile.
        layer.retain(|node| self.closes(*node, &(leg.pose)(t)));
        layer
    }

    /// Whether a posture is in a lock, as the one before it is.
    fn stays_locked(&self, node: usize) -> bool {
        let Node {
            is_locked, parent, ..
        } = self.nodes[node];
        is_locked && parent.is_some_and(|parent| self.nodes[parent].is_locked)
    }

    /// Whether a posture goes on to none of the postures `on` exactly and in little more than `dt`: in a lock, a self-motion may then help.
    fn is_slow(&self, node: usize, on: &[usize], dt: f64) -> bool {
        let cost = |node: usize| self.nodes[node].cost;
        let most = cost(node) + SLOW * dt;
        !on.iter()
            .any(|on| self.nodes[*on].is_exact && cost(*on) < most)
    }

    /// The plain continuation of a posture to the end of a leg.
    fn plain(&mut self, leg: &Stretch<'_, N>, node: usize) -> Option<usize> {
        let (mut node, mut t) = (node, 0.0);
        for next in leg.layers {
            let Node { q, heading, .. } = self.nodes[node];
            let spectrum = self.arm.spectrum(&q);
            let (dt, rest) = (next - t, leg.duration_s - t);
            let drift = self.push(&spectrum, &q, dt) + self.homeward(&spectrum, &q, (dt, rest));
            let way = Way::plain(drift);
            let knots = self.follow(leg, &q, &heading, (t, *next), &way).ok()?;
            node = self.push_node(leg, node, knots, &way)?;
            t = *next;
        }
        Some(node)
    }

    /// Whether a posture of a layer lies on the branch of a cheaper one: beside a fold its two sides are near to each other.
    fn is_same(&self, cheaper: usize, node: usize) -> bool {
        let (one, two) = (&self.nodes[cheaper], &self.nodes[node]);
        let by = one.q - two.q;
        by.amax() < SAME
            && (!two.is_exact || one.is_exact && is_twin(&self.arm.spectrum(&one.q), &by))
    }

    /// The cheapest of postures that are one. Of too many the cheapest half is kept, and of the others those that lie furthest apart: a cheap route may
    /// end further on, where another one does not.
    fn prune(&self, mut layer: Vec<usize>) -> Vec<usize> {
        let cost = |node: &usize| self.nodes[*node].cost;
        layer.sort_by(|a, b| cost(a).total_cmp(&cost(b)).then(a.cmp(b)));
        let mut apart: Vec<usize> = vec![];
        for node in layer {
            if !apart.iter().any(|other| self.is_same(*other, node)) {
                apart.push(node);
            }
        }
        if apart.len() <= WIDTH {
            return apart;
        }
        let mut others = apart.split_off(WIDTH / 2);
        let mut distance = WIDEST;
        while apart.len() < WIDTH {
            let q = |node: usize| self.nodes[node].q;
            others.retain(|node| {
                let is_far = |other: &usize| (q(*other) - q(*node)).amax() > distance;
                let is_kept = apart.len() < WIDTH && apart.iter().all(is_far);
                if is_kept {
                    apart.push(*node);
                }
                !is_kept
            });
            distance *= 0.5;
        }
        if others.iter().any(|node| self.nodes[*node].is_exact) {
            self.cut();
        }
        apart
    }

    /// The ways on from a posture with this spectrum to the next layer, the straight one first.
    fn ways(
        &self,
        leg: &Stretch<'_, N>,
        q: &Joints<N>,
        spectrum: &Spectrum<N>,
        (t0, t1): (f64, f64),
    ) -> Vec<Way<N>> {
        let dt = t1 - t0;
        let drift = self.push(spectrum, q, dt);
        let homeward = drift + self.homeward(spectrum, q, (dt, leg.duration_s - t0));
        let straight = Way {
            drift: if leg.fans() { drift } else { homeward },
            ..Way::exact()
        };
        let drifting = |drift| Way { drift, ..straight };
        let damped = |damping| Way {
            fit: Fit::Lax,
            damping,
            ..straight
        };
        let mut ways = vec![straight];
        if leg.fans() && leg.posture.is_none() {
            if (homeward - drift).amax() > 1e-3 * dt {
                ways.push(drifting(homeward));
            }
            for v in spectrum.spare() {
                let stride = 0.6 * SPEED * dt / largest_share(v, &self.velocity).max(1e-9);
                let by = v * stride.min(0.3);
                ways.extend([drift + by, drift - by].map(drifting));
            }
        }
        if spectrum.smallest() < NEAR {
            let strong = STRONG_DAMPING.max(DAMPING_PER_RAD * self.request.allowed.orientation_rad);
            ways.extend([DAMPING, strong].map(damped));
        }
        ways
    }

    /// The postures of the next layer that follow on one.
    fn extend(&mut self, leg: &Stretch<'_, N>, node: usize, t0: f64, t1: f64) -> Vec<usize> {
        let Node { q, heading, .. } = self.nodes[node];
        let spectrum = self.arm.spectrum(&q);
        self.pass(spectrum.smallest());
        let ways = self.ways(leg, &q, &spectrum, (t0, t1));
        let mut out = vec![];
        let mut stuck = false;
        for (i, way) in ways.iter().enumerate() {
            match self.follow(leg, &q, &heading, (t0, t1), way) {
                Ok(knots) => out.extend(self.push_node(leg, node, knots, way)),
                Err(block) => {
                    self.blocked(leg, &block);
                    stuck |= i == 0 && block.block == Block::End;
                }
            }
        }
        // On the other side of a fold than the leg is to leave it on, the fold is crossed.
        let near = spectrum.smallest() < NEAR;
        let crosses = near && leg.is_across(&q);
        let enters = spectrum.smallest() < LOCKED && !self.stays_locked(node);
        if crosses || stuck && near || enters {
            for knots in self.folds(leg, &q, &spectrum, t0, t1) {
                out.extend(self.push_node(leg, node, knots, &ways[0]));
            }
        }
        // In a lock, the rest of a path may be no more than rounding, which no posture follows exactly.
        if out.is_empty() && stuck && near {
            let plain = Way::plain(ways[0].drift);
            if let Ok(knots) = self.follow(leg, &q, &heading, (t0, t1), &plain) {
                out.extend(self.push_node(leg, node, knots, &plain));
            }
        }
        out
    }

    /// Takes note of a measure on the way.
    fn pass(&self, sigma: f64) {
        let is_near = (LOCKED..PASSED).contains(&sigma);
        self.passes_locks.set(self.passes_locks.get() || is_near);
    }

    fn blocked(&mut self, leg: &Stretch<'_, N>, at: &Furthest<N>) {
        let t = leg.from_s + at.t;
        if self
            .furthest
            .is_none_or(|far| t > far.t + 1e-6 || (t > far.t - 1e-6 && at.block != Block::End))
        {
            self.furthest = Some(Furthest { t, ..*at });
        }
    }

    /// Null-space motion away from joint limits.
    fn push(&self, spectrum: &Spectrum<N>, q: &Joints<N>, dt: f64) -> Joints<N> {
        if spectrum.free == 0 {
            return Joints::zeros();
        }
        let (lower, upper) = self.range();
        let inwards = Joints::<N>::from_fn(|i, _| {
            let part = |gap: f64| ((2.0 * MARGIN - gap) / (2.0 * MARGIN)).max(0.0);
            part(q[i] - lower[i]) - part(upper[i] - q[i])
        });
        spectrum.null_part(&inwards) * dt
    }

    /// Null-space motion that brings spare joints back to the start posture until the leg ends, in `rest` s.
    fn homeward(&self, spectrum: &Spectrum<N>, q: &Joints<N>, (dt, rest): (f64, f64)) -> Joints<N> {
        let rate = spectrum.null_part(&(self.nodes[0].q - q)) / rest;
        rate * (dt * HOMEWARD / rate.amax().max(HOMEWARD))
    }

    fn push_node(
        &mut self,
        leg: &Stretch<'_, N>,
        parent: usize,
        knots: Vec<Knot<N>>,
        way: &Way<N>,
    ) -> Option<usize> {
        let end = *knots.last()?;
        if way.fit == Fit::Exact && !end.waits {
            self.note_locks(parent, &knots);
        }
        let mut cost = self.nodes[parent].cost;
        let (mut before, mut t) = (
            self.nodes[parent].q,
            self.nodes[parent]
                .knots
                .last()
                .map_or(leg.from_s, |knot| knot.t),
        );
        let from_s = t;
        let mut heading = Joints::zeros();
        for knot in &knots {
            let dq = knot.q - before;
            cost += self.price(&dq, knot.t - t, &knot.q);
            if knot.t > t {
                heading = dq / (knot.t - t);
            }
            (before, t) = (knot.q, knot.t);
        }
        if way.is_lax() {
            let X = (leg.pose)(end.t - leg.from_s);
            let e = self.arm.error(&X, &self.arm.pose(&end.q));
            cost += 0.02 + 0.1 * self.excess(&e, &X);
        }
        if leg.fans() {
            let spectrum = self.arm.spectrum(&end.q);
            let narrow = (1.0 - spectrum.smallest() / 0.1).max(0.0);
            cost += (end.t - leg.from_s).min(0.1) * 2.0 * (narrow * narrow);
            let away = spectrum.null_part(&(end.q - self.nodes[0].q)).norm();
            cost += AWAY * away.min(1.0) * (end.t - from_s);
        }
        let is_locked = self.arm.spectrum(&end.q).smallest() < LOCKED;
        self.nodes.push(Node {
            parent: Some(parent),
            q: end.q,
            heading,
            cost,
            is_exact: !way.is_lax(),
            is_locked,
            knots,
        });
        Some(self.nodes.len() - 1)
    }

    /// Notes the locks that an edge passes between its ends: other branches begin there.
    fn note_locks(&mut self, parent: usize, knots: &[Knot<N>]) {
        let parent = &self.nodes[parent];
        let sigma = |q: &Joints<N>| self.arm.spectrum(q).smallest();
        let mut before = (parent.knots.last().map_or(0.0, |knot| knot.t), parent.q);
        let (first, mut last) = (before.0, sigma(&parent.q));
        let end = knots.last().map_or(first, |knot| knot.t);
        let (mut found, mut falls) = (vec![], false);
        for knot in knots {
            let (now, by) = (sigma(&knot.q), knot.q - before.1);
            self.pass(now);
            // σ changes by no more than a joint does. A lock is where it is least, at a knot or between two.
            if last + now < by.norm() {
                let at = |x: f64| sigma(&(before.1 + by * (0.5 * (x + 1.0))));
                let x = lowest((-1.0, 1.0), 40, at);
                let t = match x {
                    ..-0.99 => before.0,
                    ..=0.99 => before.0 + (knot.t - before.0) * 0.5 * (x + 1.0),
                    _ => knot.t,
                };
                let is_least = t != knot.t && (t != before.0 || falls);
                let is_layer = (t == first || t == end) && at(x) < LOCKED;
                if is_least && !is_layer && at(x) < 2.0 * LOCKED {
                    found.push(t);
                }
                falls = t == knot.t;
            } else {
                falls = now < last;
            }
            (before, last) = ((knot.t, knot.q), now);
        }
        for t in found {
            if self.locks.iter().all(|other| (other - t).abs() > 1e-4) {
                self.locks.push(t);
            }
        }
    }

    /// Time that a motion takes, and the price of being near a limit meanwhile.
    fn price(&self, dq: &Joints<N>, dt: f64, q: &Joints<N>) -> f64 {
        let time = dt.max(largest_share(dq, &(self.velocity * SPEED)));
        let (lower, upper) = self.range();
        let near = (0..N).fold(0.0_f64, |near, i| {
            let gap = (q[i] - lower[i]).min(upper[i] - q[i]);
            near.max(1.0 - gap / MARGIN)
        });
        // A route of less joint motion is better where the time is the same.
        time * (1.0 + 0.3 * near * near) + 0.002 * dq.norm()
    }

    fn outside(&self, q: &Joints<N>, from: &Joints<N>) -> Option<Block> {
        let (lower, upper) = self.range();
        (0..N).find_map(|i| {
            let (low, high) = (lower[i] + self.clear, upper[i] - self.clear);
            // A start posture may lie on a limit: from there inwards.
            let out = q[i] < low && q[i] < from[i] || q[i] > high && q[i] > from[i];
            out.then_some(Block::Limit {
                joint: i,
                value: q[i],
            })
        })
    }

    /// Knots from `q` at `t0` to `t1` (either may be the earlier): steps are doubled where one succeeds, halved where one fails.
    fn follow(
        &self,
        leg: &Stretch<'_, N>,
        q: &Joints<N>,
        heading: &Joints<N>,
        (t0, t1): (f64, f64),
        way: &Way<N>,
    ) -> Result<Vec<Knot<N>>, Furthest<N>> {
        let (mut t, mut q, mut heading, mut h) = (t0, *q, *heading, t1 - t0);
        let (mut knots, mut block) = (vec![], Block::End);
        let share = if way.is_lax() { BESIDE } else { 1.0 };
        while t != t1 {
            self.spent.set(self.spent.get() + 1);
            if (t + h - t1) * h.signum() > -1e-12 {
                h = t1 - t;
            }
            let is_long = knots.len() >= KNOTS;
            if is_long {
                self.cut();
            }
            let is_short = h.abs() < SHORTEST * leg.duration_s && t + h != t1;
            if self.is_spent(share) || is_long || is_short {
                return Err(Furthest { t, q, block });
            }
            let drift = match leg.posture {
                Some(posture) => posture(t + h) - q,
                None => way.drift * (h / (t1 - t0)),
            };
            let ahead = heading * h;
            let guess = if ahead.amax() < STEP { q + ahead } else { q };
            let (next, half) = match self.step(leg, (t, h), (&q, &guess), &drift, way) {
                Ok(step) => step,
                Err(far) => {
                    block = far.block;
                    // A limit in the way is reached as nearly as the shortest step allows: its place is worth knowing.
                    let is_at_limit = block != Block::End && h.abs() < 1e-3 * leg.duration_s;
                    if is_at_limit || h.abs() <= SHORTEST * leg.duration_s * 2.0 {
                        return Err(far);
                    }
                    h *= 0.5;
                    continue;
                }
            };
            let dq = next - q;
            if dq.amax() > 0.3 * STEP {
                knots.push(Knot::moving(leg.from_s + t + 0.5 * h, half));
            }
            t = if h == t1 - t { t1 } else { t + h };
            (heading, q) = (dq / h, next);
            knots.push(Knot::moving(leg.from_s + t, q));
            h *= 2.0;
        }
        Ok(knots)
    }

    /// The posture after a time `h` from `q` at `t`, and the one half-way.
    fn step(
        &self,
        leg: &Stretch<'_, N>,
        (t, h): (f64, f64),
        (q, guess): (&Joints<N>, &Joints<N>),
        drift: &Joints<N>,
        way: &Way<N>,
    ) -> Result<(Joints<N>, Joints<N>), Furthest<N>> {
        let X = (leg.pose)(t + h);
        let (next, e) = self.arm.solve(&X, guess, drift, way.damping, way.enough());
        let dq = next - q;
        let blocked = |q, block| Err(Furthest { t, q, block });
        let is_solved = self.fits(way.fit, &e, &X);
        // Off the path a route has kinks: there the spline needs points that lie closer.
        let longest = if way.is_lax() { STEP / 3.0 } else { STEP };
        if !(is_solved && dq.amax() < longest) {
            return blocked(*q, Block::End);
        }
        if let Some(limit) = self.outside(&next, q) {
            return blocked(next, limit);
        }
        match self.half_way(&(leg.pose)(t + 0.5 * h), q, &dq, way) {
            Some(half) => Ok((next, half)),
            None => blocked(*q, Block::End),
        }
    }

    /// By how much an error leaves the path, over what is allowed.
    fn excess(&self, e: &Vector6, X: &Pose) -> f64 {
        self.arm.excess(e, &X.R, &self.request.allowed)
    }

    /// Whether an error at a knot counts as none.
    fn fits(&self, fit: Fit, e: &Vector6, X: &Pose) -> bool {
        match fit {
            Fit::Exact => e.norm() < 1e-7,
            Fit::Plain => {
                let most = self.request.allowed.times(PLAIN).at_most(PLAIN_MOST);
                self.arm.excess(e, &X.R, &most) < 1.0
            }
            Fit::Lax => self.excess(e, X) < LEFT.0,
        }
    }

    /// The posture half-way of a motion `dq` from `q`, at the pose `X`. A jump to another branch shows there: the posture is elsewhere, or there is none.
    fn half_way(&self, X: &Pose, q: &Joints<N>, dq: &Joints<N>, way: &Way<N>) -> Option<Joints<N>> {
        let mean = q + dq * 0.5;
        let e = self.arm.error(X, &self.arm.pose(&mean));
        if way.is_lax() {
            return (self.excess(&e, X) < LEFT.1).then_some(mean);
        }
        let zero = Joints::zeros();
        let (there, e_left) = self.arm.solve(X, &mean, &zero, way.damping, way.enough());
        let is_smooth = (there - mean).norm() < BEND * dq.norm() + 1e-6;
        (e.norm() < STRAIGHT && way.fit == Fit::Exact
            || self.fits(way.fit, &e_left, X) && is_smooth)
            .then_some(there)
    }

    /// Ways out of a fold: the solutions beside the lock, followed back to it.
    fn folds(
        &self,
        leg: &Stretch<'_, N>,
        q: &Joints<N>,
        spectrum: &Spectrum<N>,
        t0: f64,
        t1: f64,
    ) -> Vec<Vec<Knot<N>>> {
        let mut out: Vec<Vec<Knot<N>>> = vec![];
        let X = (leg.pose)(t1);
        for k in (spectrum.free..N).filter(|k| spectrum.sigma[*k] < 0.1) {
            for stride in [0.02, -0.02, 0.06, -0.06, 0.18, -0.18] {
                self.spent.set(self.spent.get() + 4);
                let beside = q + spectrum.v[k] * stride;
                let (there, e) = self.arm.solve(&X, &beside, &Joints::zeros(), 0.0, SOLVED);
                let is_twin = |knot: &Knot<N>| is_twin(spectrum, &(knot.q - there));
                let is_known = out.iter().any(|knots| knots.last().is_some_and(is_twin));
                if e.norm() <= 1e-7
                    && (there - q).amax() <= 0.5
                    && !is_known
                    && self.outside(&there, q).is_none()
                    && !leg.is_across(&there)
                {
                    out.extend(self.back_to_lock(leg, q, &there, (t0, t1)));
                }
            }
        }
        out
    }

    /// From the lock in `q`, as near as a step, to the posture `there` beside it at `t1`: followed back as far as it goes.
    fn back_to_lock(
        &self,
        leg: &Stretch<'_, N>,
        q: &Joints<N>,
        there: &Joints<N>,
        (t0, t1): (f64, f64),
    ) -> Option<Vec<Knot<N>>> {
        let mut knots = vec![Knot::moving(leg.from_s + t1, *there)];
        let (mut at, mut t, mut share) = (*there, t1, 0.5);
        for _ in 0..RETURNS {
            if (at - q).amax() <= 0.2 * STEP || share < 1e-4 {
                break;
            }
            let to = t0 + (t - t0) * (1.0 - share);
            match self.follow(leg, &at, &Joints::zeros(), (t, to), &Way::exact()) {
                Ok(part) if !part.is_empty() => {
                    knots.extend(&part);
                    (at, t) = (part[part.len() - 1].q, to);
                    share = (2.0 * share).min(0.5);
                }
                _ => share *= 0.5,
            }
        }
        knots.reverse();
        ((at - q).amax() <= STEP && !self.is_spent(1.0)).then_some(knots)
    }

    /// The lock beside a posture, where the deviation allowed from the pose `path` leads into it; the posture itself where it does not.
    fn lock_beside(&self, q: &Joints<N>, path: &Pose) -> Joints<N> {
        let sigma = |q: &Joints<N>| self.arm.spectrum(q).smallest();
        let (mut there, mut now) = (*q, sigma(q));
        if !(LOCKED..BESIDE_LOCK).contains(&now) {
            return *q;
        }
        self.spent.set(self.spent.get() + 20);
        const STEP: f64 = 1e-5;
        for _ in 0..4 {
            let gradient = Joints::<N>::from_fn(|i, _| {
                let mut beside = there;
                beside[i] += STEP;
                (sigma(&beside) - now) / STEP
            });
            there -= gradient * (now / gradient.norm_squared().max(1e-6));
            now = sigma(&there);
            if now < 0.1 * LOCKED {
                break;
            }
        }
        let e = self.arm.error(path, &self.arm.pose(&there));
        let is_allowed =
            now < LOCKED && self.excess(&e, path) < LEFT.0 && self.outside(&there, q).is_none();
        if is_allowed { there } else { *q }
    }

    /// Postures of the same pose, reached by self-motion while the path waits.
    fn waits(&mut self, leg: &Stretch<'_, N>, node: usize, t: f64, at_start: bool) -> Vec<usize> {
        let path = (leg.pose)(t);
        let q = self.lock_beside(&self.nodes[node].q, &path);
        let spectrum = self.arm.spectrum(&q);
        let X = self.arm.pose(&q);
        let mut directions: Vec<Joints<N>> = vec![];
        let locked: Vec<_> = (spectrum.free..N)
            .filter(|k| spectrum.sigma[*k] < LOCKED)
            .map(|k| spectrum.v[k])
            .collect();
        match locked[..] {
            [] if leg.fans() && at_start => directions.extend(spectrum.spare()),
            [] => {}
            [v] => directions.push(v),
            [a, b, ..] => {
                // Of two lost directions the combination that leaves the pose where it is.
                let moved = |angle: f64| {
                    let v = a * libm::cos(angle) + b * libm::sin(angle);
                    let error = |by: f64| self.arm.error(&X, &self.arm.pose(&(q + v * by))).norm();
                    (error(0.1).max(error(-0.1)), v)
                };
                const PIECE: f64 = std::f64::consts::PI / 64.0;
                let angles = (0..64).map(|k| f64::from(k) * PIECE);
                let best = angles
                    .min_by(|a, b| moved(*a).0.total_cmp(&moved(*b).0))
                    .unwrap_or_default();
                let best = lowest((best - PIECE, best + PIECE), 40, |x| moved(x).0);
                directions.push(moved(best).1);
            }
        }
        // Where the path goes on to: a posture is left there only along what it can move.
        let soon = (leg.pose)((t + 0.02 * leg.duration_s).min(leg.duration_s));
        let onwards = self.arm.error(&soon, &path);
        let onwards = if onwards.norm() > 1e-9 {
            onwards.normalize()
        } else {
            onwards
        };
        let mut out = vec![];
        for v in directions {
            for v in [v, -v] {
                let from = AtRest {
                    node,
                    q,
                    v,
                    X: &X,
                    onwards: &onwards,
                    every: locked.is_empty(),
                };
                out.extend(self.self_motion(leg, &from, t));
            }
        }
        out
    }
}

/// Whether two solutions of a pose that lie apart by `by` belong to one branch.
fn is_twin<const N: usize>(spectrum: &Spectrum<N>, by: &Joints<N>) -> bool {
    by.amax() < SAME && (by - spectrum.null_part(by)).amax() < TWIN
}

/// The product of two task displacements' linear (0) or angular (3) halves.
fn dot(a: &Vector6, b: &Vector6, half: usize) -> f64 {
    a.fixed_rows::<3>(half).dot(&b.fixed_rows::<3>(half))
}

/// The half in which `b` has become the opposite of `a`, or nothing.
fn turned(a: &Vector6, b: &Vector6) -> Option<usize> {
    [0, 3]
        .into_iter()
        .find(|half| dot(b, b, *half) > 1e-12 && dot(a, b, *half) <= 0.0)
}
