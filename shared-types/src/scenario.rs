//! A scenario, as TOML: robot, start posture, task, gains, noise, seed, judgement.
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

use crate::codes;
use crate::fault::{Fault, ScheduledFault};
use crate::file::{Complaint, InvalidFile};

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
    /// The layout that the recording opens with.
    #[serde(default)]
    pub view: View,
    /// The planned faults.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fault: Vec<Fault>,
    /// How the recording is kept.
    #[serde(default)]
    pub record: Record,
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
    /// Posture that the null space of a redundant arm is driven to meanwhile (the start posture where absent); degrees (mm for prismatic joints).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posture_deg: Option<Vec<f64>>,
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
    /// Whether links that are not neighbours, and clear of each other at the start, may collide.
    pub self_collision: bool,
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
            self_collision: false,
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
        Self { bandwidth: 150.0, disturbance_bandwidth: 0.0 }
    }
}

/// Singularity analysis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Analysis {
    /// Entry thresholds η_in on |s_i|.
    #[serde(deserialize_with = "BySingularity::eta_in")]
    pub eta_in: BySingularity,
    /// Exit thresholds η_out on |s_i|.
    #[serde(deserialize_with = "BySingularity::eta_out")]
    pub eta_out: BySingularity,
    /// Ignore the analytic factors even where the arm has them.
    pub numeric: bool,
}

impl Default for Analysis {
    fn default() -> Self {
        Self { eta_in: BySingularity::ETA_IN, eta_out: BySingularity::ETA_OUT, numeric: false }
    }
}

/// One number for each singularity, by its name.
///
/// A file gives the names it means, `{ wrist = 0.12 }`; the others keep their defaults. An array of three is read as elbow, wrist, overhead.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BySingularity {
    /// Of an elbow.
    pub elbow: f64,
    /// Of a wrist.
    pub wrist: f64,
    /// Of an overhead singularity.
    pub overhead: f64,
    /// Of any singularity that is found by number and has no name.
    pub numeric: f64,
}

impl BySingularity {
    const ETA_IN: Self = Self { elbow: 0.10, wrist: 0.10, overhead: 0.08, numeric: 0.10 };
    const ETA_OUT: Self = Self { elbow: 0.20, wrist: 0.20, overhead: 0.16, numeric: 0.20 };
    const RATE_MAX: Self = Self { elbow: 1.5, wrist: 3.0, overhead: 1.2, numeric: 1.5 };
    const SLEW: Self = Self { elbow: 20.0, wrist: 50.0, overhead: 12.0, numeric: 20.0 };

    /// The number for a singularity of this kind ([`codes::KINDS`](crate::codes::KINDS)).
    #[must_use]
    pub fn of(&self, kind: u32) -> f64 {
        match kind {
            codes::KIND_ELBOW => self.elbow,
            codes::KIND_WRIST => self.wrist,
            codes::KIND_OVERHEAD => self.overhead,
            _ => self.numeric,
        }
    }

