//! The plant as a whole: free motion, energy, contact, stops, friction, repeatability.

use crate::hybrid::STOP_DEPTH;
use crate::smooth::{Smooth, State};
use crate::{Plant, PlantError};
use model::{JointKind, Model, Robot};
use nalgebra::{SVector, Vector3};
use shared_types::scenario::{self, PlantModel};
use std::sync::LazyLock;

mod contact;

type Joints = SVector<f64, 6>;

const RATE: u32 = 1000;

fn puma() -> Robot {
    static PUMA: LazyLock<Robot> = LazyLock::new(|| Robot::builtin("puma560").unwrap());
    PUMA.clone()
}

/// The PUMA without joint limits: its motion is free wherever it goes.
fn free_puma() -> Robot {
    let mut robot = puma();
    for joint in &mut robot.joints {
        (joint.kind, joint.lower, joint.upper) =
            (JointKind::Continuous, f64::NEG_INFINITY, f64::INFINITY);
    }
    robot
}

fn nominal() -> Joints {
    static NOMINAL: LazyLock<Joints> =
        LazyLock::new(|| Joints::from_column_slice(&puma().postures["nominal"]));
    *NOMINAL
}

fn options(model: PlantModel) -> scenario::Plant {
    scenario::Plant {
        model,
        floor_m: None,
        ..scenario::Plant::default()
    }
}

fn plant(robot: &Robot, options: &scenario::Plant, q: &Joints) -> Plant<6> {
    Plant::new(robot, None, options, RATE, q).unwrap()
}

/// A torque that swings the arm about: gravity's share and a slow wave.
fn waving(arm: &Model<6>, tick: u32) -> Joints {
    let t = f64::from(tick) / f64::from(RATE);
    let wave = |i: usize| libm::sin(2.0 * t + i as f64) * [20.0, 40.0, 15.0, 3.0, 2.0, 2.0][i];
    arm.gravity(&nominal()) * 0.7 + Joints::from_fn(|i, _| wave(i))
}

#[test]
fn free_motion_is_that_of_a_far_finer_integration() {
    let robot = free_puma();
    let arm = Model::<6>::new(&robot, None).unwrap();
    let mut hybrid = plant(&robot, &options(PlantModel::Rapier), &nominal());
    let smooth = Smooth {
        model: arm.clone(),
        viscous: Joints::zeros(),
    };
    let mut fine = State::at_rest(nominal());
    for tick in 0..2 * RATE {
        let tau = waving(&arm, tick);
        hybrid.step(&tau).unwrap();
        fine = (0..40).fold(fine, |x, _| smooth.rk4(&x, &tau, 1e-3 / 40.0));
    }
    assert!((hybrid.state().q - nominal()).amax() > 1.0, "it did move");
    let error = (hybrid.state().q - fine.q).amax();
    println!("free motion after 2 s: {error:.2e} rad from 40 steps of order 4 a tick");
    assert!(error < 1e-11, "{error:e}");
}

#[test]
fn without_torque_energy_is_conserved() {
    let mut hybrid = plant(&free_puma(), &options(PlantModel::Rapier), &nominal());
    let before = hybrid.energy();
    let mut worst: f64 = 0.0;
    for _ in 0..2 * RATE {
        hybrid.step(&Joints::zeros()).unwrap();
        worst = worst.max((hybrid.energy() - before).abs());
    }
    let kinetic = hybrid
        .model()
        .kinetic_energy(&hybrid.state().q, &hybrid.state().qdot);
    println!("energy drift {worst:.2e} J with {kinetic:.1} J in motion");
    assert!(
        worst < 1e-8 && kinetic > 5.0,
        "drift {worst:e} J, kinetic {kinetic} J"
    );
}

#[test]
fn viscous_friction_takes_out_what_it_should() {
    let with = scenario::Plant {
        friction: true,
        ..options(PlantModel::Rapier)
    };
    let mut robot = free_puma();
    robot
        .joints
        .iter_mut()
        .for_each(|joint| joint.coulomb_friction = 0.0);
    let mut arm = plant(&robot, &with, &nominal());
    let smooth = Smooth {
        model: Model::new(&robot, None).unwrap(),
        viscous: *arm.model().viscous_friction(),
    };
    let mut lost = 0.0;
    let before = arm.energy();
    for _ in 0..RATE {
        let power = |x: &State<6>| x.qdot.component_mul(&x.qdot).dot(&smooth.viscous);
        let middle = smooth.rk4(arm.state(), &Joints::zeros(), 0.5e-3);
        let start = power(arm.state());
        arm.step(&Joints::zeros()).unwrap();
        lost += (start + 4.0 * power(&middle) + power(arm.state())) * (1e-3 / 6.0); // Simpson
    }
    assert!(
        lost > 1.0 && (before - arm.energy() - lost).abs() < 1e-7 * lost,
        "{} J of {lost} J",
        before - arm.energy()
    );
}

