//! Two algorithms, or an algorithm and a numerical derivative, for every quantity and every arm.

use crate::lanes::{Row, Twos};
use crate::{Model, Robot, RobotText};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use proptest::prelude::*;

/// Step of the central differences, s or rad: at joint speeds of 3 rad/s their truncation stays near 1e-9 of the values, their rounding
/// near 1e-12.
const H: f64 = 3e-4;
/// Tolerance of central differences, relative to the values (or to 1).
const NUMERIC: f64 = 1e-7;
/// Tolerance between two exact algorithms, relative to the values (or to 1).
const EXACT: f64 = 1e-12;

/// Joints of every kind, axes in odd directions, inertias with all products, fixed links with mass.
pub(super) const ODD: &str = r#"
<robot name="odd">
  <link name="ground"/>
  <link name="a"><inertial><origin xyz="0.1 -0.2 0.05" rpy="0.3 0.1 -0.4"/><mass value="3"/>
    <inertia ixx="0.03" ixy="0.002" ixz="-0.004" iyy="0.04" iyz="0.003" izz="0.05"/></inertial></link>
  <link name="b"><inertial><origin xyz="0 0.1 0.2" rpy="0 0.2 0"/><mass value="2"/>
    <inertia ixx="0.02" ixy="-0.003" ixz="0.001" iyy="0.03" iyz="0.002" izz="0.025"/></inertial></link>
  <link name="weight"><inertial><origin xyz="0.02 0 0.03" rpy="0.1 0.2 0.3"/><mass value="1.5"/>
    <inertia ixx="0.004" ixy="0.001" ixz="0" iyy="0.005" iyz="0" izz="0.006"/></inertial></link>
  <link name="c"><inertial><origin xyz="0.1 0 0" rpy="0 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.012" iyz="0.001" izz="0.011"/></inertial></link>
  <link name="tool"/>
  <joint name="turn" type="revolute"><parent link="ground"/><child link="a"/><origin xyz="0.1 0.2 0.3" rpy="0.4 -0.2 0.7"/>
    <axis xyz="1 -2 0.5"/><limit lower="-3" upper="3" effort="50" velocity="2"/></joint>
  <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0 0.3 0.1" rpy="-0.5 0.3 0.2"/>
    <axis xyz="0.3 0.4 -1"/><limit lower="-3" upper="3" effort="50" velocity="2"/></joint>
  <joint name="bolt" type="fixed"><parent link="b"/><child link="weight"/><origin xyz="0.05 0.1 0.15" rpy="0.6 0.1 -0.2"/></joint>
  <joint name="spin" type="continuous"><parent link="weight"/><child link="c"/><origin xyz="0.2 -0.1 0" rpy="1.1 0 0.3"/>
    <axis xyz="-1 0 0"/><dynamics damping="0.5" friction="0.1"/></joint>
  <joint name="grip" type="fixed"><parent link="c"/><child link="tool"/><origin xyz="0.1 0.05 0.2" rpy="0 0.4 0.1"/></joint>
</robot>"#;

pub(super) fn odd() -> Robot {
    let description = "[joints.slide]\narmature = 0.7\n".to_owned();
    Robot::from_source(&RobotText {
        name: "odd".to_owned(),
        description,
        urdf: ODD.to_owned(),
    })
    .unwrap()
}

fn close<const R: usize, const C: usize>(
    what: &str,
    tolerance: f64,
    ours: SMatrix<f64, R, C>,
    other: SMatrix<f64, R, C>,
) -> Result<(), TestCaseError> {
    let (deviation, allowed) = ((ours - other).amax(), tolerance * other.amax().max(1.0));
    prop_assert!(
        deviation <= allowed,
        "{what}: off by {deviation:e}, {allowed:e} allowed\n{ours}{other}"
    );
    Ok(())
}

/// f′(0), by central differences of fourth order.
fn slope<const R: usize, const C: usize>(
    f: impl Fn(f64) -> SMatrix<f64, R, C>,
) -> SMatrix<f64, R, C> {
    (8.0 * (f(H) - f(-H)) - (f(2.0 * H) - f(-2.0 * H))) / (12.0 * H)
}

