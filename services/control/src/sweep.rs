//! A seeded set of straight lines through and near each singularity of a PUMA: what a control law has to get along with.
//!
//! Each line is a [`Scenario`] of its own. It is made from a posture at or near a lock, a direction and a turn; it is kept if the arm can follow it:
//! at 201 points along it a posture exists within the joint limits that continues the one before, but for what the wrist does in a near miss.

use crate::arm_family::axes::shoulder;
use crate::arm_family::puma_inverse::PumaLengths;
use crate::linear::{rotation_exp, rotation_log, wrap_angle};
use crate::random::Uniform;
use crate::types::Kind;
use model::{Factors, Model, Pose, Robot};
use nalgebra::{SVector, Vector3, Vector6};
use shared_types::scenario::{Scenario, Segment, Start};

/// Points at which a line is checked.
const STEPS: u32 = 200;

/// The singularities that lines go through or near.
const KINDS: [Kind; 3] = [Kind::Elbow, Kind::Wrist, Kind::Overhead];

/// How far from the lock a line may pass: a third of them through it, a third within 0.02 of it, the rest within 0.15.
const DEPTHS: [f64; 3] = [0.0, 0.02, 0.15];

/// Distance from the wrist's lock within which it may jump between two points of a line, rad.
const NEAR_MISS: f64 = 0.05;

/// One line of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// The singularity it goes through or near.
    pub near: Kind,
    /// The run: start posture and one segment.
    pub scenario: Scenario,
}

/// `count` lines for a PUMA, in turn near elbow, wrist and overhead lock, with a peak speed of `speed` m/s.
///
/// `template` gives everything but start and task. Empty for an arm without the PUMA's factors.
#[must_use]
pub fn lines(robot: &Robot, template: &Scenario, seed: u64, count: usize, speed: f64) -> Vec<Line> {
    let (Factors::Puma { a2, a3, d4 }, Ok(model)) = (robot.factors, Model::<6>::new(robot, None)) else { return vec![] };
    let factors = PumaLengths::new(a2, a3, d4);
    let inverse = Inverse { model: &model, factors, offset: offset(&model) };
    let mut random = Uniform(seed);
    let mut lines = Vec::with_capacity(count);
    while lines.len() < count {
        // In turn, not at random: lines that cannot be followed are drawn again, which must not thin out the difficult ones.
        let (kind, depth) = (KINDS[lines.len() % 3], DEPTHS[lines.len() / 3 % 3]);
        if let Some(line) = line(&inverse, kind, depth, &mut random, template, speed, lines.len()) {
            lines.push(line);
        }
    }
    lines
}

