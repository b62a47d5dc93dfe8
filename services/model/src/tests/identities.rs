//! Two algorithms, or an algorithm and a numerical derivative, for every quantity and every arm.

use super::{ODD, load};
use crate::lanes::Plain;
use crate::{ArmMotion, Model, Robot, Terms, embedded};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3, vector};
use proptest::prelude::*;

/// Step of the central differences, s or rad: at joint speeds of 3 rad/s their truncation stays near 1e-9 of the values, their rounding
/// near 1e-12.
const H: f64 = 3e-4;
/// Tolerance of central differences, relative to the values (or to 1).
const NUMERIC: f64 = 1e-7;
/// Tolerance between two exact algorithms, relative to the values (or to 1).
const EXACT: f64 = 1e-12;

type Checked = Result<(), TestCaseError>;

pub(super) fn odd() -> Robot {
    load(ODD, "[joints.slide]\narmature = 0.7\n").unwrap()
}

fn close<const R: usize, const C: usize>(
    what: &str,
    tolerance: f64,
    ours: SMatrix<f64, R, C>,
    other: SMatrix<f64, R, C>,
) -> Checked {
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

/// The angular velocity of a rotation that is R(0) now.
fn spin(R: impl Fn(f64) -> Matrix3<f64>) -> Vector3<f64> {
    let W = slope(&R) * R(0.0).transpose();
    let double = W - W.transpose();
    vector![double.m32, double.m13, double.m21] / 2.0
}

/// The unit vector of joint i.
fn unit<const N: usize>(i: usize) -> SVector<f64, N> {
    SVector::from_fn(|j, _| f64::from(u8::from(i == j)))
}

/// q, q̇ and τ of a state.
fn split<const N: usize>(state: &[f64]) -> [SVector<f64, N>; 3] {
    [0, 7, 14].map(|at| SVector::from_column_slice(&state[at..at + N]))
}

/// Composite bodies against Newton and Euler, and both against energies.
fn dynamics<const N: usize>(model: &Model<N>, state: &[f64]) -> Checked {
    let [q, qdot, tau] = split::<N>(state);
    let zero = SVector::zeros();
    let terms = model.evaluate(&q, &qdot);
    let A = terms.A;
    close("A, CRBA", EXACT, A, model.mass_matrix(&q))?;
    let columns: [_; N] = std::array::from_fn(|i| {
        model.inverse_dynamics(&q, &zero, &unit(i)) - model.inverse_dynamics(&q, &zero, &zero)
    });
    close("A, RNEA", EXACT, A, SMatrix::from_columns(&columns))?;
    close("g", EXACT, terms.gravity, model.bias(&q, &zero))?;
    close("g alone", EXACT, terms.gravity, model.gravity(&q))?;
    close("C q̇ + g", EXACT, terms.bias(), model.bias(&q, &qdot))?;
    let cholesky = A.cholesky();
    prop_assert!(cholesky.is_some(), "A is not positive definite: {A}");
    let expected = cholesky.unwrap().solve(&(tau - terms.bias()));
    let qddot = model.forward_dynamics(&q, &qdot, &tau);
    close("q̈", 1e-10, qddot, expected)?;
    close("q̈ of the terms", 1e-10, terms.qddot(&tau), qddot)?;
    close("τ", 1e-11, model.inverse_dynamics(&q, &qdot, &qddot), tau)?;

    for i in 0..N {
        let numeric = slope(|h| vector![model.potential_energy(&(q + h * unit(i)))]);
        close("∂V/∂q", NUMERIC, vector![terms.gravity[i]], numeric)?;
    }
    // Ȧ − 2C is skew: q̇ᵀ·C·q̇ = ½·q̇ᵀ·Ȧ·q̇.
    let Adot = slope(|h| model.mass_matrix(&(q + h * qdot)));
    let power = vector![qdot.dot(&terms.coriolis)];
    close(
        "passivity",
        NUMERIC,
        power,
        0.5 * qdot.transpose() * Adot * qdot,
    )?;

    // One pass or several: the same bits.
    let motion = model.motion(&q, &qdot);
    let apart = ArmMotion {
        X_BE: model.forward_kinematics(&q),
        V_BE: model.jacobian(&q) * qdot,
        energy: model.kinetic_energy(&q, &qdot) + model.potential_energy(&q),
        A: model.mass_matrix(&q),
        bias: model.bias(&q, &qdot),
    };
    prop_assert_eq!(motion, apart);
    prop_assert_eq!(motion.qddot(&tau), qddot);
    Ok(())
}

/// The end-effector's and the links' motion against differences of their poses.
fn kinematics<const N: usize>(robot: &Robot, model: &Model<N>, state: &[f64]) -> Checked {
    let [q, qdot, _] = split::<N>(state);
    let terms = model.evaluate(&q, &qdot);
    let X = model.forward_kinematics(&q);
    close("X_BE.p", EXACT, terms.X_BE.p, X.p)?;
    close("X_BE.R", EXACT, terms.X_BE.R, X.R)?;
    let square = X.R * X.R.transpose();
    close("X_BE.R is a rotation", EXACT, square, Matrix3::identity())?;
    close("J", EXACT, terms.J, model.jacobian(&q))?;
    for i in 0..N {
        let at = |h: f64| model.forward_kinematics(&(q + h * unit(i)));
        let (v, w) = (slope(|h| at(h).p), spin(|h| at(h).R));
        let column = terms.J.column(i);
        close("J, linear", NUMERIC, column.fixed_rows::<3>(0).into(), v)?;
        close("J, angular", NUMERIC, column.fixed_rows::<3>(3).into(), w)?;
    }
    let Jdot = slope(|h| model.jacobian(&(q + h * qdot)));
    close("J̇ q̇", NUMERIC, terms.Jdot_qdot, Jdot * qdot)?;

    let moved = |h: f64| model.evaluate(&(q + h * qdot), &qdot);
    let poses = |h: f64| model.link_poses(&(q + h * qdot));
    for (i, X) in poses(0.0).iter().enumerate() {
        close("p", EXACT, terms.p[i], X.p)?;
        close("z", EXACT, terms.z[i], X.R * robot.joints[i].axis)?;
        close("ṗ", NUMERIC, terms.pdot[i], slope(|h| moved(h).p[i]))?;
        close(
            "p̈",
            NUMERIC,
            terms.pddot_bias[i],
            slope(|h| moved(h).pdot[i]),
        )?;
        close("ω", NUMERIC, terms.omega[i], spin(|h| poses(h)[i].R))?;
        close(
            "α",
            NUMERIC,
            terms.alpha_bias[i],
            slope(|h| moved(h).omega[i]),
        )?;
    }
    Ok(())
}

/// Arrays, or the widest registers that this processor has: the same bits.
fn same_bits<const N: usize>(model: &Model<N>, state: &[f64]) -> Checked {
    let [q, qdot, tau] = &split::<N>(state);
    let mut terms = Terms::zero();
    model.evaluate_anywhere::<Plain<N>>(q, qdot, &mut terms);
    let bits = |value: &dyn std::fmt::Debug| format!("{value:?}");
    prop_assert_eq!(bits(&terms), bits(&model.evaluate(q, qdot)));
    let motion = model.motion_anywhere::<Plain<N>>(q, qdot);
    prop_assert_eq!(bits(&motion), bits(&model.motion(q, qdot)));
    let qddot = model.qddot_anywhere::<Plain<N>>(q, qdot, tau);
    prop_assert_eq!(bits(&qddot), bits(&model.forward_dynamics(q, qdot, tau)));
    let (x, friction) = (&[*q, *qdot], &tau.abs());
    let next = model.advance_anywhere::<Plain<N>>(x, tau, tau, friction, 1e-3);
    prop_assert_eq!(
        bits(&next),
        bits(&model.advance(x, tau, tau, friction, 1e-3))
    );
    let torques = model.torques_anywhere::<Plain<N>>(q, qdot, Some(tau));
    let torques = torques + model.armature().component_mul(tau);
    prop_assert_eq!(bits(&torques), bits(&model.inverse_dynamics(q, qdot, tau)));
    Ok(())
}

fn identities<const N: usize>(robot: &Robot, frame: Option<&str>, state: &[f64]) -> Checked {
    let model = Model::<N>::new(robot, frame).unwrap();
    same_bits(&model, state)?;
    dynamics(&model, state)?;
    kinematics(robot, &model, state)
}

/// In a larger size an arm computes the same numbers in its own places; absent joints are decoupled and at rest.
fn embedding<const N: usize, const M: usize>(robot: &Robot, state: &[f64]) -> Checked {
    let own = Model::<N>::new(robot, None).unwrap();
    let large = Model::<M>::new(robot, None).unwrap();
    let [q, qdot, tau] = split::<N>(state);
    let wide = |values: &SVector<f64, N>| embedded::<M>(values.as_slice());
    let [Q, Qdot, Tau] = [q, qdot, tau].map(|values| wide(&values));
    let (a, b) = (own.evaluate(&q, &qdot), large.evaluate(&Q, &Qdot));
    let mut A = SMatrix::<f64, M, M>::identity();
    A.view_mut((0, 0), (N, N)).copy_from(&a.A);
    let mut J = SMatrix::<f64, 6, M>::zeros();
    J.columns_mut(0, N).copy_from(&a.J);
    prop_assert_eq!((b.A, b.J, b.bias()), (A, J, wide(&a.bias())));
    prop_assert_eq!((a.X_BE, a.Jdot_qdot), (b.X_BE, b.Jdot_qdot));
    prop_assert_eq!((large.mass_matrix(&Q), large.jacobian(&Q)), (A, J));
    let qddot = own.forward_dynamics(&q, &qdot, &tau);
    prop_assert_eq!(large.forward_dynamics(&Q, &Qdot, &Tau), wide(&qddot));
    prop_assert_eq!(
        large.inverse_dynamics(&Q, &Qdot, &wide(&qddot)),
        wide(&own.inverse_dynamics(&q, &qdot, &qddot))
    );
    Ok(())
}

/// Three vectors of up to seven.
fn state() -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(-3.0..3.0, 21)
}

