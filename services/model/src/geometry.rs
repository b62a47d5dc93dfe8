//! Plain kinematics for any number of joints: for checking and describing a robot as it is loaded.

use crate::joint::{Frame, Joint, JointKind};
use crate::pose::Pose;
use crate::robot::Robot;
use crate::task::{TaskAxes, TaskAxis};
use nalgebra::{Matrix3, Unit, Vector3, Vector6};

/// The Jacobian's columns [v; ω] at the default frame, from axes and origins alone.
pub(crate) fn jacobian(robot: &Robot, q: &[f64]) -> Vec<Vector6<f64>> {
    let frame = robot.frame(&robot.default_frame).expect("a loaded robot has its default frame");
    let moving = frame.joint.map_or(0, |i| i + 1);
    let mut X = Pose::identity();
    let mut axes = Vec::new();
    for (joint, &q) in robot.joints.iter().zip(q).take(moving) {
        X = X * joint.X_PJ;
        axes.push((joint.kind, X.R * joint.axis, X.p));
        X = X * displacement(joint, q);
    }
    let p_E = (X * frame.X_LF).p;
    let column = |(kind, z, p): (JointKind, Vector3<f64>, Vector3<f64>)| {
        let (v, w) = match kind {
            JointKind::Prismatic => (z, Vector3::zeros()),
            JointKind::Revolute | JointKind::Continuous => (z.cross(&(p_E - p)), z),
        };
        Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
    };
    let mut columns: Vec<_> = axes.into_iter().map(column).collect();
    columns.resize(robot.dof(), Vector6::zeros());
    columns
}

/// The joint's own motion.
fn displacement(joint: &Joint, q: f64) -> Pose {
    match joint.kind {
        JointKind::Prismatic => Pose::translation(joint.axis * q),
        JointKind::Revolute | JointKind::Continuous => {
            let axis = Unit::new_unchecked(joint.axis);
            let (s, c) = libm::sincos(q);
            let K = axis.cross_matrix();
            // Rodrigues: R = 1 + s·K + (1 − c)·K².
            Pose::rotation(Matrix3::identity() + s * K + (1.0 - c) * K * K)
        }
    }
}

/// Half the sum of the distances between successive joint origins, from the first to the end frame; 1 m if that is zero.
pub(crate) fn default_length(joints: &[Joint], frames: &[Frame], tip: &str) -> f64 {
    let links: f64 = joints.iter().skip(1).map(|joint| joint.X_PJ.p.norm()).sum();
    let tool = frames.iter().find(|frame| frame.name == tip).map_or(0.0, |frame| frame.X_LF.p.norm());
    match 0.5 * (links + tool) {
        length if length > 0.0 => length,
        _ => 1.0,
    }
}

/// The task axes whose Jacobian rows are independent, taken in order, at a generic posture.
pub(crate) fn served_axes(robot: &Robot) -> TaskAxes {
    let q: Vec<f64> = (0..robot.dof()).map(|i| 0.7 + 0.37 * i as f64).collect();
    let J = jacobian(robot, &q);
    let mut basis: Vec<f64> = Vec::new(); // one row of the length of q after the other
    let independent = |axis: &TaskAxis| {
        let mut row: Vec<f64> = J.iter().map(|column| column[axis.row()]).collect();
        // Gram–Schmidt against the rows already taken.
        for b in basis.chunks_exact(row.len().max(1)) {
            let along: f64 = b.iter().zip(&row).map(|(b, r)| b * r).sum();
            row.iter_mut().zip(b).for_each(|(r, b)| *r -= along * b);
        }
        let norm = row.iter().map(|r| r * r).sum::<f64>().sqrt();
        if norm < 1e-6 {
            return false;
        }
        basis.extend(row.into_iter().map(|r| r / norm));
        true
    };
    let mut independent = independent;
    TaskAxis::ALL.into_iter().filter(|axis| independent(axis)).collect()
}
