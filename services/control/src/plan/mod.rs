//! The plan: one search along the whole path, before the arm moves (+).
//!
//! **What is searched.** A route: a chain of postures q(t), one for every pose of the path, each reached from the start posture by continuous motion
//! within the joint limits, so that no jump between branches can hide in it.
//!
//! **Over which branches.** Each leg has layers at equal times ([`LAYERS`] at most, more where a curve is long), and the postures of a layer are followed to the next one by Newton
//! steps of adaptive length. Regular postures have one way on. More of them are tried where the arm is nearly singular: past the lock with ζ off the
//! direction of travel, within the deviation that the user allows; out of a fold on either side; and, exactly in a lock, a self-motion that turns ζ while
//! the path waits. Spare joints are tried both ways. A layer keeps its 10 cheapest postures,
//! and 10 more that lie apart from those.
//!
//! **By which cost.** The time that the motion takes at 0.8 of the speed limits, raised near joint limits and near singular postures, and a price for
//! every stop and every deviation.
//!
//! **When it gives up.** After 40,000 steps in a leg (more in a long curve), 100,000 in all, or with a layer that has no posture. A first search without further
//! ways is enough where its route takes no longer than the path; so is the law without a plan, where it keeps to the path by itself ([`rehearsal`]). Else
//! the spare joint's posture is chosen anew for time ([`ease`]), and a second search adds layers where that route is nearest to a singular posture: the
//! quicker route is kept. [`Infeasible`] gives the reason otherwise, and how much was covered.
//!
//! The route's own clock u runs as the path's does, but also while the path waits ([`schedule`]). PURE and deterministic; allocates.

pub(crate) mod beyond_reach;
mod ease;
pub mod kinematics;
pub(crate) mod rehearsal;
mod request;
mod route;
pub(crate) mod scenario;
mod schedule;

pub use request::{Deviation, Request};
pub use schedule::{PathPlan, Sample};

use crate::linear::{Joints, Vector3};
use crate::paper::type_1::SIDE_CHANGE;
use crate::reference::path::{Leg, Progress};
use crate::singularity::analyzer::Analyzer;
use crate::types::{Kind, Report};
use kinematics::Kinematics;
use model::{Model, Pose};
use request::{analyse, centre};
use route::{ADVICE, ARRIVED, Block, Effort, Furthest, Knot, STEPS, Search, Stretch};

/// Most layers of a leg.
pub const LAYERS: usize = 40;
/// Length of a curve, in the arm's own and with its turn in rad, that counts as a line; most lines in a curve.
const LINE: f64 = 2.5;
const LINES: f64 = 10.0;
/// Layers of all legs together, where a task has many.
const LAYERS_IN_ALL: usize = 4000;
/// Seeds from which a pose is looked for anywhere in the joint space.
const SEEDS: u32 = 48;
/// Points between the end of the furthest route and that of its leg at which the reach is asked for.
const PROBES: u32 = 50;
/// Other start postures that are tried for a remedy, how far they lie apart, rad, and the deviations: factors on what the task allows.
const STARTS: usize = 6;
const DISTINCT: f64 = 0.1;
const ALLOWANCES: [f64; 2] = [4.0, 16.0];

/// Most of a route's time that another posture of the spare joint must take to be worth its motion.
const WORTH: f64 = 0.97;

/// Why there is no route.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Infeasible {
    /// Index of the leg.
    pub leg: usize,
    /// Time on the path's clock to which the best route comes, s.
    pub time_s: f64,
    /// The cause of its end.
    pub obstacle: Obstacle,
    /// Whether the search has covered all branches, self-motions in locks and full turns, not a sample: there is no route.
    pub is_certain: bool,
}

/// The cause of the best route's end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Obstacle {
    /// A joint would leave its limits.
    Limit {
        /// Index of the joint.
        joint: usize,
        /// Its limit, rad (m).
        limit: f64,
    },
    /// The path leaves the reachable space between reachable ends.
    Reach,
    /// No posture continues the motion, though the poses are within reach.
    Discontinuous,
    /// The search has ended before it had tried everything, or as good as at the goal, or the goal lies on the branch where the search ended.
    Undecided,
}

/// A change of the task that makes it feasible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Remedy<const N: usize> {
    /// Start in this posture of the same pose, rad.
    Start(Joints<N>),
    /// Allow so much deviation from the path.
    Allow(Deviation),
}