fn builtin(name: &str) -> Robot {
    Robot::builtin(name).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 100, ..ProptestConfig::default() })]

    #[test]
    fn algorithms_check_each_other(state in state()) {
        identities::<6>(&builtin("puma560"), None, &state)?;
        identities::<6>(&builtin("puma560-ideal"), Some("flange"), &state)?;
        identities::<3>(&builtin("planar3r"), None, &state)?;
        identities::<6>(&builtin("ur5"), None, &state)?;
        identities::<7>(&builtin("iiwa14"), None, &state)?;
        identities::<7>(&builtin("iiwa14"), Some("link4"), &state)?;
        for frame in [None, Some("weight"), Some("ground")] {
            identities::<3>(&odd(), frame, &state)?;
        }
    }

    /// det J of the geometry is the product of the factors, at the wrist and with a tool.
    #[test]
    fn det_J_is_the_product_of_its_factors(state in state()) {
        let [q, ..] = split::<6>(&state);
        for robot in ["puma560", "puma560-ideal"].map(builtin) {
            let product = robot.factors.determinant(q.as_slice()).unwrap();
            for frame in ["ee", "flange"] {
                let det = Model::new(&robot, Some(frame)).unwrap().jacobian(&q).determinant();
                prop_assert!((det - product).abs() < 1e-15, "{frame}: {det:e}, {product:e}");
            }
        }
    }

    #[test]
    fn a_larger_size_gives_the_same_numbers(state in state()) {
        embedding::<2, 6>(&builtin("planar2r"), &state)?;
        embedding::<3, 6>(&odd(), &state)?;
        embedding::<6, 8>(&builtin("puma560"), &state)?;
    }
}

/// A quarter turn in a URDF is one exactly: at wrist lock, z4 and z6 are the same vector.
#[test]
fn wrist_lock_is_exact() {
    let model = Model::<6>::new(&builtin("puma560"), None).unwrap();
    let q = vector![0.3, -0.7, 2.0, 0.6, 0.0, -0.4];
    let Terms { z, .. } = model.evaluate(&q, &SVector::zeros());
    assert_eq!(z[3], z[5]);
}

/// A tool moves the end-effector frame and nothing else.
#[test]
fn tools_move_the_frame() {
    let robot = builtin("puma560");
    let at = |frame| Model::<6>::new(&robot, Some(frame)).unwrap();
    let X_EF = robot.frame("flange").unwrap().X_LF;
    let q = vector![0.3, -0.7, 2.0, 0.6, 0.9, -0.4];
    let with_tool = at("ee").with_tool(&X_EF);
    assert_eq!(with_tool.evaluate(&q, &q), at("flange").evaluate(&q, &q));
}
