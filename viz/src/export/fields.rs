//! Columns that only an export has: numbers of the messages that a run keeps beside its recording.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use crate::signals::TickRow;

/// A column that is read from a message.
pub(super) struct Field {
    /// `group:quantity`.
    pub(super) name: &'static str,
    /// As [`Signal::unit`](crate::signals::Signal).
    pub(super) unit: &'static str,
    /// Its quantity.
    pub(super) about: &'static str,
    pub(super) elements: Elements,
    /// Appends its values at a tick, for so many joints; nothing where its message is missing.
    pub(super) take: fn(&TickRow, usize, &mut Vec<f64>),
}

/// The elements of a field.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Elements {
    One,
    Joints,
    Xyz,
    Quaternion,
    Singularities,
    /// Six of each singularity: a unit vector of twists.
    Directions,
}

impl Elements {
    pub(super) fn names(self, joints: usize, singularities: &[String]) -> Vec<String> {
        let named = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        match self {
            Self::One => named(&[""]),
            Self::Joints => (1..=joints).map(|i| i.to_string()).collect(),
            Self::Xyz => named(&["x", "y", "z"]),
            Self::Quaternion => named(&["x", "y", "z", "w"]),
            Self::Singularities => singularities.to_vec(),
            Self::Directions => {
                let of = |name: &String| {
                    ["vx", "vy", "vz", "wx", "wy", "wz"].map(|part| format!("{name}.{part}"))
                };
                singularities.iter().flat_map(of).collect()
            }
        }
    }
}

macro_rules! fields {
    ($( $name:literal $unit:literal $elements:ident $about:literal, |$row:ident, $n:pat_param, $out:ident| $take:expr; )*) => {
        /// All of them, in column order.
        pub(super) const FIELDS: &[Field] = &[ $( Field {
            name: $name,
            unit: $unit,
            about: $about,
            elements: Elements::$elements,
            take: |$row, $n, $out| { if let Some(values) = $take { $out.extend(values) } },
        } ),* ];
    };
}

fields! {
    "joint:q_encoder" "rad" Joints "Joint positions as the encoders read them", |row, n, out| row.sensor.map(|m| m.q_encoder[..n].to_vec());
    "joint:q_estimate" "rad" Joints "Estimated joint positions", |row, n, out| row.estimate.map(|m| m.q[..n].to_vec());
    "joint:qdot_estimate" "rad/s" Joints "Estimated joint velocities", |row, n, out| row.estimate.map(|m| m.qdot[..n].to_vec());
    "torque:commanded" "N*m" Joints "Torques that the controller commands", |row, n, out| row.torque.map(|m| m.tau[..n].to_vec());
    "torque:applied" "N*m" Joints "Torques that the drives applied over the tick before", |row, n, out| row.plant_state.map(|m| m.tau[..n].to_vec());
    "torque:drive" "N*m" Joints "Torques over the tick before as the drives report them", |row, n, out| row.sensor.map(|m| m.tau_drive[..n].to_vec());
    "torque:disturbance" "N*m" Joints "Torques that the model does not explain, as they act on the joints", |row, n, out| row.estimate.map(|m| m.tau_disturbance[..n].to_vec());
    "hand:position" "m" Xyz "True position of the end-effector; base axes", |row, _, out| row.plant_state.map(|m| m.p_BE);
    "hand:orientation" "1" Quaternion "True rotation of the end-effector in the base frame, a unit quaternion of continuous sign", |row, _, out| row.plant_state.map(|m| quaternion(&m.R_BE));
    "hand:velocity" "m/s" Xyz "True velocity of the end-effector; base axes", |row, _, out| row.plant_state.map(|m| m.V_BE.into_iter().take(3));
    "hand:angular_velocity" "rad/s" Xyz "True angular velocity of the end-effector; base axes", |row, _, out| row.plant_state.map(|m| m.V_BE.into_iter().skip(3));
    "desired:position" "m" Xyz "Desired position of the end-effector; base axes", |row, _, out| row.control_state.map(|m| m.p_BE_d);
    "desired:orientation" "1" Quaternion "Desired rotation of the end-effector in the base frame, a unit quaternion of continuous sign", |row, _, out| row.control_state.map(|m| quaternion(&m.R_BE_d));
    "desired:velocity" "m/s" Xyz "Desired velocity of the end-effector; base axes", |row, _, out| row.control_state.map(|m| m.V_BE_d.into_iter().take(3));
    "desired:angular_velocity" "rad/s" Xyz "Desired angular velocity of the end-effector; base axes", |row, _, out| row.control_state.map(|m| m.V_BE_d.into_iter().skip(3));
    "world:contact_force_vector" "N" Xyz "Sum of the contact forces on the arm; base axes", |row, _, out| row.plant_state.map(|m| m.contact_force_n);
    "singularity:inside" "1" Singularities "1 inside the neighbourhood of the singularity, else 0", |row, _, out| row.singularity.map(|_| row.singularities().iter().map(|one| f64::from(one.inside)).collect::<Vec<_>>());
    "singularity:zeta" "1" Directions "Singular direction at the wrist centre: a unit vector, a translation (v) or a rotation (w); base axes", |row, _, out| row.singularity.map(|_| row.singularities().iter().flat_map(|one| one.zeta_B).collect::<Vec<_>>());
    "servo:position" "m" Xyz "Position of the end-effector that the target asks for; of a twist that of the reference; base axes", |row, _, out| row.servo_state.map(|m| m.p_target);
    "servo:velocity" "m/s" Xyz "Velocity that the target asks for, before any limit; base axes", |row, _, out| row.servo_state.map(|m| m.V_target.into_iter().take(3));
    "servo:angular_velocity" "rad/s" Xyz "Angular velocity that the target asks for, before any limit; base axes", |row, _, out| row.servo_state.map(|m| m.V_target.into_iter().skip(3));
    "servo:speed_share" "1" One "Twist of the reference over the one asked for", |row, _, out| row.servo_state.map(|m| [m.speed_scale]);
    "servo:behind" "m" One "Distance that reach and limits have taken away since the target began", |row, _, out| row.servo_state.map(|m| [m.behind_m]);
    "servo:age" "s" One "Age of the target", |row, _, out| row.servo_state.map(|m| [m.age_s]);
    "servo:reason" "1" One "Why the arm follows so and not faster: a code of REASONS (shared-types/src/codes.rs)", |row, _, out| row.servo_state.map(|m| [f64::from(m.reason)]);
    "servo:joint" "1" One "The joint in the reason, from 1; negative at its lower limit; 0 for none", |row, _, out| row.servo_state.map(|m| [f64::from(m.joint) * if m.upper > 0 || m.joint == 0 { 1.0 } else { -1.0 }]);
    "servo:singularity" "1" One "The nearest singularity, from 1 in the order of the report; 0 for none", |row, _, out| row.servo_state.map(|m| [f64::from(m.singularity)]);
    "servo:nearest" "1" One "Its |s| over its outer bound: below 1 the law acts on it", |row, _, out| row.servo_state.map(|m| [m.nearest]);
    "servo:refused" "1" One "Targets refused since the start of the run", |row, _, out| row.servo_state.map(|m| [f64::from(m.refused)]);
}

/// `[x, y, z, w]` of a rotation matrix, column-major.
fn quaternion(R: &[f64; 9]) -> [f64; 4] {
    let R = Rotation3::from_matrix_unchecked(Matrix3::from_column_slice(R));
    UnitQuaternion::from_rotation_matrix(&R).coords.into()
}