/// A remedy for a task that is not feasible, and that `helps`: another posture of the start pose, else more deviation from the path.
///
/// Cost up to [`STARTS`] + [`ALLOWANCES`] searches, and as many calls of `helps`: only for a refusal's words.
pub fn remedy<const N: usize>(
    request: &Request<'_, N>,
    helps: &mut dyn FnMut(&Remedy<N>) -> bool,
) -> Option<Remedy<N>> {
    let legs = request.path.legs().len();
    let holds = |request: &Request<'_, N>| {
        let found = attempt(request, Effort::Branches, &[], ADVICE);
        found.is_ok_and(|plan| plan.legs() == legs)
    };
    let arm = request.kinematics(Vector3::zeros());
    let X = arm.pose(&request.q_start);
    let (lower, upper) = (request.model.lower(), request.model.upper());
    let mut starts = vec![request.q_start];
    for k in 0..SEEDS {
        let near = spread(request.model, k);
        let Some(q) = arm.approach(&X, &near) else {
            continue;
        };
        let fits = (0..N).all(|i| q[i] >= lower[i] && q[i] <= upper[i])
            && starts.iter().all(|other| (q - other).amax() > DISTINCT);
        if fits && starts.len() <= STARTS {
            starts.push(q);
        }
    }
    starts[1..].sort_by(|a, b| {
        (a - request.q_start)
            .norm()
            .total_cmp(&(b - request.q_start).norm())
    });
    let other_starts = starts[1..].iter().map(|q| {
        let there = Request {
            q_start: *q,
            ..*request
        };
        (Remedy::Start(*q), there)
    });
    let allowances = ALLOWANCES.map(|factor| {
        let allowed = request.allowed.times(factor);
        (
            Remedy::Allow(allowed),
            Request {
                allowed,
                ..*request
            },
        )
    });
    other_starts
        .chain(allowances)
        .find(|(remedy, changed)| holds(changed) && helps(remedy))
        .map(|(remedy, _)| remedy)
}

/// A plan for the whole path, or as far as it lies within reach; `None` where the plain continuation does not do, but the law `is_followed` without.
///
/// # Errors
/// [`Infeasible`] where no continuous motion within the limits was found that follows the path. A leg whose goal is beyond reach is no such case: the
/// plan ends where that leg begins.
pub fn plan<const N: usize>(
    request: &Request<'_, N>,
    is_followed: &dyn Fn() -> bool,
) -> Result<Option<PathPlan<N>>, Infeasible> {
    let plain = attempt(request, Effort::Plain, &[], STEPS);
    let is_easy = plain.as_ref().is_ok_and(PathPlan::is_in_time);
    if !is_easy && is_followed() {
        return Ok(None);
    }
    let found = if is_easy {
        plain
    } else {
        searched(request, plain)
    };
    found.map(Some).map_err(|failed| failed.why)
}

/// The best of the `plain` continuation and the routes of further searches.
fn searched<const N: usize>(request: &Request<'_, N>, plain: Found<N>) -> Found<N> {
    let quick = attempt(request, Effort::Branches, &[], STEPS);
    if quick.as_ref().is_ok_and(PathPlan::is_in_time) {
        return quick;
    }
    let times = match &quick {
        Ok(plan) => plan.singular_times(request),
        Err(failed) => {
            let mut times = schedule::singular_times(request, &failed.knots);
            times.extend(&failed.locks);
            times
        }
    };
    let mut found = better(plain, quick);
    if has_spare_joints(request) {
        found = better(found, attempt(request, Effort::Fan, &times, STEPS));
    } else if !times.is_empty() {
        found = better(found, attempt(request, Effort::Branches, &times, STEPS));
    }
    found
}

/// The better one of two searches: the plan that leads further, the quicker one of those, or the reason of the one that came further.
fn better<const N: usize>(one: Found<N>, two: Found<N>) -> Found<N> {
    match (one, two) {
        (Ok(one), Ok(two)) => {
            let is_better =
                two.legs() > one.legs() || two.legs() == one.legs() && two.price() < one.price();
            Ok(if is_better { two } else { one })
        }
        (Ok(plan), Err(_)) | (Err(_), Ok(plan)) => Ok(plan),
        // The later search has tried more.
        (Err(one), Err(two)) => Err(if two.legs >= one.legs { two } else { one }),
    }
}

