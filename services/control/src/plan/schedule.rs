//! A route with its own clock: when the path waits, and how fast it may go (+).

use super::kinematics::{Kinematics, lowest};
use super::request::{Request, analyse, centre};
use super::route::Knot;
use crate::limits::speed::largest_share;
use crate::limits::{clock, range};
use crate::linear::Joints;
use crate::reference::path::{Leg, Path, Progress, ramped};
use crate::types::Report;
use model::Pose;

/// Share of a speed limit that the schedule takes.
const SCHEDULED: f64 = 0.92;
/// Most of the path's own time with which a plan is in time.
const IN_TIME: f64 = 1.01;
/// Share of the search's cost in what a plan is judged by: of two that take as long, the one further from limits.
const COSTS: f64 = 0.1;
/// Torque kept for a coordinate's bends over what they take by themselves: feedback and lag take the rest.
const BENDS: f64 = 1.6;
/// Share of the torque limits that slowing the clock down may take.
const BRAKE: f64 = 0.175;
/// Share of the torque rates that following the path may take, and the share of a torque that bends may take where a way counts as straight.
const RATE: f64 = 0.5;
const STRAIGHT: f64 = 0.25;
/// Most that the clock slows down by, 1/s: what it follows with its lag.
const HARDEST: f64 = 10.0;
/// Slowest clock that is planned.
pub(super) const SLOWEST: f64 = 0.005;
/// Share of the torque beside what holds the arm that it may take.
const TURNING_TORQUE: f64 = 0.5;
/// Shortest time in which it gets up to speed, s.
const SHORTEST_RAMP_S: f64 = 0.05;
/// Knots of a self-motion.
const PIECES: u32 = 24;
/// σ below which a knot is singular enough for the path to wait there.
pub(super) const SINGULAR: f64 = 0.05;
/// Shortest step of the route's clock, s; longest motion, at full joint speed, that counts as none.
const SHORTEST_S: f64 = 1e-7;
const BRIEF_S: f64 = 2e-3;
/// Share of the path's time that is next to none.
const INSTANT: f64 = 1e-3;

/// A point of the route.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point<const N: usize> {
    u: f64,
    t: f64,
    q: Joints<N>,
    /// dq/du, rad/s.
    slope: Joints<N>,
    /// Fastest clock here for which what follows can still be braked for.
    speed: f64,
}

/// A motion q(s) between two points, s the fraction of a leg's way.
#[derive(Clone)]
struct Way<const N: usize> {
    leg: usize,
    /// Δs.
    length: f64,
    /// q′.
    slope: Joints<N>,
    /// ṡ and s̈ at its beginning and in its middle.
    law: [(f64, f64); 2],
    /// s⃛ between them.
    jerk: f64,
}

/// Postures for the path, and the clock that runs along them.
#[derive(Clone, Debug, PartialEq)]
pub struct PathPlan<const N: usize> {
    points: Vec<Point<N>>,
    /// Times at which the legs that are planned end, on the path's clock, s.
    ends: Vec<f64>,
    /// Whether it ends before a leg whose goal is beyond reach.
    is_short: bool,
    cost: f64,
    duration_s: f64,
    /// How long it takes by its schedule, s.
    pub(super) takes_s: f64,
}

/// The route at one moment of its clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<const N: usize> {
    /// Time on the path's clock, s.
    pub t: f64,
    /// Speed of the path's clock against the route's: 1, or 0 while the path waits.
    pub time_rate: f64,
    /// Posture, rad.
    pub q: Joints<N>,
    /// Its rate per unit of the route's clock, rad/s.
    pub dq: Joints<N>,
}

impl<const N: usize> PathPlan<N> {
    pub(super) fn new(
        request: &Request<'_, N>,
        arm: &Kinematics<'_, N>,
        knots: &[Knot<N>],
        ends: &[f64],
        cost: f64,
        is_short: bool,
    ) -> Self {
        let (points, rests, stops) = timed(request, arm, knots, ends);
        let duration_s = points.last().map_or(0.0, |last| last.u);
        let mut plan = Self {
            points,
            ends: ends.to_vec(),
            is_short,
            cost,
            duration_s,
            takes_s: 0.0,
        };
        plan.slope(request, &rests);
        plan.limit_speed(request, &stops);
        plan
    }

