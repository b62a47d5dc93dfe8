//! The facts of a run that are known before its first tick.

use glam::{Affine3, Vec3};
use model::{Joint, JointKind, Model, Robot, unit_scaled};
use nalgebra::{SVector, Vector3};
use rerun::{ApplicationId, StoreId};
use shared_types::MAX_DOF;
use shared_types::job::Job;
use shared_types::scenario::{Scenario, Segment};

use crate::body::Body;
use crate::manipulability::{Jacobian, at_point};
use crate::meshes::Meshes;
use crate::pose::{placement, vec3};
use crate::run::{Happened, Tick};
use crate::signals::{ChainHops, chain_hops};
use crate::sink::RecordError;

/// The run, its arm, and all that numbers and pictures are computed from.
///
/// One type for every arm: the model has as many places for joints as a message, so that this code is compiled once.
pub(crate) struct Facts<'a> {
    pub(crate) job: &'a Job,
    pub(crate) robot: &'a Robot,
    pub(crate) happened: Happened<'a>,
    pub(crate) is_live: bool,
    /// The task is to stand still with the hand while the joints move.
    pub(crate) stands_still: bool,
    pub(crate) rate_hz: u32,
    pub(crate) floor_m: f32,
    /// Against gravity, base axes: the base may be mounted in any way.
    pub(crate) up: Vec3,
    pub(crate) title: &'a str,
    pub(crate) arm: Model<MAX_DOF>,
    pub(crate) body: Body,
    /// About meshes that could not be read.
    pub(crate) lacking: Option<String>,
    pub(crate) hops: Option<ChainHops>,
}

impl<'a> Facts<'a> {
    pub(crate) fn new(
        job: &'a Job,
        robot: &'a Robot,
        happened: Happened<'a>,
        is_live: bool,
    ) -> Result<Self, RecordError> {
        let scenario = &job.scenario;
        let arm = Model::new(robot, scenario.frame()).map_err(|error| RecordError::Arm {
            robot: robot.name.clone(),
            reason: error.to_string(),
        })?;
        let (meshes, lacking) = Meshes::of(robot);
        let title = match scenario.title.as_str() {
            "" => &scenario.name,
            _ => &scenario.title,
        };
        let floor_m = scenario.plant.floor_m.map_or(0.0, |height| height as f32);
        Ok(Self {
            job,
            robot,
            happened,
            is_live,
            stands_still: stands_still(scenario),
            rate_hz: scenario.rate_hz.max(1),
            floor_m,
            up: (-vec3(&robot.gravity)).normalize_or(Vec3::Z),
            title,
            arm,
            body: Body::new(robot, floor_m, &meshes),
            lacking,
            hops: chain_hops(&job.graph),
        })
    }

    /// Recordings of one robot share their blueprint.
    pub(crate) fn store(&self) -> StoreId {
        let robot = &self.job.robot.name;
        let application = ApplicationId::new_or_unknown(format!("armplane-{robot}"));
        StoreId::recording(application, self.job.run.as_str())
    }