/// Whether the arm has more joints than the task has axes.
fn has_spare_joints<const N: usize>(request: &Request<'_, N>) -> bool {
    // An absent joint moves nothing, and is no spare one.
    let J = request.model.jacobian(&request.q_start);
    let joints = J.column_iter().filter(|column| column.amax() > 0.0).count();
    joints > request.robot.task.count()
}

/// The outcome of a search.
type Found<const N: usize> = Result<PathPlan<N>, Box<Failed<N>>>;

/// A plan that was not found: why, and the knots of the route that came furthest.
struct Failed<const N: usize> {
    why: Infeasible,
    knots: Vec<Knot<N>>,
    /// Times of the locks between its layers, s.
    locks: Vec<f64>,
    /// How many legs a route was found for.
    legs: usize,
}

/// One search of at most so many steps; `times` are further layers, on the path's clock.
fn attempt<const N: usize>(
    request: &Request<'_, N>,
    effort: Effort,
    times: &[f64],
    most: u32,
) -> Found<N> {
    let mut route = Route::new(*request, most);
    while let Some(leg) = request.path.leg(route.progress.leg).copied() {
        if let Some((place, angle)) = leg.reorient {
            route.turn(&leg, (place, angle));
        } else if !route.follow(&leg, effort, times) {
            let Some(why) = route.infeasible(&leg) else {
                // The controller clips the goal to the boundary, and reports it.
                return Ok(route.planned(true));
            };
            return Err(Box::new(Failed {
                why,
                knots: route.search.chain(route.search.deepest()),
                locks: route.search.locks.clone(),
                legs: route.ends.len(),
            }));
        }
        route.end_leg(&leg);
    }
    Ok(route.planned(false))
}

/// The routes of one search, up to the beginning of a leg.
struct Route<'a, const N: usize> {
    request: Request<'a, N>,
    arm: Kinematics<'a, N>,
    search: Search<'a, N>,
    /// The postures from which the leg begins, one per route.
    layer: Vec<usize>,
    /// At the beginning of the path, and of the leg.
    begun: Progress,
    progress: Progress,
    /// Time on the path's clock, s.
    from_s: f64,
    /// Times at which the legs before end, s.
    ends: Vec<f64>,
    analyzer: Analyzer<N>,
    /// The last analysis that a leg depends on, and how many knots of its route have been analysed.
    report: Report<N>,
    analysed: usize,
    /// Most layers of a leg.
    layers_max: usize,
}

impl<'a, const N: usize> Route<'a, N> {
    fn new(request: Request<'a, N>, most: u32) -> Self {
        let Request {
            model,
            path,
            q_start,
            ..
        } = request;
        let mut analyzer = request.analyzer.clone();
        let report = analyse(&mut analyzer, model, &q_start);
        let arm = request.kinematics(centre(model, &q_start, &report));
        let mut progress = Progress::at(model.forward_kinematics(&q_start));
        path.advance(&mut progress, 0.0, &report);
        let legs = path.legs().len();
        Self {
            request,
            arm,
            search: Search::new(request, arm, most),
            layer: vec![0],
            begun: progress,
            progress,
            from_s: 0.0,
            ends: vec![],
            analyzer,
            report,
            analysed: 0,
            layers_max: (LAYERS_IN_ALL / legs.max(1)).clamp(4, LAYERS),
        }
    }

    /// The cheapest posture from which the leg begins.
    fn best(&self) -> usize {
        self.search.best(&self.layer).unwrap_or_default()
    }

    /// The plan of the legs before the present one.
    fn planned(&self, is_short: bool) -> PathPlan<N> {
        let node = self.best();
        let knots = self.search.chain(node);
        let cost = self.search.node(node).cost;
        let timed = |knots: &[Knot<N>]| {
            PathPlan::new(&self.request, &self.arm, knots, &self.ends, cost, is_short)
        };
        let plan = timed(&knots);
        let is_eased = |eased: &PathPlan<N>| eased.takes_s < WORTH * plan.takes_s;
        let eased = (self.ends.len() == 1 && !plan.is_in_time())
            .then(|| ease::eased(&self.request, &self.arm, &knots, &self.pose(self.begun)))
            .flatten();
        eased
            .map(|knots| timed(&knots))
            .filter(is_eased)
            .unwrap_or(plan)
    }