/// Runs two plants of the same arm side by side, one of them asking rapier3d at every sub-step: every bit is equal.
fn agrees_with_always_asking(
    robot: &Robot,
    options: &scenario::Plant,
    start: State<6>,
    ticks: u32,
    tau: impl Fn(&Plant<6>, u32) -> Joints,
) -> Plant<6> {
    let mut sparing = plant(robot, options, &nominal());
    let mut always = plant(robot, options, &nominal());
    always.always_ask();
    sparing.set_state(start);
    always.set_state(start);
    for tick in 0..ticks {
        let tau = tau(&sparing, tick);
        sparing.step(&tau).unwrap();
        always.step(&tau).unwrap();
        assert_eq!(sparing.state(), always.state(), "tick {tick}");
        assert_eq!(sparing.touch(), always.touch(), "tick {tick}");
    }
    sparing
}

#[test]
fn where_rapier_is_not_asked_it_would_have_had_nothing_to_say() {
    let world = scenario::Plant {
        floor_m: Some(-0.3),
        ..options(PlantModel::Rapier)
    };
    let arm = Model::<6>::new(&puma(), None).unwrap();
    // Freely about; then into the floor and the stops, and out again, several times.
    let low = scenario::Plant {
        floor_m: Some(-0.9),
        ..options(PlantModel::Rapier)
    };
    let free = agrees_with_always_asking(
        &free_puma(),
        &low,
        State::at_rest(nominal()),
        600,
        |_, k| waving(&arm, k),
    );
    assert_eq!(free.touch().contacts, 0);
    let bouncing = |plant: &Plant<6>, tick: u32| {
        let x = plant.state();
        let lift = plant.model().bias(&x.q, &x.qdot) + (nominal() - x.q) * 60.0 - x.qdot * 20.0;
        if tick % 1200 < 600 { -x.qdot } else { lift }
    };
    let mut touched = false;
    let mut apart = false;
    let mut sparing = plant(&puma(), &world, &nominal());
    for tick in 0..2400 {
        sparing.step(&bouncing(&sparing, tick)).unwrap();
        touched |= sparing.touch().contacts > 0 || sparing.touch().limits != 0;
        apart |= touched && sparing.touch().contacts == 0 && sparing.touch().limits == 0;
    }
    assert!(touched && apart, "the scenario has contact and leaves it");
    agrees_with_always_asking(&puma(), &world, State::at_rest(nominal()), 2400, bouncing);
}

#[test]
fn two_runs_are_the_same_to_the_last_bit() {
    let world = scenario::Plant {
        floor_m: Some(-0.3),
        friction: true,
        ..options(PlantModel::Rapier)
    };
    let run = || {
        let mut arm = plant(&puma(), &world, &nominal());
        let mut trace = Vec::new();
        for _ in 0..800 {
            arm.step(&Joints::zeros()).unwrap();
            trace.extend(
                arm.state()
                    .q
                    .iter()
                    .chain(arm.state().qdot.iter())
                    .chain(arm.touch().force.iter())
                    .map(|x| x.to_bits()),
            );
        }
        assert!(arm.touch().contacts > 0);
        trace
    };
    assert!(run() == run());
}

/// One joint that turns a rod about −y: its end goes up with q, and the floor is below.
fn rod(length: f64, mass: f64) -> Robot {
    let mut robot = Robot::builtin("planar3r").unwrap();
    robot.joints.truncate(1);
    robot
        .frames
        .retain(|frame| frame.joint.is_none_or(|i| i == 0));
    robot.default_frame = robot
        .frames
        .iter()
        .rev()
        .find(|frame| frame.joint == Some(0))
        .unwrap()
        .name
        .clone();
    robot.gravity = Vector3::new(0.0, 0.0, -9.81);
    robot.shapes = vec![model::Shape {
        joint: Some(0),
        X_LS: model::Pose::translation(Vector3::new(length, 0.0, 0.0)),
        geometry: model::Geometry::Sphere { radius: 0.05 },
        colour: None,
    }];
    let joint = &mut robot.joints[0];
    joint.axis = -Vector3::y();
    (joint.mass, joint.com, joint.inertia) = (
        mass,
        Vector3::new(length / 2.0, 0.0, 0.0),
        nalgebra::Matrix3::identity() * 0.1,
    );
    robot
}

