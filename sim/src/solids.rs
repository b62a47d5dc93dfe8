//! Collision shapes: what of the arm can touch the world.

use model::{Geometry, Pose, Robot};
use nalgebra::{SVector, Vector3};
use rapier3d::geometry::SharedShape;
use rapier3d::math;
use rapier3d::parry::query;

/// Radius of a guessed capsule as a fraction of its length, and its bounds; m.
const GUESS_RATIO: f64 = 0.12;
const GUESS_RADIUS: [f64; 2] = [0.02, 0.06];

/// Links shorter than this get no guessed capsule; m.
const GUESS_SHORTEST: f64 = 1e-3;

/// A convex solid fixed to a link.
pub(crate) struct Solid {
    /// Index of the joint whose link carries it; `None` for the base.
    pub(crate) link: Option<usize>,
    /// Its frame in the link's.
    pub(crate) X_LS: Pose,
    pub(crate) shape: SharedShape,
    /// Distance of its farthest point from the link's origin; m.
    pub(crate) reach: f64,
}

/// The robot's own shapes, or, where it has none, capsules from joint to joint.
pub(crate) fn solids(robot: &Robot) -> Vec<Solid> {
    if robot.shapes.is_empty() {
        guessed(robot)
    } else {
        described(robot)
    }
}

fn described(robot: &Robot) -> Vec<Solid> {
    let solid = |shape: &model::Shape| {
        let along_z = |half: f64| {
            (
                math::Vector::new(0.0, 0.0, -half),
                math::Vector::new(0.0, 0.0, half),
            )
        };
        let (solid, radius, X_LS) = match shape.geometry {
            Geometry::Box { size } => {
                let half = size / 2.0;
                (
                    SharedShape::cuboid(half.x, half.y, half.z),
                    half.norm(),
                    shape.X_LS,
                )
            }
            // rapier's cylinder lies along y.
            Geometry::Cylinder { radius, length } => {
                let half = length / 2.0;
                (
                    SharedShape::cylinder(half, radius),
                    libm::hypot(half, radius),
                    shape.X_LS * y_to_z(),
                )
            }
            Geometry::Sphere { radius } => (SharedShape::ball(radius), radius, shape.X_LS),
            Geometry::Capsule { radius, length } => {
                let (a, b) = along_z(length / 2.0);
                (
                    SharedShape::capsule(a, b, radius),
                    length / 2.0 + radius,
                    shape.X_LS,
                )
            }
        };
        Solid {
            link: shape.joint,
            X_LS,
            shape: solid,
            reach: X_LS.p.norm() + radius,
        }
    };
    robot.shapes.iter().map(solid).collect()
}

/// A rotation that takes y to z.
fn y_to_z() -> Pose {
    Pose::rotation(nalgebra::Matrix3::new(
        1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0,
    ))
}

fn guessed(robot: &Robot) -> Vec<Solid> {
    let last = robot.dof().saturating_sub(1);
    let end = |i: usize| match robot.joints.get(i + 1) {
        Some(next) => next.X_PJ.p,
        // The farthest frame on the last link: the flange, or the end-effector.
        None => {
            let frames = robot
                .frames
                .iter()
                .filter(|frame| frame.joint == Some(last))
                .map(|frame| frame.X_LF.p);
            frames.fold(Vector3::zeros(), |far, p| {
                if p.norm() > far.norm() { p } else { far }
            })
        }
    };
    let capsule = |i: usize| {
        let p = end(i);
        let length = p.norm();
        let radius = (GUESS_RATIO * length).clamp(GUESS_RADIUS[0], GUESS_RADIUS[1]);
        let shape =
            SharedShape::capsule(math::Vector::ZERO, math::Vector::new(p.x, p.y, p.z), radius);
        (length > GUESS_SHORTEST).then(|| Solid {
            link: Some(i),
            X_LS: Pose::identity(),
            shape,
            reach: length + radius,
        })
    };
    (0..robot.dof()).filter_map(capsule).collect()
}

/// The solid's pose in the base, given the links'.
pub(crate) fn placed<const N: usize>(solid: &Solid, X_BL: &[Pose; N]) -> math::Pose {
    to_rapier(&solid.link.map_or(solid.X_LS, |i| X_BL[i] * solid.X_LS))
}

/// Distance between two placed solids, 0 where they overlap; m.
pub(crate) fn distance(a: (&math::Pose, &SharedShape), b: (&math::Pose, &SharedShape)) -> f64 {
    query::distance(a.0, &*a.1.0, b.0, &*b.1.0).map_or(0.0, |found| found.distance)
}

pub(crate) fn to_rapier(X: &Pose) -> math::Pose {
    let column = |j: usize| math::Vector::new(X.R[(0, j)], X.R[(1, j)], X.R[(2, j)]);
    let R = math::Rotation::from_mat3(&math::Matrix::from_cols(column(0), column(1), column(2)))
        .normalize();
    math::Pose::from_parts(math::Vector::new(X.p.x, X.p.y, X.p.z), R)
}

/// For each joint, how far a point of the arm can move per unit of its motion, relative to anything before it: m/rad.
///
/// The farthest point beyond joint j is never farther from its axis than the links between them are long, so
/// |Δp| ≤ Σ_j reach_j·|Δq_j| in every posture.
pub(crate) fn reach<const N: usize>(robot: &Robot, solids: &[Solid]) -> SVector<f64, N> {
    let slide = |i: usize| match robot.joints[i].kind {
        model::JointKind::Prismatic => robot.joints[i].lower.abs().max(robot.joints[i].upper.abs()),
        _ => 0.0,
    };
    let own = |i: usize| {
        solids
            .iter()
            .filter(|s| s.link == Some(i))
            .map(|s| s.reach)
            .fold(0.0, f64::max)
    };
    let mut reach = SVector::zeros();
    let mut beyond = 0.0;
    for i in (0..robot.dof()).rev() {
        beyond = own(i).max(beyond);
        reach[i] = if robot.joints[i].kind == model::JointKind::Prismatic {
            1.0
        } else {
            beyond
        };
        beyond += robot.joints[i].X_PJ.p.norm() + slide(i);
    }
    reach
}
