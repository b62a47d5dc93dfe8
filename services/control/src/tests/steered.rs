//! The reference arm of a steered run in closed loop: random targets, and an arm that follows it exactly.

use crate::Controller;
use crate::linear::{Joints, Vector3, Vector6, angular, linear, rotation_log, stack};
use crate::testing::{Bench, robot};
use crate::types::Phase;
use model::Model;
use nalgebra::{Rotation3, UnitQuaternion};
use proptest::prelude::*;
use shared_types::codes::{
    FRAME_HAND, REASON_FOLLOWING, REASON_LIMIT, REASON_LOST, REASON_OVER, REASON_STALE,
    REFUSAL_CONTACT, TARGET_END, TARGET_POSE, TARGET_POSTURE, TARGET_REFUSAL_FORCE, TARGET_TWIST,
};
use shared_types::scenario::Scenario;
use shared_types::{MAX_DOF, ServoState, TargetContent};
use std::f64::consts::FRAC_PI_2;

/// A target and for how many ticks it is in force.
type Held = (TargetContent, u64);

fn any_target() -> impl Strategy<Value = Held> {
    let twist = (
        prop::array::uniform6(-1.0..1.0_f64),
        0..3_u32,
        0..3_u32,
        0..5_i32,
    );
    let twist = twist.prop_map(|(v, frame, side, size)| {
        // From a tenth of the session's speed to a thousand times as much: beyond it the direction alone counts.
        let twist = v
            .map(|x| x * 10.0_f64.powi(size - 1))
            .map(|x| x.clamp(-1000.0, 1000.0));
        TargetContent {
            kind: TARGET_TWIST,
            valid_s: 1.0,
            twist,
            frame,
            side,
            ..Default::default()
        }
    });
    let posture = prop::array::uniform7(-9.0..9.0_f64).prop_map(|places| {
        let mut q = [0.0; MAX_DOF];
        q[..7].copy_from_slice(&places);
        TargetContent {
            kind: TARGET_POSTURE,
            valid_s: 1.0,
            q,
            ..Default::default()
        }
    });
    (
        prop_oneof![4 => twist, 1 => posture],
        prop_oneof![Just(1_u64), 20..800_u64],
    )
}

/// Follows the targets, and looks at every tick; the last state of the session, and the reference arm's posture and velocity at the end.
fn steer<const N: usize>(
    name: &str,
    start: &str,
    targets: &[Held],
) -> Result<(ServoState, [Joints<N>; 2]), TestCaseError> {
    let text =
        format!("name = \"t\"\nrobot = \"{name}\"\n[start]\n{start}\n[servo]\nduration_s = 60.0\n");
    let mut arm = Bench::<N>::new(&text);
    let (model, dt, mut tau) = (arm.model.clone(), 1e-3, arm.model.gravity(&arm.q));
    let mut state = ServoState::default();
    for (target, ticks) in targets {
        let mut target = TargetContent {
            given_tick: arm.tick,
            ..*target
        };
        if target.kind == TARGET_POSTURE {
            target.joints = N as u32;
            target.q[N..].fill(0.0);
        }
        for _ in 0..*ticks {
            let (tick, command) = (arm.tick, arm.command(Some(&target)));
            state = command.session.unwrap_or_default();
            let reference = arm.controller.state.targets;
            prop_assert!(
                state.refused == 0 && command.phase != Phase::Refused,
                "tick {tick}: {:?} {:?}",
                state.refusal,
                command.refusal
            );
            let A = model.mass_matrix(&reference.q);
            for i in 0..N {
                let place = || format!("tick {tick}, joint {}: {state:?}", i + 1);
                let (position, speed, torque) = (reference.q[i], reference.qdot[i], command.tau[i]);
                let range = model.lower()[i]..=model.upper()[i];
                prop_assert!(
                    range.contains(&position),
                    "{position} is out of range: {}",
                    place()
                );
                // From one full torque to the other, of all joints at once.
                let (effort, rate) = (model.effort()[i], model.torque_rate()[i]);
                let most = 2.0 * N as f64 * effort / A[(i, i)];
                for (what, found, most) in [
                    ("rad/s", speed, model.velocity()[i]),
                    ("N·m", torque, effort),
                    ("N·m in a tick", torque - tau[i], rate * dt * (1.0 + 1e-9)),
                    ("rad/s in a tick", speed - arm.qdot[i], most * dt),
                ] {
                    prop_assert!(found.abs() <= most, "{found} of {most} {what}: {}", place());
                }
            }
            (arm.q, arm.qdot, tau) = (reference.q, reference.qdot, command.tau);
        }
    }
    Ok((state, [arm.q, arm.qdot]))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_targets_take_the_reference_arm_beyond_range_speed_or_torque(targets in prop::collection::vec(any_target(), 3..9)) {
        steer::<6>("puma560", "posture = \"nominal\"", &targets)?;
        steer::<7>("iiwa14", "posture = \"ready\"", &targets)?;
    }
}