/// All digits of all numbers, signs of zeros too.
fn bits(value: &impl std::fmt::Debug) -> String {
    format!("{value:?}")
}

/// ω of a rotation with Ṙ = [ω]×·R.
fn angular(Rdot: Matrix3<f64>, R: Matrix3<f64>) -> Vector3<f64> {
    let W = Rdot * R.transpose();
    Vector3::new(
        W[(2, 1)] - W[(1, 2)],
        W[(0, 2)] - W[(2, 0)],
        W[(1, 0)] - W[(0, 1)],
    ) / 2.0
}

/// Registers of this width, or the widest that this processor has: the same bits.
fn same_bits<const N: usize, R: Row<N>>(
    model: &Model<N>,
    [q, qdot, tau]: [&SVector<f64, N>; 3],
) -> Result<(), TestCaseError> {
    let mut terms = model.evaluate(&SVector::zeros(), &SVector::zeros());
    model.evaluate_anywhere::<R>(q, qdot, &mut terms);
    prop_assert!(bits(&terms) == bits(&model.evaluate(q, qdot)));
    prop_assert!(bits(&model.motion_anywhere::<R>(q, qdot)) == bits(&model.motion(q, qdot)));
    prop_assert!(
        bits(&model.qddot_anywhere::<R>(q, qdot, tau))
            == bits(&model.forward_dynamics(q, qdot, tau))
    );
    let advanced = model.advance_anywhere::<R>(
        &[*q, *qdot],
        tau,
        tau,
        &model.viscous_friction().abs(),
        1e-3,
    );
    prop_assert!(
        bits(&advanced)
            == bits(&model.advance(
                &[*q, *qdot],
                tau,
                tau,
                &model.viscous_friction().abs(),
                1e-3
            ))
    );
    prop_assert!(bits(&model.mass_matrix_anywhere::<R>(q)) == bits(&model.mass_matrix(q)));
    let torques =
        model.torques_anywhere::<R>(q, qdot, Some(tau)) + model.armature().component_mul(tau);
    prop_assert!(bits(&torques) == bits(&model.inverse_dynamics(q, qdot, tau)));
    Ok(())
}

