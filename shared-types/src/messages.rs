//! The messages of the control chain. Arrays of joints are zero beyond the arm's own joints. Frames: B base, E end-effector,
//! C the wrist centre (where singularities are analysed), S singular. All twists are `[linear; angular]` in base axes.

#![allow(non_snake_case)]

use crate::wire::{Header, wire};
use crate::{MAX_DOF, MAX_SINGULARITIES};

wire! {
    /// The readings of the arm's own sensors at a tick: plant → estimator.
    SensorSample on "sensor" version 3 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// Encoder positions, quantised and noisy; rad (m for prismatic joints).
        q_encoder: [f64; MAX_DOF],
        /// Torque the drives applied over the tick before, as they report it; N·m.
        tau_drive: [f64; MAX_DOF],
        /// One of `codes::DRIVES`.
        drive: u32,
        /// Ticks since the last fresh torque.
        stale_ticks: u32,
    }
}

wire! {
    /// The simulator's truth at a tick, for judging and showing only: no process of the control chain reads it.
    PlantState on "plant_state" version 4 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// Joint positions; rad.
        q: [f64; MAX_DOF],
        /// Joint velocities; rad/s.
        qdot: [f64; MAX_DOF],
        /// Torque applied over the tick before; N·m.
        tau: [f64; MAX_DOF],
        /// End-effector position in B; m.
        p_BE: [f64; 3],
        /// End-effector rotation in B, column-major.
        R_BE: [f64; 9],
        /// End-effector twist; m/s, rad/s.
        V_BE: [f64; 6],
        /// Sum of contact forces on the arm, base axes; N.
        contact_force_n: [f64; 3],
        /// Moment of the surfaces on the hand about E, base axes; N·m.
        contact_torque_nm: [f64; 3],
        /// Kinetic and potential energy; J.
        energy_j: f64,
        /// Number of contact points.
        contacts: u32,
        /// Bit i: joint i is at a limit stop.
        limit_mask: u32,
        /// Bit i: the drive limited the torque of joint i.
        saturation_mask: u32,
        /// One of `codes::DRIVES`.
        drive: u32,
        /// Why the drive did not apply the commanded torque: a sum of `codes::DRIVE_FLAGS`.
        drive_flags: u32,
        /// Commands refused since the start of the run.
        refused: u32,
    }
}

wire! {
    /// The force on the hand as the wrist's sensor measures it, the tool's own weight taken out: plant → controller. Only runs that control a force have it.
    WristForce on "wrist_force" version 2 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// Force of the surroundings on the hand, base axes, noise included; N.
        force_n: [f64; 3],
        /// Their moment about E, base axes, noise included; N·m.
        torque_nm: [f64; 3],
    }
}

wire! {
    /// The estimated state: estimator → analyzer, controller.
    StateEstimate on "estimate" version 4 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// Joint positions; rad.
        q: [f64; MAX_DOF],
        /// Joint velocities; rad/s.
        qdot: [f64; MAX_DOF],
        /// Torque that the model does not explain (generalised-momentum observer), as it acts on the joints; N·m.
        tau_disturbance: [f64; MAX_DOF],
        /// Encoder minus predicted position; rad.
        innovation: [f64; MAX_DOF],
        /// One of `codes::DRIVES`, passed on.
        drive: u32,
        /// Ticks since the last fresh torque, passed on.
        stale_ticks: u32,
    }
}

wire! {
    /// One singularity at one posture, as Chang & Khatib 1995 describe it.
    SingularityState {
        /// One of `codes::KINDS`.
        kind: u32,
        /// One of `codes::TYPES`, latched while inside.
        class: u32,
        /// 1 inside the neighbourhood D_si (hysteretic: entered at η_in, left at η_out), else 0.
        inside: u32,
        /// 1 where ζ is a rotation, 0 where it is a translation.
        angular: u32,
        /// Measure s_i(q), signed; dimensionless.
        s: f64,
        /// ds_i/dt; 1/s.
        s_rate: f64,
        /// Entry threshold on |s_i|.
        eta_in: f64,
        /// Exit threshold on |s_i|.
        eta_out: f64,
        /// Singular direction ζ_i at C: a unit vector in its linear or its angular half; continuous in sign.
        zeta_B: [f64; 6],
        /// Singular frame, rotation R_BS column-major, first axis along ζ_i.
        R_BS: [f64; 9],
        /// Velocity along ζ_i per unit of the auxiliary rate: ζᵀJ → g·aux as s grows; signed, m or dimensionless.
        gain: f64,
        /// Regular auxiliary coordinate (elbow angle from full stretch, wrist φ, waist angle); rad.
        aux: f64,
        /// Its rate; rad/s.
        aux_rate: f64,
        /// Its acceleration at q̈ = 0; rad/s².
        aux_bias: f64,
        /// Its gradient: aux̎ = aux_row·q̈ + aux_bias.
        aux_row: [f64; MAX_DOF],
        /// Second-order motion along ζ per null motion: > 0 is a fold (Type 1).
        kappa_1: f64,
        /// Turning rate of ζ along the null motion (Type 2).
        kappa_2: f64,
    }
}