    /// The run in a few words, by their names.
    pub(crate) fn properties(&self) -> [(&'static str, String); 7] {
        let (job, scenario) = (self.job, &self.job.scenario);
        let units = self
            .robot
            .joints
            .iter()
            .map(|joint| if slides(joint) { "m" } else { "rad" });
        [
            ("scenario", scenario.name.clone()),
            ("robot", job.robot.name.clone()),
            ("run", job.run.clone()),
            ("seed", scenario.seed.to_string()),
            ("rate_hz", scenario.rate_hz.to_string()),
            ("armplane", job.version.clone()),
            ("joint_units", units.collect::<Vec<_>>().join(" ")),
        ]
    }

    /// Whether every joint has such a limit.
    pub(crate) fn is_limited(&self, limit: fn(&Joint) -> f64) -> bool {
        let mut all = self.robot.joints.iter().map(limit);
        all.all(f64::is_finite)
    }

    /// Units of speeds and of loads in plots: shares of the limits where every joint has one.
    pub(crate) fn axis_units(&self) -> [&'static str; 2] {
        let [speed, load] = if self.robot.joints.iter().any(slides) {
            [", rad/s or m/s", ", N·m or N"]
        } else {
            [", rad/s", ", N·m"]
        };
        let of = |limit, unit| {
            if self.is_limited(limit) {
                " / limit"
            } else {
                unit
            }
        };
        [
            of(|joint| joint.velocity, speed),
            of(|joint| joint.effort, load),
        ]
    }

    pub(crate) fn joints(&self) -> usize {
        self.robot.dof()
    }

    /// Whether the task turns the hand.
    pub(crate) fn turns(&self) -> bool {
        self.robot.task.0[3..].contains(&true)
    }

    /// Whether the task lies in the plane of the floor.
    pub(crate) fn is_planar(&self) -> bool {
        !self.robot.task.0[2]
    }

    /// Ticks in so many seconds, at least one.
    pub(crate) fn every(&self, seconds: f64) -> u64 {
        (seconds * f64::from(self.rate_hz)).round().max(1.0) as u64
    }

    /// The poses of the links.
    pub(crate) fn links(&self, q: &[f64; MAX_DOF]) -> [Affine3; MAX_DOF] {
        self.arm
            .link_poses(&SVector::from(*q))
            .map(|X| placement(&X))
    }

    pub(crate) fn hand(&self, q: &[f64; MAX_DOF]) -> Affine3 {
        placement(&self.arm.forward_kinematics(&SVector::from(*q)))
    }

    /// The Jacobian at the point that the report is of.
    pub(crate) fn jacobian(&self, q: &SVector<f64, MAX_DOF>, p_BC: [f64; 3]) -> Jacobian {
        let r_EC = Vector3::from(p_BC) - self.arm.forward_kinematics(q).p;
        at_point(self.arm.jacobian(q), &r_EC)
    }

    /// Singular values of the unit-scaled Jacobian in the posture that has been analysed, the estimated one: the law has no use for them, so they are
    /// computed where they are drawn.
    pub(crate) fn singular_values(&self, row: &Tick) -> Option<[f64; 6]> {
        let report = row.singularity.as_ref()?;
        let q = match row.estimate {
            Some(estimate) => estimate.q,
            None => *row.q()?,
        };
        let J = self.jacobian(&q.into(), report.p_BC);
        let scaled = unit_scaled(&J, report.length_m, &self.robot.task.0);
        // Of what is no number, as a foreign analyzer may send it, nalgebra would look for them without end.
        let is_finite = scaled.iter().all(|x| x.is_finite());
        is_finite.then(|| scaled.singular_values().into())
    }

    /// Half the length of the mark of a singularity the arm is in; m.
    pub(crate) fn mark_size(&self) -> f32 {
        0.12 * self.body.reach
    }
}

pub(crate) fn slides(joint: &Joint) -> bool {
    joint.kind == JointKind::Prismatic
}

/// The middle of a joint's positions, and half their range; half a turn to both sides for one without limits.
pub(crate) fn range(joint: &Joint) -> [f64; 2] {
    match joint.upper - joint.lower {
        range if range.is_finite() => [0.5 * (joint.lower + joint.upper), 0.5 * range],
        _ => [0.0, std::f64::consts::PI],
    }
}

/// Whether the task is null-space motion alone: every segment holds the hand, and some change the posture.
fn stands_still(scenario: &Scenario) -> bool {
    let holds = |one: &Segment| {
        let held = Segment {
            duration_s: one.duration_s,
            branch: one.branch,
            posture_deg: one.posture_deg.clone(),
            posture_q: one.posture_q.clone(),
            ..Segment::default()
        };
        *one == held
    };
    let mut all = scenario.segment.iter();
    all.clone().all(holds) && all.any(|one| one.posture().is_some())
}
