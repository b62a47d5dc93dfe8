//! Checkpoints: the state that a replacement takes over. Arrays of joints are zero beyond the arm's
//! own joints. Frames: B base, C the wrist centre. A process fills its checkpoint at every tick,
//! and its replacement continues from it, bit for bit.

#![allow(non_snake_case)]

use crate::messages::TargetContent;
use crate::wire::wire;
use crate::{MAX_DOF, MAX_SINGULARITIES};

wire! {
    /// State of the estimator's filter after a tick.
    EstimatorCheckpoint checkpoint version 2 {
        /// Tick of the last sample taken in.
        tick: u64,
        /// Joint positions; rad.
        q: [f64; MAX_DOF],
        /// Joint velocities; rad/s.
        qdot: [f64; MAX_DOF],
        /// Acceleration that the model does not explain; rad/s².
        disturbance: [f64; MAX_DOF],
        /// The same by the slow filter, which decides whether there is a disturbance; rad/s².
        disturbance_slow: [f64; MAX_DOF],
        /// Share of the disturbance that is explained, beyond 1 for as long as it is held; dimensionless.
        disturbance_presence: [f64; MAX_DOF],
        /// First of the readings set aside in a row, per joint; rad.
        rejected_reading: [f64; MAX_DOF],
        /// Ticks since the first of the readings set aside in a row, that one counted, per joint.
        rejected_ticks: [u32; MAX_DOF],
        /// Ticks since the filter began, that one counted.
        samples: u32,
        /// Zero in this version.
        reserved: u32,
    }
}

wire! {
    /// A block of the unit-scaled Jacobian, decomposed as Σ u_i σ_i v_iᵀ with signs and order that are continuous in time, but where two of them
    /// meet within a tick.
    BlockCheckpoint {
        /// Row i: the left vector u_i on the block's own rows; dimensionless.
        U: [[f64; 6]; 6],
        /// Row i: the right vector v_i on all joints; dimensionless.
        v: [[f64; MAX_DOF]; 6],
        /// σ_i, signed; dimensionless.
        sigma: [f64; 6],
        /// 1 once a posture has been decomposed, else 0.
        begun: u32,
        /// Zero in this version.
        reserved: u32,
    }
}

wire! {
    /// One place of the report: which direction of its block is followed there, and what is known of its singularity.
    PlaceCheckpoint {
        /// Index of the direction in its block.
        index: u32,
        /// One of `codes::TYPES`.
        class: u32,
        /// 1 where ζ is a rotation.
        angular: u32,
        /// 1 while the type is kept: near the neighbourhood and inside.
        latched: u32,
        /// 1 where ζ points against the measured direction: a fold is left against it.
        flipped: u32,
        /// Its place in the report, for arms with spare joints; elsewhere the array index is the place.
        place: u32,
        /// Second-order motion along ζ per null motion.
        kappa_1: f64,
        /// Turning rate of ζ per null motion.
        kappa_2: f64,
        /// Auxiliary row, of arms with spare joints: a unit vector in the null space of the kept rows; dimensionless.
        direction: [f64; MAX_DOF],
    }
}

wire! {
    /// State of the analyzer after a tick.
    AnalyzerCheckpoint checkpoint version 2 {
        /// Per singularity: 1 inside its neighbourhood.
        inside: [u32; MAX_SINGULARITIES],
        /// Decomposition of the Jacobian; of arms that are analysed by number only.
        blocks: [BlockCheckpoint; 2],
        /// Per singularity, of such arms only.
        places: [PlaceCheckpoint; MAX_SINGULARITIES],
    }
}

wire! {
    /// One auxiliary loop and the reference that drives it.
    LoopCheckpoint {
        /// One of `codes::MODES`.
        mode: u32,
        /// 1 while the singularity is passed through with ζ off the direction of travel.
        passing: u32,
        /// 1 while the desired motion leaves ζ undetermined.
        holding: u32,
        /// Zero in this version.
        reserved: u32,
        /// Side of the fold: −1 or +1; 0 before the first tick.
        side: f64,
        /// Commanded rate of the auxiliary coordinate; rad/s.
        rate: f64,
        /// Its low-passed change; rad/s².
        feed_forward: f64,
        /// The error's share in β, 0 to 1.
        trust: f64,
        /// Angle of ζ's companion in the forearm while passing through; rad.
        passage: f64,
    }
}