/// Exactly along ζ of a lock that bends the other way: neither the self-motion nor the path leads on, and no joint circles the lock.
#[test]
fn an_arm_with_a_spare_joint_rests_in_a_lock_beyond_which_its_target_leads() {
    let lock = "q = [-0.402204211, -0.000001466, 0.865677564, -0.401816255, 0.41449968, 2.930077921, 1.424792985]";
    let outwards = TargetContent {
        kind: TARGET_TWIST,
        valid_s: 10.0,
        twist: [0.016177819, 0.004548092, 0.078215043, 0.0, 0.0, 0.0],
        ..Default::default()
    };
    let (state, [_, qdot]) = steer::<7>("panda", lock, &[(outwards, 2000)]).unwrap();
    assert_eq!(state.reason, REASON_LOST);
    assert!(qdot.amax() < 0.01, "{qdot}");
}

/// Steered out of an exact lock for 4 s at a constant twist: its largest error orthogonal to the twist asked for, m and rad, and the share of it that is made.
fn out_of_a_lock(name: &str, lock: [f64; 7], twist: [f64; 6]) -> ([f64; 2], f64) {
    let model = Model::<7>::new(robot(name), None).unwrap();
    let from = model.forward_kinematics(&Joints::from(lock));
    let asked = Vector6::from(twist) * 4.0;
    let target = TargetContent {
        kind: TARGET_TWIST,
        valid_s: 10.0,
        twist,
        ..Default::default()
    };
    let (mut worst, mut share) = ([0.0_f64; 2], 0.0);
    for ticks in [200, 1000, 4000] {
        let (_, [q, _]) = steer::<7>(name, &format!("q = {lock:?}"), &[(target, ticks)]).unwrap();
        let to = model.forward_kinematics(&q);
        let turn = rotation_log(&(to.R * from.R.transpose()));
        let moved = stack(&(to.p - from.p), &turn);
        share = moved.dot(&asked) / asked.norm_squared();
        let across = moved - asked * share;
        worst[0] = worst[0].max(linear(&across).norm());
        worst[1] = worst[1].max(angular(&across).norm());
    }
    (worst, share)
}

/// Beside ζ, of a lock that is left along its self-motion: until then the path waits, and the hand does not slide along a boundary that is none.
#[test]
fn a_lock_that_can_be_left_is_no_boundary_of_reach() {
    let shoulder = [
        -1.740517, 0.0, 1.552531, -2.054121, 2.081972, 1.910335, -2.244619,
    ];
    let (across, share) = out_of_a_lock(
        "panda",
        shoulder,
        [-0.037466, 0.031717, 0.009504, 0.0, 0.0, 0.0],
    );
    assert!(across[0] < 0.0015 && share > 0.85, "{across:?}, {share}");
    let wrist = [
        0.524049, 0.911452, 2.226591, 1.526029, FRAC_PI_2, 0.0, 1.149802,
    ];
    let (across, share) = out_of_a_lock(
        "iiwa14",
        wrist,
        [0.0, 0.0, 0.0, -0.043285, -0.233927, 0.182769],
    );
    assert!(across[0] < 0.0015 && share > 0.85, "{across:?}, {share}");
}

