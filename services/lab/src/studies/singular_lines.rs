//! Seeded straight lines through exactly singular postures of any arm: benchmark scenarios, drawn by number.
//!
//! A random posture is moved onto σ_min = 0, or, for a pair of singularities, onto s_i = s_j = 0; the analysis names what is lost there. A line in a random
//! direction with a random turn goes through its pose, or starts or ends in it; it is kept if both ends and 24 poses between them have a posture within the
//! limits near by, and if, without spare joints, the postures that continue those of the ends lead to the singular pose: from any other start no motion
//! follows the line. The way on there is not checked: that is what the control law has to find out. A lock that bounds what can be reached is passed along
//! the boundary (an elbow's, a sphere, is started from or ended at).

use control::linear::{rotation_exp, symmetric_eigen};
use control::plan::kinematics::{Kinematics, SOLVED};
use control::{Analyzer, Class, Kind, Singularity};
use lines::{direction, straight};
use model::{Model, Pose, Refused, Robot, with_dof};
use nalgebra::{DMatrix, DVector, Matrix2, SVector, Vector2, Vector3};
use session::{Observer, Progress};
use shared_types::random::Uniform;
use shared_types::scenario::Scenario;
use std::f64::consts::PI;

use crate::studies::compare::name_of;

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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Where {
    /// It starts there.
    Start,
    /// It passes there.
    Middle,
    /// It ends there.
    End,
}

impl Where {
    /// `start`, `middle` or `end`.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Middle => "middle",
            Self::End => "end",
        }
    }
}

/// Lines through one singularity each, or through two at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Through {
    /// Each singularity in turn.
    One,
    /// Each pair in turn.
    Two,
}

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SingularLine {
    /// The singularities that hold exactly.
    pub(crate) kinds: Vec<Kind>,
    pub(crate) place: Where,
    /// The run: start posture and one segment.
    pub(crate) scenario: Scenario,
}

impl SingularLine {
    /// The names of its singularities, joined by `+`.
    pub(crate) fn names(&self) -> String {
        let names = self.kinds.iter().map(|kind| name_of(*kind));
        names.collect::<Vec<_>>().join("+")
    }
}

/// `count` lines for each singularity (or pair) of an arm, or fewer where draws find no more; their speed has a peak of `speed` m/s.
///
/// `template` gives everything but start and task.
///
/// # Errors
/// [`Refused`] for an arm of a size that nothing is built for.
pub(crate) fn singular_lines(
    robot: &Robot,
    template: &Scenario,
    through: Through,
    (seed, count, speed): (u64, u32, f64),
    observer: Observer<'_>,
) -> Result<Vec<SingularLine>, Refused> {
    with_dof!(robot.dof(), N => sized::<N>(robot, template, through, (seed, count, speed), observer))
        .unwrap_or_else(|| Err(Refused::size(robot)))
}

impl Through {
    /// The singularities, or the pairs of them, that lines go through.
    fn of(self, mut kinds: Vec<Kind>) -> Vec<Vec<Kind>> {
        if self == Self::One {
            return kinds.into_iter().map(|kind| vec![kind]).collect();
        }
        // A direction that no name explains is none of a pair: nothing tells one such direction from another.
        kinds.retain(|kind| *kind != Kind::Numeric);
        let pairs = kinds.iter().enumerate();
        let pairs = pairs.flat_map(|(i, a)| kinds[i + 1..].iter().map(|b| vec![*a, *b]));
        pairs.collect()
    }
}

fn sized<const N: usize>(
    robot: &Robot,
    template: &Scenario,
    through: Through,
    (seed, count, speed): (u64, u32, f64),
    observer: Observer<'_>,
) -> Result<Vec<SingularLine>, Refused> {
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
        speed,
    };
    let mut kinds: Vec<Kind> = vec![];
    for (kind, _) in draw.at(&SVector::from_fn(|i, _| 0.3 + 0.37 * i as f64)) {
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    let wanted = through.of(kinds);
    let mut random = Uniform(seed);
    let mut lines = vec![];
    // Each in turn, so that a smaller number of lines is the beginning of a larger one.
    let mut given_up = vec![false; wanted.len()];
    let title = format!("drawing lines of {}", robot.name);
    observer(Progress::Begin {
        title: &title,
        length: u64::from(count) * wanted.len() as u64,
        unit: "lines",
    });
    for number in 0..count {
        for (kinds, given_up) in wanted.iter().zip(&mut given_up) {
            observer(Progress::Step);
            if *given_up {
                continue;
            }
            match draw.line(kinds, number, lines.len(), &mut random) {
                Some(line) => lines.push(line),
                None => *given_up = true,
            }
        }
    }
    observer(Progress::End);
    Ok(lines)
}

struct Draw<'a, const N: usize> {
    robot: &'a Robot,
    arm: Kinematics<'a, N>,
    analyzer: Analyzer<N>,
    template: &'a Scenario,
    speed: f64,
}

