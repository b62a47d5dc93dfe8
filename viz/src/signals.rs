//! The numbers of a run: from the messages of a tick to columns at the control rate. PURE.
//!
//! One wide table, one row per tick: every chunk of a file carries the whole schema of its entity, so few wide entities are cheap
//! where many narrow ones are not. Positions are f64, as they came; the rest is f32, 7 digits, which halves the file.

use std::sync::Arc;

use model::Robot;
use nalgebra::{Matrix3, Vector3};
use shared_types::graph::Graph;
use shared_types::messages::{ControlState, PlantState, SingularityState};
use shared_types::process::Program;
use shared_types::topics::{ByTopic, CHAIN, Lent};
use shared_types::wire::Stamps;
use shared_types::{MAX_DOF, MAX_SINGULARITIES};

/// The messages of one tick, as a recorder has them; in real time some may be missing.
#[derive(Clone, Copy, Debug, Default)]
pub struct TickRow<'a> {
    /// The tick they belong to.
    pub tick: u64,
    /// Those that have come.
    pub messages: ByTopic<Lent<'a>>,
}

impl<'a> TickRow<'a> {
    /// These messages of a tick.
    #[must_use]
    pub fn new(tick: u64, messages: ByTopic<Lent<'a>>) -> Self {
        Self { tick, messages }
    }
}

impl<'a> std::ops::Deref for TickRow<'a> {
    type Target = ByTopic<Lent<'a>>;

    fn deref(&self) -> &ByTopic<Lent<'a>> {
        &self.messages
    }
}

impl TickRow<'_> {
    /// Joint positions, rad: the simulator's, else the estimator's.
    pub(crate) fn q(&self) -> Option<&[f64]> {
        self.plant_state
            .map(|state| &state.q[..])
            .or_else(|| self.estimate.map(|estimate| &estimate.q[..]))
    }

    /// Joint velocities, rad/s: the simulator's, else the estimator's.
    pub(crate) fn qdot(&self) -> Option<&[f64]> {
        self.plant_state
            .map(|state| &state.qdot[..])
            .or_else(|| self.estimate.map(|estimate| &estimate.qdot[..]))
    }

    /// The singularities reported.
    pub(crate) fn singularities(&self) -> &[SingularityState] {
        self.singularity.map_or(&[], |report| {
            &report.singularities[..(report.count as usize).min(report.singularities.len())]
        })
    }

    /// Stamps of as many hops as the data has passed.
    fn stamps(&self) -> Option<Stamps> {
        let last = self
            .torque
            .map(|m| &m.header)
            .or(self.singularity.map(|m| &m.header))
            .or(self.estimate.map(|m| &m.header))
            .or(self.sensor.map(|m| &m.header));
        last.map(|header| header.stamps)
    }
}

/// How a signal is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Width {
    /// With 64 bits.
    F64,
    /// With 32 bits.
    F32,
    /// Its logarithm to base 10, in steps of 1 / [`SHARES`]: plots have no logarithmic axis of their own. A value that is not above [`LEAST`] counts as 0.
    Log,
    /// With 32 bits, at the lower rate of what is drawn; held between when it is read back.
    Slow,
    /// Not at all: computed when it is read back, from other signals and the limits.
    Derived,
}

/// The least value of a [`Width::Log`]; in the signal's unit.
pub(crate) const LEAST: f64 = 1e-6;

/// The logarithm that a [`Width::Log`] records: in steps of 1 / [`SHARES`], a tenth of a percent of the value.
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

/// The value of a recorded logarithm.
pub(crate) fn from_logarithm(recorded: f32) -> f64 {
    if recorded <= LEAST.log10() as f32 {
        0.0
    } else {
        10f64.powf(f64::from(recorded))
    }
}

