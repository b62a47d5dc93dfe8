//! The numbers of a run: THE list of what is recorded, drawn, exported and read back. PURE.
//!
//! One wide table, one row per tick: every chunk of a file carries the whole schema of its entity, so few wide entities are cheap
//! where many narrow ones are not. Positions are f64, as they came; the rest is f32, 7 digits, which halves the file.

use model::Robot;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use shared_types::codes::FRAME_HAND;
use shared_types::event::Event;
use shared_types::graph::Graph;
use shared_types::messages::SingularityState;
use shared_types::scenario::{Force, Scenario};
use shared_types::topics::{ByTopic, CHAIN, Lent};
use shared_types::wire::Stamps;
use shared_types::{ControlState, MAX_DOF, SingularityReport};

/// The messages of one tick, as a recorder has them; in real time some may be missing.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TickRow<'a> {
    /// The tick they belong to.
    pub(crate) tick: u64,
    /// Those that have come.
    pub(crate) messages: ByTopic<Lent<'a>>,
    /// The events noted at it.
    pub(crate) events: &'a [Event],
}

impl<'a> std::ops::Deref for TickRow<'a> {
    type Target = ByTopic<Lent<'a>>;

    fn deref(&self) -> &ByTopic<Lent<'a>> {
        &self.messages
    }
}

impl<'a> TickRow<'a> {
    /// These messages of a tick.
    #[cfg(test)]
    pub(crate) fn new(tick: u64, messages: ByTopic<Lent<'a>>) -> Self {
        Self {
            tick,
            messages,
            events: &[],
        }
    }

    /// Joint positions, rad: the simulator's, else the estimator's.
    pub(crate) fn q(&self) -> Option<&'a [f64; MAX_DOF]> {
        let estimated = || self.messages.estimate.map(|estimate| &estimate.q);
        self.plant_state.map(|state| &state.q).or_else(estimated)
    }

    /// Joint velocities, rad/s: the simulator's, else the estimator's.
    fn qdot(&self) -> Option<&'a [f64; MAX_DOF]> {
        let estimated = || self.messages.estimate.map(|estimate| &estimate.qdot);
        self.plant_state.map(|state| &state.qdot).or_else(estimated)
    }

    /// The singularities reported.
    pub(crate) fn singularities(&self) -> &'a [SingularityState] {
        self.singularity.map_or(&[], SingularityReport::listed)
    }

    /// Stamps of as many hops as the data has passed.
    fn stamps(&self) -> Option<&'a Stamps> {
        let last = self.torque.map(|m| &m.header);
        let last = last.or(self.singularity.map(|m| &m.header));
        let last = last.or(self.estimate.map(|m| &m.header));
        let last = last.or(self.sensor.map(|m| &m.header));
        last.map(|header| &header.stamps)
    }
}

/// How a signal is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kept {
    /// At the control rate, with 64 bits.
    F64,
    /// At the control rate, with 32 bits.
    F32,
    /// The same, with the first four digits: what is left packs better.
    Short,
    /// At the control rate as its logarithm to base 10, in steps of 1 / [`SHARES`], because plots have no logarithmic axis. A value that is not
    /// above [`LEAST`] counts as 0.
    Log(&'static str),
    /// With 32 bits, at the lower rate of what is drawn; held between when it is read back.
    Slow,
    /// At the lower rate in steps of 1 / [`SHARES`], which repeat themselves and pack well: for plots only.
    Drawn,
    /// Not at all: only in tables and reports.
    Table,
}

/// The least value of a [`Kept::Log`]; in the signal's unit.
const LEAST: f64 = 1e-6;
/// Steps of what is drawn to one, and of logarithms to a power of ten.
const SHARES: f64 = 2048.0;
/// The least error that a plot shows; mm, degrees.
const FAINTEST: f64 = 1e-4;
/// The least [`Signal::Nearness`]: what is exactly singular.
const NEAREST: f64 = -3.0;

/// The logarithm that a [`Kept::Log`] records: in steps of 1 / [`SHARES`], a tenth of a percent of the value.
pub(crate) fn logarithm(value: f64) -> f32 {
    // In 32 bits, as it is written: their seven digits are finer than the steps by a factor of a thousand.
    share(f64::from((value.max(LEAST) as f32).log10()))
}

/// A number in steps of 1 / [`SHARES`].
pub(crate) fn share(value: f64) -> f32 {
    // A number of this size has no digits behind the point, so what is added to it is rounded: without a call for each of the numbers of a tick.
    const WHOLE: f64 = 1.5 * (1_u64 << 52) as f64;
    ((value * SHARES + WHOLE - WHOLE) / SHARES) as f32
}

