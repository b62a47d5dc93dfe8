//! 200 states each of the PUMA 560 and the planar arm against pinocchio (see `tests/golden/README.md`).

use crate::{Model, Robot};
use nalgebra::{SMatrix, SVector};
use serde_json::Value;

/// Every quantity agrees to this, relative to the largest element of its kind over all states (or to 1).
const TOLERANCE: f64 = 1e-13;

fn rows(value: &Value) -> Vec<Vec<f64>> {
    value.as_array().unwrap().iter().map(numbers).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect()
}

fn vector<const N: usize>(value: &Value) -> SVector<f64, N> {
    SVector::from_column_slice(&numbers(value))
}

fn matrix<const R: usize, const C: usize>(value: &Value) -> SMatrix<f64, R, C> {
    SMatrix::from_row_slice(&rows(value).concat())
}

/// Largest deviation and largest magnitude of each quantity.
#[derive(Default)]
struct Worst(std::collections::BTreeMap<&'static str, (f64, f64)>);

impl Worst {
    fn see<const R: usize, const C: usize>(
        &mut self,
        quantity: &'static str,
        ours: SMatrix<f64, R, C>,
        theirs: SMatrix<f64, R, C>,
    ) {
        let (deviation, magnitude) = self.0.entry(quantity).or_default();
        let difference = (ours - theirs).amax();
        assert!(difference.is_finite(), "{quantity}");
        *deviation = deviation.max(difference);
        *magnitude = magnitude.max(theirs.amax());
    }
}

fn check<const N: usize>(robot: &str, text: &str) {
    let data: Value = serde_json::from_str(text).unwrap();
    let model = Model::<N>::new(&Robot::builtin(robot).unwrap(), Some("ee")).unwrap();
    assert_eq!(numbers(&data["gravity"]), model.gravity_vector().as_slice());
    assert_eq!(numbers(&data["armature"]), model.armature().as_slice());
    let mut worst = Worst::default();
    let states = data["states"].as_array().unwrap();
    assert_eq!(states.len(), 200);
    for s in states {
        let [q, qdot, qddot, tau] = ["q", "qd", "qdd", "tau_in"].map(|key| vector::<N>(&s[key]));
        let terms = model.evaluate(&q, &qdot);
        worst.see("M", terms.A, matrix(&s["M"]));
        worst.see("M (CRBA)", model.mass_matrix(&q), matrix(&s["M"]));
        worst.see("nle", terms.bias(), vector(&s["nle"]));
        worst.see("nle (RNEA)", model.bias(&q, &qdot), vector(&s["nle"]));
        worst.see("g", terms.gravity, vector(&s["g"]));
        worst.see("g (alone)", model.gravity(&q), vector(&s["g"]));
        worst.see("Cqd", terms.coriolis, vector(&s["Cqd"]));
        worst.see("J", terms.J, matrix(&s["J"]));
        worst.see("J (alone)", model.jacobian(&q), matrix(&s["J"]));
        worst.see("Jdot_qd", terms.Jdot_qdot, vector(&s["Jdot_qd"]));
        worst.see("ee_pos", terms.X_BE.p, vector(&s["ee_pos"]));
        worst.see("ee_R", terms.X_BE.R, matrix(&s["ee_R"]));
        worst.see(
            "ee_R (FK)",
            model.forward_kinematics(&q).R,
            matrix(&s["ee_R"]),
        );
        worst.see(
            "tau_rnea",
            model.inverse_dynamics(&q, &qdot, &qddot),
            vector(&s["tau_rnea"]),
        );
        worst.see(
            "qdd_fd",
            model.forward_dynamics(&q, &qdot, &tau),
            vector(&s["qdd_fd"]),
        );
    }
    for (quantity, (deviation, magnitude)) in worst.0 {
        println!("{robot:9} {quantity:11} worst {deviation:.1e} of {magnitude:.1e}");
        assert!(
            deviation <= TOLERANCE * magnitude.max(1.0),
            "{robot} {quantity}: {deviation:e} of {magnitude:e}"
        );
    }
}

#[test]
fn puma560_agrees_with_pinocchio() {
    check::<6>(
        "puma560",
        include_str!("../../../../tests/golden/reference_puma560.json"),
    );
}

#[test]
fn planar3r_agrees_with_pinocchio() {
    check::<3>(
        "planar3r",
        include_str!("../../../../tests/golden/reference_planar3.json"),
    );
}