/// Upright and stretched, a fold opens in a plane in which no joint holds the hand: ζ of the shoulder is turned out of that plane first.
#[test]
fn an_elbow_waits_for_the_shoulder_that_is_lost_beside_it() {
    let upright = [-1.93176, 0.0, 1.309074, 0.0, 1.695218, 1.702621, -0.337249];
    let (across, share) = out_of_a_lock("iiwa14", upright, [0.0, 0.0, -0.05, 0.0, 0.0, 0.0]);
    assert!(across[0] < 0.006 && share > 0.4, "{across:?}, {share}");
}

/// Starts close to the end of a joint's range, inside the wrist's neighbourhood or beside it.
fn beside_a_limit() -> impl Strategy<Value = [f64; 6]> {
    let [lower, upper] = [
        crate::testing::puma().lower(),
        crate::testing::puma().upper(),
    ];
    (0..6_usize, any::<bool>(), 0.001..0.09_f64, -0.15..0.15_f64).prop_map(
        move |(joint, is_up, distance, wrist)| {
            let mut q = [0.2, -0.6, 0.9, 0.3, wrist, -0.4];
            q[joint] = if is_up {
                upper[joint] - distance
            } else {
                lower[joint] + distance
            };
            q
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_joint_near_its_limit_in_a_neighbourhood_is_slowed_down_and_held(
        q in beside_a_limit(),
        push in prop::array::uniform6(-1.0..1.0_f64),
    ) {
        let there = twist(push.map(|x| 0.3 * x), 60.0);
        let back = twist(push.map(|x| -0.3 * x), 60.0);
        steer::<6>("puma560", &format!("q = {q:?}"), &[(there, 1500), (back, 1500)])?;
    }
}

fn twist(twist: [f64; 6], valid_s: f64) -> TargetContent {
    TargetContent {
        kind: TARGET_TWIST,
        valid_s,
        twist,
        frame: FRAME_HAND,
        ..Default::default()
    }
}

fn posture(q: [f64; 7]) -> TargetContent {
    let mut target = TargetContent {
        kind: TARGET_POSTURE,
        valid_s: 60.0,
        ..Default::default()
    };
    target.q[..7].copy_from_slice(&q);
    target
}

/// Follows the targets for a while more and again: the arm stays where it is.
fn assert_rest(start: &str, targets: &[Held], reason: u32) -> ServoState {
    let (state, [q, qdot]) = steer::<7>("panda", start, targets).unwrap();
    let mut longer = targets.to_vec();
    longer.last_mut().unwrap().1 += 2000;
    let (_, [later, _]) = steer::<7>("panda", start, &longer).unwrap();
    assert!(
        qdot.amax() < 1e-3 && (later - q).amax() < 1e-3,
        "{state:?}: {qdot} rad/s, and then by {} rad",
        later - q
    );
    assert_eq!(state.reason, reason, "{state:?}");
    state
}

const READY: &str = "posture = \"ready\"";

#[test]
fn a_motion_that_a_joint_limit_ends_leaves_every_joint_at_rest() {
    let state = assert_rest(
        READY,
        &[(twist([0.0, 0.0, 0.0, 0.5, 0.5, 1.0], 60.0), 7000)],
        REASON_LIMIT,
    );
    assert_eq!((state.joint, state.upper), (7, 1));
    let state = assert_rest(
        READY,
        &[(posture([0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0]), 6000)],
        REASON_LIMIT,
    );
    assert_eq!((state.joint, state.upper), (4, 1));
}

#[test]
fn after_a_limit_another_motion_is_followed_at_once() {
    let end = (twist([0.0, 0.0, 0.0, 0.5, 0.5, 1.0], 60.0), 7000);
    let (_, [held, _]) = steer::<7>("panda", READY, &[end]).unwrap();
    let (state, [q, _]) = steer::<7>(
        "panda",
        READY,
        &[end, (twist([0.0, 0.0, 0.0, 0.0, 0.0, -0.3], 60.0), 500)],
    )
    .unwrap();
    assert!(
        state.speed_scale > 0.9 && held[6] - q[6] > 0.05,
        "{state:?}: joint 7 from {} to {}",
        held[6],
        q[6]
    );
}

#[test]
fn after_the_end_and_after_an_old_target_the_arm_rests_wherever_it_is() {
    // Stretched upwards near the shoulder singularity, where the null-space motion is fastest.
    for q2 in [-0.02, 0.1] {
        let start = format!("q = [0.2, {q2}, 1.45, -1.2, 0.3, 1.4, 0.4]");
        for push in [
            [0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.2, 0.1, 0.0, 0.0, 0.0],
            [-0.2, -0.1, 0.0, 0.0, 0.5, 0.0],
        ] {
            let end = TargetContent {
                kind: TARGET_END,
                ..Default::default()
            };
            assert_rest(
                &start,
                &[(twist(push, 60.0), 700), (end, 1500)],
                REASON_OVER,
            );
            assert_rest(&start, &[(twist(push, 0.7), 2200)], REASON_STALE);
        }
    }
}

/// A copy that begins elsewhere is the controller of that start, down to its last bit.
fn begins_alike<const N: usize>(name: &str) {
    let text = format!(
        "name = \"t\"\nrobot = \"{name}\"\n[start]\nposture = \"x\"\n[servo]\nduration_s = 60.0\n"
    );
    let scenario = Scenario::parse("t.toml", &text, &[]).unwrap();
    let robot = robot(name);
    let model = Model::<N>::new(robot, None).unwrap();
    let starts = [
        robot.middle(),
        robot.postures.values().next().unwrap().clone(),
    ];
    let [from, to] = starts.map(|q| model::embedded::<N>(&q) * 0.9);
    let made = |q| Controller::new(model.clone(), robot, &scenario, q).unwrap();
    let mut begun = made(from);
    begun.begin(to);
    assert_eq!(format!("{begun:?}"), format!("{:?}", made(to)), "{name}");
}

#[test]
fn a_steered_law_begins_in_any_posture_as_if_made_for_it() {
    begins_alike::<6>("puma560");
    begins_alike::<6>("ur5");
    begins_alike::<6>("planar3r");
    begins_alike::<7>("iiwa14");
    begins_alike::<7>("panda");
}

/// In a wrist's lock, about ζ and beside it: an arm without formulas turns ζ out of the way, and then the hand as far as it is asked to.
#[test]
fn a_turn_about_a_lost_direction_is_made_on_an_arm_without_formulas() {
    let start = "q_deg = [10, -40, 25, 20, 0, 60]\n[analysis]\nnumeric = true";
    let model = Model::<6>::new(robot("puma560"), None).unwrap();
    let pose = |q: &Joints<6>| model.forward_kinematics(q).R;
    let from = Joints::from([10.0, -40.0, 25.0, 20.0, 0.0, 60.0_f64]).map(f64::to_radians);
    for beside_deg in [0.0_f64, 2.0, 10.0, 30.0] {
        // ζ is z4×z5: in the hand's axes, a turn by −q6 of the forearm's −x.
        let (sin, cos) = (60.0 + beside_deg).to_radians().sin_cos();
        let about = twist([0.0, 0.0, 0.0, 0.3 * cos, -0.3 * sin, 0.0], 10.0);
        let (state, [q, _]) = steer::<6>("puma560", start, &[(about, 4000)]).unwrap();
        let turned = rotation_log(&(pose(&q) * pose(&from).transpose())).norm();
        assert!(
            turned > 0.9 * 1.2,
            "{beside_deg}° beside ζ: {turned} of 1.2 rad, {state:?}"
        );
    }
}

/// ζ is turned by joints 4 and 6 against each other; joint 6 is near the end of its range. Where the near way round has no room, the far one is taken, or
/// all joints stop together: nothing else turns the hand.
#[test]
fn a_joint_that_ends_a_null_motion_ends_it_for_all_joints() {
    let model = Model::<6>::new(robot("puma560"), None).unwrap();
    let pose = |q: &Joints<6>| model.forward_kinematics(q).R;
    for (q6, sense, numeric) in [1.0, -1.0]
        .into_iter()
        .flat_map(|q6| [1.0, -1.0].map(|sense| (255.0 * q6, sense)))
        .flat_map(|(q6, sense)| [true, false].map(|numeric| (q6, sense, numeric)))
    {
        let start = format!("q_deg = [10, -40, 25, 20, 0, {q6}]\n[analysis]\nnumeric = {numeric}");
        let from = Joints::from([10.0, -40.0, 25.0, 20.0, 0.0, q6].map(f64::to_radians));
        let (sin, cos) = q6.to_radians().sin_cos();
        let axis = Vector3::new(sense * cos, -sense * sin, 0.0);
        let about = twist([0.0, 0.0, 0.0, 0.3 * axis.x, 0.3 * axis.y, 0.0], 10.0);
        let (_, [q, _]) = steer::<6>("puma560", &start, &[(about, 4000)]).unwrap();
        let turned = rotation_log(&(pose(&from).transpose() * pose(&q)));
        let aside = (turned - axis * axis.dot(&turned)).norm();
        assert!(
            aside < 0.02,
            "joint 6 at {q6}°, {sense}, numeric: {numeric}: turned by {aside} rad aside, {:?}",
            (turned, q)
        );
    }
}

/// The poses of a joint path from `from` to `to` in `time_s`, given at each tick: the arm's farthest distance from them, m, and for how many ticks it was
/// more than 12 mm away and said to follow.
fn poses_of_a_joint_path(name: &str, from: [f64; 7], to: [f64; 7], time_s: f64) -> (f64, usize) {
    let text = format!(
        "name = \"t\"\nrobot = \"{name}\"\n[start]\nq = {from:?}\n[servo]\nduration_s = 60.0\n"
    );
    let mut arm = Bench::<7>::new(&text);
    let (model, from, to) = (arm.model.clone(), Joints::from(from), Joints::from(to));
    let (mut farthest, mut untrue) = (0.0_f64, 0);
    for tick in 0..(time_s * 1000.0) as u64 {
        let [share, rate, _] = crate::quintic(tick as f64 * 1e-3, time_s);
        let asked = model.evaluate(&(from + (to - from) * share), &Joints::zeros());
        let R = Rotation3::from_matrix_unchecked(asked.X_BE.R);
        let turn = UnitQuaternion::from_rotation_matrix(&R);
        let target = TargetContent {
            kind: TARGET_POSE,
            given_tick: tick,
            valid_s: 0.1,
            twist: (asked.J * (to - from) * rate).into(),
            position: asked.X_BE.p.into(),
            quaternion: [turn.w, turn.i, turn.j, turn.k],
            ..Default::default()
        };
        let command = arm.command(Some(&target));
        let off = (asked.X_BE.p - model.forward_kinematics(&arm.q).p).norm();
        let is_said = command.session.unwrap().reason == REASON_FOLLOWING;
        (farthest, untrue) = (
            farthest.max(off),
            untrue + usize::from(off > 0.012 && is_said),
        );
        let reference = arm.controller.state.targets;
        (arm.q, arm.qdot) = (reference.q, reference.qdot);
    }
    (farthest, untrue)
}

#[test]
fn arms_with_a_spare_joint_follow_the_poses_of_a_joint_path_through_a_lock() {
    let bent = [-0.75, 0.37, -0.62, -1.81, -0.8, 2.38, -0.22];
    let stretched = [-0.75, 0.37, -0.62, -0.267, -0.8, 2.38, -0.22];
    let lock = [0.3, 0.0, 0.5, 1.2, 0.4, 0.0, 0.2];
    let beyond = [0.5, -0.3, 0.7, 0.95, 0.7, 0.2, 0.3];
    for (name, from, to, time_s) in [
        ("panda", bent, stretched, 6.0),
        ("iiwa14", lock, beyond, 4.0),
        ("panda", stretched, bent, 6.0),
    ] {
        let (farthest, untrue) = poses_of_a_joint_path(name, from, to, time_s);
        assert!(farthest < 0.003, "{name} from {from:?}: {farthest} m");
        assert_eq!(untrue, 0, "{name} from {from:?}");
    }
}

#[test]
fn an_arm_that_is_not_where_it_should_be_is_not_said_to_follow() {
    // 0.4 m away at once: for a while nothing but the session's acceleration keeps the arm from being there.
    let bent = [0.0, -0.5, 0.0, -2.2, 0.0, 1.8, 0.8];
    let (farthest, untrue) = poses_of_a_joint_path("panda", bent, bent.map(|q| q + 0.3), 0.4);
    assert!(farthest > 0.05 && untrue == 0, "{farthest} m, {untrue}");
}

/// A PUMA in wrist lock, 5 mm above a spring of 20 N/mm, under a target for so many s: the mean and the largest error of the force in the last second, N, how
/// far the hand has gone, m, and the session's state.
fn pressed(force: [f64; 3], seconds: f64) -> (f64, f64, Vector3, ServoState) {
    let start = "q_deg = [10, -40, 25, 20, 0, 60]\n[servo]\nduration_s = 60.0\n[[plant.surface]]\npoint_m = [0, 0, 0]";
    let text = format!("name = \"t\"\nrobot = \"puma560\"\n[start]\n{start}\n");
    let mut arm = Bench::<6>::new(&text);
    let begun = arm.model.forward_kinematics(&arm.q).p;
    let ticks = (seconds * 1000.0) as u64;
    let (mut sum, mut most, mut state) = (0.0, 0.0_f64, ServoState::default());
    for tick in 0..ticks {
        let depth = begun.z - 0.005 - arm.model.forward_kinematics(&arm.q).p.z;
        let wrist = Vector6::z() * (2e4 * depth.max(0.0));
        let target = TargetContent {
            kind: TARGET_TWIST,
            given_tick: tick,
            valid_s: 0.1,
            twist: [0.02, 0.0, 0.0, 0.0, 0.0, 0.0],
            force,
            ..Default::default()
        };
        let command = arm.pressed(Some(&wrist), Some(&target));
        state = command.session.unwrap();
        arm.moves(&(command.tau + arm.model.jacobian(&arm.q).tr_mul(&wrist)));
        if tick + 1000 >= ticks {
            let error = (wrist.z - 10.0).abs();
            (sum, most) = (sum + error, most.max(error));
        }
    }
    let gone = arm.model.forward_kinematics(&arm.q).p - begun;
    (sum / 1000.0, most, gone, state)
}

#[test]
fn a_steered_hand_presses_as_its_target_asks_and_moves_across() {
    let (mean, most, gone, state) = pressed([0.0, 0.0, -10.0], 5.0);
    assert!(
        mean < 0.1 && most < 0.5 && gone.x > 0.09,
        "{mean} {most} {gone} {state:?}"
    );
    assert_eq!((state.refused, state.stops), (0, 0));
}

#[test]
fn a_steered_hand_gives_a_force_up_that_meets_nothing_and_refuses_one_beyond_its_joints() {
    let (_, _, gone, state) = pressed([0.0, 0.0, 10.0], 6.0);
    assert_eq!((state.stops, state.stop), (1, REFUSAL_CONTACT));
    assert!((0.04..0.06).contains(&gone.z) && gone.x > 0.05, "{gone}");
    let (_, _, gone, state) = pressed([0.0, 0.0, -900.0], 1.0);
    assert!(state.refused > 900 && state.refusal == TARGET_REFUSAL_FORCE);
    assert!(gone.z.abs() < 1e-4, "{gone}");
}