macro_rules! signals {
    ($( $(#[doc = $doc:literal])* $name:ident = $text:literal $width:ident ),* $(,)?) => {
        /// The columns at the control rate. Each row of a column is a list: one number per joint, per singularity, per hop, or as stated.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Signal { $( $(#[doc = $doc])* $name ),* }

        impl Signal {
            /// All of them, in column order.
            pub const ALL: &[Signal] = &[ $( Signal::$name ),* ];

            /// The column's name in the recording.
            pub const fn name(self) -> &'static str {
                match self { $( Signal::$name => $text ),* }
            }

            /// The name of what is recorded of it.
            pub(crate) const fn component(self) -> &'static str {
                match self {
                    Signal::PositionError => "error:position_log10_mm",
                    Signal::OrientationError => "error:orientation_log10_deg",
                    Signal::Latency => "latency:log10_us",
                    other => other.name(),
                }
            }

            /// Its quantity and unit.
            pub const fn about(self) -> &'static str {
                match self { $( Signal::$name => concat!($($doc),*) ),* }
            }

            /// Whether it is recorded with 64 bits, not 32.
            pub const fn is_wide(self) -> bool {
                matches!(self.width(), Width::F64)
            }

            pub(crate) const fn width(self) -> Width {
                match self { $( Signal::$name => Width::$width ),* }
            }
        }
    };
}

signals! {
    /// Joint positions; rad.
    Position = "joint:q" F64,
    /// Joint positions between their limits: −1 lower, 1 upper; q/π for a joint without limits. Derived.
    PositionInRange = "joint:q_in_range" Derived,
    /// Joint velocities; rad/s.
    Speed = "joint:qdot" F32,
    /// Joint velocities over their limits. Derived.
    SpeedRatio = "joint:qdot_ratio" Derived,
    /// Torques that act at the end-effector, J_rᵀF_r and compensation; N·m.
    TorqueTask = "torque:task" F32,
    /// Torques that act in the null space, N_T Γ₀; N·m.
    TorqueNull = "torque:null" F32,
    /// Torques that act at the end-effector over the joints' limits. Derived.
    TorqueTaskRatio = "torque:task_ratio" Derived,
    /// Torques that act in the null space over the joints' limits. Derived.
    TorqueNullRatio = "torque:null_ratio" Derived,
    /// s_i(q) of each singularity; dimensionless.
    Measure = "singularity:s" F32,
    /// Auxiliary coordinate of each singularity; rad.
    Auxiliary = "singularity:aux" F32,
    /// Reference of the auxiliary coordinate; rad. Every 8 ms.
    AuxiliaryReference = "singularity:aux_d" Slow,
    /// β_i of each singularity: 1 full operational control, 0 null-space control. Every 8 ms.
    Beta = "singularity:beta" Slow,
    /// Singular values of the unit-scaled Jacobian in the estimated posture. Every 8 ms.
    SingularValues = "jacobian:sigma" Slow,
    /// True position error [orthogonal to, along] the singular directions the arm is inside of; mm. Recorded as `error:position_log10_mm`.
    PositionError = "error:position_mm" Log,
    /// True orientation error [orthogonal to, along] the singular directions the arm is inside of; degrees. Recorded as `error:orientation_log10_deg`.
    OrientationError = "error:orientation_deg" Log,
    /// [time scale, task scale, null scale]: what governor and limits let through, 0 to 1. Every 8 ms.
    Scale = "control:scale" Slow,
    /// Contact force on the arm; N.
    Contact = "world:contact_force_n" F32,
    /// Time of each hop and of the whole chain, in the order of [`hop_names`]; µs. Recorded as `latency:log10_us`.
    Latency = "latency:us" Log,
}

impl Signal {
    /// The names of the elements of a row of this signal, where there are so many joints and singularities of these names; one unnamed element
    /// is a plain number.
    #[must_use]
    pub fn elements(self, joints: usize, singularities: &[String]) -> Vec<String> {
        let named = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        match self {
            Self::Position
            | Self::PositionInRange
            | Self::Speed
            | Self::SpeedRatio
            | Self::TorqueTask
            | Self::TorqueNull
            | Self::TorqueTaskRatio
            | Self::TorqueNullRatio => (1..=joints).map(|i| i.to_string()).collect(),
            Self::Measure | Self::Auxiliary | Self::AuxiliaryReference | Self::Beta => {
                singularities.to_vec()
            }
            Self::SingularValues => (1..=joints.min(6)).map(|i| i.to_string()).collect(),
            Self::PositionError | Self::OrientationError => named(&["orthogonal", "along"]),
            Self::Scale => named(&["time", "task", "null"]),
            Self::Contact => named(&[""]),
            Self::Latency => hop_names().to_vec(),
        }
    }
}

