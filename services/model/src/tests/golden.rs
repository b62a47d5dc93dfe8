//! Arms against pinocchio and MuJoCo (see `tests/golden/README.md`).

use crate::{Model, Robot};
use nalgebra::{SMatrix, SVector};
use serde_json::Value;
use std::collections::BTreeMap;

/// Every quantity agrees to this, relative to the largest element of its kind over all states (or to 1).
const TOLERANCE: f64 = 1e-13;

/// The numbers of nested arrays, row by row.
fn numbers(value: &Value) -> Vec<f64> {
    match value.as_array() {
        Some(values) => values.iter().flat_map(numbers).collect(),
        None => vec![value.as_f64().unwrap()],
    }
}

fn rows<const R: usize, const C: usize>(matrix: SMatrix<f64, R, C>) -> Vec<f64> {
    matrix.transpose().as_slice().to_vec()
}

/// 200 states of a built-in arm.
fn check<const N: usize>(robot: &str, text: &str) {
    let data: Value = serde_json::from_str(text).unwrap();
    let source = Robot::builtin(robot).unwrap();
    let model = Model::<N>::new(&source, Some("ee")).unwrap();
    assert_eq!(numbers(&data["gravity"]), source.gravity.as_slice());
    assert_eq!(numbers(&data["armature"]), model.armature().as_slice());
    let states = data["states"].as_array().unwrap();
    assert_eq!(states.len(), 200);
    // Largest deviation and largest magnitude of each quantity.
    let mut worst = BTreeMap::<&str, (f64, f64)>::new();
    for s in states {
        let vector = |key: &str| SVector::<f64, N>::from_vec(numbers(&s[key]));
        let [q, qdot, qddot, tau] = ["q", "qd", "qdd", "tau_in"].map(vector);
        let t = model.evaluate(&q, &qdot);
        for (key, ours) in [
            ("M", rows(t.A)),
            ("nle", rows(t.bias())),
            ("g", rows(t.gravity)),
            ("Cqd", rows(t.coriolis)),
            ("J", rows(t.J)),
            ("Jdot_qd", rows(t.Jdot_qdot)),
            ("ee_pos", rows(t.X_BE.p)),
            ("ee_R", rows(t.X_BE.R)),
            ("tau_rnea", rows(model.inverse_dynamics(&q, &qdot, &qddot))),
            ("qdd_fd", rows(model.forward_dynamics(&q, &qdot, &tau))),
        ] {
            let theirs = numbers(&s[key]);
            assert_eq!(ours.len(), theirs.len(), "{key}");
            let (deviation, magnitude) = worst.entry(key).or_default();
            for (ours, theirs) in ours.into_iter().zip(theirs) {
                assert!((ours - theirs).is_finite(), "{key}");
                *deviation = deviation.max((ours - theirs).abs());
                *magnitude = magnitude.max(theirs.abs());
            }
        }
    }
    for (key, (deviation, magnitude)) in worst {
        let allowed = TOLERANCE * magnitude.max(1.0);
        assert!(
            deviation <= allowed,
            "{robot} {key}: {deviation:e} of {magnitude:e}"
        );
    }
}

#[test]
fn the_puma_and_the_planar_arm_agree_with_pinocchio() {
    let puma = include_str!("../../../../tests/golden/reference_puma560.json");
    check::<6>("puma560", puma);
    let planar = include_str!("../../../../tests/golden/reference_planar3.json");
    check::<3>("planar3r", planar);
}
