//! Collision shapes: what of the arm can touch the world.

use model::{Geometry, Pose, Robot};
use nalgebra::{Matrix3, SVector, Vector3};
use rapier3d::geometry::{Group, SharedShape};
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
    /// Its link's, the base's or the floor's.
    pub(crate) group: Group,
    /// Distance of its farthest point from the link's origin; m.
    pub(crate) reach: f64,
}

impl Solid {
    fn on(link: Option<usize>, X_LS: Pose, shape: SharedShape, reach: f64) -> Self {
        let group = Group::from_bits_truncate(1 << link.map_or(0, |i| i + 1));
        Self {
            link,
            X_LS,
            shape,
            group,
            reach,
        }
    }
}

/// The floor's group.
pub(crate) const FLOOR: Group = Group::GROUP_32;

/// A floor at the height `z` in the base; m.
pub(crate) fn floor(z: f64) -> Solid {
    let X_BF = Pose::translation(Vector3::new(0.0, 0.0, z));
    Solid {
        group: FLOOR,
        ..Solid::on(None, X_BF, SharedShape::halfspace(math::Vector::Z), 0.0)
    }
}

/// The robot's own shapes but meshes, or, where it has none, capsules from joint to joint.
pub(crate) fn solids(robot: &Robot) -> Vec<Solid> {
    let touching = robot.shapes.iter().filter(|shape| shape.touches);
    let described: Vec<Solid> = touching.filter_map(described).collect();
    if described.is_empty() {
        return guessed(robot);
    }
    described
}

fn described(shape: &model::Shape) -> Option<Solid> {
    let mut X_LS = shape.X_LS;
    let (solid, radius) = match shape.geometry {
        Geometry::Box { size } => {
            let half = size / 2.0;
            (SharedShape::cuboid(half.x, half.y, half.z), half.norm())
        }
        Geometry::Cylinder { radius, length } => {
            // rapier's cylinder lies along y.
            X_LS = X_LS * y_to_z();
            let half = length / 2.0;
            let cylinder = SharedShape::cylinder(half, radius);
            (cylinder, libm::hypot(half, radius))
        }
        Geometry::Sphere { radius } => (SharedShape::ball(radius), radius),
        Geometry::Capsule { radius, length } => {
            let half = math::Vector::new(0.0, 0.0, length / 2.0);
            let capsule = SharedShape::capsule(-half, half, radius);
            (capsule, length / 2.0 + radius)
        }
        Geometry::Mesh { .. } => return None,
    };
    let reach = X_LS.p.norm() + radius;
    Some(Solid::on(shape.joint, X_LS, solid, reach))
}

/// A rotation that takes y to z.
fn y_to_z() -> Pose {
    let columns = [Vector3::x(), Vector3::z(), -Vector3::y()];
    Pose::rotation(Matrix3::from_columns(&columns))
}

fn guessed(robot: &Robot) -> Vec<Solid> {
    let capsule = |i: usize| {
        // The next joint or, on the last link, the farthest frame: the flange, or the end-effector.
        let on_last = robot.frames.iter().filter(|frame| frame.joint == Some(i));
        let p = match robot.joints.get(i + 1) {
            Some(next) => next.X_PJ.p,
            None => on_last
                .map(|frame| frame.X_LF.p)
                .fold(Vector3::zeros(), |far, p| {
                    if p.norm() > far.norm() { p } else { far }
                }),
        };
        let length = p.norm();
        let radius = (GUESS_RATIO * length).clamp(GUESS_RADIUS[0], GUESS_RADIUS[1]);
        let shape = SharedShape::capsule(math::Vector::ZERO, vector(&p), radius);
        (length > GUESS_SHORTEST)
            .then(|| Solid::on(Some(i), Pose::identity(), shape, length + radius))
    };
    (0..robot.dof()).filter_map(capsule).collect()
}

/// The solid's pose in the base, given the links'.
pub(crate) fn placed<const N: usize>(solid: &Solid, X_BL: &[Pose; N]) -> math::Pose {
    to_rapier(&solid.link.map_or(solid.X_LS, |i| X_BL[i] * solid.X_LS))
}

/// Distance between two placed solids, 0 where they overlap; m.
pub(crate) fn distance(a: (&math::Pose, &Solid), b: (&math::Pose, &Solid)) -> f64 {
    let found = query::distance(a.0, &*a.1.shape.0, b.0, &*b.1.shape.0);
    found.map_or(0.0, |found| found.distance)
}

pub(crate) fn vector(v: &Vector3<f64>) -> math::Vector {
    math::Vector::new(v.x, v.y, v.z)
}

pub(crate) fn matrix(A: &Matrix3<f64>) -> math::Matrix {
    math::Matrix::from_cols_slice(A.as_slice())
}

pub(crate) fn to_rapier(X: &Pose) -> math::Pose {
    let R = math::Rotation::from_mat3(&matrix(&X.R)).normalize();
    math::Pose::from_parts(vector(&X.p), R)
}

/// For each joint, how far a point of the arm can move per unit of its motion, relative to anything before it: m/rad.
///
/// The farthest point beyond joint j is never farther from its axis than the links between them are long, so
/// |Δp| ≤ Σ_j reach_j·|Δq_j| in every posture.
pub(crate) fn reach<const N: usize>(robot: &Robot, solids: &[Solid]) -> SVector<f64, N> {
    let (mut reach, mut beyond) = (SVector::zeros(), 0.0);
    for (i, joint) in robot.joints.iter().enumerate().rev() {
        let own = solids.iter().filter(|solid| solid.link == Some(i));
        beyond = own.map(|solid| solid.reach).fold(beyond, f64::max);
        let (per_motion, slide) = match joint.kind {
            model::JointKind::Prismatic => (1.0, joint.lower.abs().max(joint.upper.abs())),
            _ => (beyond, 0.0),
        };
        reach[i] = per_motion;
        beyond += joint.X_PJ.p.norm() + slide;
    }
    reach
}