fn line(
    inverse: &Inverse<'_>,
    kind: Kind,
    depth: f64,
    random: &mut Uniform,
    template: &Scenario,
    speed: f64,
    number: usize,
) -> Option<Line> {
    let model = inverse.model;
    let mut q = SVector::<f64, 6>::from_fn(|i, _| {
        let (low, high) = (model.lower()[i], model.upper()[i]);
        let middle = 0.5 * (low + high);
        random.within(middle + 0.8 * (low - middle), middle + 0.8 * (high - middle))
    });
    let length = random.within(0.2, 0.4);
    let mut along = random.direction();
    let turn = random.direction() * random.within(0.0, 0.8);
    let near = random.within(-depth, depth);
    // Where on the line the lock is: at an end for the elbow, whose lock is the edge of the reachable space, else in the middle.
    let mut share = random.within(0.35, 0.65);
    match kind {
        Kind::Elbow => {
            q[2] = inverse.factors.q3_stretched + near;
            share = if random.within(0.0, 1.0) < 0.5 { 0.0 } else { 1.0 };
            let outwards = model.forward_kinematics(&q).p;
            if along.dot(&outwards) * (share - 0.5) < 0.0 {
                along = -along;
            }
        }
        Kind::Wrist => q[4] = near,
        _ => {
            q[1] = inverse.shoulder_for(q[1], q[2], near * (inverse.factors.a2 + inverse.factors.L3))?;
            // No line enters the cylinder that the shoulder offset keeps clear: one that comes close runs along it.
            let outwards = model.forward_kinematics(&q).p.component_mul(&Vector3::new(1.0, 1.0, 0.0)).try_normalize(1e-9)?;
            if depth < DEPTHS[2] {
                along = (along - outwards * outwards.dot(&along)).try_normalize(0.1)?;
            }
        }
    }
    let at = model.forward_kinematics(&q);
    let pose = |x: f64| Pose { R: rotation_exp(&(turn * (x - share))) * at.R, p: at.p + along * (length * (x - share)) };
    let q_start = inverse.nearest(&pose(0.0), &q)?;
    let mut last = q_start;
    for k in 1..=STEPS {
        last = inverse.next(&pose(f64::from(k) / f64::from(STEPS)), &last)?;
    }
    let goal = pose(1.0);
    // A turn that dominates sets the duration too: 1 rad/s at its peak.
    let peak = 1.875 * (length / speed).max(turn.norm() / (speed / 0.28));
    let rotation = std::array::from_fn(|i| std::array::from_fn(|j| goal.R[(i, j)]));
    // A line that starts at the elbow's lock can leave it on either side: on the one that has been checked.
    let branch = if inverse.factors.theta(last[2]) < 0.0 { -1 } else { 1 };
    let segment = Segment { duration_s: peak, to_m: Some(goal.p.into()), rotation: Some(rotation), branch, ..Segment::default() };
    let scenario = Scenario {
        name: format!("{}-{number}", template.name),
        start: Start { q_rad: Some(q_start.iter().copied().collect()), ..Start::default() },
        segment: vec![segment],
        ..template.clone()
    };
    Some(Line { near: kind, scenario })
}

/// Distance of the arm's plane from the waist axis, m.
fn offset(model: &Model<6>) -> f64 {
    let terms = model.evaluate(&Vector6::zeros(), &Vector6::zeros());
    (terms.p[4] - shoulder(&terms)).dot(&terms.z[1])
}

/// Closed-form inverse kinematics of a PUMA at its wrist centre.
#[derive(Clone, Copy, Debug)]
struct Inverse<'a> {
    model: &'a Model<6>,
    factors: PumaLengths,
    offset: f64,
}