/// Hops and steps between the first and the last topic of [`CHAIN`], and the whole.
const HOPS: usize = 2 * CHAIN.len() - 1;

/// The parts of [`Signal::Latency`], named by topic: a process may have any name. `hop sensor`: from the sending of `sensor` until the writer of
/// the chain's next topic has received it; `step estimate`: from there until `estimate` is sent. The last is the whole chain's.
#[must_use]
pub fn hop_names() -> [String; HOPS] {
    std::array::from_fn(|part| match (part / 2, part % 2) {
        (link, _) if link + 1 == CHAIN.len() => format!("{} to {}", CHAIN[0], CHAIN[link]),
        (link, 0) => format!("hop {}", CHAIN[link]),
        (link, _) => format!("step {}", CHAIN[link + 1]),
    })
}

/// The places in the stamps of the writers of [`CHAIN`]'s topics: the chain that [`hop_names`] describes.
pub type ChainHops = [usize; CHAIN.len()];

/// The chain's places in a graph; `None` where a topic of the chain has no writer.
#[must_use]
pub fn chain_hops(graph: &Graph) -> Option<ChainHops> {
    let hops = graph.hops();
    let place = |topic| {
        hops.iter()
            .position(|hop| hop.writes.iter().any(|one| one == topic))
    };
    let [sensor, estimate, singularity, torque] = CHAIN.map(place);
    Some([sensor?, estimate?, singularity?, torque?])
}

/// The names of the processes whose lanes the state timeline has: the writers of [`CHAIN`]'s topics, and the recorder.
/// Empty where no process is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lives(Arc<[String; LIVES]>);

/// How many.
pub(crate) const LIVES: usize = CHAIN.len() + 1;

impl Lives {
    /// Those of a graph. A process that writes several of the topics has one lane.
    #[must_use]
    pub fn of(graph: &Graph) -> Self {
        let recorder = graph
            .process
            .iter()
            .find(|process| process.program() == Some(Program::Recorder));
        let processes = CHAIN
            .iter()
            .map(|topic| graph.writer(topic))
            .chain([recorder]);
        let mut names: [String; LIVES] = Default::default();
        names.iter_mut().zip(processes).for_each(|(name, process)| {
            *name = process.map_or(String::new(), |process| process.name.clone())
        });
        for i in 1..LIVES {
            if names[..i].contains(&names[i]) {
                names[i].clear();
            }
        }
        Self(names.into())
    }

    /// Place and name of each.
    pub(crate) fn named(&self) -> impl Iterator<Item = (usize, &str)> {
        self.0
            .iter()
            .map(String::as_str)
            .enumerate()
            .filter(|(_, name)| !name.is_empty())
    }
}

impl Default for Lives {
    /// Those of the built-in graph.
    fn default() -> Self {
        Self(Program::NAMES.map(str::to_owned).into())
    }
}

/// The limits that make ratios of joint quantities.
#[derive(Clone, Debug, Default)]
pub(crate) struct Limits {
    pub(crate) centre: Vec<f64>,
    pub(crate) half_range: Vec<f64>,
    pub(crate) speed: Vec<f64>,
    pub(crate) torque: Vec<f64>,
}

impl Limits {
    pub(crate) fn new(robot: &Robot) -> Self {
        let range = |lower: f64, upper: f64| {
            if (upper - lower).is_finite() {
                (0.5 * (lower + upper), 0.5 * (upper - lower))
            } else {
                (0.0, std::f64::consts::PI)
            }
        };
        let (centre, half_range) = robot
            .joints
            .iter()
            .map(|joint| range(joint.lower, joint.upper))
            .unzip();
        Self {
            centre,
            half_range,
            speed: robot.joints.iter().map(|joint| joint.velocity).collect(),
            torque: robot.joints.iter().map(|joint| joint.effort).collect(),
        }
    }