wire! {
    /// Where the arm is singular, or nearly: analyzer → controller.
    SingularityReport on "singularity" version 5 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// How many entries of `singularities` are meant.
        count: u32,
        /// Singular values above 1e-3 of √Σσ², of J at C with lengths divided by `length_m`.
        rank: u32,
        /// det J at E (unscaled) for square J, else √det JJᵀ; 0 for planar tasks that leave it undefined.
        det: f64,
        /// Yoshikawa's √det(JJᵀ), unit-scaled.
        manipulability: f64,
        /// The length that makes metres and radians comparable; m.
        length_m: f64,
        /// Position of C in B; m.
        p_BC: [f64; 3],
        /// The singularities, in an order that never changes within a run.
        singularities: [SingularityState; MAX_SINGULARITIES],
    }
}

wire! {
    /// The motion that a person or another program asks for, without its header: also what the controller keeps of it.
    TargetContent {
        /// Tick at which it was given: its age counts from there.
        given_tick: u64,
        /// How long it is valid from then on; the arm comes to rest after that; s.
        valid_s: f64,
        /// Twist of E `[linear; angular]` in the axes of `frame`; of a pose: the twist with which it moves on until the next one, base axes; m/s, rad/s.
        twist: [f64; 6],
        /// Position of E in B, of a pose; m.
        position: [f64; 3],
        /// Rotation of E in B, of a pose: unit quaternion `[w, x, y, z]`.
        quaternion: [f64; 4],
        /// Joint positions, of a posture; rad (m for prismatic joints).
        q: [f64; MAX_DOF],
        /// Force with which the hand presses, in the axes of `force_frame`: along it the force is controlled and not the motion; zero: none; N.
        force: [f64; 3],
        /// One of `codes::TARGETS`.
        kind: u32,
        /// One of `codes::FRAMES`: the axes of a twist; a pose is in B.
        frame: u32,
        /// One of `codes::SIDES`: the side in which a Type 1 singularity is to be left.
        side: u32,
        /// Joints of a posture.
        joints: u32,
        /// One of `codes::FRAMES`, base or hand: the axes of `force`.
        force_frame: u32,
        /// Zero in this version.
        reserved: u32,
    }
}

wire! {
    /// The motion asked for at a tick: operator → controller. Only runs that are steered have it.
    Target on "target" version 3 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// The motion.
        target: TargetContent,
    }
}

wire! {
    /// How the controller follows its target, and why not faster: controller → recorder, operator. Only runs that are steered have it.
    ServoState on "servo_state" version 1 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// Twist of E that the target asks for, base axes, before any limit; m/s, rad/s.
        V_target: [f64; 6],
        /// Position of E in B that the target asks for; of a twist the reference's own; m.
        p_target: [f64; 3],
        /// Twist of the reference over the one asked for, 0 to 1.
        speed_scale: f64,
        /// Reference less the motion asked for that reach and limits have taken away since the target began: distance; m.
        behind_m: f64,
        /// |s| of the nearest singularity over its η_out: below 1 the law acts on it; 1e9 where the arm reports none.
        nearest: f64,
        /// Age of the target; s.
        age_s: f64,
        /// One of `codes::REASONS`.
        reason: u32,
        /// 1 + index of the joint in the reason, 0 for none.
        joint: u32,
        /// 1 where that joint is at its upper limit, 0 at its lower one.
        upper: u32,
        /// 1 + place of the nearest singularity, 0 for none.
        singularity: u32,
        /// Targets refused since the start of the run.
        refused: u32,
        /// Why the last of them was: one of `codes::TARGET_REFUSALS`.
        refusal: u32,
        /// Why the law stopped the arm for a moment: one of `codes::REFUSALS`.
        stop: u32,
        /// How often it has since the start of the run.
        stops: u32,
    }
}

