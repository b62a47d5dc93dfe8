//! A seeded set of straight lines through and near each singularity of a PUMA: benchmark scenarios for control laws.
//!
//! Pure, and a crate of its own: the laboratory compares laws on these lines, and tests of `control` and `chain` run them without the laboratory.
//!
//! Each line is a [`Scenario`] of its own. It is made from a posture at or near a singularity, a direction and a turn; it is kept if the arm can follow it:
//! at 201 points along it a posture exists within the joint limits that continues the one before, but for what the wrist does in a near miss.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod inverse;

use control::Kind;
use control::linear::{Joints, Vector3, rotation_exp};
use inverse::{PumaInverse, PumaLengths};
use model::{Factors, Model, Pose, Robot};
use shared_types::random::Uniform;
use shared_types::scenario::{Scenario, Segment, Start};

/// Points at which a line is checked.
const STEPS: u32 = 200;

/// The singularities that lines go through or near.
pub const KINDS: [Kind; 3] = [Kind::Elbow, Kind::Wrist, Kind::Overhead];

/// How far from the singularity a line may pass: a third of them through it, a third within 0.02 of it, the rest within 0.15.
const DEPTHS: [f64; 3] = [0.0, 0.02, 0.15];

/// Distance from the wrist's singularity within which it may jump between two points of a line, rad.
const NEAR_MISS: f64 = 0.05;

/// One line of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// The singularity it goes through or near.
    pub near: Kind,
    /// The run: start posture and one segment.
    pub scenario: Scenario,
}

/// `count` lines for a PUMA, in turn near elbow, wrist and overhead singularity, with a peak speed of `speed` m/s.
///
/// `template` gives everything but start and task. Empty for an arm without the PUMA's factors.
pub fn lines(robot: &Robot, template: &Scenario, seed: u64, count: usize, speed: f64) -> Vec<Line> {
    let (Factors::Puma { a2, a3, d4 }, Ok(model)) = (robot.factors, Model::<6>::new(robot, None))
    else {
        return vec![];
    };
    let inverse = PumaInverse::new(&model, PumaLengths::new(a2, a3, d4));
    let mut random = Uniform(seed);
    let mut lines = Vec::with_capacity(count);
    while lines.len() < count {
        // In turn, not at random: lines that cannot be followed are drawn again, which must not thin out the difficult ones.
        let (kind, depth) = (KINDS[lines.len() % 3], DEPTHS[lines.len() / 3 % 3]);
        let scenario = Through::draw(&inverse, kind, depth, &mut random)
            .and_then(|through| through.line(&inverse, template, speed));
        if let Some(scenario) = scenario {
            let name = format!("{}-{}", template.name, lines.len());
            lines.push(Line {
                near: kind,
                scenario: Scenario { name, ..scenario },
            });
        }
    }
    lines
}

/// A posture at or near a singularity, and the line to go through it.
struct Through {
    q: Joints<6>,
    /// The line's direction, unit.
    along: Vector3,
    /// The rotation from its beginning to its end, rad.
    turn: Vector3,
    length_m: f64,
    /// Where on the line the posture is, 0 to 1.
    share: f64,
}