    pub(crate) fn dof(&self) -> usize {
        self.speed.len()
    }

    /// The signal that a derived one is computed from, and value and joint to the derived value.
    pub(crate) fn derive(&self, signal: Signal) -> Option<(Signal, impl Fn(usize, f64) -> f64)> {
        let (of, centre, scale) = match signal {
            Signal::PositionInRange => (Signal::Position, Some(&self.centre), &self.half_range),
            Signal::SpeedRatio => (Signal::Speed, None, &self.speed),
            Signal::TorqueTaskRatio => (Signal::TorqueTask, None, &self.torque),
            Signal::TorqueNullRatio => (Signal::TorqueNull, None, &self.torque),
            _ => return None,
        };
        let at = |values: &[f64], i: usize| values.get(i).copied().unwrap_or(f64::NAN);
        Some((of, move |i: usize, value: f64| {
            (value - centre.map_or(0.0, |centre| at(centre, i))) / at(scale, i)
        }))
    }
}

/// Values only drawn, which follow from the signals: at a lower rate, in steps of 1 / [`SHARES`], which repeat themselves and pack well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Drawn {
    /// log₁₀(|s_i| / η_i): below 0 inside the neighbourhood.
    Nearness,
    /// Joint positions between their limits.
    InRange,
    /// Joint velocities over their limits; rad/s where a joint has none.
    Speed,
    /// Torques that act at the end-effector, without gravity's, over the limits; N·m where a joint has none.
    Hand,
    /// Torques that carry the arm's weight; the same.
    Gravity,
    /// Torques in the null space; the same.
    Null,
    /// 0 while a fault is in force, nothing else: a bar in the plots of a run with planned faults.
    Fault,
}

/// Steps of what is drawn to one, and of logarithms to a power of ten.
pub(crate) const SHARES: f64 = 2048.0;
/// The least [`Drawn::Nearness`]: what is exactly singular.
const NEAREST: f64 = -3.0;

impl Drawn {
    pub(crate) const ALL: &[Self] = &[
        Self::Nearness,
        Self::InRange,
        Self::Speed,
        Self::Hand,
        Self::Gravity,
        Self::Null,
        Self::Fault,
    ];

    pub(crate) const fn component(self) -> &'static str {
        match self {
            Self::Nearness => "drawn:nearness",
            Self::InRange => "drawn:q_in_range",
            Self::Speed => "drawn:qdot_ratio",
            Self::Hand => "drawn:torque_hand",
            Self::Gravity => "drawn:torque_gravity",
            Self::Null => "drawn:torque_null",
            Self::Fault => "drawn:fault",
        }
    }
}

/// Gives what is drawn of a tick to `put`; `gravity` are the torques that carry the arm, N·m.
pub(crate) fn draw(
    row: &TickRow,
    limits: &Limits,
    gravity: &[f64],
    mut put: impl FnMut(Drawn, &[f64]),
) {
    let n = limits.dof();
    // One unit for all joints: shares of limits only where each has one.
    let units = |limits: &[f64]| -> [f64; MAX_DOF] {
        let is_limited = limits.iter().all(|limit| limit.is_finite());
        std::array::from_fn(|i| limits.get(i).copied().filter(|_| is_limited).unwrap_or(1.0))
    };
    let joints = |value: &dyn Fn(usize) -> f64| -> [f64; MAX_DOF] {
        std::array::from_fn(|i| if i < n { value(i) } else { 0.0 })
    };
    let near = |one: &SingularityState| {
        (one.s.abs() / one.eta_in.max(1e-9))
            .max(1e-9)
            .log10()
            .max(NEAREST)
    };
    put(
        Drawn::Nearness,
        &of_each(row.singularities(), near)[..row.singularities().len()],
    );
    if let Some(q) = row.q() {
        put(
            Drawn::InRange,
            &joints(&|i| (q[i] - limits.centre[i]) / limits.half_range[i])[..n],
        );
    }
    if let Some(qdot) = row.qdot() {
        let units = units(&limits.speed);
        put(Drawn::Speed, &joints(&|i| qdot[i] / units[i])[..n]);
    }
    if let Some(command) = row.control_state {
        let units = units(&limits.torque);
        put(
            Drawn::Hand,
            &joints(&|i| (command.tau_task[i] - gravity[i]) / units[i])[..n],
        );
        put(Drawn::Gravity, &joints(&|i| gravity[i] / units[i])[..n]);
        put(
            Drawn::Null,
            &joints(&|i| command.tau_null[i] / units[i])[..n],
        );
    }
}

