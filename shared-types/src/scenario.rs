//! What a run does, as TOML: robot, start posture, task, gains, noise, seed, judgement.
//!
//! ```toml
//! name = "fig5-wrist-rotation"
//! title = "Wrist lock: turn the singular direction, then rotate about it"
//! robot = "puma560"                    # a built-in name, or a URDF file beside this one
//!
//! [start]
//! q_deg = [20, -60, 170, 0, 0, 0]
//!
//! [[segment]]                          # ζ of the wrist turned by null-space motion, end-effector held
//! reorient = { singularity = "wrist", by_deg = 90 }
//! duration_s = 2.0
//!
//! [[segment]]                          # a straight line with geodesic rotation, quintic in time
//! turn = { about = "zeta:wrist@start", by_deg = 45 }
//! duration_s = 2.0
//! ```

use serde::{Deserialize, Serialize};

/// A validated scenario file. Every field but `name`, `robot`, `start` and `segment` has a default that works.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Short name, as given to `armplane run`.
    pub name: String,
    /// One line for people.
    #[serde(default)]
    pub title: String,
    /// A few sentences for people: what to look at.
    #[serde(default)]
    pub about: String,
    /// Built-in robot name, or a path to a URDF (with an optional description `.toml` beside it).
    pub robot: String,
    /// End-effector frame; the robot's default where empty.
    #[serde(default)]
    pub frame: String,
    /// Control rate; 1/s.
    #[serde(default = "rate_hz")]
    pub rate_hz: u32,
    /// Seed of every random number of the run.
    #[serde(default = "one")]
    pub seed: u64,
    /// Where the arm starts, at rest.
    pub start: Start,
    /// The task, in order.
    pub segment: Vec<Segment>,
    /// Time to hold the last pose before the run is judged; s.
    #[serde(default = "settle_s")]
    pub settle_s: f64,
    /// The simulated arm and its world.
    #[serde(default)]
    pub plant: Plant,
    /// The state estimator.
    #[serde(default)]
    pub estimator: Estimator,
    /// Singularity analysis.
    #[serde(default)]
    pub analysis: Analysis,
    /// The control law.
    #[serde(default)]
    pub control: Control,
    /// When the goal counts as reached.
    #[serde(default)]
    pub goal: Goal,
    /// What the recording shows first.
    #[serde(default)]
    pub view: View,
}

/// Start posture: exactly one of the fields.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Joint positions; degrees (mm for prismatic joints).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q_deg: Option<Vec<f64>>,
    /// Joint positions; rad (m for prismatic joints).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q_rad: Option<Vec<f64>>,
    /// A posture that the robot's description names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posture: Option<String>,
}

/// One piece of the task. At most one of `reorient` and (`to`, `by`, `turn`, `rotation`) families; none of them: hold.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// Duration; s.
    pub duration_s: f64,
    /// Goal position in B; m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to_m: Option<[f64; 3]>,
    /// Goal position relative to the segment's start, base axes; m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by_m: Option<[f64; 3]>,
    /// Goal position relative to the segment's start, along a named direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slide: Option<Slide>,
    /// Goal rotation in B, matrix rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[[f64; 3]; 3]>,
    /// Goal rotation in B, quaternion `[w, x, y, z]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quaternion: Option<[f64; 4]>,
    /// Goal rotation relative to the segment's start, about an axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn: Option<Turn>,
    /// Turn a singular direction by null-space motion, end-effector held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reorient: Option<Reorient>,
    /// Shape of the path between start and goal.
    #[serde(default)]
    pub path: Path,
    /// Which posture to leave a Type 1 singularity in: −1, +1, or 0 to keep the present one.
    #[serde(default)]
    pub branch: i32,
}

/// The shape of a segment's path in space; quintic in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Path {
    /// Straight line with geodesic rotation.
    #[default]
    Line,
    /// The same there and back again.
    ThereAndBack,
}

/// A translation along a named direction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slide {
    /// `"x"`, `"y"`, `"z"` (base), `"zeta:NAME@start"` (that singularity's ζ at the start of the run) or `"zeta:NAME"` (at the segment's start).
    pub along: String,
    /// Distance; m.
    pub by_m: f64,
}

/// A rotation about a named axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// As [`Slide::along`].
    pub about: String,
    /// Angle; degrees.
    pub by_deg: f64,
}

/// Turning a singular direction (Type 2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reorient {
    /// The singularity's name (`"wrist"`, `"overhead"`).
    pub singularity: String,
    /// Angle through which ζ turns; degrees. Its sign is a preference: the other way is taken where joint limits force it and the goal is the same line.
    pub by_deg: f64,
}