    /// The numbers with their names.
    #[must_use]
    pub fn named(&self) -> [(&'static str, f64); 4] {
        [("elbow", self.elbow), ("wrist", self.wrist), ("overhead", self.overhead), ("numeric", self.numeric)]
    }

    /// The largest of them.
    #[must_use]
    pub fn largest(&self) -> f64 {
        self.named().iter().fold(0.0, |largest, (_, value)| value.max(largest))
    }

    fn eta_in<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::ETA_IN, from)
    }

    fn eta_out<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::ETA_OUT, from)
    }

    fn rate_max<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::RATE_MAX, from)
    }

    fn slew<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::over(Self::SLEW, from)
    }

    /// The file's values over the defaults.
    fn over<'de, D: serde::Deserializer<'de>>(default: Self, from: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Named {
            elbow: Option<f64>,
            wrist: Option<f64>,
            overhead: Option<f64>,
            numeric: Option<f64>,
        }
        struct Either(BySingularity);
        impl<'de> serde::de::Visitor<'de> for Either {
            type Value = BySingularity;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("numbers by the names elbow, wrist, overhead, numeric, or an array of the first three")
            }
            fn visit_map<A: serde::de::MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                let given = Named::deserialize(serde::de::value::MapAccessDeserializer::new(map))?;
                Ok(BySingularity {
                    elbow: given.elbow.unwrap_or(self.0.elbow),
                    wrist: given.wrist.unwrap_or(self.0.wrist),
                    overhead: given.overhead.unwrap_or(self.0.overhead),
                    numeric: given.numeric.unwrap_or(self.0.numeric),
                })
            }
            fn visit_seq<A: serde::de::SeqAccess<'de>>(self, seq: A) -> Result<Self::Value, A::Error> {
                let [elbow, wrist, overhead] = Deserialize::deserialize(serde::de::value::SeqAccessDeserializer::new(seq))?;
                Ok(BySingularity { elbow, wrist, overhead, numeric: self.0.numeric })
            }
        }
        from.deserialize_any(Either(default))
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
    /// Largest auxiliary rates; rad/s.
    #[serde(deserialize_with = "BySingularity::rate_max")]
    pub aux_rate_max: BySingularity,
    /// Largest changes of the auxiliary rates; rad/s².
    #[serde(deserialize_with = "BySingularity::slew")]
    pub aux_slew: BySingularity,
    /// Whether the governor may stretch time to respect limits.
    pub governor: bool,
    /// Whether the disturbance estimate is compensated.
    pub compensate_disturbance: bool,
    /// The tuning of the baselines.
    pub baseline: Baseline,
}

impl Default for Control {
    fn default() -> Self {
        Self {
            strategy: Strategy::Blended,
            k_p: 400.0,
            k_v: 40.0,
            k_aux: 12.0,
            aux_rate_max: BySingularity::RATE_MAX,
            aux_slew: BySingularity::SLEW,
            governor: true,
            compensate_disturbance: false,
            baseline: Baseline::default(),
        }
    }
}

/// Parameters of the baselines, each at the best found: `armplane compare sweep --tune` searches them again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Baseline {
    /// Of damped least squares.
    pub damped_least_squares: Damping,
    /// Of the inverse kinematics that joint-space PD follows.
    pub joint_pd: Damping,
    /// Truncated SVD drops directions with a smaller singular value (unit-scaled).
    pub truncated_svd_floor: f64,
    /// Of hold-and-blend.
    pub hold_and_blend: HoldAndBlend,
}

/// λ² = largest²·(1 − w/onset)² where the manipulability w (unit-scaled) is below the onset, else 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Damping {
    /// Manipulability below which damping begins.
    pub onset: f64,
    /// Largest λ.
    pub largest: f64,
}

/// See [`Baseline::hold_and_blend`]. Published defaults: blend = [0.006, 0.06], hold_k_p = 50, hold_k_v = 14, push = 0.01, push_k_v = 5.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HoldAndBlend {
    /// Singular value over the largest: below the first the joint strategy alone, above the second the task alone.
    pub blend: [f64; 2],
    /// Stiffness of holding the joints (Type 1); 1/s².
    pub hold_k_p: f64,
    /// Damping of holding the joints (Type 1); 1/s.
    pub hold_k_v: f64,
    /// Open-loop torque (Type 2), as a share of the joint's limit.
    pub push: f64,
    /// Damping of the open-loop torque's motion; 1/s.
    pub push_k_v: f64,
}

impl Default for Baseline {
    fn default() -> Self {
        Self {
            damped_least_squares: Damping { onset: 0.02, largest: 0.005 },
            joint_pd: Damping { onset: 0.16, largest: 0.01 },
            truncated_svd_floor: 0.005,
            hold_and_blend: HoldAndBlend::default(),
        }
    }
}