    /// Gives every point at which the motion does not rest its slope: the mean of both sides, bounded.
    fn slope(&mut self, request: &Request<'_, N>, rests: &[usize]) {
        let points = &mut self.points;
        let (lower, upper) = (request.model.lower(), request.model.upper());
        for i in (1..points.len().saturating_sub(1)).filter(|i| !rests.contains(i)) {
            let (a, b) = (points[i].u - points[i - 1].u, points[i + 1].u - points[i].u);
            let (before, after) = (
                (points[i].q - points[i - 1].q) / a,
                (points[i + 1].q - points[i].q) / b,
            );
            let mean = (before * b + after * a) / (a + b);
            points[i].slope = Joints::from_fn(|j, _| {
                // Between a quick stretch and a slow one the spline must not overshoot.
                let bound = 2.0 * before[j].abs().min(after[j].abs()) + 0.1;
                // A cubic lies within its control points, a third of the slope away: they stay within the limits.
                let q = points[i].q[j];
                let (up, down) = (3.0 * (upper[j] - q).max(0.0), 3.0 * (q - lower[j]).max(0.0));
                mean[j]
                    .clamp(-bound, bound)
                    .clamp(-(down / b).min(up / a), (up / b).min(down / a))
            });
        }
    }

    fn limit_speed(&mut self, request: &Request<'_, N>, stops: &[usize]) {
        let mut analyzer = request.analyzer.clone();
        for i in 0..self.points.len() {
            let q = self.points[i].q;
            let report = analyse(&mut analyzer, request.model, &q);
            let speed = self
                .by_speed(request, i)
                .min(self.by_torque(request, i, &report));
            self.points[i].speed = speed.clamp(SLOWEST, 1.0);
        }
        for stop in stops {
            self.points[*stop].speed = SLOWEST;
        }
        for i in (0..self.points.len().saturating_sub(1)).rev() {
            let (here, next) = (self.points[i], self.points[i + 1]);
            let hardest = HARDEST.min(self.hardest(request, i));
            let bound = (next.speed * next.speed + 2.0 * hardest * (next.u - here.u)).sqrt();
            self.points[i].speed = here.speed.min(bound);
        }
        let takes =
            |pair: &[Point<N>]| 2.0 * (pair[1].u - pair[0].u) / (pair[0].speed + pair[1].speed);
        self.takes_s = self.points.windows(2).map(takes).sum();
    }

    /// Hardest change of the clock's speed at a point for which there is torque, 1/s.
    fn hardest(&self, request: &Request<'_, N>, i: usize) -> f64 {
        let Point { q, slope, .. } = self.points[i];
        let (effort, gravity) = (request.model.effort(), request.model.gravity(&q));
        let push = request.model.mass_matrix(&q) * slope;
        (0..N).fold(f64::INFINITY, |hardest, j| {
            let torque = BRAKE * effort[j].min(2.0 * clock::room(effort[j], gravity[j]));
            hardest.min(torque / push[j].abs().max(1e-9))
        })
    }

    /// Fastest clock at which the joints keep their speeds from one point to the next, and can be stopped before their limits.
    fn by_speed(&self, request: &Request<'_, N>, i: usize) -> f64 {
        let (Point { q, slope, u, .. }, velocity) = (self.points[i], request.velocity());
        let next = self.points.get(i + 1);
        let mean = next.map_or(slope, |next| (next.q - q) / (next.u - u));
        let share = largest_share(&slope, &velocity).max(largest_share(&mean, &velocity));
        (SCHEDULED / share.max(1e-9)).min(range::stoppable(&q, &slope, request.model))
    }

    /// How long the route takes at full speed, s.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// How many legs are planned.
    pub fn legs(&self) -> usize {
        self.ends.len()
    }

    /// Whether the plan ends before a leg whose goal is beyond reach.
    pub fn is_short(&self) -> bool {
        self.is_short
    }

