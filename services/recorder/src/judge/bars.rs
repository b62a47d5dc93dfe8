//! The two bars of success, S1 and S2, which are the same for every scenario and law.

use shared_types::bounds::within;
use shared_types::scenario::Goal;
use shared_types::summary::{JointSummary, TaskSummary};

/// How long torques may be at their limit; s.
const SATURATED_S: f64 = 0.010;

/// Bounds on the error while the arm moves.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Orthogonal to the singular directions, mm.
    pub orthogonal_mm: f64,
    /// Orthogonal to the singular directions, °.
    pub orthogonal_deg: f64,
    /// Along the singular directions, mm.
    pub along_mm: f64,
    /// Along the singular directions, °.
    pub along_deg: f64,
}

impl Bounds {
    /// S1: those of a scenario that states none, and nothing along the singular directions.
    pub fn s1() -> Self {
        let Goal {
            orthogonal_mm,
            orthogonal_deg,
            ..
        } = Goal::default();
        Self {
            orthogonal_mm,
            orthogonal_deg,
            along_mm: f64::INFINITY,
            along_deg: f64::INFINITY,
        }
    }

    /// S2: for lines that are not along ζ.
    pub fn s2() -> Self {
        Self {
            orthogonal_deg: 3.0,
            along_mm: 10.0,
            along_deg: 5.0,
            ..Self::s1()
        }
    }

    fn holds_across(&self, task: &TaskSummary) -> bool {
        within(task.orthogonal_max_mm, self.orthogonal_mm)
            && within(task.orthogonal_max_deg, self.orthogonal_deg)
    }

    fn holds_along(&self, task: &TaskSummary) -> bool {
        within(task.along_max_mm, self.along_mm) && within(task.along_max_deg, self.along_deg)
    }
}

/// Writes S1, S2 and the conditions of S2 that failed into `task`. `is_over`, `is_done`: the run came to its end, and did what the segments ask beside
/// the pose; `dt_s`: length of a tick.
pub(super) fn judge(
    task: &mut TaskSummary,
    joints: &JointSummary,
    (is_over, is_done): (bool, bool),
    dt_s: f64,
) {
    let goal = Goal::default();
    let s1 = Bounds::s1();
    let s2 = Bounds::s2();
    let saturated_s = joints.saturated_ticks as f64 * dt_s;
    let is_at_goal = within(task.final_position_mm, goal.position_mm)
        && within(task.final_orientation_deg, goal.orientation_deg);
    let ends = [
        ("stopped", !is_over),
        ("task", !is_done),
        ("joint stop", joints.stopped_ticks > 0),
        ("end", !is_at_goal),
        ("beyond", task.beyond_ticks > 0),
        ("speed", !within(joints.speed_max_ratio, 1.0)),
        ("torque", saturated_s > SATURATED_S + 1e-9),
    ];
    let errors = [
        ("orthogonal", !s2.holds_across(task)),
        ("along", !s2.holds_along(task)),
    ];
    task.s1 = s1.holds_across(task) && ends.iter().all(|(_, failed)| !failed);
    task.missed = ends
        .iter()
        .chain(&errors)
        .filter(|(_, failed)| *failed)
        .map(|(what, _)| (*what).to_owned())
        .collect();
    task.s2 = task.missed.is_empty();
}
