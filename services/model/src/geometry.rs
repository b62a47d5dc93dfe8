//! Properties of a robot's geometry, for checking and completing its description as it is loaded.

use crate::arm::Model;
use crate::dispatch::embedded;
use crate::joint::{Frame, Joint, JointKind};
use crate::robot::Robot;
use crate::task::{TaskAxes, TaskAxis};
use nalgebra::Vector6;
use shared_types::MAX_DOF;

/// The Jacobian's columns [v; ω] at the default frame, one per joint.
///
/// Units m, rad · Frame base axes · Requires a robot whose joints and frames are loaded, and a `q` of its joints
pub(crate) fn jacobian(robot: &Robot, q: &[f64]) -> Vec<Vector6<f64>> {
    let model = Model::<MAX_DOF>::new(robot, None)
        .expect("a loaded robot has its default frame, and no more joints than are supported");
    model
        .jacobian(&embedded(q))
        .column_iter()
        .take(robot.dof())
        .map(|column| column.into_owned())
        .collect()
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
    let posture = |yaw: f64| -> Vec<Vector6<f64>> {
        let turned = |i: usize| if i == 0 { yaw } else { 0.0 };
        let q: Vec<f64> = (0..robot.dof())
            .map(|i| 0.7 + 0.37 * i as f64 + turned(i))
            .collect();
        jacobian(robot, &q)
    };
    let first = posture(0.0);
    let every = independent(&TaskAxis::ALL, &first);
    let turns = (robot.joints.first()).is_some_and(|joint| joint.kind != JointKind::Prismatic);
    let faces: Vec<_> = if turns && every.len() < TaskAxis::ALL.len() {
        (0..YAWS)
            .map(|k| posture(std::f64::consts::TAU * f64::from(k) / f64::from(YAWS)))
            .collect()
    } else {
        vec![]
    };
    let holds = |axes: &[TaskAxis]| {
        let volumes = faces.iter().map(|J| volume(axes, J));
        let (low, high) = volumes.fold((f64::INFINITY, 0.0_f64), |(low, high), volume| {
            (low.min(volume), high.max(volume))
        });
        faces.is_empty() || low > LEAST_SHARE * high
    };
    if holds(&every) {
        return every.into_iter().collect();
    }
    let mut served = every.clone();
    served.retain(|axis| axis.row() < 3);
    for axis in &TaskAxis::ALL[3..] {
        let mut more = served.clone();
        more.push(*axis);
        if independent(&more, &first).len() == more.len() && holds(&more) {
            served = more;
        }
    }
    // There is no better choice if these do not hold either.
    match holds(&served) {
        true => served.into_iter().collect(),
        false => every.into_iter().collect(),
    }
}

/// Those of the axes whose rows of J are independent of the ones before; `J` by columns.
fn independent(axes: &[TaskAxis], J: &[Vector6<f64>]) -> Vec<TaskAxis> {
    let mut taken: Vec<TaskAxis> = vec![];
    for axis in axes {
        let before = volume(&taken, J);
        taken.push(*axis);
        if volume(&taken, J) < 1e-6 * before {
            taken.pop();
        }
    }
    taken
}

/// The volume that the rows of these axes span, by Gram–Schmidt; 1 of none.
fn volume(axes: &[TaskAxis], J: &[Vector6<f64>]) -> f64 {
    let mut basis: Vec<Vec<f64>> = vec![];
    let mut volume = 1.0;
    for axis in axes {
        let mut row: Vec<f64> = J.iter().map(|column| column[axis.row()]).collect();
        for b in &basis {
            let along: f64 = b.iter().zip(&row).map(|(b, r)| b * r).sum();
            row.iter_mut().zip(b).for_each(|(r, b)| *r -= along * b);
        }
        let norm = row.iter().map(|r| r * r).sum::<f64>().sqrt();
        volume *= norm;
        basis.push(row.into_iter().map(|r| r / norm.max(1e-300)).collect());
    }
    volume
}
