//! Properties of a robot's geometry, for checking and completing its description as it is loaded.

use crate::arm::Model;
use crate::dispatch::embedded;
use crate::joint::{Frame, Joint, JointKind};
use crate::robot::Robot;
use crate::task::{TaskAxes, TaskAxis};
use nalgebra::{RowSVector, SMatrix};
use shared_types::MAX_DOF;

/// Columns beyond the arm's joints are zero.
type Jacobian = SMatrix<f64, 6, MAX_DOF>;

/// The Jacobian, rows [v; ω], at the default frame.
///
/// Units m, rad · Frame base axes · Requires a robot whose joints and frames are loaded, and a `q` of its joints
pub(crate) fn jacobian(robot: &Robot, q: &[f64]) -> Jacobian {
    let model = Model::<MAX_DOF>::new(robot, None)
        .expect("a loaded robot has its default frame, and no more joints than are supported");
    model.jacobian(&embedded(q))
}

/// Half the sum of the distances between successive joint origins, from the first to the end frame; 1 m if that is zero.
pub(crate) fn default_length(joints: &[Joint], frames: &[Frame], tip: &str) -> f64 {
    let links: f64 = joints.iter().skip(1).map(|joint| joint.X_PJ.p.norm()).sum();
    let tool = frames
        .iter()
        .find(|frame| frame.name == tip)
        .map_or(0.0, |frame| frame.X_LF.p.norm());
    match 0.5 * (links + tool) {
        length if length > 0.0 => length,
        _ => 1.0,
    }
}

/// Turns of joint 1 at which the served axes must be independent, and the least share of their largest volume at any of them.
const YAWS: u32 = 64;
const LEAST_SHARE: f64 = 0.1;

/// The task axes whose Jacobian rows are independent, taken in order, at a generic posture, and at any turn of joint 1.
///
/// Of an arm of four joints that turns about z and bends in a plane, a rotation about x or y is independent of its position, but not in every direction
/// that it may face: it serves x, y and z.
pub(crate) fn served_axes(robot: &Robot) -> TaskAxes {
    let posture = |yaw: f64| {
        let turned = |i: usize| if i == 0 { yaw } else { 0.0 };
        let q: Vec<f64> = (0..robot.dof())
            .map(|i| 0.7 + 0.37 * i as f64 + turned(i))
            .collect();
        jacobian(robot, &q)
    };
    let (every, _) = independent(&TaskAxis::ALL, &posture(0.0));
    let turns = (robot.joints.first()).is_some_and(|joint| joint.kind != JointKind::Prismatic);
    if !turns || every.len() == TaskAxis::ALL.len() {
        return every.into_iter().collect();
    }
    let faces: Vec<Jacobian> = (0..YAWS)
        .map(|k| posture(std::f64::consts::TAU * f64::from(k) / f64::from(YAWS)))
        .collect();
    let holds = |axes: &[TaskAxis]| {
        let volumes = faces.iter().map(|J| match independent(axes, J) {
            (taken, volume) if taken.len() == axes.len() => volume,
            _ => 0.0,
        });
        let (low, high) = volumes.fold((f64::INFINITY, 0.0_f64), |(low, high), volume| {
            (low.min(volume), high.max(volume))
        });
        low > LEAST_SHARE * high
    };
    let mut served = every.clone();
    if !holds(&every) {
        served.retain(|axis| axis.row() < 3);
        for axis in &TaskAxis::ALL[3..] {
            let more = [&served[..], &[*axis]].concat();
            if holds(&more) {
                served = more;
            }
        }
    }
    // There is no better choice if these do not hold either.
    let chosen = if holds(&served) { served } else { every };
    chosen.into_iter().collect()
}

/// Those of the axes whose rows of J are independent of the ones before, by Gram–Schmidt, and the volume that these rows span; 1 of none.
fn independent(axes: &[TaskAxis], J: &Jacobian) -> (Vec<TaskAxis>, f64) {
    let mut basis: Vec<RowSVector<f64, MAX_DOF>> = vec![];
    let (mut taken, mut volume) = (vec![], 1.0);
    for axis in axes {
        let mut row = J.row(axis.row()).into_owned();
        for b in &basis {
            row -= b * b.dot(&row);
        }
        let height = row.norm();
        if height >= 1e-6 {
            taken.push(*axis);
            basis.push(row / height);
            volume *= height;
        }
    }
    (taken, volume)
}
