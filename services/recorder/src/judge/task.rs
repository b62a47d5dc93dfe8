//! Errors of the task: desired against true pose.

use control::{GroundTruth, Progress};
use nalgebra::{Matrix3, Vector3, Vector6};
use shared_types::bounds::larger;
use shared_types::summary::TaskSummary;

use super::force::ForceMeter;
use super::tick::Tick;

/// Desired against true pose at one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaskError {
    /// Norms of the whole error, of its part orthogonal to the singular directions in whose neighbourhood the true
    /// posture is, and of its part along them; mm.
    pub position: [f64; 3],
    /// The same; degrees.
    pub orientation: [f64; 3],
}

impl TaskError {
    /// No error yet to judge. A NaN is within no bounds.
    pub(crate) const UNKNOWN: Self = Self {
        position: [f64::NAN; 3],
        orientation: [f64::NAN; 3],
    };

    /// A pose error `[p_d − p; log(R_d Rᵀ)]` (m, rad, base axes), split by the truth alone, alike for every law.
    ///
    /// Finite for every error that is finite.
    pub fn split(truth: &dyn GroundTruth, error: &Vector6<f64>) -> Self {
        let across = truth.orthogonal(error);
        let split = |at: usize, unit: f64| {
            let whole = error.fixed_rows::<3>(at);
            let across = across.fixed_rows::<3>(at);
            [whole.norm(), across.norm(), (whole - across).norm()].map(|norm| norm * unit)
        };
        Self {
            position: split(0, 1e3),
            orientation: split(3, 1f64.to_degrees()),
        }
    }
}

/// The error against the controller's own reference on the task axes `served` alone (x, y, z, rx, ry, rz of the base), of
/// a steered run, whose targets become a reference in the controller; m, rad.
pub(super) fn against_reference(tick: &Tick<'_>, served: &[bool; 6]) -> Vector6<f64> {
    let truth = tick.truth;
    let command = tick.control;
    let position = Vector3::from(command.p_BE_d) - Vector3::from(truth.p_BE);
    let turn = matrix(&command.R_BE_d) * matrix(&truth.R_BE).transpose();
    let orientation = model::rotation_log(&turn);
    // Times zero, not zero: a NaN stays one.
    let kept = |axis: usize| if served[axis] { 1.0 } else { 0.0 };
    Vector6::from_fn(|i, _| match i {
        0..3 => position[i] * kept(i),
        _ => orientation[i - 3] * kept(i),
    })
}

fn matrix(columns: &[f64; 9]) -> Matrix3<f64> {
    Matrix3::from_column_slice(columns)
}

/// Gathers the task's errors. A NaN in any tick is the largest error of the run.
#[derive(Debug, Default)]
pub(super) struct TaskMeter {
    summary: TaskSummary,
    position_square_sum: f64,
    force: ForceMeter,
    ticks: u64,
    /// The first tick of a contact.
    contact_since: Option<u64>,
    /// Largest errors along the singular directions, towards reachable targets; mm, °.
    along: [f64; 2],
}

impl TaskMeter {
    /// `beyond`: the error along ζ lies beyond the boundary of reach.
    pub(super) fn tick(&mut self, error: &TaskError, beyond: bool) {
        let TaskError {
            position: [mm, across_mm, along_mm],
            orientation: [deg, across_deg, along_deg],
        } = *error;
        let task = &mut self.summary;
        task.position_max_mm = larger(task.position_max_mm, mm);
        task.orientation_max_deg = larger(task.orientation_max_deg, deg);
        task.orthogonal_max_mm = larger(task.orthogonal_max_mm, across_mm);
        task.orthogonal_max_deg = larger(task.orthogonal_max_deg, across_deg);
        if !beyond {
            self.along = [
                larger(self.along[0], along_mm),
                larger(self.along[1], along_deg),
            ];
        }
        task.along_max_mm = larger(task.along_max_mm, along_mm);
        task.along_max_deg = larger(task.along_max_deg, along_deg);
        task.final_position_mm = mm;
        task.final_orientation_deg = deg;
        self.position_square_sum += mm * mm;
        self.ticks += 1;
    }

    /// Takes in whether the arm touches anything, at this place of its path, with this error; `dt_s`: length of a tick.
    pub(super) fn touch(
        &mut self,
        tick: &Tick<'_>,
        truth: &dyn GroundTruth,
        place: Option<&Progress>,
        error: &Vector6<f64>,
        dt_s: f64,
    ) {
        let state = tick.truth;
        self.force.tick(tick, truth, place, error, dt_s);
        let force_n = Vector3::from(state.contact_force_n).norm();
        let most_n = self.force.most_n();
        let task = &mut self.summary;
        // A NaN is no force that was asked for.
        let is_asked = most_n > 0.0 && force_n <= most_n;
        if state.contacts > 0 && !is_asked {
            task.contact_ticks += 1;
            self.contact_since.get_or_insert(state.header.tick);
            task.contact_max_n = larger(task.contact_max_n, force_n);
        }
    }

    /// A contact that nobody asked for may explain an error.
    pub(super) fn clause(&self) -> Option<String> {
        let TaskSummary {
            contact_ticks,
            contact_max_n,
            ..
        } = self.summary;
        let what = if self.force.has_begun {
            "the arm pressed more than twice as hard as asked, or on something else,"
        } else {
            "the arm touched the floor, a surface or itself"
        };
        self.contact_since.map(|since| {
            format!("{what} for {contact_ticks} ticks from tick {since} on, with up to {contact_max_n:.0} N")
        })
    }

    /// Largest errors along the singular directions, towards reachable targets; mm, °.
    pub(super) fn along(&self) -> [f64; 2] {
        self.along
    }

    /// The summary of a run of `ticks`, planned to take `planned_ticks`.
    pub(super) fn finish(mut self, ticks: u64, planned_ticks: f64) -> TaskSummary {
        if self.ticks > 0 {
            self.summary.position_rms_mm = (self.position_square_sum / self.ticks as f64).sqrt();
            self.summary.time_stretch = ticks as f64 / planned_ticks.max(1.0);
        }
        self.summary.force = self.force.finish();
        self.summary
    }
}