impl Inverse<'_> {
    /// q2 that puts the wrist centre at in-plane radius `R`, from the elbow's angle, on the side where `q2` is; `None` beyond reach.
    fn shoulder_for(&self, q2: f64, q3: f64, R: f64) -> Option<f64> {
        let (K, M) = self.forearm(q3);
        // R = c2·K + s2·M.
        let (size, phase) = ((K * K + M * M).sqrt(), libm::atan2(M, K));
        let angle = (R.abs() < size).then(|| libm::acos(R / size))?;
        let candidates = [wrap_angle(phase + angle), wrap_angle(phase - angle)];
        let within = |x: f64| [x, x - std::f64::consts::TAU].into_iter().find(|x| *x > self.model.lower()[1] && *x < self.model.upper()[1]);
        candidates.into_iter().filter_map(within).min_by(|a, b| (a - q2).abs().total_cmp(&(b - q2).abs()))
    }

    /// In-plane place of the wrist centre from the shoulder at q2 = 0: along the upper arm, and across it.
    fn forearm(&self, q3: f64) -> (f64, f64) {
        let theta = self.factors.theta(q3);
        let (sin, cos) = libm::sincos(theta);
        (self.factors.a2 + self.factors.L3 * cos, -self.factors.L3 * sin)
    }

    /// All postures of a pose within the joint limits, with their signs of elbow and shoulder.
    fn all(&self, X: &Pose, near: &SVector<f64, 6>) -> impl Iterator<Item = (SVector<f64, 6>, [f64; 2])> {
        let (q_near, X, inverse) = (*near, *X, *self);
        let (r2, d) = (X.p.x * X.p.x + X.p.y * X.p.y, self.offset);
        let (a2, L3) = (self.factors.a2, self.factors.L3);
        let cos = (r2 - d * d + X.p.z * X.p.z - a2 * a2 - L3 * L3) / (2.0 * a2 * L3);
        // A line may end exactly on the edge: rounding there is not out of reach.
        let reachable = r2 >= d * d - 1e-12 && cos.abs() <= 1.0 + 1e-12;
        let cos = cos.clamp(-1.0, 1.0);
        let sides = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)];
        sides.into_iter().filter(move |_| reachable).flat_map(move |(elbow, shoulder)| {
            let theta = elbow * libm::acos(cos);
            let R = shoulder * (r2 - d * d).max(0.0).sqrt();
            let mut q = SVector::<f64, 6>::zeros();
            q[0] = libm::atan2(X.p.y, X.p.x) - libm::atan2(d, R);
            q[2] = inverse.factors.q3_stretched + theta;
            let (K, M) = inverse.forearm(q[2]);
            q[1] = libm::atan2(R * M - X.p.z * K, R * K + X.p.z * M);
            [1.0, -1.0].into_iter().filter_map(move |flip| Some((inverse.wrist(q, &X, flip, &q_near)?, [elbow, shoulder])))
        })
    }

    /// The wrist's three angles, each brought within its limits near `near`.
    fn wrist(&self, mut q: SVector<f64, 6>, X: &Pose, flip: f64, near: &SVector<f64, 6>) -> Option<SVector<f64, 6>> {
        let terms = self.model.evaluate(&q, &SVector::zeros());
        let (z4, z5, z6) = (terms.z[3], terms.z[4], X.R * (terms.X_BE.R.transpose() * terms.z[5]));
        let w = z4.cross(&z6);
        let axis = if w.norm() > 1e-9 { w.normalize() * flip } else { rotation_exp(&(z4 * near[3])) * z5 };
        q[3] = libm::atan2(z4.dot(&z5.cross(&axis)), z5.dot(&axis));
        q[4] = libm::atan2(w.dot(&axis), z4.dot(&z6));
        let rest = self.model.evaluate(&q, &SVector::zeros());
        let roll = rotation_log(&(rest.X_BE.R.transpose() * X.R));
        q[5] = (rest.X_BE.R * roll).dot(&rest.z[5]);
        for i in 0..6 {
            q[i] = near[i] + wrap_angle(q[i] - near[i]);
            let turn = std::f64::consts::TAU;
            let fits = |x: f64| x > self.model.lower()[i] + 0.05 && x < self.model.upper()[i] - 0.05;
            q[i] = [q[i], q[i] - turn, q[i] + turn].into_iter().find(|x| fits(*x))?;
        }
        Some(q)
    }

    /// The posture nearest to `near`.
    fn nearest(&self, X: &Pose, near: &SVector<f64, 6>) -> Option<SVector<f64, 6>> {
        let distance = |q: &SVector<f64, 6>| (q - near).norm_squared();
        self.all(X, near).map(|(q, _)| q).min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// The posture that continues `near`; a wrist may turn fast, but jump only where it passes its lock so closely that it could as well go straight
    /// through: near misses are what singularities are about.
    fn next(&self, X: &Pose, near: &SVector<f64, 6>) -> Option<SVector<f64, 6>> {
        let found = self.nearest(X, near)?;
        let jump = (found - near).abs();
        let near_miss = found[4].abs().max(near[4].abs()) < NEAR_MISS;
        (jump.rows(0, 3).max() < 0.3 && (near_miss || jump.rows(3, 3).max() < 0.8)).then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{posture, puma, robot};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inverse_kinematics_undoes_forward_kinematics(q in posture(puma())) {
            let Factors::Puma { a2, a3, d4 } = robot("puma560").factors else { unreachable!() };
            let inverse = Inverse { model: puma(), factors: PumaLengths::new(a2, a3, d4), offset: offset(puma()) };
            let X = puma().forward_kinematics(&q);
            for (found, _) in inverse.all(&X, &q) {
                let Y = puma().forward_kinematics(&found);
                prop_assert!((Y.p - X.p).norm() < 1e-9 && rotation_log(&(Y.R * X.R.transpose())).norm() < 1e-6, "{found:?}");
            }
        }
    }
}
