//! Properties of a robot's geometry, for checking and completing its description as it is loaded.

use crate::arm::Model;
use crate::dispatch::embedded;
use crate::joint::{Frame, Joint};
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
    TaskAxis::ALL
        .into_iter()
        .filter(|axis| independent(axis))
        .collect()
}