    /// The desired pose of C as a function of the time within a leg, s.
    fn pose(&self, begun: Progress) -> impl Fn(f64) -> Pose + use<'a, N> {
        let (path, p_EC) = (self.request.path, self.arm.p_EC);
        move |t| {
            let X = path
                .desired(&Progress { time_s: t, ..begun }, 1.0, 0.0)
                .at(&p_EC);
            Pose { R: X.R, p: X.p }
        }
    }

    /// Goes through a leg that turns ζ of the singularity in a place by an angle, rad.
    fn turn(&mut self, leg: &Leg, (place, angle): (usize, f64)) {
        let node = self.best();
        self.choose(node);
        let q = self.search.node(node).q;
        // Where ζ cannot be turned the controller reports it when the leg begins.
        let by = self.request.turning(&q, &self.report, place, angle);
        let by = by.unwrap_or_else(Joints::zeros);
        let knots = (1..=24).map(|k| {
            let t = leg.duration_s * f64::from(k) / 24.0;
            let x = self.request.path.fraction(&Progress {
                time_s: t,
                ..self.progress
            })[0];
            Knot::moving(self.from_s + t, q + by * x)
        });
        let knots = knots.collect();
        self.layer = self.search.append(node, knots).into_iter().collect();
    }

    /// Searches for routes along a leg that moves the end-effector; false where none leads to its end.
    fn follow(&mut self, leg: &Leg, effort: Effort, times: &[f64]) -> bool {
        let request = self.request;
        let Request {
            path,
            q_start,
            postures,
            ..
        } = request;
        let (begun, from_s, pose) = (self.progress, self.from_s, self.pose(self.progress));
        let side = |q: &Joints<N>| request.side(q);
        let goal = postures.get(begun.leg).copied().flatten();
        let before = begun
            .leg
            .checked_sub(1)
            .and_then(|i| postures.get(i).copied().flatten())
            .unwrap_or(q_start);
        let ramp = |t: f64| {
            before + (goal.unwrap_or(before) - before) * path.ramp(&Progress { time_s: t, ..begun })
        };
        let still = path.is_still(&begun) && goal.is_none();
        let (length, angle) = path.extent(begun.leg);
        let lines = ((length / self.arm.length_m + angle) / LINE)
            .ceil()
            .clamp(1.0, LINES);
        let count = if still {
            1
        } else {
            self.layers_max * lines as usize
        };
        let layers = layers(leg.duration_s, count, times.iter().map(|t| t - from_s));
        let stretch = Stretch {
            from_s,
            duration_s: leg.duration_s,
            pose: &pose,
            branch: leg.branch,
            side: &side,
            posture: goal.is_some().then_some(&ramp as &dyn Fn(f64) -> Joints<N>),
            layers: &layers,
            lines: lines as u32,
            effort: if still && effort == Effort::Fan {
                Effort::Branches
            } else {
                effort
            },
        };
        let mut found = self.search.leg(&stretch, &self.layer);
        let began = || request.fold(&self.search.node(self.best()).q);
        if leg.branch != 0 && began().is_some_and(|s| s.inside && s.kind == Kind::Elbow) {
            // A fold in whose neighbourhood the leg begins is left on the side that it asks for.
            let is_there = |x: f64| x * f64::from(leg.branch) > -SIDE_CHANGE;
            found.retain(|node| is_there(side(&self.search.node(*node).q)));
        }
        if found.is_empty() {
            return false;
        }
        self.layer = found;
        true
    }

    /// Why no route leads to the end of a leg; `None` where its goal is beyond reach.
    fn infeasible(&self, leg: &Leg) -> Option<Infeasible> {
        let (request, arm, pose) = (&self.request, &self.arm, self.pose(self.progress));
        let goal = pose(leg.duration_s);
        let far = self.search.furthest.unwrap_or(Furthest {
            t: self.from_s,
            q: request.q_start,
            block: Block::End,
        });
        if !reachable(arm, &goal, &far.q) {
            return None;
        }
        let error = arm.error(&goal, &pose(far.t - self.from_s));
        let left = arm.excess(&error, &goal.R, &request.allowed);
        let leaves = self.leaves_reach(leg, &far);
        let obstacle = match far.block {
            _ if left < ARRIVED => Obstacle::Undecided,
            _ if leaves.is_some() => Obstacle::Reach,
            _ if self.search.is_cut() => Obstacle::Undecided,
            Block::Limit { joint, value } => {
                let (low, high) = (request.model.lower()[joint], request.model.upper()[joint]);
                Obstacle::Limit {
                    joint,
                    limit: if value - low < high - value {
                        low
                    } else {
                        high
                    },
                }
            }
            // The goal is on the branch where the arm is: the law may get there, though no route of the search does.
            Block::End if arm.approach(&goal, &far.q).is_some() => Obstacle::Undecided,
            Block::End => Obstacle::Discontinuous,
        };
        Some(Infeasible {
            leg: self.progress.leg,
            time_s: leaves.unwrap_or(far.t),
            obstacle,
            is_certain: obstacle != Obstacle::Undecided
                && !has_spare_joints(request)
                && !self.search.passes_locks.get(),
        })
    }

    /// The time from which on no posture has the path's pose, between the furthest that a route came to and the leg's end, s.
    fn leaves_reach(&self, leg: &Leg, far: &Furthest<N>) -> Option<f64> {
        let (pose, mut near) = (self.pose(self.progress), far.q);
        let (from, rest) = (far.t - self.from_s, leg.duration_s - (far.t - self.from_s));
        let at = |k: u32| from + rest * f64::from(k) / f64::from(PROBES);
        let is_out = |k: &u32| {
            let X = pose(at(*k));
            let there = self.arm.approach(&X, &near);
            near = there.unwrap_or(near);
            there.is_none() && !reachable(&self.arm, &X, &near)
        };
        (1..=PROBES).find(is_out).map(|k| self.from_s + at(k - 1))
    }

    /// Goes on from one posture alone.
    fn choose(&mut self, node: usize) {
        if self.layer != [node] {
            self.search.cut();
        }
        self.layer = vec![node];
    }

    /// Ends a leg: a next one that is relative to the posture begins from the best route alone, whose knots are analysed.
    fn end_leg(&mut self, leg: &Leg) {
        let path = self.request.path;
        if path
            .leg(self.progress.leg + 1)
            .is_some_and(Leg::is_relative)
        {
            let node = self.best();
            self.choose(node);
            let chain = self.search.chain(node);
            for knot in &chain[self.analysed..] {
                self.report = analyse(&mut self.analyzer, self.request.model, &knot.q);
            }
            self.analysed = chain.len();
        }
        self.from_s += leg.duration_s;
        self.ends.push(self.from_s);
        let mut next = Progress {
            time_s: leg.duration_s,
            ..self.progress
        };
        path.advance(&mut next, 0.0, &self.report);
        self.progress = Progress {
            time_s: 0.0,
            ..next
        };
    }
}