/// Gives each signal's values at a tick to `put`; a signal whose messages are missing is not given, nor are the singular values, which no message has.
pub(crate) fn sample(
    row: &TickRow,
    limits: &Limits,
    hops: Option<ChainHops>,
    mut put: impl FnMut(Signal, &[f64]),
) {
    let n = limits.dof();
    if let Some(q) = row.q() {
        put(Signal::Position, &q[..n]);
    }
    if let Some(qdot) = row.qdot() {
        put(Signal::Speed, &qdot[..n]);
    }
    if let Some(command) = row.control_state {
        put(Signal::TorqueTask, &command.tau_task[..n]);
        put(Signal::TorqueNull, &command.tau_null[..n]);
        put(
            Signal::Scale,
            &[command.time_scale, command.task_scale, command.null_scale],
        );
        let count = row.singularities().len();
        put(Signal::AuxiliaryReference, &command.aux_d[..count]);
        put(Signal::Beta, &command.beta[..count]);
    }
    if row.singularity.is_some() {
        let (count, all) = (row.singularities().len(), row.singularities());
        put(Signal::Measure, &of_each(all, |one| one.s)[..count]);
        put(Signal::Auxiliary, &of_each(all, |one| one.aux)[..count]);
    }
    if let Some(state) = row.plant_state {
        put(
            Signal::Contact,
            &[Vector3::from(state.contact_force_n).norm()],
        );
        if let Some(command) = row.control_state {
            let error = TaskError::new(state, command, row.singularities());
            put(Signal::PositionError, &error.position_m.map(|e| 1e3 * e));
            put(
                Signal::OrientationError,
                &error.orientation_rad.map(f64::to_degrees),
            );
        }
    }
    if let Some(hops) = row
        .stamps()
        .zip(hops)
        .and_then(|(stamps, hops)| hops_us(&stamps, hops))
    {
        put(Signal::Latency, &hops);
    }
}

/// A number of each singularity, and zeros behind them.
fn of_each(
    singularities: &[SingularityState],
    value: impl Fn(&SingularityState) -> f64,
) -> [f64; MAX_SINGULARITIES] {
    std::array::from_fn(|i| singularities.get(i).map_or(0.0, &value))
}

/// Task error, desired against true pose, split at the singular directions the arm is inside of: `[orthogonal, along]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TaskError {
    pub(crate) position_m: [f64; 2],
    pub(crate) orientation_rad: [f64; 2],
}

impl TaskError {
    /// e = [p_d − p; log(R_d Rᵀ)], each half split into its part in span{ζ_i : inside} and the rest; base axes.
    pub(crate) fn new(
        state: &PlantState,
        command: &ControlState,
        singularities: &[SingularityState],
    ) -> Self {
        let p = Vector3::from(command.p_BE_d) - Vector3::from(state.p_BE);
        let R_error = Matrix3::from_column_slice(&command.R_BE_d)
            * Matrix3::from_column_slice(&state.R_BE).transpose();
        let r = model::rotation_log(&R_error);
        let directions = |angular: u32, offset: usize| {
            singularities
                .iter()
                .filter(move |one| one.inside == 1 && one.angular == angular)
                .map(move |one| Vector3::from_column_slice(&one.zeta_B[offset..offset + 3]))
        };
        Self {
            position_m: split(p, directions(0, 0)),
            orientation_rad: split(r, directions(1, 3)),
        }
    }
}