#[test]
fn a_resting_arm_presses_on_the_floor_with_the_weight_it_must() {
    let (length, mass, height) = (1.0, 4.0, -0.3);
    let world = scenario::Plant {
        floor_m: Some(height),
        ..scenario::Plant::default()
    };
    let mut arm = Plant::<1>::new(
        &rod(length, mass),
        None,
        &world,
        RATE,
        &SVector::<f64, 1>::new(0.0),
    )
    .unwrap();
    let zero = SVector::<f64, 1>::zeros();
    let tip = |arm: &Plant<1>| length * libm::sin(arm.state().q[0]) - 0.05 - height;
    let (mut deepest, mut impact): (f64, f64) = (0.0, 0.0);
    for _ in 0..3 * RATE {
        arm.step(&zero).unwrap();
        deepest = deepest.min(tip(&arm));
        impact = impact.max(arm.state().qdot[0].abs());
    }
    // Moments about the joint: F_z·length·cos q = m·g·(length/2)·cos q, and F acts below the sphere's centre.
    let q = arm.state().q[0];
    let expected = mass * 9.81 / 2.0;
    let touch = arm.touch();
    let (at_x, at_z) = (length * libm::cos(q), length * libm::sin(q) - 0.05);
    let moment = at_x * touch.force.z - at_z * touch.force.x;
    println!(
        "floor force {:.6} N for {expected} N upright, moment error {:.2e} N·m, at rest {:.2e} m deep, {:.2e} m at impact at {impact:.2} rad/s, speed {:.2e}",
        touch.force.z,
        moment - expected * at_x,
        -tip(&arm),
        -deepest,
        arm.state().qdot[0].abs()
    );
    assert_eq!(touch.contacts, 1);
    assert!(
        (moment - expected * at_x).abs() < 1e-4 * expected,
        "moment {moment} N·m, not {}",
        expected * at_x
    );
    assert!(arm.state().qdot[0].abs() < 1e-6, "at rest");
    assert!(tip(&arm).abs() < 1e-5, "rests {} m deep", -tip(&arm));
    assert!(deepest > -1e-3, "sank {} m in at the impact", -deepest);
}

#[test]
fn a_pushed_arm_presses_back_with_the_push() {
    // The PUMA is lowered onto the floor and pressed down by a torque on joint 2 on top of gravity compensation.
    let (floor, press) = (-0.3, 15.0);
    let world = scenario::Plant {
        floor_m: Some(floor),
        ..options(PlantModel::Rapier)
    };
    let mut arm = plant(&puma(), &world, &nominal());
    let mut extra = Joints::zeros();
    for _ in 0..4 * RATE {
        let x = *arm.state();
        let posture = (nominal() - x.q) * 300.0 - x.qdot * 40.0;
        extra = Joints::from_fn(|i, _| {
            if i == 1 {
                press - 40.0 * x.qdot[1]
            } else {
                posture[i]
            }
        });
        arm.step(&(arm.model().gravity(&x.q) + extra)).unwrap();
    }
    let (touch, x) = (*arm.touch(), *arm.state());
    println!(
        "pressed: {touch:?}, speed {:.1e}, extra {extra:?}",
        x.qdot.amax()
    );
    assert!(touch.contacts > 0 && touch.limits == 0 && x.qdot.amax() < 1e-5);
    // At rest the contact's moment about every joint before it balances the extra torque: z_i·((P − p_i) × F) = −τ_i, for one
    // point P on the floor. Two joints give P, the third checks it.
    let X = arm.model().link_poses(&x.q);
    let F = touch.force;
    let row = |i: usize| {
        let (z, p) = (X[i].R.column(2).into_owned(), X[i].p);
        let cross = F.cross(&z); // z·((P − p) × F) = (P − p)·(F × z)
        (cross, -extra[i] + p.dot(&cross) - cross.z * floor)
    };
    let (a, b, c) = (row(0), row(1), row(2));
    let P = nalgebra::Matrix2::new(a.0.x, a.0.y, b.0.x, b.0.y)
        .lu()
        .solve(&nalgebra::Vector2::new(a.1, b.1))
        .unwrap();
    let residual = c.0.x * P.x + c.0.y * P.y - c.1;
    println!("contact at {P:?}, residual {residual:.1e} N·m");
    assert!(
        F.z > 5.0 && residual.abs() < 1e-3 * press,
        "residual {residual} N·m"
    );
}