/// With the first 12 bits of its 24.
pub(crate) fn short(value: f64) -> f32 {
    f32::from_bits(((value as f32).to_bits() + 0x800) & !0xfff)
}

/// The elements of a row of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Elements {
    One,
    /// One of each joint: metres for rad where it slides.
    Joints,
    /// At most six.
    Sigmas,
    Singularities,
    /// Six of each singularity: a unit vector of twists.
    Directions,
    /// A unit quaternion, whose sign an export keeps continuous.
    Quaternion,
    Hops,
    Named(&'static [&'static str]),
}

const XYZ: Elements = Elements::Named(&["x", "y", "z"]);
const PARTS: Elements = Elements::Named(&["orthogonal", "along"]);
const PRESSED: Elements = Elements::Named(&["desired", "contact"]);
const SCALES: Elements = Elements::Named(&["time", "task", "null"]);

/// A row of the list.
pub(crate) struct Quantity {
    /// `group:quantity`.
    pub(crate) name: &'static str,
    /// As UDUNITS and pint read it; `1` for what has none.
    pub(crate) unit: &'static str,
    pub(crate) kept: Kept,
    pub(crate) elements: Elements,
    about: &'static str,
    /// Appends its values at a tick; nothing where its message is missing.
    pub(crate) take: fn(&Now, &mut Vec<f64>),
}

/// A tick, with what its numbers are computed from.
#[derive(Clone, Copy)]
pub(crate) struct Now<'a, 'm> {
    pub(crate) row: &'a TickRow<'m>,
    pub(crate) limits: &'a Limits,
    pub(crate) hops: Option<ChainHops>,
    /// Torques that carry the arm; N·m.
    pub(crate) gravity: &'a [f64],
    /// Singular values of the unit-scaled Jacobian.
    pub(crate) sigma: Option<[f64; 6]>,
    pub(crate) is_faulty: bool,
}

impl<'a, 'm> Now<'a, 'm> {
    pub(crate) fn new(row: &'a TickRow<'m>, limits: &'a Limits, hops: Option<ChainHops>) -> Self {
        Self {
            row,
            limits,
            hops,
            gravity: &[0.0; MAX_DOF],
            sigma: None,
            is_faulty: false,
        }
    }

    /// Of as many as there are joints.
    fn joints<'v>(&self, values: &'v [f64]) -> impl Iterator<Item = f64> + use<'v> {
        values[..self.limits.speed.len()].iter().copied()
    }

    /// Joint positions between their limits.
    fn in_range(&self) -> Option<impl Iterator<Item = f64> + use<'a, 'm>> {
        let (q, limits) = (self.row.q()?, self.limits);
        let ranges = limits.centre.iter().zip(&limits.half_range);
        Some(
            q.iter()
                .zip(ranges)
                .map(|(q, (centre, half))| (q - centre) / half),
        )
    }

    /// Over the limits, whatever they are.
    fn ratios<'v>(
        &self,
        limits: &'v [f64],
        values: &'v [f64],
    ) -> impl Iterator<Item = f64> + use<'v> {
        values
            .iter()
            .zip(limits)
            .map(|(value, limit)| value / limit)
    }

    /// Over the limits, where each joint has one: all joints have one unit.
    fn over(&self, limits: &'a [f64], values: impl Fn(usize) -> f64) -> impl Iterator<Item = f64> {
        let is_limited = limits.iter().all(|limit| limit.is_finite());
        (0..limits.len()).map(move |i| values(i) / if is_limited { limits[i] } else { 1.0 })
    }

    /// A number of each singularity, where there is a report.
    fn each<T>(
        &self,
        value: fn(&'m SingularityState) -> T,
    ) -> Option<impl Iterator<Item = T> + use<'m, T>> {
        let all = self.row.singularities();
        self.row.singularity.map(|_| all.iter().map(value))
    }

    /// A number of each singularity in the command.
    fn command(
        &self,
        values: fn(&'m ControlState) -> &'m [f64],
    ) -> Option<impl Iterator<Item = f64> + use<'m>> {
        let count = self.row.singularities().len();
        let command = self.row.control_state;
        command.map(|m| values(m)[..count].iter().copied())
    }

    /// The force that the present segment asks for, or the target.
    fn force(&self) -> Option<Pressed> {
        if let Some(message) = self.row.target {
            let force = Vector3::from(message.target.force);
            return Some(Pressed {
                newtons: force.norm(),
                axis: force.try_normalize(0.0)?,
                is_of_tool: message.target.force_frame == FRAME_HAND,
            });
        }
        let command = self.row.control_state?;
        *self.limits.forces.get(command.segment as usize)?
    }

    /// That force along its axis, [set-point, true contact]; N.
    pub(crate) fn pressed(&self) -> Option<[f64; 2]> {
        let (m, force) = (self.row.plant_state?, self.force()?);
        let e = match force.is_of_tool {
            true => Matrix3::from_column_slice(&m.R_BE) * force.axis,
            false => force.axis,
        };
        let contact = -e.dot(&Vector3::from(m.contact_force_n));
        Some([force.newtons, contact])
    }

    /// The norms of an error orthogonal to the singular directions that the arm is inside of, and along them; base axes.
    pub(crate) fn error(&self, angular: u32) -> Option<[f64; 2]> {
        let (m, command) = (self.row.plant_state?, self.row.control_state?);
        let e = if angular == 1 {
            let R_d = Matrix3::from_column_slice(&command.R_BE_d);
            model::rotation_log(&(R_d * Matrix3::from_column_slice(&m.R_BE).transpose()))
        } else {
            Vector3::from(command.p_BE_d) - Vector3::from(m.p_BE)
        };
        let inside = self.row.singularities().iter();
        let inside = inside.filter(|one| one.inside == 1 && one.angular == angular);
        let zeta = |one: &SingularityState| {
            Vector3::from_column_slice(&one.zeta_B[3 * angular as usize..][..3])
        };
        Some(split(e, inside.map(zeta)))
    }
}