/// Norms of what is left of `e` orthogonal to the directions, and of what was taken along them (Gram–Schmidt).
fn split(e: Vector3<f64>, directions: impl Iterator<Item = Vector3<f64>>) -> [f64; 2] {
    let mut basis: [Vector3<f64>; 3] = [Vector3::zeros(); 3];
    let mut taken = 0;
    for direction in directions {
        let rest = basis[..taken]
            .iter()
            .fold(direction, |rest, b| rest - b * b.dot(&rest));
        if taken < 3 && rest.norm() > 1e-6 {
            basis[taken] = rest.normalize();
            taken += 1;
        }
    }
    let along = basis[..taken]
        .iter()
        .fold(Vector3::zeros(), |sum, b| sum + b * b.dot(&e));
    [(e - along).norm(), along.norm()]
}

/// Times of the hops, µs; `None` where the data has not passed them all or clocks ran backwards.
fn hops_us(stamps: &Stamps, hops: ChainHops) -> Option<[f64; HOPS]> {
    let (received, sent) = (
        hops.map(|hop| stamps.received_ns[hop]),
        hops.map(|hop| stamps.sent_ns[hop]),
    );
    let span = |from: u64, to: u64| {
        (from > 0)
            .then(|| to.checked_sub(from))
            .flatten()
            .map(|ns| ns as f64 * 1e-3)
    };
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::StateEstimate;

    #[test]
    fn an_error_along_zeta_is_not_orthogonal_to_it() {
        let mut state = PlantState {
            R_BE: [1., 0., 0., 0., 1., 0., 0., 0., 1.],
            ..PlantState::default()
        };
        state.p_BE = [0.1, 0.2, 0.3];
        let mut command = ControlState {
            R_BE_d: state.R_BE,
            p_BE_d: [0.103, 0.2, 0.304],
            ..ControlState::default()
        };
        // A turn of 0.02 rad about z.
        command.R_BE_d = *nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), 0.02)
            .matrix()
            .as_slice()
            .first_chunk()
            .expect("nine");
        let elbow = SingularityState {
            inside: 1,
            zeta_B: [1., 0., 0., 0., 0., 0.],
            ..SingularityState::default()
        };
        let wrist = SingularityState {
            inside: 1,
            angular: 1,
            zeta_B: [0., 0., 0., 0., 0., 1.],
            ..SingularityState::default()
        };
        let close = |a: [f64; 2], b: [f64; 2]| {
            assert!(
                (a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12,
                "{a:?} {b:?}"
            )
        };
        let outside = TaskError::new(&state, &command, &[]);
        close(outside.position_m, [0.005, 0.0]);
        close(outside.orientation_rad, [0.02, 0.0]);
        let inside = TaskError::new(&state, &command, &[elbow, wrist]);
        close(inside.position_m, [0.004, 0.003]);
        close(inside.orientation_rad, [0.0, 0.02]);
    }

    proptest! {
        #[test]
        fn orthogonal_and_along_are_orthogonal_parts(e in prop::array::uniform3(-1.0..1.0f64), a in prop::array::uniform3(-1.0..1.0f64), b in prop::array::uniform3(-1.0..1.0f64)) {
            let e = Vector3::from(e);
            let directions = [Vector3::from(a), Vector3::from(b)].map(|d| d.normalize());
            let [orthogonal, along] = split(e, directions.into_iter());
            prop_assert!((orthogonal.hypot(along) - e.norm()).abs() < 1e-9);
            let [none, all] = split(directions[0] * 0.3, directions.into_iter());
            prop_assert!(none < 1e-9 && (all - 0.3).abs() < 1e-9);
        }
    }

    #[test]
    fn hops_add_up_to_the_chain() {
        // The chain's processes stand at places 0, 1, 3 and 2 of the stamps.
        let received_ns = [0, 2_000, 9_000, 5_000, 0, 0, 0, 0];
        let stamps = Stamps {
            received_ns,
            sent_ns: [1_000, 4_000, 12_500, 8_000, 0, 0, 0, 0],
            due_ns: 0,
        };
        let hops = hops_us(&stamps, [0, 1, 3, 2]).expect("complete");
        assert_eq!(hops, [1.0, 2.0, 1.0, 3.0, 1.0, 3.5, 11.5]);
        assert_eq!(hops[..6].iter().sum::<f64>(), hops[6]);
        assert_eq!(
            hops_us(
                &Stamps {
                    sent_ns: [1_000, 0, 0, 0, 0, 0, 0, 0],
                    ..stamps
                },
                [0, 1, 3, 2]
            ),
            None,
            "data that has not passed every hop has no latency"
        );
    }

    #[test]
    fn missing_messages_give_no_values() {
        let robot = Robot::builtin("puma560").expect("built in");
        let limits = Limits::new(&robot);
        let mut seen = Vec::new();
        let estimate = StateEstimate::default();
        sample(
            &TickRow::new(
                0,
                ByTopic {
                    estimate: Some(&estimate),
                    ..ByTopic::default()
                },
            ),
            &limits,
            None,
            |signal, values| seen.push((signal, values.len())),
        );
        assert_eq!(seen, [(Signal::Position, 6), (Signal::Speed, 6)]);
    }

    #[test]
    fn limits_are_at_plus_and_minus_one() {
        let robot = Robot::builtin("puma560").expect("built in");
        let limits = Limits::new(&robot);
        let mut state = PlantState::default();
        for (i, joint) in robot.joints.iter().enumerate() {
            state.q[i] = if i % 2 == 0 { joint.upper } else { joint.lower };
            state.qdot[i] = joint.velocity;
        }
        for (signal, values) in [
            (Signal::PositionInRange, state.q),
            (Signal::SpeedRatio, state.qdot),
        ] {
            let (_, derive) = limits.derive(signal).expect("derived");
            for (i, value) in values.into_iter().take(6).enumerate() {
                let expected = if signal == Signal::PositionInRange && i % 2 == 1 {
                    -1.0
                } else {
                    1.0
                };
                assert!(
                    (derive(i, value) - expected).abs() < 1e-12,
                    "{signal:?} of joint {}",
                    i + 1
                );
            }
        }
    }

    #[test]
    fn a_logarithm_reads_back_as_its_value() {
        for value in [2e-6, 0.034, 1.0, 8.5, 741.25] {
            assert!(
                (from_logarithm(logarithm(value)) / value - 1.0).abs() < 6e-4,
                "{value}"
            );
            for value in [value, -value, 1e9 * value] {
                assert_eq!(
                    share(value),
                    ((value * SHARES).round() / SHARES) as f32,
                    "{value}"
                );
            }
        }
        assert!(share(f64::NAN).is_nan() && share(f64::INFINITY) == f32::INFINITY);
        assert_eq!(from_logarithm(logarithm(0.0)), 0.0);
    }

    #[test]
    fn the_edge_of_a_neighbourhood_is_drawn_at_nought() {
        let limits = Limits::new(&Robot::builtin("puma560").expect("built in"));
        let mut report = shared_types::messages::SingularityReport {
            count: 3,
            ..Default::default()
        };
        for (one, s) in report.singularities.iter_mut().zip([0.1, -0.01, 0.0]) {
            (one.s, one.eta_in) = (s, 0.1);
        }
        let row = TickRow::new(
            0,
            ByTopic {
                singularity: Some(&report),
                ..ByTopic::default()
            },
        );
        let mut nearness: Vec<f64> = Vec::new();
        draw(&row, &limits, &[0.0; 6], |drawn, values| {
            assert_eq!(drawn, Drawn::Nearness);
            nearness.extend(values);
        });
        assert!(
            nearness[0].abs() < 1e-12
                && (nearness[1] + 1.0).abs() < 1e-12
                && nearness[2] == NEAREST,
            "{nearness:?}"
        );
    }
}