impl Through {
    /// A posture within `depth` of the singularity; `None` where the draw has none.
    fn draw(
        inverse: &PumaInverse<'_>,
        kind: Kind,
        depth: f64,
        random: &mut Uniform,
    ) -> Option<Self> {
        let model = inverse.model;
        let mut q = Joints::<6>::from_fn(|i, _| {
            let (low, high) = (model.lower()[i], model.upper()[i]);
            let middle = 0.5 * (low + high);
            random.within(
                middle + 0.8 * (low - middle),
                middle + 0.8 * (high - middle),
            )
        });
        let length_m = random.within(0.2, 0.4);
        let mut along = direction(random);
        let turn = direction(random) * random.within(0.0, 0.8);
        let near = random.within(-depth, depth);
        // At an end for the elbow, whose singularity is the boundary of the reachable space, else in the middle.
        let mut share = random.within(0.35, 0.65);
        match kind {
            Kind::Elbow => {
                q[2] = inverse.lengths.q3_stretched + near;
                share = if random.within(0.0, 1.0) < 0.5 {
                    0.0
                } else {
                    1.0
                };
                let outwards = model.forward_kinematics(&q).p;
                if along.dot(&outwards) * (share - 0.5) < 0.0 {
                    along = -along;
                }
            }
            Kind::Wrist => q[4] = near,
            _ => {
                q[1] = inverse.shoulder_for(
                    q[1],
                    q[2],
                    near * (inverse.lengths.a2 + inverse.lengths.L3),
                )?;
                // No line enters the cylinder that the shoulder offset keeps clear: one that comes close runs along it.
                let outwards = model
                    .forward_kinematics(&q)
                    .p
                    .component_mul(&Vector3::new(1.0, 1.0, 0.0))
                    .try_normalize(1e-9)?;
                if depth < DEPTHS[2] {
                    along = (along - outwards * outwards.dot(&along)).try_normalize(0.1)?;
                }
            }
        }
        Some(Self {
            q,
            along,
            turn,
            length_m,
            share,
        })
    }

    /// The line as a scenario with a peak speed of `speed` m/s; `None` where the arm cannot follow it.
    fn line(&self, inverse: &PumaInverse<'_>, template: &Scenario, speed: f64) -> Option<Scenario> {
        let at = inverse.model.forward_kinematics(&self.q);
        let pose = |x: f64| Pose {
            R: rotation_exp(&(self.turn * (x - self.share))) * at.R,
            p: at.p + self.along * (self.length_m * (x - self.share)),
        };
        let q_start = inverse.nearest(&pose(0.0), &self.q)?;
        let mut last = q_start;
        for k in 1..=STEPS {
            last = next(inverse, &pose(f64::from(k) / f64::from(STEPS)), &last)?;
        }
        // A turn that dominates sets the duration too: 1 rad/s at its peak.
        let peak = 1.875 * (self.length_m / speed).max(self.turn.norm() / (speed / 0.28));
        let q_start = q_start.iter().copied().collect();
        let mut line = straight(template, q_start, &pose(1.0), peak);
        // A line that starts at the elbow's singularity can leave it on either side: on the one that has been checked.
        line.segment[0].branch = if inverse.lengths.theta(last[2]) < 0.0 {
            -1
        } else {
            1
        };
        Some(line)
    }
}

/// A scenario of one straight line, from a posture to a pose.
pub fn straight(template: &Scenario, q: Vec<f64>, goal: &Pose, duration_s: f64) -> Scenario {
    let rotation = std::array::from_fn(|i| std::array::from_fn(|j| goal.R[(i, j)]));
    let segment = Segment {
        duration_s,
        to_m: Some(goal.p.into()),
        rotation: Some(rotation),
        ..Segment::default()
    };
    Scenario {
        start: Start {
            q: Some(q),
            ..Start::default()
        },
        segment: vec![segment],
        ..template.clone()
    }
}

/// The posture that continues `near`; a wrist may turn fast, but jump only where it passes its singularity so closely that it could as well go straight
/// through: near misses are what singularities are about.
fn next(inverse: &PumaInverse<'_>, X: &Pose, near: &Joints<6>) -> Option<Joints<6>> {
    let found = inverse.nearest(X, near)?;
    let jump = (found - near).abs();
    let near_miss = found[4].abs().max(near[4].abs()) < NEAR_MISS;
    (jump.rows(0, 3).max() < 0.3 && (near_miss || jump.rows(3, 3).max() < 0.8)).then_some(found)
}

/// A unit vector, uniform on the sphere.
pub fn direction(random: &mut Uniform) -> Vector3 {
    loop {
        let v = Vector3::from_fn(|_, _| random.within(-1.0, 1.0));
        if (0.1..1.0).contains(&v.norm()) {
            return v.normalize();
        }
    }
}