impl Default for HoldAndBlend {
    fn default() -> Self {
        Self { blend: [0.001, 0.004], hold_k_p: 50.0, hold_k_v: 14.0, push: 0.01, push_k_v: 5.0 }
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

impl Strategy {
    /// Every law, the default first.
    pub const ALL: [Self; 9] = [
        Self::Blended,
        Self::ChangKhatib,
        Self::OperationalSpace,
        Self::DampedLeastSquares,
        Self::TruncatedSvd,
        Self::HoldAndBlend,
        Self::JointPd,
        Self::PseudoInverse,
        Self::DynamicallyConsistent,
    ];

    /// Its name in scenario files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Blended => "blended",
            Self::ChangKhatib => "chang-khatib",
            Self::OperationalSpace => "operational-space",
            Self::DampedLeastSquares => "damped-least-squares",
            Self::TruncatedSvd => "truncated-svd",
            Self::HoldAndBlend => "hold-and-blend",
            Self::JointPd => "joint-pd",
            Self::PseudoInverse => "pseudo-inverse",
            Self::DynamicallyConsistent => "dynamically-consistent",
        }
    }
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
    /// How far the arm may leave the commanded path on purpose, to pass a singularity; mm.
    pub path_mm: f64,
    /// The same for orientation; degrees.
    pub path_deg: f64,
}

impl Default for Goal {
    fn default() -> Self {
        Self { position_mm: 1.0, orientation_deg: 0.5, orthogonal_mm: 1.0, orthogonal_deg: 0.5, path_mm: 1.0, path_deg: 0.5 }
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
        Self { part_s: 300.0, part_mb: 1000 }
    }
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

impl Scenario {
    /// Reads and validates a scenario, with `settings` (`key=value`) laid over it.
    ///
    /// # Errors
    /// [`InvalidFile`]: where, what, and what to do.
    pub fn parse(file: &str, text: &str, settings: &[String]) -> Result<Self, InvalidFile> {
        let scenario: Self = crate::file::parse(file, text, settings)?;
        scenario.check().map_err(|complaint| complaint.locate(file, text))?;
        Ok(scenario)
    }

    /// Time step; s.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        1.0 / f64::from(self.rate_hz)
    }

