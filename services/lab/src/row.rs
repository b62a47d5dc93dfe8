//! The result of a trial, one structure for every experiment.

use std::collections::BTreeMap;

use recorder::Verdict;
use serde::Serialize;
use shared_types::scenario::{Goal, Strategy};
use shared_types::summary::{JointSummary, TaskSummary};

/// The result of a run, judged on the simulator's truth; its names are those of `summary.json`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Row {
    /// The control law; empty where the summary of a run does not say.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub law: String,
    /// `"goal reached"`, `"followed to the boundary"`, `"goal missed"`, `"stopped"` or `"failed"`.
    pub outcome: String,
    /// Why, in one sentence.
    pub reason: String,
    /// Ticks done.
    pub ticks: u64,
    /// Whether the task ran to its end.
    pub completed: bool,
    /// Task errors.
    #[serde(flatten)]
    pub task: TaskSummary,
    /// Joint loads.
    #[serde(flatten)]
    pub joints: JointSummary,
    /// Smallest |s| of any singularity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub s_min: Option<f64>,
    /// Ticks inside the neighbourhood of any singularity, each counted.
    pub inside_ticks: u64,
    /// Hash over each topic.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub hash: BTreeMap<String, String>,
}

impl Row {
    /// The row of a run on one thread.
    pub fn of(law: Strategy, verdict: Verdict) -> Self {
        Self {
            law: law.name().to_owned(),
            outcome: verdict.outcome,
            reason: verdict.reason,
            ticks: verdict.ticks,
            completed: verdict.completed,
            task: verdict.task,
            joints: verdict.joints,
            s_min: verdict
                .singularities
                .iter()
                .map(|one| one.s_min)
                .min_by(f64::total_cmp),
            inside_ticks: verdict
                .singularities
                .iter()
                .map(|one| one.inside_ticks)
                .sum(),
            hash: BTreeMap::new(),
        }
    }

    /// S1, S2, or the bars of S2 that were missed.
    pub fn success(&self) -> String {
        match (self.task.s1, self.task.s2) {
            (true, _) => "S1".to_owned(),
            (_, true) => "S2".to_owned(),
            _ => format!("no: {}", self.task.missed.join(", ")),
        }
    }

    /// Whether the goal pose was reached, by the bounds of a scenario that states none.
    pub fn ended(&self) -> bool {
        let goal = Goal::default();
        self.completed
            && self.task.final_position_mm < goal.position_mm
            && self.task.final_orientation_deg < goal.orientation_deg
    }
}