wire! {
    /// Commanded torque: controller → plant.
    TorqueCommand on "torque" version 5 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// Commanded torque Γ; N·m.
        tau: [f64; MAX_DOF],
        /// One of `codes::PHASES`: the run is over when the task is.
        phase: u32,
        /// Bit i: the torque of joint i is at its limit.
        saturation_mask: u32,
    }
}

const _: () = assert!(
    size_of::<TorqueCommand>() <= 256,
    "what a drive needs, at every tick"
);

wire! {
    /// The control law's intermediate results and its reference: controller → recorder, for judging and showing.
    ControlState on "control_state" version 4 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// The part of the torque that acts at the end-effector, J_rᵀF_r with compensation of gravity and Coriolis; N·m.
        tau_task: [f64; MAX_DOF],
        /// The part that acts in the null space, N_T Γ₀; N·m.
        tau_null: [f64; MAX_DOF],
        /// Desired end-effector position in B; m.
        p_BE_d: [f64; 3],
        /// Desired end-effector rotation in B, column-major.
        R_BE_d: [f64; 9],
        /// Desired end-effector twist; m/s, rad/s.
        V_BE_d: [f64; 6],
        /// Pose error `[p_d − p; axis-angle of R_d Rᵀ]` as the controller sees it; m, rad.
        error: [f64; 6],
        /// The trajectory's own clock; s.
        path_time_s: f64,
        /// How fast it runs against real time, 0 to 1 (the governor).
        time_scale: f64,
        /// Fraction of the null-space torque that the limits let through, 0 to 1.
        null_scale: f64,
        /// Fraction of the task torque that the limits let through, 0 to 1.
        task_scale: f64,
        /// Per singularity: β_i, 1 outside (full operational control), 0 fully inside.
        beta: [f64; MAX_SINGULARITIES],
        /// Per singularity: reference of the auxiliary coordinate; rad.
        aux_d: [f64; MAX_SINGULARITIES],
        /// Per singularity: commanded rate of the auxiliary coordinate; rad/s.
        aux_rate_d: [f64; MAX_SINGULARITIES],
        /// Planned motion of each joint while ζ is turned by null-space motion, published before it begins; rad. Zero when nothing is planned.
        planned_dq: [f64; MAX_DOF],
        /// Planned duration of that motion, the governor's stretch included; s. Zero when nothing is planned.
        planned_s: f64,
        /// Per singularity: one of `codes::MODES`.
        mode: [u32; MAX_SINGULARITIES],
        /// Index of the task segment.
        segment: u32,
        /// 1 where the goal was beyond reach and has been clipped to the boundary.
        clipped: u32,
        /// 1 + the place of the singularity whose ζ is being turned as planned, 0 when none is.
        planned: u32,
        /// One of `codes::REFUSALS`.
        refusal: u32,
        /// Bit i: the law asked for a faster change of torque i than its drive accepts; the torque sent changes at the largest rate.
        rate_mask: u32,
        /// Ticks in a row for which the estimate has been set aside, because no torque within the limits moves the arm so.
        rejected_ticks: u32,
    }
}

impl SingularityReport {
    /// The singularities in use, bounded by the message's capacity.
    #[must_use]
    pub fn listed(&self) -> &[SingularityState] {
        &self.singularities[..(self.count as usize).min(MAX_SINGULARITIES)]
    }
}

#[cfg(test)]
mod tests {
    use crate::layout::MessageLayout;
    use crate::topics::OfTopic;

    #[test]
    fn a_layout_that_changes_takes_a_new_version() {
        // Other programs know a topic's layout by its type name: one name, one layout. A line here is never edited, only replaced by that of the
        // next version.
        let known = [
            ("armplane.SensorSample.v3", 288, 0x7b59_6d81_3efc_bd78),
            ("armplane.PlantState.v4", 568, 0xb388_8d72_7801_d3f1),
            ("armplane.WristForce.v2", 200, 0xc27d_3de5_4482_2214),
            ("armplane.StateEstimate.v4", 416, 0x26d6_dbe8_667c_45e8),
            ("armplane.SingularityReport.v5", 1328, 0xa796_68c8_2480_372e),
            ("armplane.Target.v3", 384, 0xd05e_d08f_0498_db01),
            ("armplane.ServoState.v1", 288, 0xb214_d5f1_9577_26e4),
            ("armplane.ControlState.v4", 712, 0x3d62_26b6_3bfd_a497),
            ("armplane.TorqueCommand.v5", 224, 0xf478_adea_d3f1_5ea4),
        ];
        let all = MessageLayout::all();
        let all = all
            .each_ref()
            .map(|one| (&*one.type_name, one.bytes, one.hash));
        assert_eq!(all, known);
    }
}