    /// The leg that is the fastest for its joints, and the clock at which they can follow it: at most [`SCHEDULED`] of their limits at the peak of its time
    /// law.
    pub(super) fn fastest(&self, path: &Path, velocity: &Joints<N>) -> (usize, f64) {
        let mut needed = vec![0.0; self.legs()];
        for pair in self.points.windows(2).filter(|pair| pair[1].t > pair[0].t) {
            let by = pair[1].q - pair[0].q;
            if let Some(needed) = needed.get_mut(self.leg_between(&pair[0], &pair[1])) {
                *needed += largest_share(&by, velocity);
            }
        }
        let clock = |leg: usize| {
            let peak = path.leg(leg).map_or(1.0, Leg::peak);
            SCHEDULED * (self.ends[leg] - self.begins(leg)) / (peak * needed[leg]).max(1e-9)
        };
        (0..self.legs())
            .map(|leg| (leg, clock(leg)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((0, f64::INFINITY))
    }

    /// The leg in which the path goes from one point to the next.
    fn leg_between(&self, from: &Point<N>, to: &Point<N>) -> usize {
        self.ends
            .partition_point(|end| *end <= 0.5 * (from.t + to.t))
    }

    /// When a leg begins, s.
    fn begins(&self, leg: usize) -> f64 {
        leg.checked_sub(1).map_or(0.0, |before| self.ends[before])
    }

    /// Fastest clock at which the torques, and their rates, follow the time law of a leg from one point to the next.
    ///
    /// At the clock's speed r, a leg of the time law s(t) along q(s) takes the torque r²·[M·(q′·s̈ + q″·ṡ²) + c(q, q′·ṡ)] beside what holds the arm, and
    /// changes it by r³·M·q′·s⃛ where q(s) is straight; where it bends, as out of a fold, the other terms of the derivative take most of this one back. In a
    /// neighbourhood the law follows the spline between the points: there the torque of its bends counts, too.
    fn by_torque(&self, request: &Request<'_, N>, i: usize, report: &Report<N>) -> f64 {
        let Some(way) = self.way(request, i) else {
            return f64::INFINITY;
        };
        let (from, model) = (&self.points[i], request.model);
        let is_regular = report.listed().iter().all(|s| s.s.abs() >= s.eta_out);
        let neighbour = |i: Option<usize>| {
            let beside = self.way(request, i?)?;
            (beside.leg == way.leg && beside.length * way.length > 0.0).then_some(beside)
        };
        // At the beginning of a leg there is none before it: the next one shows whether q(s) is straight.
        let beside = neighbour(i.checked_sub(1)).or_else(|| neighbour(Some(i + 1)));
        let beside = beside.unwrap_or_else(|| way.clone());
        let (A, gravity) = (model.mass_matrix(&from.q), model.gravity(&from.q));
        // At the point: q′ between the slopes of both sides, which lie half a length away, and q″ from their difference.
        let length = way.length.abs() + beside.length.abs();
        let slope = (way.slope * beside.length.abs() + beside.slope * way.length.abs()) / length;
        let turn = A * (way.slope - beside.slope);
        let (straight, bends) = (A * slope, turn * (2.0 / (way.length + beside.length)));
        let [(v, a), (v_mid, a_mid)] = way.law;
        let coriolis = model.bias(&from.q, &(slope * v)) - gravity;
        let (effort, torque_rate) = (model.effort(), model.torque_rate());
        let bends_here = if is_regular {
            [Joints::zeros(); 2]
        } else {
            let own = model.bias(&from.q, &from.slope) - gravity;
            self.bends(i).map(|bend| A * bend * BENDS + own)
        };
        let mut fastest = f64::INFINITY;
        for j in 0..N {
            let (along, bend) = (straight[j] * a + coriolis[j], bends[j] * v * v);
            let mut torque = (along + bend).abs();
            torque = bends_here
                .iter()
                .fold(torque, |most, own| most.max(own[j].abs()));
            let is_straight = turn[j].abs() <= STRAIGHT * straight[j].abs()
                && (bends[j] * v_mid * v_mid).abs() <= STRAIGHT * (straight[j] * a_mid).abs();
            if is_straight {
                torque = torque.max((straight[j] * a_mid).abs());
                let change = (straight[j] * way.jerk).abs();
                fastest = fastest.min(libm::cbrt(RATE * torque_rate[j] / change.max(1e-9)));
            }
            let room = clock::room(effort[j], gravity[j]);
            fastest = fastest.min((room / torque.max(1e-9)).sqrt());
        }
        fastest
    }

    /// The route's second derivative by its clock at a point, rad/s²: of the spline that ends there, and of the one that begins.
    fn bends(&self, i: usize) -> [Joints<N>; 2] {
        let bend = |pair: &[Point<N>], at_end: f64| {
            let h = pair[1].u - pair[0].u;
            let mean = (pair[1].q - pair[0].q) / h;
            ((mean - pair[0].slope) * (4.0 - 6.0 * at_end)
                + (mean - pair[1].slope) * (2.0 - 6.0 * at_end))
                / h
        };
        let between = |from: Option<usize>, at_end: f64| {
            let pair = from.and_then(|from| self.points.get(from..from + 2));
            pair.map_or_else(Joints::zeros, |pair| bend(pair, at_end))
        };
        [between(i.checked_sub(1), 1.0), between(Some(i), 0.0)]
    }

    /// The way from a point to the next as a function of a leg's time law; `None` where the path rests.
    fn way(&self, request: &Request<'_, N>, i: usize) -> Option<Way<N>> {
        let (from, to) = (self.points.get(i)?, self.points.get(i + 1)?);
        let leg = self.leg_between(from, to);
        let law = |t: f64| {
            let time_s = t - self.begins(leg);
            request.path.fraction(&Progress {
                leg,
                time_s,
                ..Progress::at(Pose::identity())
            })
        };
        let [[s, v, a], [_, v_mid, a_mid], [s_next, _, a_next]] =
            [from.t, 0.5 * (from.t + to.t), to.t].map(law);
        let length = s_next - s;
        (length.abs() > 1e-9).then(|| Way {
            leg,
            length,
            slope: (to.q - from.q) / length,
            law: [(v, a), (v_mid, a_mid)],
            jerk: (a_next - a) / (to.t - from.t),
        })
    }

    /// The price by which plans are compared: its time, s, and for a small part the search's cost.
    pub(super) fn price(&self) -> f64 {
        self.takes_s + COSTS * (self.cost - self.takes_s)
    }

    /// Whether a better route is not worth looking for.
    pub(super) fn is_in_time(&self) -> bool {
        let path_s = self.points.last().map_or(0.0, |last| last.t);
        self.takes_s < IN_TIME * path_s
    }

    /// The route's postures.
    pub fn postures(&self) -> impl Iterator<Item = (f64, &Joints<N>)> {
        self.points.iter().map(|point| (point.t, &point.q))
    }

    pub(super) fn singular_times(&self, request: &Request<'_, N>) -> Vec<f64> {
        let knots: Vec<_> = self
            .points
            .iter()
            .map(|point| Knot::moving(point.t, point.q))
            .collect();
        singular_times(request, &knots)
    }

    /// The points about `u` of the route's clock, and the share of the way from the first to the second; `None` beyond its ends.
    #[inline]
    fn about(&self, u: f64) -> Option<(&Point<N>, &Point<N>, f64)> {
        let after = self.points.partition_point(|point| point.u <= u);
        let (a, b) = (
            self.points.get(after.checked_sub(1)?)?,
            self.points.get(after)?,
        );
        Some((a, b, (u - a.u) / (b.u - a.u)))
    }

    /// Time on the path's clock at `u` of the route's, s: that of [`at`](Self::at).
    pub fn path_time(&self, u: f64) -> f64 {
        self.about(u)
            .map_or_else(|| self.time_beyond(u), |(a, b, x)| time_between(a, b, x))
    }

    /// Fastest that the route's clock may run anywhere between two of its times.
    pub fn speed(&self, from: f64, to: f64) -> f64 {
        let at = |u: f64| {
            self.about(u)
                .map_or(1.0, |(a, b, x)| speed_between(a, b, x))
        };
        let first = self.points.partition_point(|point| point.u <= from);
        self.points[first..]
            .iter()
            .take_while(|point| point.u < to)
            .fold(at(from).min(at(to)), |least, point| least.min(point.speed))
    }

    /// Time on the path's clock beyond the route's end, s: both clocks go on together.
    fn time_beyond(&self, u: f64) -> f64 {
        self.points.last().map_or(0.0, |last| last.t) + (u - self.duration_s).max(0.0)
    }

    /// The route at `u` of its clock; beyond its end the last posture, at rest.
    pub fn at(&self, u: f64) -> Sample<N> {
        let Some((a, b, x)) = self.about(u) else {
            let q = self.points.last().map_or_else(Joints::zeros, |last| last.q);
            return Sample {
                t: self.time_beyond(u),
                time_rate: 1.0,
                q,
                dq: Joints::zeros(),
            };
        };
        let h = b.u - a.u;
        // Cubic Hermite.
        let (x2, x3) = (x * x, x * x * x);
        let q = a.q * (2.0 * x3 - 3.0 * x2 + 1.0)
            + a.slope * (h * (x3 - 2.0 * x2 + x))
            + b.q * (3.0 * x2 - 2.0 * x3)
            + b.slope * (h * (x3 - x2));
        let dq = (b.q - a.q) * (6.0 * (x - x2) / h)
            + a.slope * (3.0 * x2 - 4.0 * x + 1.0)
            + b.slope * (3.0 * x2 - 2.0 * x);
        let time_rate = (b.t - a.t) / h;
        let time_rate = if time_rate > 0.5 { 1.0 } else { 0.0 };
        Sample {
            t: time_between(a, b, x),
            time_rate,
            q,
            dq,
        }
    }
}

/// The points of a route on its own clock; those at which the motion rests, and those at which the path itself has to rest though it is on its way.
fn timed<const N: usize>(
    request: &Request<'_, N>,
    arm: &Kinematics<'_, N>,
    knots: &[Knot<N>],
    ends: &[f64],
) -> (Vec<Point<N>>, Vec<usize>, Vec<usize>) {
    let point = |u: f64, t: f64, q: Joints<N>| Point {
        u,
        t,
        q,
        slope: Joints::zeros(),
        speed: 1.0,
    };
    let at_end = |t: f64| t < 1e-9 || ends.iter().any(|end| (end - t).abs() < 1e-9);
    let Some(first) = knots.first() else {
        return (vec![], vec![], vec![]);
    };
    let velocity = request.velocity();
    // Where a damped step leads past a lock, a route may turn in next to no time: while it does, the path waits.
    let is_instant = |by: f64| by < INSTANT * ends.last().copied().unwrap_or_default();
    let waits = |a: &Knot<N>, b: &Knot<N>| {
        let (least_s, by) = (largest_share(&(b.q - a.q), &velocity), b.t - a.t);
        b.waits || is_instant(by) && SLOWEST * least_s > SCHEDULED * by
    };
    // The route begins at its first knot, which waits for nothing.
    let mut points = vec![point(0.0, first.t, first.q)];
    let (mut rests, mut stops) = (vec![0], vec![]);
    let mut from = 0;
    while from + 1 < knots.len() {
        let pairs = knots[from..].windows(2);
        let waiting = pairs.take_while(|pair| waits(&pair[0], &pair[1])).count();
        let way = &knots[from..=from + waiting.max(1)];
        from += way.len() - 1;
        let (last, knot) = (points[points.len() - 1], way[way.len() - 1]);
        let rests_there = way.iter().skip(1).all(|knot| knot.waits);
        let is_brief = !rests_there && largest_share(&(knot.q - last.q), &velocity) < BRIEF_S;
        if waiting == 0 || is_brief {
            if knot.t - last.t > SHORTEST_S {
                points.push(point(last.u + knot.t - last.t, knot.t, knot.q));
                if at_end(knot.t) {
                    rests.push(points.len() - 1);
                }
            }
            continue;
        }
        let mut postures = vec![last.q];
        postures.extend(way.iter().skip(1).map(|knot| knot.q));
        let moved = self_motion(request, arm, &last, &postures, rests_there);
        let here = [points.len() - 1, points.len() - 1 + moved.len()];
        points.extend(moved.into_iter().map(|(u, q)| point(u, last.t, q)));
        rests.extend(here);
        if !at_end(last.t) {
            stops.extend(here);
        }
    }
    (points, rests, stops)
}

/// Time on the path's clock at a share `x` of the way between two points, s.
#[inline]
fn time_between<const N: usize>(a: &Point<N>, b: &Point<N>, x: f64) -> f64 {
    a.t + (b.t - a.t) * x
}

/// Fastest clock at a share `x` of the way between two points: its square changes evenly, as under constant braking.
#[inline]
fn speed_between<const N: usize>(a: &Point<N>, b: &Point<N>, x: f64) -> f64 {
    (a.speed * a.speed * (1.0 - x) + b.speed * b.speed * x).sqrt()
}

/// A motion while the path waits as (u, q): a ramp up to full speed and down along the way, whose postures keep the pose where the path `rests` in it.
fn self_motion<const N: usize>(
    request: &Request<'_, N>,
    arm: &Kinematics<'_, N>,
    from: &Point<N>,
    way: &[Joints<N>],
    rests: bool,
) -> Vec<(f64, Joints<N>)> {
    let speeds = request.velocity() * SCHEDULED;
    let lengths = way.windows(2);
    let lengths: Vec<f64> = lengths
        .map(|pair| largest_share(&(pair[1] - pair[0]), &speeds))
        .collect();
    let whole: f64 = lengths.iter().sum();
    // A ramp accelerates by 1.5 of its rate over its time: to full speed, or half of the way.
    let up_s = 1.5 * inertia(request, way, &lengths);
    let up_s = up_s.min((up_s * whole).sqrt()).max(SHORTEST_RAMP_S);
    let T = whole.max(up_s) + up_s;
    // The first part may lead into a lock beside the path: from there on the pose rests.
    let X = arm.pose(&way[way.len() - 1]);
    let is_still = arm.error(&X, &arm.pose(&from.q)).norm() < 1e-5;
    let piece = |k: u32| {
        let time = f64::from(k) / f64::from(PIECES);
        let mut left = whole * ramped(T * time, T, up_s)[0];
        let (mut q, mut is_beside) = (way[way.len() - 1], false);
        for (part, (pair, length)) in way.windows(2).zip(&lengths).enumerate() {
            if left <= *length {
                q = pair[0] + (pair[1] - pair[0]) * (left / length.max(1e-12));
                is_beside = part == 0 && !is_still;
                break;
            }
            left -= length;
        }
        if rests && !is_beside {
            q = arm.at_rest(&X, &q).0;
        }
        (from.u + T * time, q)
    };
    (1..=PIECES).map(piece).collect()
}

/// Torque of a self-motion along `way` over what there is for it, per acceleration along the way, whose parts take `lengths` at full speed, s; s.
fn inertia<const N: usize>(request: &Request<'_, N>, way: &[Joints<N>], lengths: &[f64]) -> f64 {
    let model = request.model;
    let (A, gravity) = (model.mass_matrix(&way[0]), model.gravity(&way[0]));
    let room = model.effort().zip_map(&gravity, |effort, gravity| {
        TURNING_TORQUE * clock::room(effort, gravity)
    });
    way.windows(2)
        .zip(lengths)
        .fold(0.0, |time, (pair, length)| {
            time.max(largest_share(&(A * (pair[1] - pair[0])), &room) / length.max(1e-9))
        })
}

/// Times at which a route is nearest to a singular posture.
pub(super) fn singular_times<const N: usize>(
    request: &Request<'_, N>,
    knots: &[Knot<N>],
) -> Vec<f64> {
    let Some(first) = knots.first() else {
        return vec![];
    };
    let report = analyse(&mut request.analyzer.clone(), request.model, &first.q);
    let arm = request.kinematics(centre(request.model, &first.q, &report));
    let sigma: Vec<f64> = knots
        .iter()
        .map(|knot| arm.spectrum(&knot.q).smallest())
        .collect();
    let is_lowest =
        |i: usize| sigma[i] < SINGULAR && sigma[i] <= sigma[i - 1] && sigma[i] <= sigma[i + 1];
    let refined = |i: usize| {
        // Between the neighbours, along the straight motion.
        let neighbour = |x: f64| &knots[if x < 0.0 { i - 1 } else { i + 1 }];
        let q = |x: f64| knots[i].q + (neighbour(x).q - knots[i].q) * x.abs();
        let x = lowest((-1.0, 1.0), 30, |x| arm.spectrum(&q(x)).smallest());
        knots[i].t + (neighbour(x).t - knots[i].t) * x.abs()
    };
    (1..knots.len().saturating_sub(1))
        .filter(|i| is_lowest(*i))
        .map(refined)
        .take(8)
        .collect()
}
