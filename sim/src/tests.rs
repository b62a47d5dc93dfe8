//! The plant as a whole: free motion, energy, contact, stops, friction, repeatability.

use crate::hybrid::STOP_DEPTH;
use crate::smooth::{Smooth, State};
use crate::surface::Surfaces;
use crate::world::World;
use crate::{Plant, PlantError};
use model::{JointKind, Model, Robot};
use nalgebra::{SVector, Vector3};
use shared_types::scenario::{Plant as Options, PlantModel, Surface};
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
        joint.kind = JointKind::Continuous;
        (joint.lower, joint.upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    robot
}

fn nominal() -> Joints {
    static NOMINAL: LazyLock<Joints> =
        LazyLock::new(|| Joints::from_column_slice(&puma().postures["nominal"]));
    *NOMINAL
}

/// rapier's world, with or without a floor at a height, and friction.
fn world(floor_m: Option<f64>, friction: bool) -> Options {
    Options {
        floor_m,
        friction,
        ..Options::default()
    }
}

/// A free arm under Runge–Kutta alone.
fn reference() -> Options {
    Options {
        model: PlantModel::Reference,
        ..world(None, false)
    }
}

/// `x` at joint i alone.
fn only(i: usize, x: f64) -> Joints {
    Joints::from_fn(|k, _| if k == i { x } else { 0.0 })
}

fn plant(robot: &Robot, options: &Options, q: &Joints) -> Plant<6> {
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
    let mut hybrid = plant(&robot, &world(None, false), &nominal());
    let smooth = Smooth {
        model: arm.clone(),
        viscous: Joints::zeros(),
        surfaces: Surfaces::default(),
    };
    let mut fine = State::at_rest(nominal());
    for tick in 0..2 * RATE {
        let tau = waving(&arm, tick);
        hybrid.step(&tau).unwrap();
        fine = (0..40).fold(fine, |x, _| smooth.rk4(&x, &tau, 1e-3 / 40.0));
    }
    assert!((hybrid.state().q - nominal()).amax() > 1.0, "it did move");
    let error = (hybrid.state().q - fine.q).amax();
    assert!(error < 1e-11, "{error:e}");
}

#[test]
fn viscous_friction_takes_out_what_it_should() {
    let mut robot = free_puma();
    robot
        .joints
        .iter_mut()
        .for_each(|joint| joint.coulomb_friction = 0.0);
    let mut arm = plant(&robot, &world(None, true), &nominal());
    let smooth = Smooth {
        model: Model::new(&robot, None).unwrap(),
        viscous: *arm.model().viscous_friction(),
        surfaces: Surfaces::default(),
    };
    let (mut lost, before) = (0.0, arm.energy());
    for _ in 0..RATE {
        let power = |x: &State<6>| x.qdot.component_mul(&x.qdot).dot(&smooth.viscous);
        let middle = smooth.rk4(arm.state(), &Joints::zeros(), 0.5e-3);
        let start = power(arm.state());
        arm.step(&Joints::zeros()).unwrap();
        lost += (start + 4.0 * power(&middle) + power(arm.state())) * (1e-3 / 6.0); // Simpson
    }
    let error = (before - arm.energy() - lost).abs();
    assert!(lost > 1.0 && error < 1e-7 * lost, "{error} J of {lost} J");
}

/// Runs two plants of the same arm side by side, one of them asking rapier3d at every sub-step: every bit is equal. Whether it touched something, and
/// was free again afterwards.
fn agrees_with_always_asking(
    robot: &Robot,
    options: &Options,
    ticks: u32,
    tau: impl Fn(&Plant<6>, u32) -> Joints,
) -> (bool, bool) {
    let [mut sparing, mut always] = [0, 1].map(|_| plant(robot, options, &nominal()));
    always.hybrid.as_mut().unwrap().always = true;
    let (mut touched, mut apart) = (false, false);
    for tick in 0..ticks {
        let tau = tau(&sparing, tick);
        sparing.step(&tau).unwrap();
        always.step(&tau).unwrap();
        assert_eq!(sparing.state(), always.state(), "tick {tick}");
        assert_eq!(sparing.touch(), always.touch(), "tick {tick}");
        let touches = sparing.touch().contacts > 0 || sparing.touch().limits != 0;
        touched |= touches;
        apart |= touched && !touches;
    }
    (touched, apart)
}

