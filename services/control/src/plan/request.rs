//! The task of a plan (+).

use super::kinematics::Kinematics;
use crate::reference::path::Path;
use crate::singularity::analyzer::Analyzer;
use crate::types::{Kind, Report, Singularity};
use model::Model;
use nalgebra::{SVector, Vector3};

/// Joint motion that turns ζ: from a posture, its analysis, the singularity's place and the angle, rad.
pub type Turning<'a, const N: usize> =
    dyn Fn(&SVector<f64, N>, &Report<N>, usize, f64) -> Option<SVector<f64, N>> + 'a;

/// The arm, its task, and the bounds of a plan.
#[derive(Clone, Copy)]
pub struct Request<'a, const N: usize> {
    /// The arm.
    pub model: &'a Model<N>,
    /// The task.
    pub path: &'a Path,
    /// Where the arm starts, rad.
    pub q_start: SVector<f64, N>,
    /// Posture goals of the legs whose null-space posture is commanded, rad.
    pub postures: &'a [Option<SVector<f64, N>>],
    /// Finds the singularities along the route.
    pub analyzer: &'a Analyzer<N>,
    /// Joint motion that turns ζ of the singularity in a place by an angle, end-effector held; `None` where there is none within limits.
    pub turning: &'a Turning<'a, N>,
    /// Which of the six task axes count.
    pub task: [bool; 6],
    /// The length that makes metres and radians comparable, m.
    pub length_m: f64,
    /// How far the path may be left, m.
    pub position_m: f64,
    /// How far the path may be left, rad.
    pub orientation_rad: f64,
}

/// Fastest motion that is planned for a joint whose model states no speed limit, rad/s (m/s for prismatic joints): half a turn a second.
const UNSTATED: f64 = std::f64::consts::PI;

impl<'a, const N: usize> Request<'a, N> {
    /// Fastest joint motion that is planned, rad/s.
    pub(super) fn velocity(&self) -> SVector<f64, N> {
        let stated = |limit: f64| if limit.is_finite() { limit } else { UNSTATED };
        self.model.velocity().map(stated)
    }

    /// The elbow of a posture, else the first of its singularities.
    pub(super) fn fold(&self, q: &SVector<f64, N>) -> Option<Singularity<N>> {
        let report = analyse(&mut self.analyzer.clone(), self.model, q);
        let mut listed = report.listed().iter();
        let elbow = listed.find(|s| s.kind == Kind::Elbow);
        elbow.or(report.listed().first()).copied()
    }

    /// The side of a fold that a posture is on. By factors sin θ: the coordinate of an elbow that is folded back is another joint.
    pub(super) fn side(&self, q: &SVector<f64, N>) -> f64 {
        let is_factored = self.analyzer.family().is_factored();
        self.fold(q).map_or(0.0, |s| match s.kind {
            Kind::Elbow if is_factored => s.s,
            _ => s.aux,
        })
    }

    /// The kinematics of C, which lies at `p_EC` in the end-effector's axes.
    pub(super) fn kinematics(&self, p_EC: Vector3<f64>) -> Kinematics<'a, N> {
        Kinematics {
            model: self.model,
            p_EC,
            task: self.task,
            length_m: self.length_m,
        }
    }
}

/// C in the end-effector's axes, from the analysis of the start posture.
pub(super) fn centre<const N: usize>(
    model: &Model<N>,
    q: &SVector<f64, N>,
    report: &Report<N>,
) -> Vector3<f64> {
    let X = model.forward_kinematics(q);
    X.R.transpose() * (report.p_BC - X.p)
}

/// The analysis of a posture at rest, after those before it.
pub(super) fn analyse<const N: usize>(
    analyzer: &mut Analyzer<N>,
    model: &Model<N>,
    q: &SVector<f64, N>,
) -> Report<N> {
    let zero = SVector::zeros();
    analyzer.step(q, &zero, &model.evaluate(q, &zero))
}
