//! The numbers of a run: THE list of what is recorded, drawn, exported and read back. PURE.
//!
//! One wide table, one row per tick: every chunk of a file carries the whole schema of its entity, so few wide entities are cheap
//! where many narrow ones are not. Positions are f64, as they came; the rest is f32, 7 digits, which halves the file.

use model::Joint;
use nalgebra::{Matrix3, Rotation3, SVector, UnitQuaternion, Vector3};
use shared_types::codes::FRAME_HAND;
use shared_types::graph::Graph;
use shared_types::messages::SingularityState;
use shared_types::topics::CHAIN;
use shared_types::wire::Stamps;
use shared_types::{ControlState, MAX_DOF};

use crate::entity;
use crate::facts::{Facts, range};
use crate::run::Tick;
use crate::story::Named;

/// How a signal is kept.
#[derive(Clone, Copy, PartialEq)]
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

impl Kept {
    /// The entity that records it.
    pub(crate) fn entity(self) -> Option<&'static str> {
        match self {
            Slow | Drawn => Some(entity::DRAWN),
            Table => None,
            _ => Some(entity::SIGNALS),
        }
    }
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
#[derive(PartialEq)]
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
pub(crate) struct Now<'a> {
    pub(crate) row: &'a Tick,
    pub(crate) facts: &'a Facts<'a>,
    pub(crate) is_faulty: bool,
}

impl<'a> Now<'a> {
    /// Without a fault.
    pub(crate) fn new(row: &'a Tick, facts: &'a Facts) -> Self {
        Self {
            row,
            facts,
            is_faulty: false,
        }
    }

    /// Of as many as there are joints.
    fn joints<'v>(&self, values: &'v [f64]) -> impl Iterator<Item = f64> + use<'v> {
        values[..self.facts.joints()].iter().copied()
    }

    /// Joint positions between their limits.
    fn in_range(&self) -> Option<impl Iterator<Item = f64> + use<'a>> {
        Some(
            self.row
                .q()?
                .iter()
                .zip(&self.facts.robot.joints)
                .map(|(q, joint)| {
                    let [middle, half] = range(joint);
                    (q - middle) / half
                }),
        )
    }

    /// Over the joints' limits, whatever they are.
    fn ratios(
        &self,
        values: [f64; MAX_DOF],
        limit: fn(&Joint) -> f64,
    ) -> impl Iterator<Item = f64> + use<'a> {
        values
            .into_iter()
            .zip(&self.facts.robot.joints)
            .map(move |(value, joint)| value / limit(joint))
    }

    /// Over the joints' limits where each has one: all joints have one unit.
    fn over(
        &self,
        values: [f64; MAX_DOF],
        limit: fn(&Joint) -> f64,
    ) -> impl Iterator<Item = f64> + use<'a> {
        let is_limited = self.facts.is_limited(limit);
        self.ratios(values, if is_limited { limit } else { |_| 1.0 })
    }

    /// Torques that carry the arm; N·m.
    fn gravity(&self) -> SVector<f64, MAX_DOF> {
        let of = |q: &[f64; MAX_DOF]| self.facts.arm.gravity(&SVector::from(*q));
        self.row.q().map(of).unwrap_or_default()
    }

    /// A number of each singularity, where there is a report.
    fn each<T>(
        &self,
        value: fn(&'a SingularityState) -> T,
    ) -> Option<impl Iterator<Item = T> + use<'a, T>> {
        let all = self.row.singularities();
        let is_reported = self.row.singularity.is_some();
        is_reported.then(|| all.iter().map(value))
    }

    /// A number of each singularity in the command.
    fn command(
        &self,
        values: fn(&'a ControlState) -> &'a [f64],
    ) -> Option<impl Iterator<Item = f64> + use<'a>> {
        let count = self.row.singularities().len();
        let command = self.row.control_state.as_ref();
        command.map(|m| values(m)[..count].iter().copied())
    }

    /// The force that the present segment asks for, or the target, along its axis, [set-point, true contact]; N.
    pub(crate) fn pressed(&self) -> Option<[f64; 2]> {
        let m = self.row.plant_state?;
        let (newtons, axis, is_of_tool) = match self.row.target {
            Some(message) => {
                let force = Vector3::from(message.target.force);
                let is_of_tool = message.target.force_frame == FRAME_HAND;
                (force.norm(), force.try_normalize(0.0)?, is_of_tool)
            }
            None => {
                let force = self
                    .facts
                    .job
                    .scenario
                    .segment
                    .get(self.row.control_state?.segment as usize)?
                    .force
                    .as_ref()?;
                let (axis, is_of_tool) = force.direction()?;
                (force.newtons, axis.into(), is_of_tool)
            }
        };
        let e = if is_of_tool {
            Matrix3::from_column_slice(&m.R_BE) * axis
        } else {
            axis
        };
        Some([newtons, -e.dot(&Vector3::from(m.contact_force_n))])
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
    ($t:ident $m:ident [] $take:expr) => {
        |$t, out| {
            if let Some(values) = $take {
                out.extend(values)
            }
        }
    };
    ($t:ident $m:ident [$source:ident] $take:expr) => {
        |$t, out| {
            if let Some($m) = &$t.row.$source {
                out.extend($take)
            }
        }
    };
}