fn identities<const N: usize>(
    robot: &Robot,
    frame: Option<&str>,
    state: &[f64],
) -> Result<(), TestCaseError> {
    let model = Model::<N>::new(robot, frame).unwrap();
    let [q, qdot, tau] =
        [0, 1, 2].map(|k| SVector::<f64, N>::from_column_slice(&state[k * 7..k * 7 + N]));
    let zero = SVector::<f64, N>::zeros();
    let unit = |i: usize| SVector::<f64, N>::from_fn(|j, _| f64::from(u8::from(i == j)));
    let terms = model.evaluate(&q, &qdot);

    // Dynamics: composite bodies, Newton–Euler and articulated bodies.
    let A = terms.A;
    close("A, CRBA", EXACT, A, model.mass_matrix(&q))?;
    let columns: [SVector<f64, N>; N] =
        std::array::from_fn(|i| model.inverse_dynamics(&q, &zero, &unit(i)) - model.gravity(&q));
    close("A, RNEA", EXACT, A, SMatrix::from_columns(&columns))?;
    close("g", EXACT, terms.gravity, model.gravity(&q))?;
    close("C q̇ + g", EXACT, terms.bias(), model.bias(&q, &qdot))?;
    let cholesky = A.cholesky();
    prop_assert!(cholesky.is_some(), "A is not positive definite: {A}");
    let qddot = model.forward_dynamics(&q, &qdot, &tau);
    close(
        "q̈, ABA",
        1e-10,
        qddot,
        cholesky.unwrap().solve(&(tau - terms.bias())),
    )?;
    close(
        "τ, there and back",
        1e-11,
        model.inverse_dynamics(&q, &qdot, &qddot),
        tau,
    )?;

    // Dynamics: energies.
    let energy = |q: &SVector<f64, N>| SVector::<f64, 1>::new(model.potential_energy(q));
    for i in 0..N {
        let numeric = slope(|h| energy(&(q + h * unit(i))));
        close(
            "g = ∂V/∂q",
            NUMERIC,
            SVector::<f64, 1>::new(terms.gravity[i]),
            numeric,
        )?;
    }
    // Ȧ − 2C is skew: q̇ᵀ·C·q̇ = ½·q̇ᵀ·Ȧ·q̇.
    let Adot = slope(|h| model.mass_matrix(&(q + h * qdot)));
    let power = SVector::<f64, 1>::new(qdot.dot(&terms.coriolis));
    close(
        "passivity",
        NUMERIC,
        power,
        0.5 * qdot.transpose() * Adot * qdot,
    )?;
    let kinetic = model.kinetic_energy(&q, &qdot);
    prop_assert!((kinetic - 0.5 * qdot.dot(&(A * qdot))).abs() <= EXACT * kinetic.max(1.0));

    // One pass or several: the same bits.
    let motion = model.motion(&q, &qdot);
    prop_assert_eq!(motion.X_BE, model.forward_kinematics(&q));
    prop_assert_eq!(motion.V_BE, model.jacobian(&q) * qdot);
    prop_assert_eq!(motion.energy, kinetic + model.potential_energy(&q));
    prop_assert_eq!(
        (motion.A, motion.bias),
        (model.mass_matrix(&q), model.bias(&q, &qdot))
    );
    prop_assert_eq!(motion.qddot(&tau), qddot);
    close("q̈ of the terms", 1e-10, terms.qddot(&tau), qddot)?;

    same_bits::<N, Twos<N>>(&model, [&q, &qdot, &tau])?;
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        same_bits::<N, crate::lanes::Fours<N>>(&model, [&q, &qdot, &tau])?;
    }

    // Kinematics of the end-effector frame.
    let X = model.forward_kinematics(&q);
    close("X_BE.p", EXACT, terms.X_BE.p, X.p)?;
    close("X_BE.R", EXACT, terms.X_BE.R, X.R)?;
    close(
        "X_BE.R is a rotation",
        EXACT,
        X.R * X.R.transpose(),
        Matrix3::identity(),
    )?;
    close("J", EXACT, terms.J, model.jacobian(&q))?;
    for i in 0..N {
        let at = |h: f64| model.forward_kinematics(&(q + h * unit(i)));
        let (v, w) = (slope(|h| at(h).p), angular(slope(|h| at(h).R), X.R));
        close(
            "J, linear",
            NUMERIC,
            terms.J.fixed_view::<3, 1>(0, i).into_owned(),
            v,
        )?;
        close(
            "J, angular",
            NUMERIC,
            terms.J.fixed_view::<3, 1>(3, i).into_owned(),
            w,
        )?;
    }
    let Jdot = slope(|h| model.jacobian(&(q + h * qdot)));
    close("J̇ q̇", NUMERIC, terms.Jdot_qdot, Jdot * qdot)?;

    // Kinematics of the links, moving at constant q̇.
    let moved = |h: f64| model.evaluate(&(q + h * qdot), &qdot);
    let poses = model.link_poses(&q);
    for (i, X) in poses.iter().enumerate() {
        close("p", EXACT, terms.p[i], X.p)?;
        close("z", EXACT, terms.z[i], X.R * robot.joints[i].axis)?;
        close("ṗ", NUMERIC, terms.pdot[i], slope(|h| moved(h).p[i]))?;
        close(
            "p̈",
            NUMERIC,
            terms.pddot_bias[i],
            slope(|h| moved(h).pdot[i]),
        )?;
        let Rdot = slope(|h| model.link_poses(&(q + h * qdot))[i].R);
        close("ω", NUMERIC, terms.omega[i], angular(Rdot, X.R))?;
        close(
            "α",
            NUMERIC,
            terms.alpha_bias[i],
            slope(|h| moved(h).omega[i]),
        )?;
    }
    Ok(())
}