#[test]
fn where_rapier_is_not_asked_it_would_have_had_nothing_to_say() {
    let low = world(Some(-0.9), false);
    let free = |plant: &Plant<6>, tick| waving(plant.model(), tick);
    assert!(!agrees_with_always_asking(&free_puma(), &low, 600, free).0);
    // Into the floor and the stops, and out again, several times.
    let bouncing = |plant: &Plant<6>, tick: u32| {
        let x = plant.state();
        let lift = plant.model().bias(&x.q, &x.qdot) + (nominal() - x.q) * 60.0 - x.qdot * 20.0;
        if tick % 1200 < 600 { -x.qdot } else { lift }
    };
    let bounced = agrees_with_always_asking(&puma(), &world(Some(-0.3), false), 2400, bouncing);
    assert_eq!(bounced, (true, true));
}

/// One joint that turns a rod of 1 m and 4 kg about −y: its end, a sphere, goes up with q, and the floor is below.
fn rod() -> Robot {
    let urdf = r#"<robot name="rod"><link name="base"/><link name="rod"><inertial><origin xyz="0.5 0 0"/><mass value="4"/>
        <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
        <visual><origin xyz="1 0 0"/><geometry><sphere radius="0.05"/></geometry></visual></link>
        <joint name="turn" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 -1 0"/></joint></robot>"#;
    Robot::from_source(&model::RobotText {
        name: "rod".to_owned(),
        urdf: urdf.to_owned(),
        ..Default::default()
    })
    .unwrap()
}

#[test]
fn a_resting_arm_presses_on_the_floor_with_the_weight_it_must() {
    let (height, zero) = (-0.3, SVector::<f64, 1>::zeros());
    let mut arm = Plant::new(&rod(), None, &world(Some(height), false), RATE, &zero).unwrap();
    let tip = |arm: &Plant<1>| libm::sin(arm.state().q[0]) - 0.05 - height;
    let mut deepest: f64 = 0.0;
    for _ in 0..3 * RATE {
        arm.step(&zero).unwrap();
        deepest = deepest.min(tip(&arm));
    }
    // Moments about the joint: F_z·length·cos q = m·g·(length/2)·cos q, and F acts below the sphere's centre.
    let (x, touch) = (arm.state(), arm.touch());
    let (at_x, at_z) = (libm::cos(x.q[0]), libm::sin(x.q[0]) - 0.05);
    let weight = 4.0 * 9.81 / 2.0;
    let off = at_x * touch.force.z - at_z * touch.force.x - weight * at_x;
    assert_eq!(touch.contacts, 1);
    assert!(off.abs() < 1e-4 * weight, "{off} N·m too much");
    assert!(x.qdot[0].abs() < 1e-6, "at rest");
    assert!(tip(&arm).abs() < 1e-5, "rests {} m deep", -tip(&arm));
    assert!(deepest > -1e-3, "sank {} m in at the impact", -deepest);
}