/// The simulated arm and its world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Plant {
    /// `"rapier"` (hybrid, with contact) or `"reference"` (exact integrator, no world).
    pub model: PlantModel,
    /// Sub-steps per tick.
    pub substeps: u32,
    /// Encoder resolution, bits per turn; 0: ideal.
    pub encoder_bits: u32,
    /// Standard deviation of encoder noise, in counts.
    pub encoder_noise_counts: f64,
    /// Whether the robot's own viscous and Coulomb friction acts.
    pub friction: bool,
    /// Factor on every mass and inertia of the simulated arm (the controller's model keeps the true ones).
    pub mass_factor: f64,
    /// Height of the floor in B; m. None: no floor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floor_m: Option<f64>,
    /// Ticks for which the drive holds the last torque before it stops the arm by itself.
    pub hold_ticks: u32,
}

/// See [`Plant::model`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlantModel {
    /// rapier3d for contact, limits and dry friction; exact Runge–Kutta for the smooth dynamics.
    #[default]
    Rapier,
    /// Runge–Kutta alone.
    Reference,
}

impl Default for Plant {
    fn default() -> Self {
        Self {
            model: PlantModel::Rapier,
            substeps: 4,
            encoder_bits: 16,
            encoder_noise_counts: 0.5,
            friction: false,
            mass_factor: 1.0,
            floor_m: Some(-0.67183),
            hold_ticks: 3,
        }
    }
}

/// The state estimator's tuning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Estimator {
    /// Bandwidth of the position/velocity observer; rad/s.
    pub bandwidth: f64,
    /// Bandwidth of the generalised-momentum disturbance observer; rad/s. 0: off.
    pub disturbance_bandwidth: f64,
}

impl Default for Estimator {
    fn default() -> Self {
        Self { bandwidth: 300.0, disturbance_bandwidth: 0.0 }
    }
}

/// Singularity analysis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Analysis {
    /// Entry thresholds on |s_i| for elbow, wrist, overhead.
    pub eta_in: [f64; 3],
    /// Exit thresholds.
    pub eta_out: [f64; 3],
    /// Ignore the analytic factors even where the arm has them.
    pub numeric: bool,
}

impl Default for Analysis {
    fn default() -> Self {
        Self { eta_in: [0.10, 0.10, 0.08], eta_out: [0.20, 0.20, 0.16], numeric: false }
    }
}

/// The control law and its gains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Control {
    /// Which law.
    pub strategy: Strategy,
    /// Task stiffness; 1/s².
    pub k_p: f64,
    /// Task damping; 1/s.
    pub k_v: f64,
    /// Auxiliary (null-space) position gain; 1/s.
    pub k_aux: f64,
    /// Auxiliary rate caps: elbow, wrist, overhead; rad/s.
    pub aux_rate_max: [f64; 3],
    /// Auxiliary slews; rad/s².
    pub aux_slew: [f64; 3],
    /// Whether the governor may stretch time to respect limits.
    pub governor: bool,
    /// Whether the disturbance estimate is compensated.
    pub compensate_disturbance: bool,
}

impl Default for Control {
    fn default() -> Self {
        Self {
            strategy: Strategy::Blended,
            k_p: 400.0,
            k_v: 40.0,
            k_aux: 12.0,
            aux_rate_max: [1.5, 3.0, 1.2],
            aux_slew: [20.0, 50.0, 12.0],
            governor: true,
            compensate_disturbance: false,
        }
    }
}

/// The control laws that can be compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Strategy {
    /// The paper's law as one continuous solve (the default).
    #[default]
    Blended,
    /// The paper's own hard switching at η.
    ChangKhatib,
    /// Operational space control that ignores singularities.
    OperationalSpace,
    /// Damped least squares (Nakamura & Hanafusa 1986).
    DampedLeastSquares,
    /// Truncated singular value decomposition.
    TruncatedSvd,
    /// Hold-and-blend, as published for Stanford's SAI.
    HoldAndBlend,
    /// Joint-space PD on inverse kinematics.
    JointPd,
    /// Posture control in the null space of the pseudo-inverse (Fig. 1).
    PseudoInverse,
    /// The same in the dynamically consistent null space (Fig. 2).
    DynamicallyConsistent,
}

/// When the goal counts as reached, judged on the simulator's truth at the end.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Goal {
    /// Final position error; mm.
    pub position_mm: f64,
    /// Final orientation error; degrees.
    pub orientation_deg: f64,
    /// Largest error across the singular directions while moving; mm.
    pub orthogonal_mm: f64,
    /// The same for orientation; degrees.
    pub orthogonal_deg: f64,
}

impl Default for Goal {
    fn default() -> Self {
        Self { position_mm: 1.0, orientation_deg: 0.5, orthogonal_mm: 1.0, orthogonal_deg: 0.5 }
    }
}

/// What the recording shows first.
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

fn rate_hz() -> u32 {
    1000
}
fn one() -> u64 {
    1
}
fn settle_s() -> f64 {
    0.5
}