/// det J of the geometry is the product of the factors, at the wrist and with a tool.
fn factors(robot: &str, q: &[f64]) -> Result<(), TestCaseError> {
    let robot = Robot::builtin(robot).unwrap();
    let product = robot.factors.determinant(q).unwrap();
    for frame in ["ee", "flange"] {
        let model = Model::<6>::new(&robot, Some(frame)).unwrap();
        let det = model.jacobian(&SVector::from_column_slice(q)).determinant();
        prop_assert!(
            (det - product).abs() < 1e-15,
            "{frame}: {det:e}, {product:e}"
        );
    }
    Ok(())
}

/// Three vectors of up to seven.
fn state() -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(-3.0..3.0, 21)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn puma560(state in state()) {
        identities::<6>(&Robot::builtin("puma560").unwrap(), None, &state)?;
    }

    #[test]
    fn puma560_ideal(state in state()) {
        identities::<6>(&Robot::builtin("puma560-ideal").unwrap(), Some("flange"), &state)?;
    }

    #[test]
    fn planar3r(state in state()) {
        identities::<3>(&Robot::builtin("planar3r").unwrap(), None, &state)?;
    }

    #[test]
    fn ur5(state in state()) {
        identities::<6>(&Robot::builtin("ur5").unwrap(), None, &state)?;
    }

    #[test]
    fn iiwa14(state in state()) {
        identities::<7>(&Robot::builtin("iiwa14").unwrap(), None, &state)?;
    }

    #[test]
    fn odd_joints(state in state()) {
        identities::<3>(&odd(), None, &state)?;
    }

    #[test]
    fn frames_within_the_chain(state in state()) {
        identities::<7>(&Robot::builtin("iiwa14").unwrap(), Some("link4"), &state)?;
        identities::<3>(&odd(), Some("weight"), &state)?;
        identities::<3>(&odd(), Some("ground"), &state)?;
    }

    #[test]
    fn det_J_is_the_product_of_its_factors(q in proptest::collection::vec(-3.2..3.2, 6)) {
        factors("puma560", &q)?;
        factors("puma560-ideal", &q)?;
    }
}

/// In a larger size an arm computes the same numbers in its own places; absent joints are decoupled and at rest.
fn embedding<const N: usize, const M: usize>(
    robot: &Robot,
    state: &[f64],
) -> Result<(), TestCaseError> {
    let (own, large) = (
        Model::<N>::new(robot, None).unwrap(),
        Model::<M>::new(robot, None).unwrap(),
    );
    let [q, qdot, tau] =
        [0, 1, 2].map(|k| SVector::<f64, N>::from_column_slice(&state[k * 7..k * 7 + N]));
    let [Q, Qdot, Tau] = [q, qdot, tau].map(|values| crate::embedded::<M>(values.as_slice()));
    let (a, b) = (own.evaluate(&q, &qdot), large.evaluate(&Q, &Qdot));
    for i in 0..M {
        for j in 0..M {
            let expected = if i < N && j < N {
                a.A[(i, j)]
            } else {
                f64::from(u8::from(i == j))
            };
            prop_assert_eq!(b.A[(i, j)], expected);
        }
        let column = if i < N {
            a.J.column(i).into_owned()
        } else {
            nalgebra::Vector6::zeros()
        };
        prop_assert_eq!(b.J.column(i).into_owned(), column);
        prop_assert_eq!(b.bias()[i], if i < N { a.bias()[i] } else { 0.0 });
    }
    prop_assert_eq!((a.X_BE, a.Jdot_qdot), (b.X_BE, b.Jdot_qdot));
    prop_assert_eq!((large.mass_matrix(&Q), large.jacobian(&Q)), (b.A, b.J));
    let qddot = own.forward_dynamics(&q, &qdot, &tau);
    prop_assert_eq!(
        large.forward_dynamics(&Q, &Qdot, &Tau),
        crate::embedded::<M>(qddot.as_slice())
    );
    prop_assert_eq!(
        large.inverse_dynamics(&Q, &Qdot, &crate::embedded(qddot.as_slice())),
        crate::embedded::<M>(own.inverse_dynamics(&q, &qdot, &qddot).as_slice())
    );
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_larger_size_gives_the_same_numbers(state in state()) {
        embedding::<2, 6>(&Robot::builtin("planar2r").unwrap(), &state)?;
        embedding::<3, 6>(&odd(), &state)?;
        embedding::<6, 8>(&Robot::builtin("puma560").unwrap(), &state)?;
    }
}