/// The list, computed from a tick, or from its message of a topic.
macro_rules! signals {
    (|$t:ident, $m:ident| $( $(#[doc = $doc:literal])* $name:ident $text:literal $unit:literal $kept:expr, $elements:expr, $(in $source:ident:)? $take:expr; )*) => {
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
            take: taken!($t $m [$($source)?] $take),
        } ),* ];
    };
}

use Elements::{Directions, Hops, Joints, One, Quaternion, Sigmas, Singularities};
use Kept::{Drawn, F32, F64, Log, Short, Slow, Table};

signals! { |t, m|
    /// Joint positions; rad.
    Position "joint:q" "rad" F64, Joints, t.row.q().map(|q| t.joints(q));
    /// Joint positions between their limits: −1 lower, 1 upper; q/π for a joint without limits
    PositionInRange "joint:q_in_range" "1" Table, Joints, t.in_range();
    /// Joint velocities; rad/s.
    Speed "joint:qdot" "rad/s" F32, Joints, t.row.qdot().map(|qdot| t.joints(qdot));
    /// Joint velocities over their limits
    SpeedRatio "joint:qdot_ratio" "1" Table, Joints, t.row.qdot().map(|qdot| t.ratios(*qdot, |joint| joint.velocity));
    /// Torques that act at the end-effector, J_rᵀF_r and compensation; N·m.
    TorqueTask "torque:task" "N*m" F32, Joints, in control_state: t.joints(&m.tau_task);
    /// Torques that act in the null space, N_T Γ₀; N·m.
    TorqueNull "torque:null" "N*m" F32, Joints, in control_state: t.joints(&m.tau_null);
    /// Torques that act at the end-effector over the joints' limits
    TorqueTaskRatio "torque:task_ratio" "1" Table, Joints, in control_state: t.ratios(m.tau_task, |joint| joint.effort);
    /// Torques that act in the null space over the joints' limits
    TorqueNullRatio "torque:null_ratio" "1" Table, Joints, in control_state: t.ratios(m.tau_null, |joint| joint.effort);
    /// s_i(q) of each singularity; dimensionless.
    Measure "singularity:s" "1" F32, Singularities, t.each(|one| one.s);
    /// Auxiliary coordinate of each singularity; rad.
    Auxiliary "singularity:aux" "rad" F32, Singularities, t.each(|one| one.aux);
    /// Reference of the auxiliary coordinate; rad.
    AuxiliaryReference "singularity:aux_d" "rad" Slow, Singularities, t.command(|m| &m.aux_d);
    /// β_i of each singularity: 1 full operational control, 0 null-space control.
    Beta "singularity:beta" "1" Slow, Singularities, t.command(|m| &m.beta);
    /// Singular values of the unit-scaled Jacobian in the estimated posture.
    SingularValues "jacobian:sigma" "1" Slow, Sigmas, t.facts.singular_values(t.row).map(|sigma| sigma.into_iter().take(t.facts.joints()));
    /// True position error [orthogonal to, along] the singular directions the arm is inside of; mm.
    PositionError "error:position_mm" "mm" Short, PARTS, t.error(0).map(|e| e.map(|m| 1e3 * m));
    /// True orientation error [orthogonal to, along] the singular directions the arm is inside of; degrees.
    OrientationError "error:orientation_deg" "deg" Short, PARTS, t.error(1).map(|e| e.map(f64::to_degrees));
    /// [time scale, task scale, null scale]: what governor and limits let through, 0 to 1.
    Scale "control:scale" "1" Slow, SCALES, in control_state: [m.time_scale, m.task_scale, m.null_scale];
    /// Contact force on the arm; N.
    Contact "world:contact_force_n" "N" F32, One, in plant_state: [Vector3::from(m.contact_force_n).norm()];
    /// Time of each hop and of the whole chain, in the order of [`hop_names`]; µs.
    Latency "latency:us" "us" Log("latency:log10_us"), Hops, hops_us(t.row.headers().into_iter().flatten().next_back().map(|last| &last.stamps), t.facts.hops);

    /// log₁₀(|s_i| / η_i): below 0 inside the neighbourhood.
    Nearness "drawn:nearness" "1" Drawn, Singularities, t.each(|one| (one.s.abs() / one.eta_in.max(1e-9)).max(1e-9).log10().max(NEAREST));
    /// log₁₀ of the position error; mm.
    DrawnPositionError "drawn:position_error_log10" "1" Drawn, PARTS, t.error(0).map(|e| e.map(|m| (1e3 * m).max(FAINTEST).log10()));
    /// log₁₀ of the orientation error; degrees.
    DrawnOrientationError "drawn:orientation_error_log10" "1" Drawn, PARTS, t.error(1).map(|e| e.map(|w| w.to_degrees().max(FAINTEST).log10()));
    /// Joint positions between their limits.
    DrawnPosition "drawn:q_in_range" "1" Drawn, Joints, t.in_range();
    /// Joint velocities over their limits; rad/s where a joint has none.
    DrawnSpeed "drawn:qdot_ratio" "1" Drawn, Joints, t.row.qdot().map(|qdot| t.over(*qdot, |joint| joint.velocity));
    /// Torques that act at the end-effector, without gravity's, over the limits; N·m where a joint has none.
    DrawnHand "drawn:torque_hand" "1" Drawn, Joints, in control_state: t.over((SVector::from(m.tau_task) - t.gravity()).into(), |joint| joint.effort);
    /// Torques that carry the arm's weight; the same.
    DrawnGravity "drawn:torque_gravity" "1" Drawn, Joints, t.row.control_state.map(|_| t.over(t.gravity().into(), |joint| joint.effort));
    /// Torques in the null space; the same.
    DrawnNull "drawn:torque_null" "1" Drawn, Joints, in control_state: t.over(m.tau_null, |joint| joint.effort);
    /// 0 while a fault is in force, nothing else: a bar in the plots of a run with planned faults.
    Fault "drawn:fault" "1" Drawn, One, t.is_faulty.then_some([0.0]);

    /// Joint positions as the encoders read them
    Encoder "joint:q_encoder" "rad" Table, Joints, in sensor: t.joints(&m.q_encoder);
    /// Estimated joint positions
    Estimate "joint:q_estimate" "rad" Table, Joints, in estimate: t.joints(&m.q);
    /// Estimated joint velocities
    SpeedEstimate "joint:qdot_estimate" "rad/s" Table, Joints, in estimate: t.joints(&m.qdot);
    /// Torques that the controller commands
    Commanded "torque:commanded" "N*m" Table, Joints, in torque: t.joints(&m.tau);
    /// Torques that the drives applied over the tick before
    Applied "torque:applied" "N*m" Table, Joints, in plant_state: t.joints(&m.tau);
    /// Torques over the tick before as the drives report them
    Reported "torque:drive" "N*m" Table, Joints, in sensor: t.joints(&m.tau_drive);
    /// Torques that the model does not explain, as they act on the joints
    Disturbance "torque:disturbance" "N*m" Table, Joints, in estimate: t.joints(&m.tau_disturbance);
    /// True position of the end-effector; base axes
    Hand "hand:position" "m" Table, XYZ, in plant_state: m.p_BE;
    /// True rotation of the end-effector in the base frame, a unit quaternion of continuous sign
    HandRotation "hand:orientation" "1" Table, Quaternion, in plant_state: quaternion(&m.R_BE);
    /// True velocity of the end-effector; base axes
    HandVelocity "hand:velocity" "m/s" Table, XYZ, in plant_state: halves(&m.V_BE)[0];
    /// True angular velocity of the end-effector; base axes
    HandTurn "hand:angular_velocity" "rad/s" Table, XYZ, in plant_state: halves(&m.V_BE)[1];
    /// Desired position of the end-effector; base axes
    Desired "desired:position" "m" Table, XYZ, in control_state: m.p_BE_d;
    /// Desired rotation of the end-effector in the base frame, a unit quaternion of continuous sign
    DesiredRotation "desired:orientation" "1" Table, Quaternion, in control_state: quaternion(&m.R_BE_d);
    /// Desired velocity of the end-effector; base axes
    DesiredVelocity "desired:velocity" "m/s" Table, XYZ, in control_state: halves(&m.V_BE_d)[0];
    /// Desired angular velocity of the end-effector; base axes
    DesiredTurn "desired:angular_velocity" "rad/s" Table, XYZ, in control_state: halves(&m.V_BE_d)[1];
    /// Sum of the contact forces on the arm; base axes
    ContactForce "world:contact_force_vector" "N" Table, XYZ, in plant_state: m.contact_force_n;
    /// Force of the surroundings on the hand as the wrist's sensor measures it; base axes
    Felt "force:measured" "N" Table, XYZ, in wrist_force: m.force_n;
    /// Their moment about the end-effector; base axes
    Twisted "force:moment" "N·m" Table, XYZ, in wrist_force: m.torque_nm;
    /// Force of the segment along its axis: set-point, and true contact
    Pressed "force:along_axis" "N" Table, PRESSED, t.pressed();
    /// 1 inside the neighbourhood of the singularity, else 0
    Inside "singularity:inside" "1" Table, Singularities, t.each(|one| f64::from(one.inside));
    /// Singular direction at the wrist centre: a unit vector, a translation (v) or a rotation (w); base axes
    Zeta "singularity:zeta" "1" Table, Directions, t.each(|one| one.zeta_B).map(Iterator::flatten);
    /// Position of the end-effector that the target asks for; of a twist that of the reference; base axes
    Asked "servo:position" "m" Table, XYZ, in servo_state: m.p_target;
    /// Velocity that the target asks for, before any limit; base axes
    AskedVelocity "servo:velocity" "m/s" Table, XYZ, in servo_state: halves(&m.V_target)[0];
    /// Angular velocity that the target asks for, before any limit; base axes
    AskedTurn "servo:angular_velocity" "rad/s" Table, XYZ, in servo_state: halves(&m.V_target)[1];
    /// Twist of the reference over the one asked for
    SpeedShare "servo:speed_share" "1" Table, One, in servo_state: [m.speed_scale];
    /// Distance that reach and limits have taken away since the target began
    Behind "servo:behind" "m" Table, One, in servo_state: [m.behind_m];
    /// Age of the target
    Age "servo:age" "s" Table, One, in servo_state: [m.age_s];
    /// Why the arm follows so and not faster: a code of REASONS (shared-types/src/codes.rs)
    Reason "servo:reason" "1" Table, One, in servo_state: [f64::from(m.reason)];
    /// The joint in the reason, from 1; negative at its lower limit; 0 for none
    Joint "servo:joint" "1" Table, One, in servo_state: [f64::from(m.joint) * if m.upper > 0 || m.joint == 0 { 1.0 } else { -1.0 }];
    /// The nearest singularity, from 1 in the order of the report; 0 for none
    Nearest "servo:singularity" "1" Table, One, in servo_state: [f64::from(m.singularity)];
    /// Its |s| over its outer bound: below 1 the law acts on it
    NearestMeasure "servo:nearest" "1" Table, One, in servo_state: [m.nearest];
    /// Targets refused since the start of the run
    Refused "servo:refused" "1" Table, One, in servo_state: [f64::from(m.refused)];
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

    /// The names of the elements of a row of this signal, where there are so many joints, and these singularities; one unnamed element is a
    /// plain number.
    pub(crate) fn elements(self, joints: usize, singularities: &[Named]) -> Vec<String> {
        let named = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let parts = |one: &Named| {
            ["vx", "vy", "vz", "wx", "wy", "wz"].map(|part| format!("{}.{part}", one.name))
        };
        match self.of().elements {
            One => named(&[""]),
            Joints => (1..=joints).map(|i| i.to_string()).collect(),
            Sigmas => (1..=joints.min(6)).map(|i| i.to_string()).collect(),
            Singularities => singularities.iter().map(|one| one.name.clone()).collect(),
            Directions => singularities.iter().flat_map(parts).collect(),
            Quaternion => named(&["x", "y", "z", "w"]),
            Hops => hop_names().into(),
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
fn hops_us(stamps: Option<&Stamps>, hops: Option<ChainHops>) -> Option<Vec<f64>> {
    let (stamps, [first, rest @ ..]) = (stamps?, hops?);
    let mut passed = vec![stamps.sent_ns[first]];
    passed.extend(
        rest.iter()
            .flat_map(|hop| [stamps.received_ns[*hop], stamps.sent_ns[*hop]]),
    );
    let span = |from: u64, to: u64| Some(to.checked_sub(from).filter(|_| from > 0)? as f64 * 1e-3);
    let parts = passed.windows(2).map(|pair| span(pair[0], pair[1]));
    parts.chain([span(passed[0], passed[HOPS - 1])]).collect()
}

/// Norms of what is left of `e` orthogonal to the directions, and of what was taken along them (Gram–Schmidt).
fn split(e: Vector3<f64>, directions: impl Iterator<Item = Vector3<f64>>) -> [f64; 2] {
    let mut basis: Vec<Vector3<f64>> = Vec::new();
    let along = |basis: &[Vector3<f64>], v: &Vector3<f64>| {
        basis.iter().map(|b| b * b.dot(v)).sum::<Vector3<f64>>()
    };
    for direction in directions {
        let rest = direction - along(&basis, &direction);
        if rest.norm() > 1e-6 {
            basis.push(rest.normalize());
        }
    }
    let along = along(&basis, &e);
    [(e - along).norm(), along.norm()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::tests::job;
    use crate::run::Happened;
    use crate::story::Story;
    use proptest::prelude::*;
    use shared_types::PlantState;
    use shared_types::scenario::Force;

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
        for (one, (s, angular, axis)) in report
            .singularities
            .iter_mut()
            .zip([(0.1, 0, 0), (0.0, 1, 5)])
        {
            (one.s, one.eta_in, one.inside, one.angular) = (s, 0.1, 1, angular);
            one.zeta_B[axis] = 1.0;
        }
        report
    }

    #[test]
    fn each_number_is_the_messages_own() {
        let (mut job, robot) = job("fig5-wrist-rotation");
        job.scenario.segment.first_mut().expect("a segment").force = Some(Force {
            axis: "tool -z".to_owned(),
            newtons: 10.0,
            ..Force::on(1e4)
        });
        let facts = Facts::new(&job, &robot, Happened::default(), false).expect("six joints");
        let mut state = PlantState {
            contact_force_n: [3.0, 0.0, 9.0],
            R_BE: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            ..PlantState::default()
        };
        for (i, joint) in robot.joints.iter().enumerate() {
            (state.q[i], state.qdot[i]) = (joint.upper, joint.velocity);
        }
        let (sin, cos) = 0.02f64.sin_cos();
        let command = ControlState {
            p_BE_d: [0.003, 0.0, 0.004],
            R_BE_d: [cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0],
            ..ControlState::default()
        };
        let mut row = Tick::default();
        (row.messages.plant_state, row.messages.control_state) = (Some(state), Some(command));
        row.messages.singularity = Some(along_x_and_about_z());
        let take = |row: &Tick, signal: Signal| {
            let mut values = Vec::new();
            (signal.of().take)(&Now::new(row, &facts), &mut values);
            values
        };
        for (signal, expected) in [
            (Signal::PositionError, &[4.0, 3.0][..]),
            (Signal::OrientationError, &[0.0, 0.02f64.to_degrees()]),
            (Signal::Nearness, &[0.0, NEAREST]),
            (Signal::Pressed, &[10.0, 9.0]),
            (Signal::PositionInRange, &[1.0; 6]),
            (Signal::SpeedRatio, &[1.0; 6]),
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
        // As many values as a signal has elements, or none where its message is missing.
        let mut story = Story::new(&facts);
        story.push(&row, &mut |_, _| ());
        for signal in Signal::ALL {
            let count = take(&row, *signal).len();
            assert!(
                [0, signal.elements(6, &story.named).len()].contains(&count),
                "{signal:?}"
            );
            assert!(take(&Tick::default(), *signal).is_empty());
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
        let expected = [1.0, 2.0, 1.0, 3.0, 1.0, 3.5, 11.5];
        assert_eq!(hops(&stamps), Some(expected.to_vec()));
        // Data that has not passed every hop has no latency.
        stamps.sent_ns[2] = 0;
        assert_eq!(hops(&stamps), None);
    }
}