/// The values of a tick, or of the message that a column is of.
macro_rules! taken {
    (|$t:ident| $take:expr) => {
        |$t, out| {
            if let Some(values) = $take {
                out.extend(values)
            }
        }
    };
    ($source:ident |$t:ident, $m:ident| $take:expr) => {
        |$t, out| {
            if let Some($m) = $t.row.$source {
                out.extend($take)
            }
        }
    };
}

macro_rules! signals {
    ($( $(#[doc = $doc:literal])* $name:ident $text:literal $unit:literal $kept:expr, $elements:expr, $($source:ident)? |$t:ident $(, $m:ident)?| $take:expr; )*) => {
        /// The columns of a recording and of its exports. Each row of a column is a list: one number per joint, per singularity, per hop, or as stated.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Signal { $( $(#[doc = $doc])* $name ),* }

        impl Signal {
            /// All of them, in column order.
            pub const ALL: &[Signal] = &[ $( Signal::$name ),* ];
        }

        const TABLE: &[Quantity] = &[ $( Quantity {
            name: $text,
            unit: $unit,
            kept: $kept,
            elements: $elements,
            about: concat!($($doc),*),
            take: taken!($($source)? |$t $(, $m)?| $take),
        } ),* ];
    };
}

use Elements::{Directions, Hops, Joints, One, Quaternion, Sigmas, Singularities};
use Kept::{Drawn, F32, F64, Log, Short, Slow, Table};

signals! {
    /// Joint positions; rad.
    Position "joint:q" "rad" F64, Joints, |t| t.row.q().map(|q| t.joints(q));
    /// Joint positions between their limits: −1 lower, 1 upper; q/π for a joint without limits
    PositionInRange "joint:q_in_range" "1" Table, Joints, |t| t.in_range();
    /// Joint velocities; rad/s.
    Speed "joint:qdot" "rad/s" F32, Joints, |t| t.row.qdot().map(|qdot| t.joints(qdot));
    /// Joint velocities over their limits
    SpeedRatio "joint:qdot_ratio" "1" Table, Joints, |t| t.row.qdot().map(|qdot| t.ratios(&t.limits.speed, qdot));
    /// Torques that act at the end-effector, J_rᵀF_r and compensation; N·m.
    TorqueTask "torque:task" "N*m" F32, Joints, control_state |t, m| t.joints(&m.tau_task);
    /// Torques that act in the null space, N_T Γ₀; N·m.
    TorqueNull "torque:null" "N*m" F32, Joints, control_state |t, m| t.joints(&m.tau_null);
    /// Torques that act at the end-effector over the joints' limits
    TorqueTaskRatio "torque:task_ratio" "1" Table, Joints, control_state |t, m| t.ratios(&t.limits.torque, &m.tau_task);
    /// Torques that act in the null space over the joints' limits
    TorqueNullRatio "torque:null_ratio" "1" Table, Joints, control_state |t, m| t.ratios(&t.limits.torque, &m.tau_null);
    /// s_i(q) of each singularity; dimensionless.
    Measure "singularity:s" "1" F32, Singularities, |t| t.each(|one| one.s);
    /// Auxiliary coordinate of each singularity; rad.
    Auxiliary "singularity:aux" "rad" F32, Singularities, |t| t.each(|one| one.aux);
    /// Reference of the auxiliary coordinate; rad.
    AuxiliaryReference "singularity:aux_d" "rad" Slow, Singularities, |t| t.command(|m| &m.aux_d);
    /// β_i of each singularity: 1 full operational control, 0 null-space control.
    Beta "singularity:beta" "1" Slow, Singularities, |t| t.command(|m| &m.beta);
    /// Singular values of the unit-scaled Jacobian in the estimated posture.
    SingularValues "jacobian:sigma" "1" Slow, Sigmas, |t| t.sigma.map(|sigma| sigma.into_iter().take(t.limits.speed.len()));
    /// True position error [orthogonal to, along] the singular directions the arm is inside of; mm.
    PositionError "error:position_mm" "mm" Short, PARTS, |t| t.error(0).map(|e| e.map(|m| 1e3 * m));
    /// True orientation error [orthogonal to, along] the singular directions the arm is inside of; degrees.
    OrientationError "error:orientation_deg" "deg" Short, PARTS, |t| t.error(1).map(|e| e.map(f64::to_degrees));
    /// [time scale, task scale, null scale]: what governor and limits let through, 0 to 1.
    Scale "control:scale" "1" Slow, SCALES, control_state |t, m| [m.time_scale, m.task_scale, m.null_scale];
    /// Contact force on the arm; N.
    Contact "world:contact_force_n" "N" F32, One, plant_state |t, m| [Vector3::from(m.contact_force_n).norm()];
    /// Time of each hop and of the whole chain, in the order of [`hop_names`]; µs.
    Latency "latency:us" "us" Log("latency:log10_us"), Hops, |t| hops_us(t.row.stamps(), t.hops);

    /// log₁₀(|s_i| / η_i): below 0 inside the neighbourhood.
    Nearness "drawn:nearness" "1" Drawn, Singularities, |t| t.each(|one| (one.s.abs() / one.eta_in.max(1e-9)).max(1e-9).log10().max(NEAREST));
    /// log₁₀ of the position error; mm.
    DrawnPositionError "drawn:position_error_log10" "1" Drawn, PARTS, |t| t.error(0).map(|e| e.map(|m| (1e3 * m).max(FAINTEST).log10()));
    /// log₁₀ of the orientation error; degrees.
    DrawnOrientationError "drawn:orientation_error_log10" "1" Drawn, PARTS, |t| t.error(1).map(|e| e.map(|w| w.to_degrees().max(FAINTEST).log10()));
    /// Joint positions between their limits.
    DrawnPosition "drawn:q_in_range" "1" Drawn, Joints, |t| t.in_range();
    /// Joint velocities over their limits; rad/s where a joint has none.
    DrawnSpeed "drawn:qdot_ratio" "1" Drawn, Joints, |t| t.row.qdot().map(|qdot| t.over(&t.limits.speed, move |i| qdot[i]));
    /// Torques that act at the end-effector, without gravity's, over the limits; N·m where a joint has none.
    DrawnHand "drawn:torque_hand" "1" Drawn, Joints, control_state |t, m| t.over(&t.limits.torque, move |i| m.tau_task[i] - t.gravity[i]);
    /// Torques that carry the arm's weight; the same.
    DrawnGravity "drawn:torque_gravity" "1" Drawn, Joints, control_state |t, _m| t.over(&t.limits.torque, move |i| t.gravity[i]);
    /// Torques in the null space; the same.
    DrawnNull "drawn:torque_null" "1" Drawn, Joints, control_state |t, m| t.over(&t.limits.torque, move |i| m.tau_null[i]);
    /// 0 while a fault is in force, nothing else: a bar in the plots of a run with planned faults.
    Fault "drawn:fault" "1" Drawn, One, |t| t.is_faulty.then_some([0.0]);

    /// Joint positions as the encoders read them
    Encoder "joint:q_encoder" "rad" Table, Joints, sensor |t, m| t.joints(&m.q_encoder);
    /// Estimated joint positions
    Estimate "joint:q_estimate" "rad" Table, Joints, estimate |t, m| t.joints(&m.q);
    /// Estimated joint velocities
    SpeedEstimate "joint:qdot_estimate" "rad/s" Table, Joints, estimate |t, m| t.joints(&m.qdot);
    /// Torques that the controller commands
    Commanded "torque:commanded" "N*m" Table, Joints, torque |t, m| t.joints(&m.tau);
    /// Torques that the drives applied over the tick before
    Applied "torque:applied" "N*m" Table, Joints, plant_state |t, m| t.joints(&m.tau);
    /// Torques over the tick before as the drives report them
    Reported "torque:drive" "N*m" Table, Joints, sensor |t, m| t.joints(&m.tau_drive);
    /// Torques that the model does not explain, as they act on the joints
    Disturbance "torque:disturbance" "N*m" Table, Joints, estimate |t, m| t.joints(&m.tau_disturbance);
    /// True position of the end-effector; base axes
    Hand "hand:position" "m" Table, XYZ, plant_state |t, m| m.p_BE;
    /// True rotation of the end-effector in the base frame, a unit quaternion of continuous sign
    HandRotation "hand:orientation" "1" Table, Quaternion, plant_state |t, m| quaternion(&m.R_BE);
    /// True velocity of the end-effector; base axes
    HandVelocity "hand:velocity" "m/s" Table, XYZ, plant_state |t, m| halves(&m.V_BE)[0];
    /// True angular velocity of the end-effector; base axes
    HandTurn "hand:angular_velocity" "rad/s" Table, XYZ, plant_state |t, m| halves(&m.V_BE)[1];
    /// Desired position of the end-effector; base axes
    Desired "desired:position" "m" Table, XYZ, control_state |t, m| m.p_BE_d;
    /// Desired rotation of the end-effector in the base frame, a unit quaternion of continuous sign
    DesiredRotation "desired:orientation" "1" Table, Quaternion, control_state |t, m| quaternion(&m.R_BE_d);
    /// Desired velocity of the end-effector; base axes
    DesiredVelocity "desired:velocity" "m/s" Table, XYZ, control_state |t, m| halves(&m.V_BE_d)[0];
    /// Desired angular velocity of the end-effector; base axes
    DesiredTurn "desired:angular_velocity" "rad/s" Table, XYZ, control_state |t, m| halves(&m.V_BE_d)[1];
    /// Sum of the contact forces on the arm; base axes
    ContactForce "world:contact_force_vector" "N" Table, XYZ, plant_state |t, m| m.contact_force_n;
    /// Force of the surroundings on the hand as the wrist's sensor measures it; base axes
    Felt "force:measured" "N" Table, XYZ, wrist_force |t, m| m.force_n;
    /// Their moment about the end-effector; base axes
    Twisted "force:moment" "N·m" Table, XYZ, wrist_force |t, m| m.torque_nm;
    /// Force of the segment along its axis: set-point, and true contact
    Pressed "force:along_axis" "N" Table, PRESSED, |t| t.pressed();
    /// 1 inside the neighbourhood of the singularity, else 0
    Inside "singularity:inside" "1" Table, Singularities, |t| t.each(|one| f64::from(one.inside));
    /// Singular direction at the wrist centre: a unit vector, a translation (v) or a rotation (w); base axes
    Zeta "singularity:zeta" "1" Table, Directions, |t| t.each(|one| one.zeta_B).map(Iterator::flatten);
    /// Position of the end-effector that the target asks for; of a twist that of the reference; base axes
    Asked "servo:position" "m" Table, XYZ, servo_state |t, m| m.p_target;
    /// Velocity that the target asks for, before any limit; base axes
    AskedVelocity "servo:velocity" "m/s" Table, XYZ, servo_state |t, m| halves(&m.V_target)[0];
    /// Angular velocity that the target asks for, before any limit; base axes
    AskedTurn "servo:angular_velocity" "rad/s" Table, XYZ, servo_state |t, m| halves(&m.V_target)[1];
    /// Twist of the reference over the one asked for
    SpeedShare "servo:speed_share" "1" Table, One, servo_state |t, m| [m.speed_scale];
    /// Distance that reach and limits have taken away since the target began
    Behind "servo:behind" "m" Table, One, servo_state |t, m| [m.behind_m];
    /// Age of the target
    Age "servo:age" "s" Table, One, servo_state |t, m| [m.age_s];
    /// Why the arm follows so and not faster: a code of REASONS (shared-types/src/codes.rs)
    Reason "servo:reason" "1" Table, One, servo_state |t, m| [f64::from(m.reason)];
    /// The joint in the reason, from 1; negative at its lower limit; 0 for none
    Joint "servo:joint" "1" Table, One, servo_state |t, m| [f64::from(m.joint) * if m.upper > 0 || m.joint == 0 { 1.0 } else { -1.0 }];
    /// The nearest singularity, from 1 in the order of the report; 0 for none
    Nearest "servo:singularity" "1" Table, One, servo_state |t, m| [f64::from(m.singularity)];
    /// Its |s| over its outer bound: below 1 the law acts on it
    NearestMeasure "servo:nearest" "1" Table, One, servo_state |t, m| [m.nearest];
    /// Targets refused since the start of the run
    Refused "servo:refused" "1" Table, One, servo_state |t, m| [f64::from(m.refused)];
}

/// `[x, y, z, w]` of a rotation matrix, column-major.
fn quaternion(R: &[f64; 9]) -> [f64; 4] {
    let R = Rotation3::from_matrix_unchecked(Matrix3::from_column_slice(R));
    UnitQuaternion::from_rotation_matrix(&R).coords.into()
}

/// The linear and the angular half of a twist.
pub(crate) fn halves<T: Copy>([a, b, c, d, e, f]: &[T; 6]) -> [[T; 3]; 2] {
    [[*a, *b, *c], [*d, *e, *f]]
}

impl Signal {
    pub(crate) fn of(self) -> &'static Quantity {
        &TABLE[self as usize]
    }

    /// The column's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.of().name
    }

    /// Its quantity and unit.
    #[must_use]
    pub fn about(self) -> &'static str {
        self.of().about.trim()
    }

    /// The name of what is recorded of it.
    pub(crate) fn component(self) -> &'static str {
        match self.of().kept {
            Log(name) => name,
            _ => self.name(),
        }
    }

    /// Those in a recording, but for what is only drawn.
    pub(crate) fn recorded() -> impl Iterator<Item = Self> {
        let all = Self::ALL.iter().copied();
        all.filter(|signal| !matches!(signal.of().kept, Drawn | Table))
    }

    /// The names of the elements of a row of this signal, where there are so many joints and singularities of these names; one unnamed element
    /// is a plain number.
    #[must_use]
    pub fn elements(self, joints: usize, singularities: &[String]) -> Vec<String> {
        let named = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let parts = |name: &String| {
            ["vx", "vy", "vz", "wx", "wy", "wz"].map(|part| format!("{name}.{part}"))
        };
        match self.of().elements {
            One => named(&[""]),
            Joints => (1..=joints).map(|i| i.to_string()).collect(),
            Sigmas => (1..=joints.min(6)).map(|i| i.to_string()).collect(),
            Singularities => singularities.to_vec(),
            Directions => singularities.iter().flat_map(parts).collect(),
            Quaternion => named(&["x", "y", "z", "w"]),
            Hops => hop_names().to_vec(),
            Elements::Named(names) => named(names),
        }
    }
}

