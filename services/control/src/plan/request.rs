//! The task of a plan (+).

use super::kinematics::Kinematics;
use crate::linear::{Joints, Vector3};
use crate::reference::path::Path;
use crate::reference::turn;
use crate::singularity::analyzer::Analyzer;
use crate::types::{Kind, Report, Singularity};
use model::{Model, Robot};
use shared_types::scenario::{Goal, Scenario};

/// A deviation from a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// m.
    pub position_m: f64,
    /// rad.
    pub orientation_rad: f64,
}

impl Deviation {
    /// The one that a scenario's goal allows on the way.
    pub(crate) fn of(goal: &Goal) -> Self {
        Self {
            position_m: goal.path_mm * 1e-3,
            orientation_rad: goal.path_deg.to_radians(),
        }
    }

    /// So many times as much.
    pub(super) fn times(self, factor: f64) -> Self {
        Self {
            position_m: self.position_m * factor,
            orientation_rad: self.orientation_rad * factor,
        }
    }

    /// The lesser one of each kind.
    pub(super) fn at_most(self, other: Self) -> Self {
        Self {
            position_m: self.position_m.min(other.position_m),
            orientation_rad: self.orientation_rad.min(other.orientation_rad),
        }
    }
}

/// The arm, its task, and the bounds of a plan.
#[derive(Clone, Copy)]
pub struct Request<'a, const N: usize> {
    /// The arm.
    pub model: &'a Model<N>,
    /// Its description.
    pub robot: &'a Robot,
    /// The task.
    pub scenario: &'a Scenario,
    /// The task's path.
    pub path: &'a Path,
    /// Where the arm starts, rad.
    pub q_start: Joints<N>,
    /// Posture goals of the legs whose null-space posture is commanded, rad.
    pub postures: &'a [Option<Joints<N>>],
    /// Finds the singularities along the route.
    pub analyzer: &'a Analyzer<N>,
    /// How far the path may be left.
    pub allowed: Deviation,
}

/// Fastest motion that is planned for a joint whose model states no speed limit, rad/s (m/s for prismatic joints): half a turn a second.
const UNSTATED: f64 = std::f64::consts::PI;

impl<'a, const N: usize> Request<'a, N> {
    /// Fastest joint motion that is planned, rad/s.
    pub(super) fn velocity(&self) -> Joints<N> {
        let stated = |limit: f64| if limit.is_finite() { limit } else { UNSTATED };
        self.model.velocity().map(stated)
    }

    /// The elbow of a posture, else the first of its singularities.
    pub(super) fn fold(&self, q: &Joints<N>) -> Option<Singularity<N>> {
        let report = analyse(&mut self.analyzer.clone(), self.model, q);
        let mut listed = report.listed().iter();
        let elbow = listed.find(|s| s.kind == Kind::Elbow);
        elbow.or(report.listed().first()).copied()
    }

    /// The side of a fold that a posture is on. By factors sin θ: the coordinate of an elbow that is folded back is another joint.
    pub(super) fn side(&self, q: &Joints<N>) -> f64 {
        let is_factored = self.analyzer.family().is_factored();
        self.fold(q).map_or(0.0, |s| match s.kind {
            Kind::Elbow if is_factored => s.s,
            _ => s.aux,
        })
    }

    /// Joint motion that turns ζ of the singularity in a place by an angle, rad, end-effector held; `None` where there is none within limits.
    pub(super) fn turning(
        &self,
        q: &Joints<N>,
        report: &Report<N>,
        place: usize,
        angle: f64,
    ) -> Option<Joints<N>> {
        let s = report.listed().get(place)?;
        let (_, by) = turn::within_limits(self.analyzer.family(), self.model, q, s, angle)?;
        Some(by)
    }

    /// The kinematics of C, which lies at `p_EC` in the end-effector's axes.
    pub(super) fn kinematics(&self, p_EC: Vector3) -> Kinematics<'a, N> {
        Kinematics {
            model: self.model,
            p_EC,
            task: self.robot.task.0,
            length_m: self.robot.length_m,
        }
    }
}

/// C in the end-effector's axes, from the analysis of the start posture.
pub(super) fn centre<const N: usize>(
    model: &Model<N>,
    q: &Joints<N>,
    report: &Report<N>,
) -> Vector3 {
    let X = model.forward_kinematics(q);
    X.R.transpose() * (report.p_BC - X.p)
}

/// The analysis of a posture at rest, after those before it.
pub(super) fn analyse<const N: usize>(
    analyzer: &mut Analyzer<N>,
    model: &Model<N>,
    q: &Joints<N>,
) -> Report<N> {
    let zero = Joints::zeros();
    analyzer.step(q, &zero, &model.evaluate(q, &zero))
}
