//! The facts of a run that are known before its first tick.

use glam::Vec3;
use model::{Joint, JointKind, Model, Robot, unit_scaled};
use nalgebra::{SVector, Vector3};
use rerun::{ApplicationId, StoreId};
use shared_types::MAX_DOF;
use shared_types::job::Job;
use shared_types::scenario::{Scenario, Segment};

use crate::body::Body;
use crate::manipulability::{Jacobian, at_point};
use crate::meshes::Meshes;
use crate::pose::{Placement, placement, vec3};
use crate::run::Rival;
use crate::signals::{ChainHops, Limits, Now, TickRow, chain_hops};
use crate::sink::RecordError;

/// Pictures per second: enough for eyes.
const PICTURE_HZ: f64 = 50.0;

/// The run, its arm, and all that numbers and pictures are computed from.
///
/// One type for every arm: the model has as many places for joints as a message, so that this code is compiled once.
pub(crate) struct Facts<'a> {
    pub(crate) job: &'a Job,
    pub(crate) rival: Option<&'a Rival>,
    pub(crate) is_live: bool,
    /// The task is to stand still with the hand while the joints move.
    pub(crate) stands_still: bool,
    /// Makes metres and radians comparable; m.
    pub(crate) length_m: f64,
    pub(crate) rate_hz: u32,
    pub(crate) floor_m: f32,
    /// Against gravity, base axes: the base may be mounted in any way.
    pub(crate) up: Vec3,
    pub(crate) title: &'a str,
    pub(crate) joint_units: String,
    pub(crate) arm: Model<MAX_DOF>,
    pub(crate) body: Body,
    /// About meshes that could not be read.
    pub(crate) lacking: Option<String>,
    /// The axes of the hand's twist that the task has.
    pub(crate) task: [bool; 6],
    pub(crate) limits: Limits,
    pub(crate) hops: Option<ChainHops>,
}

impl<'a> Facts<'a> {
    pub(crate) fn new(
        job: &'a Job,
        robot: &Robot,
        rival: Option<&'a Rival>,
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
        let unit = |joint: &Joint| match joint.kind {
            JointKind::Prismatic => "m",
            _ => "rad",
        };
        let units: Vec<_> = robot.joints.iter().map(unit).collect();
        Ok(Self {
            job,
            rival,
            is_live,
            stands_still: stands_still(scenario),
            length_m: robot.length_m,
            rate_hz: scenario.rate_hz.max(1),
            floor_m,
            up: (-vec3(&robot.gravity)).normalize_or(Vec3::Z),
            title,
            joint_units: units.join(" "),
            arm,
            body: Body::new(robot, floor_m, &meshes),
            lacking,
            task: robot.task.0,
            limits: Limits::new(robot).with_forces(scenario),
            hops: chain_hops(&job.graph),
        })
    }

    /// Recordings of one robot share their blueprint.
    pub(crate) fn store(job: &Job) -> StoreId {
        let application = ApplicationId::new_or_unknown(format!("armplane-{}", job.robot.name));
        StoreId::recording(application, job.run.as_str())
    }

    /// The run in a few words, by their names.
    pub(crate) fn properties(&self) -> [(&'static str, String); 7] {
        let (job, scenario) = (self.job, &self.job.scenario);
        [
            ("scenario", scenario.name.clone()),
            ("robot", job.robot.name.clone()),
            ("run", job.run.clone()),
            ("seed", scenario.seed.to_string()),
            ("rate_hz", scenario.rate_hz.to_string()),
            ("armplane", job.version.clone()),
            ("joint_units", self.joint_units.clone()),
        ]
    }

    /// Units of speeds and of loads in plots: shares of the limits where every joint has one.
    pub(crate) fn axis_units(&self) -> [&'static str; 2] {
        let slides = self.joint_units.split(' ').any(|unit| unit == "m");
        let [speed, load] = match slides {
            true => [", rad/s or m/s", ", N·m or N"],
            false => [", rad/s", ", N·m"],
        };
        let of = |limits: &[f64], unit| match limits.iter().all(|limit| limit.is_finite()) {
            true => " / limit",
            false => unit,
        };
        [of(&self.limits.speed, speed), of(&self.limits.torque, load)]
    }

    pub(crate) fn joints(&self) -> usize {
        self.body.links
    }

    /// Directions of the task.
    pub(crate) fn directions(&self) -> usize {
        self.task.iter().filter(|served| **served).count()
    }

    /// Whether the task lies in the plane of the floor.
    pub(crate) fn is_planar(&self) -> bool {
        !self.task[2]
    }

    /// All that the numbers of a tick are computed from, but for what is only drawn.
    pub(crate) fn now<'n, 'm>(&'n self, row: &'n TickRow<'m>) -> Now<'n, 'm> {
        let now = Now::new(row, &self.limits, self.hops);
        Now {
            sigma: self.singular_values(row),
            ..now
        }
    }

    /// Ticks in so many seconds, at least one.
    pub(crate) fn every(&self, seconds: f64) -> u64 {
        (seconds * f64::from(self.rate_hz)).round().max(1.0) as u64
    }

    /// Whether a tick has a picture.
    pub(crate) fn is_pictured(&self, tick: u64) -> bool {
        tick.is_multiple_of(self.every(1.0 / PICTURE_HZ))
    }

    /// The poses of the links.
    pub(crate) fn links(&self, q: &[f64; MAX_DOF]) -> [Placement; MAX_DOF] {
        let poses = self.arm.link_poses(&SVector::from(*q));
        poses.map(|X| placement(&X))
    }

    pub(crate) fn hand(&self, q: &[f64; MAX_DOF]) -> Placement {
        placement(&self.arm.forward_kinematics(&SVector::from(*q)))
    }

    /// The Jacobian at the point that the report is of.
    pub(crate) fn jacobian(&self, q: &SVector<f64, MAX_DOF>, p_BC: [f64; 3]) -> Jacobian {
        let r_EC = Vector3::from(p_BC) - self.arm.forward_kinematics(q).p;
        at_point(self.arm.jacobian(q), &r_EC)
    }

    /// Singular values of the unit-scaled Jacobian in the posture that has been analysed, the estimated one: the law has no use for them, so they are
    /// computed where they are drawn.
    pub(crate) fn singular_values(&self, row: &TickRow) -> Option<[f64; 6]> {
        let report = row.singularity?;
        let estimated = row.estimate.map(|estimate| &estimate.q);
        let q = estimated.or_else(|| row.q())?;
        let J = self.jacobian(&SVector::from(*q), report.p_BC);
        let scaled = unit_scaled(&J, report.length_m, &self.task);
        Some(scaled.singular_values().into())
    }

    /// Half the length of the mark of a singularity the arm is in; m.
    pub(crate) fn mark_size(&self) -> f32 {
        0.12 * self.body.reach
    }
}

/// Whether the task is null-space motion alone: every segment holds the hand, and some change the posture.
fn stands_still(scenario: &Scenario) -> bool {
    let holds = |one: &Segment| {
        let held = Segment {
            duration_s: one.duration_s,
            branch: one.branch,
            ..Segment::default()
        };
        let hand = Segment {
            posture_deg: None,
            posture_q: None,
            ..one.clone()
        };
        hand == held
    };
    let mut all = scenario.segment.iter();
    all.clone().all(holds) && all.any(|one| one.posture().is_some())
}