/// Undriven, the arm keeps its energy: 1 s of RK4 at 0.25 ms.
#[test]
fn energy_is_conserved() {
    fn drift<const N: usize>(robot: &Robot) -> f64 {
        let model = Model::<N>::new(robot, None).unwrap();
        let mut q = SVector::<f64, N>::from_fn(|i, _| 0.4 + 0.3 * i as f64);
        let mut v = SVector::<f64, N>::from_fn(|i, _| 1.0 - 0.4 * i as f64);
        let energy = |q: &_, v: &_| model.kinetic_energy(q, v) + model.potential_energy(q);
        let acceleration = |q: &_, v: &_| model.forward_dynamics(q, v, &SVector::zeros());
        let (start, dt) = (energy(&q, &v), 0.25e-3);
        for _ in 0..4000 {
            let (v1, a1) = (v, acceleration(&q, &v));
            let (v2, a2) = (
                v + 0.5 * dt * a1,
                acceleration(&(q + 0.5 * dt * v1), &(v + 0.5 * dt * a1)),
            );
            let (v3, a3) = (
                v + 0.5 * dt * a2,
                acceleration(&(q + 0.5 * dt * v2), &(v + 0.5 * dt * a2)),
            );
            let (v4, a4) = (v + dt * a3, acceleration(&(q + dt * v3), &(v + dt * a3)));
            q += dt / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
            v += dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
        }
        assert!(
            (q - SVector::from_fn(|i, _| 0.4 + 0.3 * i as f64)).amax() > 0.3,
            "the arm has moved"
        );
        (energy(&q, &v) - start).abs()
    }
    for (name, drift) in [
        ("puma560", drift::<6>(&Robot::builtin("puma560").unwrap())),
        ("planar3r", drift::<3>(&Robot::builtin("planar3r").unwrap())),
        ("ur5", drift::<6>(&Robot::builtin("ur5").unwrap())),
        ("iiwa14", drift::<7>(&Robot::builtin("iiwa14").unwrap())),
        ("odd", drift::<3>(&odd())),
    ] {
        println!("{name}: energy drift {drift:.1e} J");
        assert!(drift < 1e-8, "{name}: {drift:e} J");
    }
}

/// A quarter turn in a URDF is one exactly: at wrist lock, z4 and z6 are the same vector.
#[test]
fn wrist_lock_is_exact() {
    let model = Model::<6>::new(&Robot::builtin("puma560").unwrap(), None).unwrap();
    let q = SVector::from([0.3, -0.7, 2.0, 0.6, 0.0, -0.4]);
    let z = model.evaluate(&q, &SVector::zeros()).z;
    assert_eq!(z[3], z[5]);
}

/// A tool moves the end-effector frame and nothing else.
#[test]
fn tools_move_the_frame() {
    let robot = Robot::builtin("puma560").unwrap();
    let wrist = Model::<6>::new(&robot, Some("ee")).unwrap();
    let flange = Model::<6>::new(&robot, Some("flange")).unwrap();
    let X_EF = robot.frame("flange").unwrap().X_LF;
    let q = SVector::from([0.3, -0.7, 2.0, 0.6, 0.9, -0.4]);
    assert_eq!(
        wrist.with_tool(&X_EF).evaluate(&q, &q),
        flange.evaluate(&q, &q)
    );
}
