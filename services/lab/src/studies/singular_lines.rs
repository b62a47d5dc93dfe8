//! Seeded straight lines through exactly singular postures of any arm: benchmark scenarios, drawn by number.
//!
//! A random posture is moved onto σ_min = 0, or, for a pair of singularities, onto s_i = s_j = 0; the analysis names what is lost there. A line in a random
//! direction with a random turn goes through its pose, or starts or ends in it; it is kept if both ends and 24 poses between them have a posture within the
//! limits near by, and if, without spare joints, the postures that continue those of the ends lead to the singular pose: from any other start no motion
//! follows the line. The way on there is not checked: that is what the control law has to find out. A lock that bounds what can be reached is passed along
//! the boundary (an elbow's, a sphere, is started from or ended at).

use control::linear::{rotation_exp, symmetric_eigen};
use control::plan::kinematics::{Kinematics, SOLVED};
use control::{Analyzer, Class, Kind, Report};
use lines::{direction, straight};
use model::{Model, Pose, Refused, Robot, with_dof};
use nalgebra::{DMatrix, DVector, Matrix2, SVector, Vector2, Vector3};
use session::{Observer, Progress};
use shared_types::random::Uniform;
use shared_types::scenario::Scenario;
use std::f64::consts::PI;

use crate::studies::compare::{Drawn, Lines, name_of};

/// Unit-scaled singular value, and |s|, that count as zero.
const LOCKED: (f64, f64) = (1e-9, 1e-8);
/// Most steps onto a singularity, and the largest of one joint, rad; most onto two: where both can hold, Gauss and Newton need 5 to 10.
const STEPS: (u32, f64) = (120, 0.3);
const STEPS_ONTO_TWO: u32 = 16;
/// Draws of a posture for one line; and so many of which none can be moved onto a pair of formulas: they do not both hold within the limits.
const DRAWS: u32 = 4000;
const DRAWS_ONTO_TWO: u32 = 300;
/// Draws of a line through one posture.
const LINES: u32 = 20;
/// Poses of a line that must have a posture.
const POSES: u32 = 24;
/// Distance that the ends keep from the joint limits, rad (m).
const MARGIN: f64 = 0.05;
/// Guesses for the posture of an end, and how far they lie from the singular posture, rad (m); likewise for the poses between, further away.
const GUESSES: (u32, f64) = (60, 0.4);
const FAR_GUESSES: (u32, f64) = (40, 1.5);

/// Largest joint motion between two poses of which one continues the other, rad (m); shortest step, and the rest of the way to the singular pose, as
/// shares of the line.
const CONTINUES: f64 = 0.15;
const SHORTEST: f64 = 1e-5;
const REST: f64 = 1e-3;

/// The part of a line at which the arm is singular.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Where {
    /// It starts there.
    Start,
    /// It passes there.
    Middle,
    /// It ends there.
    End,
}

impl Where {
    /// `start`, `middle` or `end`.
    fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Middle => "middle",
            Self::End => "end",
        }
    }
}

/// The lines that are wanted of each singularity (or pair) of an arm, or fewer where draws find no more. `template` gives everything but start and task,
/// the seed of the draws too.
///
/// # Errors
/// [`Refused`] for an arm of a size that nothing is built for.
pub(crate) fn singular_lines(
    robot: &Robot,
    template: &Scenario,
    lines: &Lines<'_>,
    observer: Observer<'_>,
) -> Result<Vec<Drawn>, Refused> {
    with_dof!(robot.dof(), N => sized::<N>(robot, template, lines, observer))
        .unwrap_or_else(|| Err(Refused::size(robot)))
}

/// The pairs of singularities that lines go through.
fn pairs(mut kinds: Vec<Kind>) -> Vec<Vec<Kind>> {
    // A direction that no name explains is none of a pair: nothing tells one such direction from another.
    kinds.retain(|kind| *kind != Kind::Numeric);
    let pairs = kinds.iter().enumerate();
    let pairs = pairs.flat_map(|(i, a)| kinds[i + 1..].iter().map(|b| vec![*a, *b]));
    pairs.collect()
}