/// The PUMA is lowered onto the floor and pressed down by a torque on joint 2 on top of gravity compensation.
#[test]
fn a_pushed_arm_presses_back_with_the_push() {
    let (floor, press) = (-0.3, 15.0);
    let mut arm = plant(&puma(), &world(Some(floor), false), &nominal());
    let mut extra = Joints::zeros();
    for _ in 0..4 * RATE {
        let x = *arm.state();
        extra = (nominal() - x.q) * 300.0 - x.qdot * 40.0;
        extra[1] = press - 40.0 * x.qdot[1];
        arm.step(&(arm.model().gravity(&x.q) + extra)).unwrap();
    }
    let (touch, x) = (*arm.touch(), *arm.state());
    assert!(touch.contacts > 0 && touch.limits == 0 && x.qdot.amax() < 1e-5);
    // At rest the contact's moment about every joint before it balances the extra torque: z_i·((P − p_i) × F) = −τ_i, for one
    // point P on the floor. Two joints give P, the third checks it.
    let (X, F) = (arm.model().link_poses(&x.q), touch.force);
    let row = |i: usize| {
        let cross = F.cross(&X[i].R.column(2)); // z·((P − p) × F) = (P − p)·(F × z)
        (cross, -extra[i] + X[i].p.dot(&cross) - cross.z * floor)
    };
    let (a, b, c) = (row(0), row(1), row(2));
    let P = nalgebra::Matrix2::new(a.0.x, a.0.y, b.0.x, b.0.y).lu();
    let P = P.solve(&nalgebra::Vector2::new(a.1, b.1)).unwrap();
    let residual = c.0.x * P.x + c.0.y * P.y - c.1;
    assert!(F.z > 5.0 && residual.abs() < 1e-3 * press, "{residual} N·m");
}

#[test]
fn a_joint_driven_into_its_stop_stays_there() {
    let mut arm = plant(&puma(), &world(None, false), &nominal());
    let upper = puma().joints[0].upper;
    let (mut beyond, mut fastest): (f64, f64) = (0.0, 0.0);
    for tick in 0..4 * RATE {
        let x = *arm.state();
        let mut hold = (nominal() - x.q) * 200.0 - x.qdot * 40.0;
        hold[0] = 20.0;
        arm.step(&(arm.model().bias(&x.q, &x.qdot) + hold)).unwrap();
        let x = arm.state();
        beyond = beyond.max(x.q[0] - upper);
        fastest = fastest.max(x.qdot[0]);
        if tick > 3 * RATE {
            assert!(x.qdot[0].abs() < 1e-6 && (x.q[0] - upper).abs() < 10.0 * STOP_DEPTH);
            assert_eq!(arm.touch().limits, 1, "tick {tick}");
        }
    }
    // One sub-step of free motion goes by before rapier3d sees that the joint is beyond.
    assert!(
        fastest > 1.0 && beyond < fastest * 0.25e-3 + STOP_DEPTH,
        "{beyond} rad"
    );
    // And it comes off again.
    for _ in 0..RATE / 2 {
        let bias = arm.model().bias(&arm.state().q, &arm.state().qdot);
        arm.step(&(bias - only(0, 5.0))).unwrap();
    }
    assert!(arm.state().q[0] < upper - 0.1 && arm.touch().limits == 0);
}

#[test]
fn dry_friction_is_that_of_rapier() {
    let [mut own, mut rapiers] =
        [0, 1].map(|_| plant(&free_puma(), &world(Some(-0.9), true), &nominal()));
    rapiers.hybrid.as_mut().unwrap().always = true;
    for tick in 0..500 {
        let tau = waving(own.model(), tick);
        own.step(&tau).unwrap();
        rapiers.step(&tau).unwrap();
    }
    let moved = (own.state().q - nominal()).amax();
    let error = (own.state().q - rapiers.state().q).amax();
    assert!(
        moved > 0.2 && error < 1e-6,
        "{error:e} rad after {moved} rad"
    );
}

