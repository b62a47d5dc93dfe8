//! One cell of the matrix of faults and processes: its fault, and what became of the arm.

use serde::Serialize;

/// One cell of the matrix.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Cell {
    /// Name of the scenario.
    pub scenario: String,
    /// Process of the fault.
    pub process: String,
    /// Kind of the fault.
    pub kind: String,
    /// In which way, for the kinds that have several.
    #[serde(rename = "as", skip_serializing_if = "String::is_empty")]
    pub way: String,
    /// The injected fault, in words.
    pub faults: Vec<String>,
    /// Tick of the fault.
    pub at_tick: u64,
    /// Wall-clock time until the fault is detected.
    pub detected_ms: Option<f64>,
    /// Longest age of a torque in force, in ticks.
    pub stale_ticks: u32,
    /// The same in time; ms.
    pub stale_ms: f64,
    /// Largest torque over its limit.
    pub torque_max_ratio: f64,
    /// Largest joint speed over its limit.
    pub speed_max_ratio: f64,
    /// Largest change of applied torque in one tick.
    pub torque_step_max_ratio: f64,
    /// Largest distance in joint space from the path of the run without a fault.
    pub excursion_max_rad: f64,
    /// The same of the end-effector's position; mm.
    pub excursion_max_mm: f64,
    /// The most that is allowed of a joint's; rad.
    pub excursion_allowed_rad: f64,
    /// The most that is allowed of the end-effector's; mm.
    pub excursion_allowed_mm: f64,
    /// From the fault to the first tick of fresh torque after the drives had taken over, or to rest; null where they never had to.
    pub settled_ms: Option<f64>,
    /// The drives follow the controller again, or never had to stop.
    pub recovered: bool,
    /// Whether the goal was reached.
    pub goal_reached: bool,
    /// At rest, or held by the brakes, at the end.
    pub safe_stop: bool,
    /// Restarts.
    pub restarts: u32,
    /// Messages lost.
    pub messages_lost: u64,
    /// Whether the run of its saved plan gave the same bytes.
    pub replayed_identically: bool,
    /// Guarantees that were broken, in words.
    pub invariants_broken: Vec<String>,
    /// Files and processes left behind.
    pub left_behind: Vec<String>,
}