/// Hops and steps between the first and the last topic of [`CHAIN`], and the whole.
const HOPS: usize = 2 * CHAIN.len() - 1;

/// The parts of [`Signal::Latency`], named by topic: a process may have any name. `hop sensor`: from the sending of `sensor` until the writer of
/// the chain's next topic has received it; `step estimate`: from there until `estimate` is sent. The last is the whole chain's.
pub(crate) fn hop_names() -> [String; HOPS] {
    std::array::from_fn(|part| match (part / 2, part % 2) {
        (link, _) if link + 1 == CHAIN.len() => format!("{} to {}", CHAIN[0], CHAIN[link]),
        (link, 0) => format!("hop {}", CHAIN[link]),
        (link, _) => format!("step {}", CHAIN[link + 1]),
    })
}

/// The places in the stamps of the writers of [`CHAIN`]'s topics: the chain that [`hop_names`] describes.
pub(crate) type ChainHops = [usize; CHAIN.len()];

/// The chain's places in a graph; `None` where a topic of the chain has no writer.
pub(crate) fn chain_hops(graph: &Graph) -> Option<ChainHops> {
    let hops = graph.hops();
    let place = |topic| {
        hops.iter()
            .position(|hop| hop.writes.iter().any(|one| one == topic))
    };
    let [sensor, estimate, singularity, torque] = CHAIN.map(place);
    Some([sensor?, estimate?, singularity?, torque?])
}