    /// Planned length of the task, settling included; s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.segment.iter().map(|segment| segment.duration_s).sum::<f64>() + self.settle_s
    }

    /// Ticks that the task is planned to take.
    #[must_use]
    pub fn planned_ticks(&self) -> u64 {
        (self.duration_s() * f64::from(self.rate_hz)).round() as u64
    }

    /// The checks that do not need the robot.
    pub(crate) fn check(&self) -> Result<(), Complaint> {
        let positive = |path: &str, value: f64| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(Complaint::new(path, format!("`{path}` is {value}"), "it must be a positive number"))
            }
        };
        if self.name.is_empty() || !self.name.chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c)) {
            return Err(Complaint::new("name", format!("`{}` cannot be a name", self.name), "letters, digits, `-`, `_` and `.`"));
        }
        if !(50..=20_000).contains(&self.rate_hz) {
            return Err(Complaint::new("rate_hz", format!("rate {} Hz is out of range", self.rate_hz), "50 to 20000"));
        }
        if !(0.0..=600.0).contains(&self.settle_s) {
            return Err(Complaint::new("settle_s", format!("`settle_s` is {}", self.settle_s), "0 to 600"));
        }
        self.start.check()?;
        if self.segment.is_empty() {
            return Err(Complaint::new("segment", "the task is empty", "add a [[segment]] with a duration_s"));
        }
        for (i, segment) in self.segment.iter().enumerate() {
            segment.check(i)?;
        }
        if self.duration_s() > 36_000.0 {
            return Err(Complaint::new("segment", format!("the task takes {} s", self.duration_s()), "10 hours at most"));
        }
        let plant = &self.plant;
        if !(1..=64).contains(&plant.substeps) {
            return Err(Complaint::new("plant.substeps", format!("{} sub-steps", plant.substeps), "1 to 64"));
        }
        if plant.encoder_bits != 0 && !(8..=32).contains(&plant.encoder_bits) {
            return Err(Complaint::new(
                "plant.encoder_bits",
                format!("an encoder of {} bits", plant.encoder_bits),
                "8 to 32, or 0 for an ideal one",
            ));
        }
        if !(0.0..=1e3).contains(&plant.encoder_noise_counts) {
            return Err(Complaint::new(
                "plant.encoder_noise_counts",
                format!("noise of {} counts", plant.encoder_noise_counts),
                "0 to 1000",
            ));
        }
        if !(0.1..=10.0).contains(&plant.mass_factor) {
            return Err(Complaint::new("plant.mass_factor", format!("a mass factor of {}", plant.mass_factor), "0.1 to 10"));
        }
        if plant.floor_m.is_some_and(|floor| !floor.is_finite()) {
            return Err(Complaint::new("plant.floor_m", "the floor's height is not a number", "metres in the base frame"));
        }
        positive("estimator.bandwidth", self.estimator.bandwidth)?;
        if !(0.0..=1e4).contains(&self.estimator.disturbance_bandwidth) {
            return Err(Complaint::new("estimator.disturbance_bandwidth", "out of range", "0 (off) to 10000 rad/s"));
        }
        for ((name, inner), (_, outer)) in self.analysis.eta_in.named().into_iter().zip(self.analysis.eta_out.named()) {
            if !(inner > 0.0 && outer > inner && outer < 1.0) {
                return Err(Complaint::new(
                    format!("analysis.eta_out.{name}"),
                    format!("η_in = {inner} and η_out = {outer} do not bound a neighbourhood"),
                    "0 < η_in < η_out < 1",
                ));
            }
        }
        positive("control.k_p", self.control.k_p)?;
        positive("control.k_v", self.control.k_v)?;
        positive("control.k_aux", self.control.k_aux)?;
        for (name, value) in self.control.aux_rate_max.named() {
            positive(&format!("control.aux_rate_max.{name}"), value)?;
        }
        for (name, value) in self.control.aux_slew.named() {
            positive(&format!("control.aux_slew.{name}"), value)?;
        }
        let Baseline { damped_least_squares, joint_pd, truncated_svd_floor, hold_and_blend } = &self.control.baseline;
        for (name, value) in [
            ("damped_least_squares.onset", damped_least_squares.onset),
            ("damped_least_squares.largest", damped_least_squares.largest),
            ("joint_pd.onset", joint_pd.onset),
            ("joint_pd.largest", joint_pd.largest),
            ("truncated_svd_floor", *truncated_svd_floor),
            ("hold_and_blend.blend.0", hold_and_blend.blend[0]),
            ("hold_and_blend.blend.1", hold_and_blend.blend[1] - hold_and_blend.blend[0]),
            ("hold_and_blend.hold_k_p", hold_and_blend.hold_k_p),
            ("hold_and_blend.hold_k_v", hold_and_blend.hold_k_v),
            ("hold_and_blend.push", hold_and_blend.push),
            ("hold_and_blend.push_k_v", hold_and_blend.push_k_v),
        ] {
            positive(&format!("control.baseline.{name}"), value)?;
        }
        positive("record.part_s", self.record.part_s)?;
        positive("record.part_mb", self.record.part_mb as f64)?;
        positive("goal.position_mm", self.goal.position_mm)?;
        positive("goal.orientation_deg", self.goal.orientation_deg)?;
        positive("goal.orthogonal_mm", self.goal.orthogonal_mm)?;
        positive("goal.orthogonal_deg", self.goal.orthogonal_deg)?;
        positive("goal.path_mm", self.goal.path_mm)?;
        positive("goal.path_deg", self.goal.path_deg)?;
        self.scheduled_faults(|_| Some(0)).map(drop)
    }

    /// Its faults in their fixed-size form; `index` gives a process's place in the manifest (`None`: it is not there).
    ///
    /// # Errors
    /// [`Complaint`]: a fault that makes no sense, or of a process that the graph does not have.
    pub fn scheduled_faults(&self, index: impl Fn(&str) -> Option<u32>) -> Result<Vec<ScheduledFault>, Complaint> {
        let scheduled = |(i, fault): (usize, &Fault)| {
            let place = index(&fault.process).ok_or_else(|| {
                Complaint::new("process", format!("the graph has no process `{}`", fault.process), "take the fault out, or the process in")
            });
            let seed = self.seed.wrapping_mul(0x0100_0000_01b3).wrapping_add(i as u64);
            place.and_then(|place| fault.schedule(place, self.rate_hz, seed)).map_err(|complaint| complaint.within(&format!("fault.{i}")))
        };
        self.fault.iter().enumerate().map(scheduled).collect()
    }
}

