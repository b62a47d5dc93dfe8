//! Goal, recording and layout of a run.

use serde::{Deserialize, Serialize};

use crate::file::{Complaint, positive};

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

/// Layouts of the viewer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// Arm, singularities, errors, torques.
    #[default]
    Control,
    /// Latencies and deadlines first.
    Timing,
    /// Lives, faults and torques first.
    Faults,
}

impl Layout {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Control, Self::Timing, Self::Faults];

    /// As written in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Control => "control",
            Self::Timing => "timing",
            Self::Faults => "faults",
        }
    }
}

/// Size of the recording's files. A long recording continues in further files; each opens alone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Record {
    /// Longest part of the run in one file; s.
    pub part_s: f64,
    /// Largest file, within one chunk; MB (10⁶ bytes).
    pub part_mb: u64,
}

impl Default for Record {
    fn default() -> Self {
        Self {
            part_s: 300.0,
            part_mb: 1000,
        }
    }
}

impl Goal {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        let bounds = [
            ("position_mm", self.position_mm),
            ("orientation_deg", self.orientation_deg),
            ("orthogonal_mm", self.orthogonal_mm),
            ("orthogonal_deg", self.orthogonal_deg),
            ("path_mm", self.path_mm),
            ("path_deg", self.path_deg),
        ];
        let mut bounds = bounds.into_iter();
        bounds.try_for_each(|(key, value)| positive(&format!("goal.{key}"), value))
    }
}

impl Record {
    pub(super) fn check(&self) -> Result<(), Complaint> {
        positive("record.part_s", self.part_s)?;
        positive("record.part_mb", self.part_mb as f64)
    }
}