fn sized<const N: usize>(
    robot: &Robot,
    template: &Scenario,
    lines: &Lines<'_>,
    observer: Observer<'_>,
) -> Result<Vec<Drawn>, Refused> {
    let model = Model::<N>::new(robot, None).map_err(Refused::because)?;
    let arm = Kinematics {
        model: &model,
        p_EC: Vector3::zeros(),
        task: robot.task.0,
        length_m: robot.length_m,
    };
    let draw = Draw {
        robot,
        arm,
        analyzer: Analyzer::new(robot, &template.analysis),
        template,
        speed: lines.speed,
    };
    let mut kinds: Vec<Kind> = vec![];
    let report = draw.report(&SVector::from_fn(|i, _| 0.3 + 0.37 * i as f64));
    for one in report.listed() {
        if !kinds.contains(&one.kind) {
            kinds.push(one.kind);
        }
    }
    let wanted = match lines.pairs {
        true => pairs(kinds),
        false => kinds.into_iter().map(|kind| vec![kind]).collect(),
    };
    let mut random = Uniform(template.seed);
    let mut drawn = vec![];
    // Each in turn, so that a smaller number of lines is the beginning of a larger one.
    let mut given_up = vec![false; wanted.len()];
    let title = format!("drawing lines of {}", robot.name);
    observer(Progress::Begin {
        title: &title,
        length: u64::from(lines.count) * wanted.len() as u64,
        unit: "lines",
    });
    for number in 0..lines.count {
        for (kinds, given_up) in wanted.iter().zip(&mut given_up) {
            observer(Progress::Step);
            if *given_up {
                continue;
            }
            match draw.line(kinds, number, drawn.len(), &mut random) {
                Some(line) => drawn.push(line),
                None => *given_up = true,
            }
        }
    }
    observer(Progress::End);
    Ok(drawn)
}

struct Draw<'a, const N: usize> {
    robot: &'a Robot,
    arm: Kinematics<'a, N>,
    analyzer: Analyzer<N>,
    template: &'a Scenario,
    speed: f64,
}

