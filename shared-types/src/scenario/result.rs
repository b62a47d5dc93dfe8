//! Goal and layout of a run.

use serde::{Deserialize, Serialize};

use crate::file::{Complaint, positive};
use crate::words::words;

/// Errors within which the goal counts as reached, judged on the simulator's true state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Goal {
    /// Position error at the end; mm.
    pub position_mm: f64,
    /// Orientation error at the end; degrees.
    pub orientation_deg: f64,
    /// Largest position error orthogonal to ζ while moving; mm.
    pub orthogonal_mm: f64,
    /// Largest orientation error orthogonal to ζ while moving; degrees.
    pub orthogonal_deg: f64,
    /// Root mean square of the error of a force, where segments ask for one; N.
    pub force_n: f64,
    /// The same of moments; N·m.
    pub moment_nm: f64,
    /// Distance by which the planner may leave the path to pass a singularity; mm.
    pub path_mm: f64,
    /// Angle by which the planner may leave the path to pass a singularity; degrees.
    pub path_deg: f64,
}

impl Default for Goal {
    fn default() -> Self {
        Self {
            position_mm: 1.0,
            orientation_deg: 0.5,
            orthogonal_mm: 1.0,
            orthogonal_deg: 0.5,
            force_n: 1.0,
            moment_nm: 0.1,
            path_mm: 1.0,
            path_deg: 0.5,
        }
    }
}

/// Layout of the recording in the viewer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct View {
    /// Layout with which the recording opens.
    pub layout: Layout,
}

words! {
    /// Layouts of the viewer.
    Layout {
        /// Arm, singularities, errors, torques.
        Control "control",
        /// Processes, faults and latencies first.
        Timing "timing",
    }
}

impl Goal {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        let bounds = [
            ("position_mm", self.position_mm),
            ("orientation_deg", self.orientation_deg),
            ("orthogonal_mm", self.orthogonal_mm),
            ("orthogonal_deg", self.orthogonal_deg),
            ("force_n", self.force_n),
            ("moment_nm", self.moment_nm),
            ("path_mm", self.path_mm),
            ("path_deg", self.path_deg),
        ];
        let mut bounds = bounds.into_iter();
        bounds.try_for_each(|(key, value)| positive(&format!("goal.{key}"), value))
    }
}