wire! {
    /// The reference of a steered run; zero in others.
    ServoCheckpoint {
        /// The target in force.
        held: TargetContent,
        /// Tick of the step that comes next.
        tick: u64,
        /// Tick at which the session ended, plus 1; 0 before.
        over_tick: u64,
        /// Given tick of the last refused target, plus 1.
        refused_tick: u64,
        /// Position of the reference in B; m.
        p_BE: [f64; 3],
        /// Rotation of the reference in B, column-major.
        R_BE: [f64; 9],
        /// Its twist at full clock speed; m/s, rad/s.
        V: [f64; 6],
        /// Change of that twist; m/s², rad/s².
        a: [f64; 6],
        /// Posture of the reference arm; rad.
        q: [f64; MAX_DOF],
        /// Its velocity; rad/s.
        qdot: [f64; MAX_DOF],
        /// Torque of the reference arm; N·m.
        tau: [f64; MAX_DOF],
        /// Its part along the reference's motion; N·m.
        tau_path: [f64; MAX_DOF],
        /// Its part in the null space; N·m.
        tau_null: [f64; MAX_DOF],
        /// Analysis of the reference arm.
        analysis: AnalyzerCheckpoint,
        /// Distance that reach and limits have taken away since the target began; m.
        behind_m: f64,
        /// Targets refused.
        refused: u32,
        /// One of `codes::TARGET_REFUSALS`.
        refusal: u32,
        /// One of `codes::REFUSALS`: why the arm is being brought to rest, or was last.
        stop: u32,
        /// How often it was.
        stops: u32,
        /// 1 while the arm is being brought to rest.
        stopping: u32,
        /// 1 where the tick before was at the boundary of reach.
        clipped: u32,
        /// 1 where the reference arm begins anew at the arm.
        parted: u32,
        /// Ticks in a row in which nothing was asked for, and the reference stood.
        idle_ticks: u32,
        /// Twist that a joint limit has ended, its linear part over the arm's length; rad/s.
        ended: [f64; 6],
        /// 1 + index of that joint, 0 where none has.
        ended_joint: u32,
        /// 1 where it is at its upper limit, 0 at its lower one.
        ended_upper: u32,
        /// Ticks in a row in which a joint limit kept the hand from the motion asked for.
        held_ticks: u32,
        /// Zero in this version.
        reserved: u32,
        /// The force of a target that the arm has given up, zero: none; N.
        given_up: [f64; 3],
    }
}

wire! {
    /// The force of a segment; zero without one.
    ForceCheckpoint {
        /// Set-point as far as it has risen; N.
        set_n: f64,
        /// Measured force, low-passed; N.
        felt_n: f64,
        /// Direction of the tick before, base axes.
        e: [f64; 3],
        /// The newest wrench of the wrist's sensor, base axes; N, N·m.
        wrist: [f64; 6],
        /// Along the force: estimated depth in the surface, m; the surface's speed; integral of the error as a speed; m/s.
        along: [f64; 3],
        /// The same about each axis of a moment; rad, rad/s.
        about: [[f64; 3]; 3],
        /// Place along the force's direction from which a surface is looked for; m.
        from_m: f64,
        /// How long the segment has waited for its force; s.
        waited_s: f64,
        /// How long the force has been near its set-point, or without contact where there was one; s.
        lasted_s: f64,
        /// 1 + index of the segment, 0 before the first.
        leg: u32,
        /// 0: nothing was met yet; 1: in contact; 2: in contact, and the segment's motion has begun; 3: that contact is lost.
        stage: u32,
        /// 1: the hand gives way about the axes of its moments.
        turns: u32,
        /// 1: a moment is not reached yet.
        is_off: u32,
    }
}