/// Times of the hops, µs; `None` where the data has not passed them all or clocks ran backwards.
fn hops_us(stamps: Option<&Stamps>, hops: Option<ChainHops>) -> Option<[f64; HOPS]> {
    let (stamps, hops) = (stamps?, hops?);
    let received = hops.map(|hop| stamps.received_ns[hop]);
    let sent = hops.map(|hop| stamps.sent_ns[hop]);
    let span = |from: u64, to: u64| Some(to.checked_sub(from).filter(|_| from > 0)? as f64 * 1e-3);
    let mut times = [0.0; HOPS];
    for (part, time) in times.iter_mut().enumerate() {
        *time = match (part / 2, part % 2) {
            (link, _) if link + 1 == CHAIN.len() => span(sent[0], sent[link])?,
            (link, 0) => span(sent[link], received[link + 1])?,
            (link, _) => span(received[link + 1], sent[link + 1])?,
        };
    }
    Some(times)
}

/// A force that a segment or a target asks for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pressed {
    /// Set-point, N.
    newtons: f64,
    /// A unit vector, in the hand's axes or the base's.
    axis: Vector3<f64>,
    is_of_tool: bool,
}

/// The constants of a run that its numbers need: limits that make ratios of joint quantities, and forces.
#[derive(Clone, Debug, Default)]
pub(crate) struct Limits {
    /// By segment; empty of a run that presses on nothing. A steered run has one place, for its targets.
    pub(crate) forces: Vec<Option<Pressed>>,
    pub(crate) centre: Vec<f64>,
    pub(crate) half_range: Vec<f64>,
    pub(crate) speed: Vec<f64>,
    pub(crate) torque: Vec<f64>,
}