#[test]
fn other_rates_and_sub_steps_work() {
    let robot = free_puma();
    let fall = |rate: u32, substeps: u32| {
        let options = Options {
            substeps,
            ..world(None, false)
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
fn an_arm_with_massless_links_can_be_simulated() {
    let mut robot = puma();
    let floor = Options {
        self_collision: true,
        ..world(Some(-0.3), false)
    };
    for _ in 0..2 {
        let mut arm = plant(&robot, &floor, &nominal());
        (0..1500).for_each(|_| arm.step(&Joints::zeros()).unwrap());
        assert!(arm.touch().contacts > 0 && arm.state().is_finite());
        // Next time with a massless wrist: only armature carries its joints.
        for joint in &mut robot.joints[3..] {
            (joint.mass, joint.inertia) = (0.0, nalgebra::Matrix3::zeros());
        }
    }
}

#[test]
fn motion_diverges_before_its_energy_is_no_number() {
    let robot = Robot::builtin("planar3r").unwrap();
    let bent = SVector::<f64, 3>::from_column_slice(&robot.postures["bent"]);
    for options in [world(None, false), reference()] {
        let mut arm = Plant::<3>::new(&robot, None, &options, RATE, &bent).unwrap();
        // An arm without limits, pushed ever harder.
        let diverged = (0..400).find(|k| {
            let (before, push) = (*arm.state(), 10_f64.powi(*k));
            let is_over = arm.step(&SVector::from([push, 0.0, -push])).is_err();
            assert!(arm.energy().is_finite() && arm.state().is_finite());
            assert!(!is_over || *arm.state() == before);
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
    let (options, h) = (world(None, false), 0.25e-3);
    let X_BL = arm.link_poses(&nominal());
    let mut world = World::new(&robot, &nominal(), &X_BL, &options, 1e-3).unwrap();
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
    let rapier = world(None, false);
    let dry = Options {
        friction: true,
        ..reference()
    };
    let over = Surface {
        point_m: [0.0, 0.0, 3.0],
        normal: [0.0, 0.0, 1.0],
        radius_m: None,
        stiffness_n_m: 2e4,
        damping_s_m: 5.0,
        friction: 0.2,
    };
    let under = Options {
        surface: vec![over],
        ..rapier.clone()
    };
    let mut negative = puma();
    negative.joints[2].inertia[(0, 0)] = -0.1;
    let mut weightless = puma();
    let last = &mut weightless.joints[5];
    (last.mass, last.inertia, last.armature) = (0.0, nalgebra::Matrix3::zeros(), 0.0);
    let beyond = nominal() + Joints::repeat(10.0);
    macro_rules! assert_refused {
        ($($robot:expr, $options:expr, $q:expr => $error:pat,)+) => {$(
            let found = Plant::<6>::new(&$robot, None, &$options, RATE, &$q).map(drop);
            assert!(matches!(found, Err($error)), "{found:?}");
        )+};
    }
    assert_refused! {
        puma(), world(Some(0.2), false), nominal() => PlantError::StartInFloor { .. },
        puma(), under, nominal() => PlantError::StartInSurface { surface: 0, .. },
        puma(), dry, nominal() => PlantError::DryFriction { .. },
        puma(), rapier, beyond => PlantError::Start(_),
        negative, rapier, nominal() => PlantError::NotRealisable { .. },
        weightless, rapier, nominal() => PlantError::SingularMass { .. },
        Robot::builtin("iiwa14").unwrap(), rapier, nominal() => PlantError::Model(_),
    }
}

#[test]
fn the_mass_factor_makes_the_arm_heavier() {
    let with = |mass_factor: f64| {
        let options = Options {
            mass_factor,
            ..world(None, false)
        };
        plant(&puma(), &options, &nominal())
    };
    let [plain, heavy] = [1.0, 1.1].map(|factor| *with(factor).model().armature());
    assert_eq!(plain, heavy);
    let [plain, heavy] = [1.0, 1.1].map(|factor| with(factor).model().gravity(&nominal()).norm());
    assert!((heavy / plain - 1.1).abs() < 1e-12);
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
        for solid in &solids {
            let Some(i) = solid.link else { continue };
            for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
                for p in [axis * solid.reach, -axis * solid.reach] {
                    let moved = (after[i].transform_point(&p) - before[i].transform_point(&p)).norm();
                    proptest::prop_assert!(moved <= bound * (1.0 + 1e-12) + 1e-12, "{moved} > {bound}");
                }
            }
        }
    }
}