#[test]
fn a_joint_driven_into_its_stop_stays_there() {
    let mut arm = plant(&puma(), &options(PlantModel::Rapier), &nominal());
    let upper = puma().joints[0].upper;
    let (mut beyond, mut fastest): (f64, f64) = (0.0, 0.0);
    let mut settled: f64 = 0.0;
    for tick in 0..4 * RATE {
        let x = *arm.state();
        let hold = (nominal() - x.q) * 200.0 - x.qdot * 40.0;
        let mut tau = arm.model().bias(&x.q, &x.qdot) + hold;
        tau[0] += 20.0 - hold[0];
        arm.step(&tau).unwrap();
        beyond = beyond.max(arm.state().q[0] - upper);
        fastest = fastest.max(arm.state().qdot[0]);
        if tick > 3 * RATE {
            settled = settled.max(arm.state().qdot[0].abs());
            assert_eq!(arm.touch().limits, 1, "tick {tick}");
        }
    }
    println!(
        "stop hit at {fastest:.2} rad/s: {beyond:.2e} rad beyond, then {settled:.2e} rad/s, {:.2e} rad",
        arm.state().q[0] - upper
    );
    assert!(fastest > 1.0, "it hit hard: {fastest} rad/s");
    // One sub-step of free motion goes by before rapier3d sees that the joint is beyond.
    assert!(
        beyond < fastest * 0.25e-3 + STOP_DEPTH,
        "{beyond} rad beyond"
    );
    assert!((arm.state().q[0] - upper).abs() < 10.0 * STOP_DEPTH);
    assert!(settled < 1e-6, "still moving at {settled} rad/s");
    // And it comes off again.
    for _ in 0..RATE / 2 {
        let mut tau = arm.model().bias(&arm.state().q, &arm.state().qdot);
        tau[0] -= 5.0;
        arm.step(&tau).unwrap();
    }
    assert!(arm.state().q[0] < upper - 0.1 && arm.touch().limits == 0);
}

#[test]
fn dry_friction_stops_and_holds_as_coulomb_says() {
    let mut robot = puma();
    robot.gravity = Vector3::zeros();
    let with = scenario::Plant {
        friction: true,
        ..options(PlantModel::Rapier)
    };
    robot
        .joints
        .iter_mut()
        .for_each(|joint| joint.viscous_friction = 0.0);
    // Joint 1 alone, the others held straight by symmetry of rest: A_11·q̈ = −c.
    let mut arm = plant(&robot, &with, &nominal());
    let c = robot.joints[0].coulomb_friction;
    let mut start = State::at_rest(nominal());
    // Below breakaway nothing moves.
    for _ in 0..500 {
        arm.step(&Joints::new(0.9 * c, 0.0, 0.0, 0.0, 0.0, 0.0))
            .unwrap();
    }
    let crept = (arm.state().q - nominal()).amax();
    println!("crept {crept:.1e} rad in 0.5 s at 0.9 of breakaway");
    assert!(crept < 1e-6);
    // Sliding: energy is lost at the rate Σ c·|q̇|.
    start.qdot[0] = 1.0;
    start.qdot[4] = 1.5;
    arm.set_state(start);
    let before = arm.energy();
    let mut lost = 0.0;
    let loss = |x: &State<6>| {
        (0..6)
            .map(|i| robot.joints[i].coulomb_friction * x.qdot[i].abs())
            .sum::<f64>()
    };
    for _ in 0..100 {
        let power = loss(arm.state());
        arm.step(&Joints::zeros()).unwrap();
        lost += 0.5e-3 * (power + loss(arm.state()));
    }
    let error = (before - arm.energy() - lost).abs() / lost;
    println!("dry friction: {lost:.4} J lost, {error:.1e} of it unaccounted for");
    assert!(error < 1e-3);
    for _ in 0..2000 {
        arm.step(&Joints::zeros()).unwrap();
    }
    assert!(arm.state().qdot.amax() < 1e-6, "it comes to rest");
}