impl<const N: usize> Draw<'_, N> {
    /// Kind and signed s of each singularity, in a posture that none came before.
    fn at(&self, q: &SVector<f64, N>) -> Vec<(Kind, f64)> {
        self.report(q).iter().map(|s| (s.0, s.1)).collect()
    }

    /// Kind, s, class, and the normal of the boundary where it is one that a path can run along.
    fn report(&self, q: &SVector<f64, N>) -> Vec<(Kind, f64, Class, Option<Vector3<f64>>)> {
        let zero = SVector::zeros();
        let report = self
            .analyzer
            .clone()
            .step(q, &zero, &self.arm.model.evaluate(q, &zero));
        let boundary =
            |s: &Singularity<N>| (s.kind == Kind::Overhead && s.kappa_1 > 0.0).then(|| s.axis());
        report
            .listed()
            .iter()
            .map(|s| (s.kind, s.s, s.class, boundary(s)))
            .collect()
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
        let dof = self.robot.dof();
        SVector::from_fn(|i, _| {
            if i >= dof {
                return 0.0;
            }
            let by = SVector::from_fn(|k, _| if k == i { h } else { 0.0 });
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
            let all = self.at(q);
            let of_kind = all.iter().filter(|one| one.0 == kind).map(|one| one.1);
            of_kind
                .min_by(|a, b| a.abs().total_cmp(&b.abs()))
                .unwrap_or(1.0)
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
                let by = SVector::from_fn(|k, _| if k == i { 1e-6 } else { 0.0 });
                slope.set_column(i, &((residual(&(q + by)) - residual(&(q - by))) / 2e-6));
            }
            let step = slope.svd(true, true).solve(&residual(&q), 1e-6).ok()?;
            q -= SVector::from_fn(|i, _| if i < dof { step[i] } else { 0.0 })
                * (STEPS.1 / step.amax().max(STEPS.1));
        }
        None
    }

    fn has_spare_joints(&self) -> bool {
        self.robot.dof() > self.arm.task.iter().filter(|counts| **counts).count()
    }

    fn line(
        &self,
        kinds: &[Kind],
        number: u32,
        index: usize,
        random: &mut Uniform,
    ) -> Option<SingularLine> {
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
            let lost: Vec<_> = report.iter().filter(|one| one.1.abs() < 1e-6).collect();
            if kinds
                .iter()
                .any(|kind| !lost.iter().any(|one| one.0 == *kind))
                || kinds.len() == 1 && lost.len() != 1
            {
                continue;
            }
            excludes_both = false;
            // A fold is the boundary of what can be reached: a line starts or ends there.
            let fold = lost.iter().any(|one| one.2 == Class::Type1);
            let boundary = lost.iter().find_map(|one| one.3);
            let place = match (number % 4, fold) {
                (0 | 2, false) => Where::Middle,
                (1, _) | (2, true) => Where::Start,
                _ => Where::End,
            };
            for _ in 0..LINES {
                if let Some(scenario) = self.through(&q, (place, boundary), index, random) {
                    return Some(SingularLine {
                        kinds: lost.iter().map(|one| one.0).collect(),
                        place,
                        scenario,
                    });
                }
            }
        }
        None
    }

    /// A line through the pose of `q`.
    fn through(
        &self,
        q: &SVector<f64, N>,
        (place, boundary): (Where, Option<Vector3<f64>>),
        index: usize,
        random: &mut Uniform,
    ) -> Option<Scenario> {
        let at = self.arm.pose(q);
        let served = |v: Vector3<f64>, first: usize| {
            Vector3::from_fn(|k, _| if self.arm.task[first + k] { v[k] } else { 0.0 })
        };
        let length = self.arm.length_m * random.within(0.5, 1.0);
        let inside = boundary
            .filter(|_| place == Where::Middle)
            .unwrap_or_else(Vector3::zeros);
        let tangent = |v: Vector3<f64>| v - inside * inside.dot(&v);
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
        let dof = self.robot.dof();
        q + SVector::from_fn(|i, _| if i < dof { random.within(-by, by) } else { 0.0 })
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

    #[test]
    fn lines_of_a_planar_arm_ask_for_the_axes_of_its_task_alone() {
        let robot = Robot::builtin("planar3r").unwrap();
        let template = crate::trial::bare("lines", "planar3r", &[]).unwrap();
        let of = (5, 4, 0.28);
        let lines = singular_lines(&robot, &template, Through::One, of, &|_| ()).unwrap();
        assert_eq!(lines.len(), 4);
        for line in lines {
            let law = line.scenario.control.strategy;
            let trial = crate::trial::Trial::under(law, &robot, &line.scenario);
            assert!(trial.run().is_ok(), "{:?}", trial.run());
        }
    }

    #[test]
    fn lines_are_exactly_singular_where_they_say_and_the_same_for_a_seed() {
        let robot = Robot::builtin("ur5").unwrap();
        let template = crate::trial::bare("lines", "ur5", &[]).unwrap();
        let draw = |through, count| {
            singular_lines(&robot, &template, through, (5, count, 0.28), &|_| ()).unwrap()
        };
        let lines = draw(Through::One, 2);
        assert_eq!(lines.len(), 6);
        assert_eq!(
            lines[..3],
            draw(Through::One, 1)[..],
            "fewer lines are the beginning of more"
        );
        let model = Model::<6>::new(&robot, None).unwrap();
        let arm = Kinematics {
            model: &model,
            p_EC: Vector3::zeros(),
            task: [true; 6],
            length_m: robot.length_m,
        };
        for line in lines.iter().filter(|line| line.place == Where::Start) {
            let q = SVector::from_column_slice(line.scenario.start.q.as_ref().unwrap());
            assert!(arm.spectrum(&q).smallest() < 1e-8, "{:?}", line.kinds);
        }
        for line in draw(Through::Two, 1) {
            assert!(line.kinds.len() >= 2, "{:?}", line.kinds);
        }
    }
}
