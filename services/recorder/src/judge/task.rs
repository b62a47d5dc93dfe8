//! Errors of the task: desired against true pose.

use nalgebra::{Matrix3, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use shared_types::bounds::larger;
use shared_types::codes::MODE_REGULAR;
use shared_types::summary::TaskSummary;

use super::tick::{Tick, active, halves};

/// Desired against true pose at one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaskError {
    /// Norms of the whole error, of its part orthogonal to the engaged singular directions, and of its part along them; mm.
    pub position: [f64; 3],
    /// The same; degrees.
    pub orientation: [f64; 3],
}

impl TaskError {
    /// The error against the controller's own reference on the task axes `served` alone (x, y, z, rx, ry, rz of the base),
    /// split as in [`split`](Self::split): of a steered run, whose targets become a reference in the controller.
    #[must_use]
    pub fn on(tick: &Tick<'_>, served: &[bool; 6]) -> Self {
        let (truth, command) = (tick.truth, tick.control);
        let position = Vector3::from(command.p_BE_d) - Vector3::from(truth.p_BE);
        let turn = matrix(&command.R_BE_d) * matrix(&truth.R_BE).transpose();
        let orientation = model::rotation_log(&turn);
        // Times zero, not zero: a NaN stays one.
        let kept = |axis: usize| if served[axis] { 1.0 } else { 0.0 };
        let error = Vector6::from_fn(|i, _| match i {
            0..3 => position[i] * kept(i),
            _ => orientation[i - 3] * kept(i),
        });
        Self::split(tick, &error)
    }

    /// A pose error `[p_d − p; log(R_d Rᵀ)]` (m, rad, base axes), split at the directions of the singularities that are
    /// engaged: inside their neighbourhood, or not yet left by the law.
    ///
    /// Finite for every error that is finite.
    #[must_use]
    pub fn split(tick: &Tick<'_>, error: &Vector6<f64>) -> Self {
        let position: Vector3<f64> = error.fixed_rows::<3>(0).into();
        let orientation: Vector3<f64> = error.fixed_rows::<3>(3).into();
        let (mut across_m, mut across_rad) = (position, orientation);
        for (i, singularity) in active(tick.report).iter().enumerate() {
            if tick.control.mode[i] == MODE_REGULAR && singularity.inside == 0 {
                continue;
            }
            let (linear, angular) = halves(&singularity.zeta_B);
            across_m -= linear * linear.dot(&across_m);
            across_rad -= angular * angular.dot(&across_rad);
        }
        let split = |whole: Vector3<f64>, across: Vector3<f64>, unit: f64| {
            [whole, across, whole - across].map(|x| x.norm() * unit)
        };
        Self {
            position: split(position, across_m, 1e3),
            orientation: split(orientation, across_rad, 1f64.to_degrees()),
        }
    }
}

fn matrix(columns: &[f64; 9]) -> Matrix3<f64> {
    Matrix3::from_column_slice(columns)
}

/// Gathers the task's errors. A NaN in any tick is the largest error of the run.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct TaskMeter {
    summary: TaskSummary,
    position_square_sum: f64,
}

impl TaskMeter {
    pub(super) fn tick(&mut self, error: &TaskError) {
        let TaskError {
            position: [mm, across_mm, _],
            orientation: [deg, across_deg, _],
        } = *error;
        let task = &mut self.summary;
        task.position_max_mm = larger(task.position_max_mm, mm);
        task.orientation_max_deg = larger(task.orientation_max_deg, deg);
        task.orthogonal_max_mm = larger(task.orthogonal_max_mm, across_mm);
        task.orthogonal_max_deg = larger(task.orthogonal_max_deg, across_deg);
        (task.final_position_mm, task.final_orientation_deg) = (mm, deg);
        self.position_square_sum += mm * mm;
    }

    /// The summary of a run of `ticks`, planned to take `planned_ticks`.
    pub(super) fn finish(mut self, ticks: u64, planned_ticks: f64) -> TaskSummary {
        if ticks > 0 {
            self.summary.position_rms_mm = (self.position_square_sum / ticks as f64).sqrt();
            self.summary.time_stretch = ticks as f64 / planned_ticks.max(1.0);
        }
        self.summary
    }
}
