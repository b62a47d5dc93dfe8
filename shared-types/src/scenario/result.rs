//! Judgement, recording and layout of a run.

use serde::{Deserialize, Serialize};

use crate::file::{Complaint, positive};

/// When the goal counts as reached, judged on the simulator's truth at the end.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Goal {
    /// Final position error; mm.
    pub position_mm: f64,
    /// Final orientation error; degrees.
    pub orientation_deg: f64,
    /// Largest error orthogonal to the singular directions while moving; mm.
    pub orthogonal_mm: f64,
    /// The same for orientation; degrees.
    pub orthogonal_deg: f64,
    /// How far the arm may leave the commanded path on purpose, to pass a singularity; mm.
    pub path_mm: f64,
    /// The same for orientation; degrees.
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

/// The layout that the recording opens with.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct View {
    /// Blueprint layout.
    pub layout: Layout,
}

/// Blueprint layouts.
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

/// How the recording is kept: a long one goes on in further files, each of which opens alone, and all together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Record {
    /// A file holds at most so much of the run; s.
    pub part_s: f64,
    /// A file is at most so large, to within a chunk; MB (10⁶ bytes).
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