impl Limits {
    pub(crate) fn new(robot: &Robot) -> Self {
        let of = |value: fn(&model::Joint) -> f64| robot.joints.iter().map(value).collect();
        let has_range = |joint: &model::Joint| (joint.upper - joint.lower).is_finite();
        let (centre, half_range) = robot
            .joints
            .iter()
            .map(|joint| match has_range(joint) {
                true => (
                    0.5 * (joint.lower + joint.upper),
                    0.5 * (joint.upper - joint.lower),
                ),
                false => (0.0, std::f64::consts::PI),
            })
            .unzip();
        Self {
            forces: Vec::new(),
            centre,
            half_range,
            speed: of(|joint| joint.velocity),
            torque: of(|joint| joint.effort),
        }
    }

    /// The same, and the forces of a scenario.
    pub(crate) fn with_forces(self, scenario: &Scenario) -> Self {
        let pressed = |force: &Force| {
            let (axis, is_of_tool) = force.direction()?;
            Some(Pressed {
                newtons: force.newtons,
                axis: axis.into(),
                is_of_tool,
            })
        };
        let segments = scenario.segment.iter().filter(|_| scenario.presses());
        let forces = segments.map(|one| one.force.as_ref().and_then(pressed));
        let steered = scenario.servo.iter().filter(|_| scenario.presses());
        Self {
            forces: forces.chain(steered.map(|_| None)).collect(),
            ..self
        }
    }