impl Start {
    fn check(&self) -> Result<(), Complaint> {
        let given = [self.q_deg.is_some(), self.q_rad.is_some(), self.posture.is_some()].iter().filter(|given| **given).count();
        if given != 1 {
            return Err(Complaint::new("start", format!("the start posture is given {given} times"), "give one of q_deg, q_rad, posture"));
        }
        for (name, values) in [("q_deg", &self.q_deg), ("q_rad", &self.q_rad)] {
            if let Some(i) = values.iter().flatten().position(|value| !value.is_finite()) {
                return Err(Complaint::new(format!("start.{name}.{i}"), "a joint position is not a number", "finite numbers"));
            }
        }
        Ok(())
    }
}

impl Segment {
    fn check(&self, i: usize) -> Result<(), Complaint> {
        let at = |key: &str| format!("segment.{i}.{key}");
        if !(self.duration_s.is_finite() && self.duration_s > 0.0) {
            return Err(Complaint::new(at("duration_s"), format!("the segment takes {} s", self.duration_s), "a positive time"));
        }
        let translations = [self.to_m.is_some(), self.by_m.is_some(), self.slide.is_some()].iter().filter(|given| **given).count();
        let rotations = [self.rotation.is_some(), self.quaternion.is_some(), self.turn.is_some()].iter().filter(|given| **given).count();
        if translations > 1 {
            return Err(Complaint::new(format!("segment.{i}"), "the goal position is given more than once", "one of to_m, by_m, slide"));
        }
        if rotations > 1 {
            return Err(Complaint::new(
                format!("segment.{i}"),
                "the goal rotation is given more than once",
                "one of rotation, quaternion, turn",
            ));
        }
        if let Some(reorient) = &self.reorient {
            if translations + rotations > 0 {
                return Err(Complaint::new(at("reorient"), "a segment cannot move and reorient at once", "split it into two segments"));
            }
            if !reorient.by_deg.is_finite() {
                return Err(Complaint::new(at("reorient.by_deg"), "the angle is not a number", "degrees"));
            }
        }
        for (key, position) in [("to_m", &self.to_m), ("by_m", &self.by_m)] {
            if position.iter().flatten().any(|x| !x.is_finite()) {
                return Err(Complaint::new(at(key), "the position is not a number", "three finite numbers, in metres"));
            }
        }
        if let Some(rows) = &self.rotation {
            let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let determinant = rows[0][0] * (rows[1][1] * rows[2][2] - rows[1][2] * rows[2][1])
                - rows[0][1] * (rows[1][0] * rows[2][2] - rows[1][2] * rows[2][0])
                + rows[0][2] * (rows[1][0] * rows[2][1] - rows[1][1] * rows[2][0]);
            let orthonormal = (0..3).all(|a| (0..3).all(|b| (dot(&rows[a], &rows[b]) - f64::from(u8::from(a == b))).abs() < 1e-6));
            if !orthonormal || determinant < 0.0 {
                return Err(Complaint::new(at("rotation"), "the matrix is not a rotation", "orthonormal rows, determinant +1, to 1e-6"));
            }
        }
        if let Some(quaternion) = &self.quaternion {
            let norm = quaternion.iter().map(|x| x * x).sum::<f64>();
            if (norm - 1.0).abs() > 1e-6 || norm.is_nan() {
                return Err(Complaint::new(
                    at("quaternion"),
                    format!("the quaternion's norm² is {norm}"),
                    "[w, x, y, z] with norm 1, to 1e-6",
                ));
            }
        }
        for (key, direction, amount) in [
            ("slide.along", self.slide.as_ref().map(|slide| &slide.along), self.slide.as_ref().map(|slide| slide.by_m)),
            ("turn.about", self.turn.as_ref().map(|turn| &turn.about), self.turn.as_ref().map(|turn| turn.by_deg)),
        ] {
            let Some(direction) = direction else { continue };
            let named = direction.strip_prefix("zeta:").map(|rest| rest.strip_suffix("@start").unwrap_or(rest));
            if !["x", "y", "z"].contains(&direction.as_str()) && named.is_none_or(str::is_empty) {
                return Err(Complaint::new(
                    at(key),
                    format!("`{direction}` is not a direction"),
                    "x, y, z, zeta:NAME or zeta:NAME@start, for example zeta:wrist@start",
                ));
            }
            if amount.is_some_and(|amount| !amount.is_finite()) {
                return Err(Complaint::new(at(key), "the amount is not a number", "by_m in metres, by_deg in degrees"));
            }
        }
        if !(-1..=1).contains(&self.branch) {
            return Err(Complaint::new(at("branch"), format!("there is no posture {}", self.branch), "-1, 0 (keep) or 1"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "name = \"x\"\nrobot = \"puma560\"\n[start]\nposture = \"ready\"\n[[segment]]\nduration_s = 1.0\n";

    #[test]
    fn wrong_values_are_refused_with_their_line() {
        let cases = [
            ("duration_s = 1.0", "duration_s = -1.0", "the segment takes -1 s", 6),
            ("duration_s = 1.0", "duration_s = 1.0\nturn = { about = \"zta\", by_deg = 1 }", "`zta` is not a direction", 7),
            ("duration_s = 1.0", "duration_s = 1.0\nquaternion = [1, 1, 0, 0]", "norm² is 2", 7),
            ("duration_s = 1.0", "duration_s = 1.0\nrotation = [[1,0,0],[0,1,0],[0,0,-1]]", "not a rotation", 7),
            ("duration_s = 1.0", "duration_s = 1.0\nto_m = [0,0,0]\nby_m = [0,0,0]", "given more than once", 5),
            ("posture = \"ready\"", "posture = \"ready\"\nq_rad = [0]", "given 2 times", 3),
            ("name = \"x\"", "name = \"x\"\nrate_hz = 1", "out of range", 2),
        ];
        for (right, wrong, expected, line) in cases {
            let error = Scenario::parse("a.toml", &TEXT.replacen(right, wrong, 1), &[]).unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
            assert_eq!(error.line(), Some(line), "{error}");
        }
    }

    #[test]
    fn a_law_is_called_what_its_file_says() {
        for strategy in Strategy::ALL {
            let named = Scenario::parse("a.toml", TEXT, &[format!("control.strategy={:?}", strategy.name())]).unwrap();
            assert_eq!(named.control.strategy, strategy);
        }
    }

    #[test]
    fn a_scenario_survives_being_written_and_read() {
        let scenario = Scenario::parse("a.toml", TEXT, &[]).unwrap();
        let text = toml::to_string(&scenario).unwrap();
        assert_eq!(Scenario::parse("b.toml", &text, &[]).unwrap(), scenario);
    }
}