/// Times of the layers of a leg, s: `count` equal ones, and those of the `others` that lie within the leg.
fn layers(duration_s: f64, count: usize, others: impl Iterator<Item = f64>) -> Vec<f64> {
    let equal = (1..=count).map(|k| duration_s * k as f64 / count as f64);
    let others = others.filter(|t| *t > 1e-6 && *t < duration_s - 1e-6);
    let mut layers: Vec<f64> = equal.chain(others).collect();
    layers.sort_by(f64::total_cmp);
    layers.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    layers
}

/// Whether any posture, within the limits or not, has this pose.
pub(crate) fn reachable<const N: usize>(
    arm: &Kinematics<'_, N>,
    X: &Pose,
    near: &Joints<N>,
) -> bool {
    let solves = |q: &Joints<N>| arm.approach(X, q).is_some();
    let middle = spread(arm.model, 0);
    let beside = |k: u32| near + (spread(arm.model, k) - middle) * 0.2;
    solves(near) || (0..SEEDS).any(|k| solves(&beside(k)) || solves(&spread(arm.model, k)))
}

/// The `k`-th of a sequence of postures that fills the joint ranges evenly: additive recurrence with the roots of primes.
fn spread<const N: usize>(model: &Model<N>, k: u32) -> Joints<N> {
    const PRIMES: [f64; 8] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0];
    Joints::from_fn(|i, _| {
        let x = (f64::from(k + 1) * PRIMES[i % PRIMES.len()].sqrt()).fract();
        let (low, high) = (model.lower()[i].max(-3.2), model.upper()[i].min(3.2));
        low + x * (high - low)
    })
}

#[cfg(test)]
mod tests;