impl<const N: usize> Draw<'_, N> {
    /// The singularities in a posture that none came before.
    fn report(&self, q: &SVector<f64, N>) -> Report<N> {
        let zero = SVector::zeros();
        let terms = self.arm.model.evaluate(q, &zero);
        self.analyzer.clone().step(q, &zero, &terms)
    }

    /// A value for each joint; 0 for those that fill the arm up.
    fn joints(&self, mut value: impl FnMut(usize) -> f64) -> SVector<f64, N> {
        let dof = self.robot.dof();
        SVector::from_fn(|i, _| if i < dof { value(i) } else { 0.0 })
    }

    fn limits(&self, i: usize) -> (f64, f64) {
        (
            self.arm.model.lower()[i].max(-PI),
            self.arm.model.upper()[i].min(PI),
        )
    }

    fn is_inside(&self, q: &SVector<f64, N>) -> bool {
        let (lower, upper) = (self.arm.model.lower(), self.arm.model.upper());
        (0..self.robot.dof()).all(|i| q[i] > lower[i] + MARGIN && q[i] < upper[i] - MARGIN)
    }

    fn posture(&self, random: &mut Uniform) -> SVector<f64, N> {
        let dof = self.robot.dof();
        SVector::from_fn(|i, _| {
            let (low, high) = if i < dof { self.limits(i) } else { (0.0, 0.0) };
            let x = random.within(0.1, 0.9);
            low + x * (high - low)
        })
    }

    /// The gradient of `f` by central differences of width `h`.
    fn gradient(
        &self,
        q: &SVector<f64, N>,
        h: f64,
        f: impl Fn(&SVector<f64, N>) -> f64,
    ) -> SVector<f64, N> {
        self.joints(|i| {
            let by = self.joints(|k| if k == i { h } else { 0.0 });
            (f(&(q + by)) - f(&(q - by))) / (2.0 * h)
        })
    }

    /// Onto σ_min = 0 by steps −σ∇σ/|∇σ|².
    fn onto_one(&self, mut q: SVector<f64, N>) -> Option<SVector<f64, N>> {
        let sigma = |q: &SVector<f64, N>| self.arm.spectrum(q).smallest();
        for _ in 0..STEPS.0 {
            let here = sigma(&q);
            if here < LOCKED.0 {
                return Some(q);
            }
            let gradient = self.gradient(&q, (0.05 * here).clamp(1e-9, 1e-5), sigma);
            let step = gradient * (-here / gradient.norm_squared().max(1e-6));
            q += step * (STEPS.1 / step.amax().max(STEPS.1));
        }
        None
    }

    /// Onto s_a = s_b = 0 by Gauss-Newton steps.
    fn onto_two(&self, mut q: SVector<f64, N>, kinds: &[Kind]) -> Option<SVector<f64, N>> {
        let s = |q: &SVector<f64, N>, kind: Kind| {
            let report = self.report(q);
            let of_kind = report.listed().iter().filter(|one| one.kind == kind);
            let s = of_kind.map(|one| one.s);
            s.min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(1.0)
        };
        for _ in 0..STEPS_ONTO_TWO {
            let here = Vector2::new(s(&q, kinds[0]), s(&q, kinds[1]));
            if here.amax() < LOCKED.1 {
                return Some(q);
            }
            let h = (0.05 * here.amax()).clamp(1e-8, 1e-5);
            let gradients = [0, 1].map(|k| self.gradient(&q, h, |q| s(q, kinds[k])));
            let gram = Matrix2::from_fn(|a, b| gradients[a].dot(&gradients[b]))
                + Matrix2::identity() * 1e-9;
            let share = gram.try_inverse()? * -here;
            let step = gradients[0] * share.x + gradients[1] * share.y;
            q += step * (STEPS.1 / step.amax().max(STEPS.1));
        }
        None
    }

    /// Onto a posture that loses two directions u_1, u_2, any two: with spare joints most |s_i| are distances from sets of a higher codimension, which
    /// have no gradient there. u_aᵀJ v_b = 0 for the motions v_b that the other directions leave free is smooth, by Newton steps with u and v held.
    fn onto_rank_loss_of_two(&self, mut q: SVector<f64, N>) -> Option<SVector<f64, N>> {
        let dof = self.robot.dof();
        for _ in 0..STEPS.0 {
            let spectrum = self.arm.spectrum(&q);
            let free = spectrum.free + 2;
            if spectrum.sigma[free - 1] < LOCKED.0 {
                return Some(q);
            }
            let (values, u) = symmetric_eigen(&(spectrum.J * spectrum.J.transpose()));
            let mut order: Vec<usize> = (0..6)
                .filter(|k| self.arm.task[*k] || values[*k] > 1e-12)
                .collect();
            order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
            let residual = |q: &SVector<f64, N>| {
                let J = self.arm.spectrum(q).J;
                DVector::from_fn(2 * free, |k, _| {
                    u.column(order[k / free]).dot(&(J * spectrum.v[k % free]))
                })
            };
            let mut slope = DMatrix::zeros(2 * free, dof);
            for i in 0..dof {
                let by = self.joints(|k| if k == i { 1e-6 } else { 0.0 });
                slope.set_column(i, &((residual(&(q + by)) - residual(&(q - by))) / 2e-6));
            }
            let step = slope.svd(true, true).solve(&residual(&q), 1e-6).ok()?;
            q -= self.joints(|i| step[i]) * (STEPS.1 / step.amax().max(STEPS.1));
        }
        None
    }

    fn has_spare_joints(&self) -> bool {
        self.robot.dof() > self.robot.task.count()
    }

    fn line(
        &self,
        kinds: &[Kind],
        number: u32,
        index: usize,
        random: &mut Uniform,
    ) -> Option<Drawn> {
        let mut excludes_both = true;
        for draw in 0..DRAWS {
            if draw == DRAWS_ONTO_TWO && excludes_both && !self.has_spare_joints() {
                return None;
            }
            let q = self.posture(random);
            let found = match (kinds, self.has_spare_joints()) {
                ([_], _) => self.onto_one(q),
                (_, false) => self.onto_two(q, kinds),
                (_, true) => self.onto_rank_loss_of_two(q),
            };
            let Some(q) = found.filter(|q| self.is_inside(q)) else {
                continue;
            };
            let report = self.report(&q);
            let listed = report.listed().iter();
            let lost: Vec<_> = listed.filter(|one| one.s.abs() < 1e-6).collect();
            let is_lost = |kind: &Kind| lost.iter().any(|one| one.kind == *kind);
            if !kinds.iter().all(is_lost) || kinds.len() == 1 && lost.len() != 1 {
                continue;
            }
            excludes_both = false;
            // A fold is the boundary of what can be reached: a line starts or ends there.
            let fold = lost.iter().any(|one| one.class == Class::Type1);
            let place = match (number % 4, fold) {
                (0 | 2, false) => Where::Middle,
                (1, _) | (2, true) => Where::Start,
                _ => Where::End,
            };
            // Of a boundary that a path can run along.
            let mut passed = lost.iter().filter(|_| place == Where::Middle);
            let sphere = passed.find(|one| one.kind == Kind::Overhead && one.kappa_1 > 0.0);
            let normal = sphere.map_or_else(Vector3::zeros, |one| one.axis());
            for _ in 0..LINES {
                if let Some(scenario) = self.through(&q, place, normal, index, random) {
                    let names: Vec<_> = lost.iter().map(|one| name_of(one.kind)).collect();
                    return Some(Drawn {
                        singularities: names.join("+"),
                        place: place.name(),
                        scenario,
                    });
                }
            }
        }
        None
    }

    /// A line through the pose of `q`, along the boundary with this normal; zero: there is none.
    fn through(
        &self,
        q: &SVector<f64, N>,
        place: Where,
        normal: Vector3<f64>,
        index: usize,
        random: &mut Uniform,
    ) -> Option<Scenario> {
        let at = self.arm.pose(q);
        let served = |v: Vector3<f64>, first: usize| {
            Vector3::from_fn(|k, _| if self.arm.task[first + k] { v[k] } else { 0.0 })
        };
        let length = self.arm.length_m * random.within(0.5, 1.0);
        let tangent = |v: Vector3<f64>| v - normal * normal.dot(&v);
        let along = tangent(served(direction(random), 0))
            .try_normalize(1e-3)
            .unwrap_or_else(Vector3::zeros)
            * length;
        let turn = served(direction(random), 3) * random.within(0.0, 0.8);
        let middle = random.within(0.35, 0.65);
        let share = match place {
            Where::Start => 0.0,
            Where::Middle => middle,
            Where::End => 1.0,
        };
        let pose = |x: f64| Pose {
            R: rotation_exp(&(turn * (x - share))) * at.R,
            p: at.p + along * (x - share),
        };
        let mut end = |x: f64| match x == share {
            true => Some(*q),
            false => self.end(&pose(x), q, random),
        };
        let (q_start, q_end) = (end(0.0)?, end(1.0)?);
        let has_ends =
            self.leads(&pose, &q_start, 0.0, share) && self.leads(&pose, &q_end, 1.0, share);
        if !(self.has_spare_joints() || has_ends) {
            return None;
        }
        let mut last = q_start;
        for k in 1..POSES {
            last = self.any(&pose(f64::from(k) / f64::from(POSES)), &last, q, random)?;
        }
        let peak = 1.875 * (along.norm() / self.speed).max(turn.norm() / (self.speed / 0.28));
        let goal = match self.robot.task.is_full() {
            true => pose(1.0),
            // Along the axes that the task leaves free the hand stays as it is at the start.
            false => {
                let start = self.arm.pose(&q_start);
                Pose {
                    R: rotation_exp(&turn) * start.R,
                    p: start.p + along,
                }
            }
        };
        let q_start = q_start.iter().copied().take(self.robot.dof());
        Some(Scenario {
            name: format!("{}-{index}", self.template.name),
            ..straight(self.template, q_start.collect(), &goal, peak)
        })
    }

    /// Whether the postures that continue `q`, within the limits, lead along the line from the share `from` to nearly `to`.
    fn leads(&self, pose: &impl Fn(f64) -> Pose, q: &SVector<f64, N>, from: f64, to: f64) -> bool {
        let (way, mut q, mut at, mut step) = (to - from, *q, 0.0, 1.0 / f64::from(POSES));
        while at < 1.0 - REST {
            let next = (at + step).min(1.0 - REST);
            let there = self.solved(&pose(from + way * next), &q);
            if let Some(there) = there.filter(|there| (there - q).amax() < CONTINUES) {
                (q, at, step) = (there, next, (1.5 * step).min(1.0 / f64::from(POSES)));
            } else if step > SHORTEST {
                step *= 0.5;
            } else {
                return way == 0.0;
            }
        }
        true
    }

    /// The posture of the pose `X` that a guess leads to, within the limits.
    fn solved(&self, X: &Pose, guess: &SVector<f64, N>) -> Option<SVector<f64, N>> {
        let (there, e) = self.arm.solve(X, guess, &SVector::zeros(), 0.0, SOLVED);
        (e.norm() < 10.0 * SOLVED && self.is_inside(&there)).then_some(there)
    }

    /// A guess at most so far from `q`.
    fn guess(&self, q: &SVector<f64, N>, by: f64, random: &mut Uniform) -> SVector<f64, N> {
        q + self.joints(|_| random.within(-by, by))
    }

    /// A posture of the pose `X` within the limits: the one that continues `last`, or another.
    fn any(
        &self,
        X: &Pose,
        last: &SVector<f64, N>,
        q: &SVector<f64, N>,
        random: &mut Uniform,
    ) -> Option<SVector<f64, N>> {
        let mut far = (0..FAR_GUESSES.0).map(|k| [GUESSES.1, FAR_GUESSES.1][k as usize % 2]);
        self.solved(X, last)
            .or_else(|| far.find_map(|by| self.solved(X, &self.guess(q, by, random))))
    }

    /// A posture of the pose `X` within the limits, near `q`.
    fn end(&self, X: &Pose, q: &SVector<f64, N>, random: &mut Uniform) -> Option<SVector<f64, N>> {
        (0..GUESSES.0)
            .filter_map(|_| self.solved(X, &self.guess(q, GUESSES.1, random)))
            .min_by(|a, b| (a - q).norm().total_cmp(&(b - q).norm()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(robot: &str, pairs: bool, count: u32) -> (Robot, Vec<Drawn>) {
        let lines = Lines {
            robot: Some(robot),
            settings: &[],
            seed: Some(5),
            count,
            pairs,
            speed: 0.28,
        };
        let (robot, _, lines) = lines.drawn(&|_| ()).unwrap();
        (robot, lines)
    }

    #[test]
    fn lines_of_a_planar_arm_ask_for_the_axes_of_its_task_alone() {
        let (robot, lines) = lines("planar3r", false, 4);
        assert_eq!(lines.len(), 4);
        for line in lines {
            let law = line.scenario.control.strategy;
            let trial = crate::trial::Trial::under(law, &robot, &line.scenario);
            assert!(trial.run().is_ok(), "{:?}", trial.run());
        }
    }

    #[test]
    fn lines_are_exactly_singular_where_they_say_and_the_same_for_a_seed() {
        let (robot, more) = lines("ur5", false, 2);
        assert_eq!(more.len(), 6);
        let fewer = lines("ur5", false, 1).1;
        assert_eq!(more[..3], fewer, "fewer lines are the beginning of more");
        let model = Model::<6>::new(&robot, None).unwrap();
        let arm = Kinematics {
            model: &model,
            p_EC: Vector3::zeros(),
            task: [true; 6],
            length_m: robot.length_m,
        };
        for line in more.iter().filter(|line| line.place == "start") {
            let q = SVector::from_column_slice(line.scenario.start.q.as_ref().unwrap());
            assert!(arm.spectrum(&q).smallest() < 1e-8, "{line:?}");
        }
        for line in lines("ur5", true, 1).1 {
            assert!(line.singularities.contains('+'), "{line:?}");
        }
    }
}