#[test]
fn dry_friction_is_that_of_rapier() {
    let arm = Model::<6>::new(&puma(), None).unwrap();
    let with = scenario::Plant {
        friction: true,
        floor_m: Some(-0.9),
        ..options(PlantModel::Rapier)
    };
    let [mut own, mut rapiers] = [0, 1].map(|_| plant(&free_puma(), &with, &nominal()));
    rapiers.always_ask();
    for tick in 0..500 {
        let tau = waving(&arm, tick);
        own.step(&tau).unwrap();
        rapiers.step(&tau).unwrap();
    }
    let (moved, error) = (
        (own.state().q - nominal()).amax(),
        (own.state().q - rapiers.state().q).amax(),
    );
    println!("dry friction: {error:.1e} rad from rapier3d's after {moved:.2} rad");
    assert!(
        moved > 0.2 && error < 1e-6,
        "{error:e} rad after {moved} rad"
    );
}

#[test]
fn other_rates_and_sub_steps_work() {
    let robot = free_puma();
    let fall = |rate: u32, substeps: u32| {
        let options = scenario::Plant {
            substeps,
            ..options(PlantModel::Rapier)
        };
        let mut arm = Plant::<6>::new(&robot, None, &options, rate, &nominal()).unwrap();
        (0..rate / 2).for_each(|_| arm.step(&Joints::zeros()).unwrap());
        arm.state().q
    };
    let fine = fall(4000, 4);
    for (rate, substeps, bound) in [
        (250, 8, 1e-8),
        (500, 4, 1e-8),
        (1000, 1, 1e-7),
        (2000, 2, 1e-9),
    ] {
        let error = (fall(rate, substeps) - fine).amax();
        assert!(
            error < bound,
            "{rate} Hz, {substeps} sub-steps: {error:e} rad"
        );
    }
}

#[test]
fn every_built_in_arm_and_one_with_massless_links_can_be_simulated() {
    for name in ["puma560", "puma560-ideal"] {
        let mut robot = Robot::builtin(name).unwrap();
        let zero = Joints::from_column_slice(&robot.postures["nominal"]);
        let world = scenario::Plant {
            floor_m: Some(-0.3),
            self_collision: true,
            ..options(PlantModel::Rapier)
        };
        for _ in 0..2 {
            let mut arm = plant(&robot, &world, &zero);
            (0..1500).for_each(|_| arm.step(&Joints::zeros()).unwrap());
            assert!(
                arm.touch().contacts > 0 && arm.state().is_finite(),
                "{name}: {:?}",
                arm.touch()
            );
            // Next time with a massless wrist: only armature carries its joints.
            for joint in &mut robot.joints[3..] {
                (joint.mass, joint.inertia) = (0.0, nalgebra::Matrix3::zeros());
            }
        }
    }
    let robot = Robot::builtin("planar3r").unwrap();
    let bent = SVector::<f64, 3>::from_column_slice(&robot.postures["bent"]);
    let mut arm = Plant::<3>::new(&robot, None, &scenario::Plant::default(), RATE, &bent).unwrap();
    (0..1000).for_each(|_| arm.step(&SVector::zeros()).unwrap());
    assert!(arm.state().is_finite());
}

#[test]
fn motion_diverges_before_its_energy_is_no_number() {
    let robot = Robot::builtin("planar3r").unwrap();
    let bent = SVector::<f64, 3>::from_column_slice(&robot.postures["bent"]);
    for model in [PlantModel::Rapier, PlantModel::Reference] {
        let options = scenario::Plant {
            model,
            ..scenario::Plant::default()
        };
        let mut arm = Plant::<3>::new(&robot, None, &options, RATE, &bent).unwrap();
        // An arm without limits, pushed ever harder.
        let diverged = (0..400).find(|k| {
            let is_over = arm
                .step(&SVector::from([10_f64.powi(*k), 0.0, -(10_f64.powi(*k))]))
                .is_err();
            assert!(
                arm.energy().is_finite() && arm.state().is_finite(),
                "{:?}",
                arm.state()
            );
            is_over
        });
        assert!(diverged.is_some());
    }
}

#[test]
fn rapier_has_the_same_arm() {
    // At rest, where first-order terms vanish, rapier's acceleration is the model's: masses, inertias, axes, armature.
    let robot = puma();
    let arm = Model::<6>::new(&robot, None).unwrap();
    let tau = Joints::new(10.0, -20.0, 5.0, 1.0, 2.0, -3.0);
    let h = 0.25e-3;
    let mut world = crate::world::World::<6>::new(
        &robot,
        &nominal(),
        &arm.link_poses(&nominal()),
        None,
        false,
        false,
        h,
    )
    .unwrap();
    for k in 0..20 {
        let q = nominal() + Joints::from_fn(|i, _| libm::sin((k * 6 + i) as f64) * 0.5);
        let response = world.step(&State::at_rest(q), &tau, h);
        let exact = arm.forward_dynamics(&q, &Joints::zeros(), &tau);
        let error = (response.free / h - exact).amax() / exact.amax();
        assert!(error < 1e-6, "posture {k}: {error:e}");
    }
}