wire! {
    /// State of the controller after a tick.
    ControllerCheckpoint checkpoint version 10 {
        /// Index of the task segment; the number of segments once the path is finished.
        segment: u32,
        /// 1 once the segment's goal has been fixed.
        begun: u32,
        /// Time in the segment, on the path's clock; after the path, time since its end; s.
        segment_time_s: f64,
        /// Time on the path's clock since the start; s.
        path_time_s: f64,
        /// The path plan's own clock; s.
        route_time_s: f64,
        /// Desired end-effector position in B at the segment's start; m.
        p_BE_start: [f64; 3],
        /// Desired end-effector rotation in B at the segment's start, column-major.
        R_BE_start: [f64; 9],
        /// Translation over the segment; m.
        translation: [f64; 3],
        /// Rotation vector over the segment; rad.
        rotation: [f64; 3],
        /// Speed of the path's clock against real time, 0 to 1.
        governor_rate: f64,
        /// Its change; 1/s.
        governor_rate_dot: f64,
        /// Demand of the tick before, as a share of what the arm can do.
        governor_demand: f64,
        /// ζ in B when its null-space turn began.
        turn_from: [f64; 3],
        /// The turn's whole angle; rad.
        turn_angle: f64,
        /// Planned motion of each joint over the turn; rad.
        turn_dq: [f64; MAX_DOF],
        /// Planned duration of the turn, 0 before it begins; s.
        turn_s: f64,
        /// One of `codes::REFUSALS`.
        refusal: u32,
        /// Ticks in a row for which the estimate has been set aside.
        rejected_ticks: u32,
        /// 1 once an estimate has been taken as plausible.
        plausible: u32,
        /// Zero in this version.
        reserved: u32,
        /// Torque sent; N·m.
        tau: [f64; MAX_DOF],
        /// Its part along the path; N·m.
        tau_path: [f64; MAX_DOF],
        /// Its part in the null space; N·m.
        tau_null: [f64; MAX_DOF],
        /// Joint velocities that the path needs; rad/s.
        qdot_planned: [f64; MAX_DOF],
        /// Last plausible joint positions, carried on while the estimate is set aside; rad.
        q_plausible: [f64; MAX_DOF],
        /// Joint velocities there; rad/s.
        qdot_plausible: [f64; MAX_DOF],
        /// Per singularity.
        loops: [LoopCheckpoint; MAX_SINGULARITIES],
        /// Of segments with a force.
        force: ForceCheckpoint,
        /// Of steered runs.
        servo: ServoCheckpoint,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Layout;

    #[test]
    fn a_layout_that_changes_takes_a_new_version() {
        fn of<C: Layout>() -> (&'static str, usize, u64) {
            (C::TYPE_NAME, size_of::<C>(), C::layout_hash())
        }
        // A line here is never edited, only replaced by that of the next version.
        let known = [
            (
                "armplane.EstimatorCheckpoint.v2",
                432,
                0x0184_47d8_5cf1_979d,
            ),
            (
                "armplane.AnalyzerCheckpoint.v2",
                1888,
                0xd183_645a_d89c_2cda,
            ),
            (
                "armplane.ControllerCheckpoint.v10",
                3936,
                0xa4ee_c5c5_17e2_0918,
            ),
        ];
        assert_eq!(
            [
                of::<EstimatorCheckpoint>(),
                of::<AnalyzerCheckpoint>(),
                of::<ControllerCheckpoint>()
            ],
            known
        );
    }
}

wire! {
    /// State of the drives after a tick.
    DriveCheckpoint {
        /// Torque on the joints; N·m.
        tau: [f64; MAX_DOF],
        /// Joint speeds of the tick before; rad/s.
        qdot_before: [f64; MAX_DOF],
        /// 1 where there was a tick before, else 0.
        has_before: u32,
        /// One of `codes::DRIVES`.
        drive: u32,
        /// A sum of `codes::DRIVE_FLAGS`.
        flags: u32,
        /// Bit i: the torque of joint i is not the one asked for.
        saturation_mask: u32,
        /// Age of the torque in force; ticks.
        stale_ticks: u32,
        /// 1 while the brakes hold the arm.
        braked: u32,
        /// 1 on the way back from a stop to commanded torque.
        returning: u32,
        /// How long the drives have been stopping; ticks.
        stopping_ticks: u32,
        /// Commands refused so far.
        refused: u32,
        /// Zero in this version.
        reserved: u32,
    }
}

wire! {
    /// State of the simulated arm after a tick.
    PlantCheckpoint checkpoint version 1 {
        /// Joint positions; rad.
        q: [f64; MAX_DOF],
        /// Joint velocities; rad/s.
        qdot: [f64; MAX_DOF],
        /// Torque that acted on the joints over the tick; N·m.
        acted: [f64; MAX_DOF],
        /// Acceleration by contact and joint stops in the last sub-step; rad/s².
        effect: [f64; MAX_DOF],
        /// Readings of encoders before they failed; rad.
        stuck_reading: [f64; MAX_DOF],
        /// Torques of drives before they failed; N·m.
        stuck_torque: [f64; MAX_DOF],
        /// Mean force from the world on the arm; N.
        force: [f64; 3],
        /// Lower bound on the distance between any two solids that may touch; m.
        clearance: f64,
        /// Ticks done.
        ticks: u64,
        /// Ticks since the controller refused to go on.
        refused_ticks: u64,
        /// The drives.
        drives: DriveCheckpoint,
        /// Phase of the last command, one of `codes::PHASES`.
        phase: u32,
        /// Contact points that carry force.
        contacts: u32,
        /// Bit i: joint i was at a stop.
        limits: u32,
        /// 1 if the last sub-step saw contact points.
        touching: u32,
        /// Constraints that pushed in the last sub-step.
        pushing: u32,
        /// 1 if the effect of constraints was steady over the tick.
        is_steady: u32,
        /// 1 if the motion has left the finite numbers.
        diverged: u32,
        /// 1 if the encoders report a position that the drives' own sensors contradict.
        contradicted: u32,
    }
}