    /// Each list with the name under which a recording has it.
    pub(crate) fn named(&self) -> [(&'static str, &Vec<f64>); 4] {
        [
            ("joint:qdot_limit", &self.speed),
            ("joint:torque_limit", &self.torque),
            ("joint:q_centre", &self.centre),
            ("joint:q_half_range", &self.half_range),
        ]
    }
}

/// Norms of what is left of `e` orthogonal to the directions, and of what was taken along them (Gram–Schmidt).
fn split(e: Vector3<f64>, directions: impl Iterator<Item = Vector3<f64>>) -> [f64; 2] {
    let mut basis = [Vector3::zeros(); 3];
    let mut taken = 0;
    let along = |basis: &[Vector3<f64>], v: &Vector3<f64>| {
        basis
            .iter()
            .fold(Vector3::zeros(), |sum, b| sum + b * b.dot(v))
    };
    for direction in directions {
        let rest = direction - along(&basis[..taken], &direction);
        if taken < 3 && rest.norm() > 1e-6 {
            basis[taken] = rest.normalize();
            taken += 1;
        }
    }
    let along = along(&basis[..taken], &e);
    [(e - along).norm(), along.norm()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::PlantState;

    proptest! {
        /// The two parts of an error are orthogonal, and an error along ζ has no other part.
        #[test]
        fn orthogonal_and_along_are_orthogonal_parts(e in prop::array::uniform3(-1.0..1.0f64), a in prop::array::uniform3(-1.0..1.0f64), b in prop::array::uniform3(-1.0..1.0f64)) {
            let directions = [a, b].map(|d| Vector3::from(d).normalize());
            let [orthogonal, along] = split(Vector3::from(e), directions.into_iter());
            prop_assert!((orthogonal.hypot(along) - Vector3::from(e).norm()).abs() < 1e-9);
            let [none, all] = split(directions[0] * 0.3, directions.into_iter());
            prop_assert!(none < 1e-9 && (all - 0.3).abs() < 1e-9);
        }

        /// A recorded logarithm reads back as its value; what is drawn is rounded to steps, also without a call.
        #[test]
        fn numbers_are_recorded_in_steps(power in -5.5..6.0f64) {
            let value = 10f64.powf(power);
            prop_assert!((10f64.powf(f64::from(logarithm(value))) / value - 1.0).abs() < 6e-4);
            prop_assert_eq!(share(-value), ((-value * SHARES).round() / SHARES) as f32);
            prop_assert!(share(f64::NAN).is_nan() && logarithm(0.0) == LEAST.log10() as f32);
        }
    }

    /// A report of two lost directions.
    fn along_x_and_about_z() -> shared_types::SingularityReport {
        let mut report = shared_types::SingularityReport {
            count: 2,
            ..Default::default()
        };
        let lost = report.singularities.iter_mut();
        for (one, (s, angular, axis)) in lost.zip([(0.1, 0, 0), (0.0, 1, 5)]) {
            (one.s, one.eta_in, one.inside, one.angular) = (s, 0.1, 1, angular);
            one.zeta_B[axis] = 1.0;
        }
        report
    }

    #[test]
    fn each_number_is_the_messages_own() {
        let robot = Robot::builtin("puma560").expect("built in");
        let mut limits = Limits::new(&robot);
        limits.forces = vec![Some(Pressed {
            newtons: 10.0,
            axis: -Vector3::z(),
            is_of_tool: true,
        })];
        let mut state = PlantState {
            contact_force_n: [3.0, 0.0, 9.0],
            R_BE: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            ..PlantState::default()
        };
        for (i, joint) in robot.joints.iter().enumerate() {
            (state.q[i], state.qdot[i]) = (joint.upper, joint.velocity);
        }
        let report = along_x_and_about_z();
        let (sin, cos) = 0.02f64.sin_cos();
        let command = ControlState {
            p_BE_d: [0.003, 0.0, 0.004],
            R_BE_d: [cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0],
            ..ControlState::default()
        };
        let messages = ByTopic {
            plant_state: Some(&state),
            singularity: Some(&report),
            control_state: Some(&command),
            ..ByTopic::default()
        };
        let take = |row: &TickRow, signal: Signal| {
            let mut values = Vec::new();
            (signal.of().take)(&Now::new(row, &limits, None), &mut values);
            values
        };
        let row = TickRow::new(0, messages);
        for (signal, expected) in [
            (Signal::PositionError, &[4.0, 3.0][..]),
            (Signal::OrientationError, &[0.0, 0.02f64.to_degrees()]),
            (Signal::Nearness, &[0.0, NEAREST]),
            (Signal::Pressed, &[10.0, 9.0]),
            (Signal::DrawnPosition, &[1.0; 6]),
            (Signal::DrawnSpeed, &[1.0; 6]),
        ] {
            let found = take(&row, signal);
            let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-9;
            let is_close = found.iter().zip(expected).all(near);
            assert!(
                found.len() == expected.len() && is_close,
                "{signal:?}: {found:?}"
            );
        }
        for signal in [Signal::PositionInRange, Signal::SpeedRatio] {
            assert!((take(&row, signal)[4] - 1.0).abs() < 1e-12);
        }
        // As many values as a signal has elements, or none where its message is missing.
        let names = ["elbow", "wrist"].map(str::to_owned);
        for signal in Signal::ALL {
            let count = take(&row, *signal).len();
            assert!(
                [0, signal.elements(6, &names).len()].contains(&count),
                "{signal:?}"
            );
            assert!(take(&TickRow::default(), *signal).is_empty());
        }
    }

    #[test]
    fn hops_add_up_to_the_chain() {
        // The chain's processes stand at places 0, 1, 3 and 2 of the stamps.
        let mut stamps = Stamps {
            received_ns: [0, 2_000, 9_000, 5_000, 0, 0, 0, 0],
            sent_ns: [1_000, 4_000, 12_500, 8_000, 0, 0, 0, 0],
            due_ns: 0,
        };
        let hops = |stamps: &Stamps| hops_us(Some(stamps), Some([0, 1, 3, 2]));
        assert_eq!(hops(&stamps), Some([1.0, 2.0, 1.0, 3.0, 1.0, 3.5, 11.5]));
        // Data that has not passed every hop has no latency.
        stamps.sent_ns[2] = 0;
        assert_eq!(hops(&stamps), None);
    }
}