#[test]
fn an_arm_that_cannot_be_simulated_is_refused_with_a_reason() {
    let refused = |robot: &Robot, options: &scenario::Plant, q: &Joints| {
        Plant::<6>::new(robot, None, options, RATE, q)
            .map(|_| ())
            .unwrap_err()
            .to_string()
    };
    let floor = scenario::Plant {
        floor_m: Some(0.2),
        ..options(PlantModel::Rapier)
    };
    assert!(refused(&puma(), &floor, &nominal()).contains("starts in the floor at z = 0.2 m"));
    let dry = scenario::Plant {
        friction: true,
        ..options(PlantModel::Reference)
    };
    assert!(refused(&puma(), &dry, &nominal()).contains("no dry friction"));
    for (mass_factor, substeps) in [(0.0, 4), (-1.0, 4), (f64::NAN, 4), (1.0, 0)] {
        let odd = scenario::Plant {
            mass_factor,
            substeps,
            ..options(PlantModel::Rapier)
        };
        assert!(refused(&puma(), &odd, &nominal()).contains("plant."));
    }
    let beyond = nominal() + Joints::new(10.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    assert!(refused(&puma(), &options(PlantModel::Rapier), &beyond).contains("outside its limits"));
    let mut odd = puma();
    odd.joints[2].inertia[(0, 0)] = -0.1;
    assert!(refused(&odd, &options(PlantModel::Rapier), &nominal()).contains("principal inertia"));
    let mut weightless = puma();
    for joint in &mut weightless.joints[5..] {
        (joint.mass, joint.inertia, joint.armature) = (0.0, nalgebra::Matrix3::zeros(), 0.0);
    }
    assert!(refused(&weightless, &options(PlantModel::Rapier), &nominal()).contains("singular"));
    assert!(matches!(
        Plant::<5>::new(
            &puma(),
            None,
            &options(PlantModel::Rapier),
            RATE,
            &SVector::zeros()
        ),
        Err(PlantError::Model(_))
    ));
}

#[test]
fn an_absurd_torque_leaves_the_last_finite_state() {
    let mut arm = plant(&free_puma(), &options(PlantModel::Reference), &nominal());
    let before = *arm.state();
    assert!(arm.step(&Joints::repeat(f64::MAX)).is_err());
    assert_eq!(*arm.state(), before);
}

#[test]
fn the_mass_factor_makes_the_arm_heavier() {
    let heavy = scenario::Plant {
        mass_factor: 1.1,
        ..options(PlantModel::Rapier)
    };
    let (plain, heavy) = (
        plant(&puma(), &options(PlantModel::Rapier), &nominal()),
        plant(&puma(), &heavy, &nominal()),
    );
    let ratio = heavy.model().gravity(&nominal()).norm() / plain.model().gravity(&nominal()).norm();
    assert!((ratio - 1.1).abs() < 1e-12);
    assert_eq!(heavy.model().armature(), plain.model().armature());
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(200))]

    /// The clearance bound holds: no point moves farther than Σ reach·|Δq|.
    #[test]
    fn no_point_of_the_arm_outruns_its_reach(q in proptest::array::uniform6(-3.0f64..3.0), d in proptest::array::uniform6(-0.5f64..0.5)) {
        let (robot, arm) = (puma(), Model::<6>::new(&puma(), None).unwrap());
        let solids = crate::solids::solids(&robot);
        let reach = crate::solids::reach::<6>(&robot, &solids);
        let (q, d) = (Joints::from(q), Joints::from(d));
        let bound: f64 = (0..6).map(|i| reach[i] * d[i].abs()).sum();
        let (before, after) = (arm.link_poses(&q), arm.link_poses(&(q + d)));
        for solid in solids.iter().filter(|s| s.link.is_some()) {
            let i = solid.link.unwrap();
            for direction in [Vector3::x(), Vector3::y(), Vector3::z(), -Vector3::x(), -Vector3::y(), -Vector3::z()] {
                let p = direction * solid.reach;
                let moved = (after[i].transform_point(&p) - before[i].transform_point(&p)).norm();
                proptest::prop_assert!(moved <= bound * (1.0 + 1e-12) + 1e-12, "{moved} > {bound}");
            }
        }
    }
}
