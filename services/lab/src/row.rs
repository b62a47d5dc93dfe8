//! The result of a trial, one structure for every experiment.

use std::collections::BTreeMap;

use serde::Serialize;
use shared_types::scenario::{Goal, Strategy};
use shared_types::summary::{JointSummary, Summary, TaskSummary};

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
    /// The row of a run.
    pub fn of(law: Strategy, summary: Summary) -> Self {
        let singularities = summary.singularities.iter();
        let topics = summary.topics.into_iter().filter(|(_, one)| one.count > 0);
        Self {
            law: law.name().to_owned(),
            outcome: summary.outcome,
            reason: summary.reason,
            ticks: summary.ticks,
            completed: summary.completed,
            task: summary.task,
            joints: summary.joints,
            s_min: (singularities.clone().map(|one| one.s_min)).min_by(f64::total_cmp),
            inside_ticks: singularities.map(|one| one.inside_ticks).sum(),
            hash: topics.map(|(topic, one)| (topic, one.hash)).collect(),
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
        is_at_goal(self.completed, &self.task)
    }
}

/// Whether a run that was completed has reached the goal pose, by the bounds of a scenario that states none.
pub(crate) fn is_at_goal(completed: bool, task: &TaskSummary) -> bool {
    let goal = Goal::default();
    completed
        && task.final_position_mm <= goal.position_mm
        && task.final_orientation_deg <= goal.orientation_deg
}
