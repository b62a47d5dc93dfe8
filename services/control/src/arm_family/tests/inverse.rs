//! Closed-form inverse kinematics, and the predicted turn of ζ.

use crate::analyzer::Analyzer;
use crate::arm_family::choice::Family;
use crate::arm_family::parallel_axes_inverse::{PlanarArm, turned};
use crate::arm_family::puma_inverse::{PumaInverse, PumaLengths};
use crate::linear::{rotation_log, wrap_angle};
use crate::testing::{posture, puma, puma_lengths, robot};
use model::Model;
use nalgebra::{SVector, Vector3};
use proptest::prelude::*;
use shared_types::scenario::Analysis;

proptest! {
    #[test]
    fn a_pumas_inverse_kinematics_undoes_forward_kinematics(q in posture(puma())) {
        let inverse = PumaInverse::new(puma(), puma_lengths("puma560"));
        let X = puma().forward_kinematics(&q);
        for found in inverse.all(&X, &q) {
            let Y = puma().forward_kinematics(&found);
            prop_assert!((Y.p - X.p).norm() < 1e-9 && rotation_log(&(Y.R * X.R.transpose())).norm() < 1e-6, "{found:?}");
        }
        // Joints 4 to 6 keep 0.05 rad from their limits, which a random posture does not.
        let inner = (0..6).all(|i| q[i] > puma().lower()[i] + 0.05 && q[i] < puma().upper()[i] - 0.05);
        let off_lock = libm::sin(q[4]).abs() > 1e-3;
        prop_assert!(!inner || !off_lock || inverse.nearest(&X, &q).is_some_and(|found| (found - q).amax() < 1e-5), "q itself is among them");
    }

    #[test]
    fn a_ur5s_inverse_kinematics_undoes_forward_kinematics(q in posture(&Model::<6>::new(robot("ur5"), None).unwrap()), to in prop::array::uniform6(-0.2..0.2)) {
        let model = Model::<6>::new(robot("ur5"), None).unwrap();
        let mut analyzer = Analyzer::<6>::new(robot("ur5"), &Analysis::default());
        let zero = SVector::zeros();
        let (q2, terms) = (q + SVector::from(to), model.evaluate(&q, &zero));
        let there = model.evaluate(&q2, &zero);
        let (one, two) = (analyzer.step(&q, &zero, &terms), analyzer.step(&q2, &zero, &there));
        // On the same sides of every lock.
        prop_assume!((0..3).all(|i| one.singularities[i].s * two.singularities[i].s > 0.0 && two.singularities[i].s.abs() > 0.15));
        let arm = PlanarArm::new(&terms, &one.p_BC);
        let placed = arm.at(&two.p_BC);
        prop_assert!(wrap_angle(placed.turn - (q2[0] - q[0])).abs() < 1e-9, "waist");
        let w = placed.wrist_bend(&there.z[5]);
        let z5 = w * (if w.dot(&arm.plane.z5) < 0.0 { -1.0 } else { 1.0 } / w.norm());
        let expected = turned(&arm.plane.z5, q2[1] + q2[2] + q2[3] - q[1] - q[2] - q[3]);
        prop_assume!(expected.dot(&arm.plane.z5) > 0.0);
        prop_assert!((z5 - expected).norm() < 1e-9, "axis 5");
        let [upper, theta, _] = arm.solve(&placed.C, &z5).unwrap();
        let now = libm::atan2(arm.plane.upper.y, arm.plane.upper.x);
        prop_assert!(wrap_angle(theta - q2[2]).abs() < 1e-7 && wrap_angle(upper - now - (q2[1] - q[1])).abs() < 1e-7, "elbow and shoulder");
    }
}

/// At a lock, the predicted motion leaves the end-effector where it is, whole, and turns ζ by the angle.
fn predicted<const N: usize>(name: &str, place: usize, q: SVector<f64, N>, angle: f64) {
    let model = Model::<N>::new(robot(name), None).unwrap();
    let zero = SVector::zeros();
    let analysed = |q: &SVector<f64, N>| {
        Analyzer::new(robot(name), &Analysis::default()).step(q, &zero, &model.evaluate(q, &zero))
    };
    let (terms, report) = (model.evaluate(&q, &zero), analysed(&q));
    let one = report.singularities[place];
    assert!(one.s.abs() < 1e-9, "{name}: {one:?}");
    let by = Family::<N>::of(robot(name), &Analysis::default())
        .get()
        .turning(&one, &terms, &report.p_BC, angle)
        .unwrap();
    let there = model.evaluate(&(q + by), &zero).X_BE;
    assert!(
        (there.p - terms.X_BE.p).norm() < 1e-9 && (there.R - terms.X_BE.R).norm() < 1e-9,
        "{name}: the hand moves, {by}"
    );
    let zeta = analysed(&(q + by)).singularities[place].axis();
    let about: Vector3<f64> = one.R_BS.column(1).into_owned();
    let turned = libm::atan2(about.dot(&one.axis().cross(&zeta)), one.axis().dot(&zeta));
    assert!(
        wrap_angle(turned - angle).abs() < 1e-9,
        "{name}: ζ turned by {turned}"
    );
}

#[test]
fn the_predicted_motion_keeps_the_hand_still_and_turns_zeta() {
    for angle in [-1.2, 0.4, 1.5] {
        predicted(
            "puma560",
            1,
            SVector::from([0.3, -1.0, 2.9, 0.2, 0.0, 0.1]),
            angle,
        );
        predicted(
            "ur5",
            1,
            SVector::from([0.3, -1.2, 1.6, -1.0, 0.0, 0.2]),
            angle,
        );
    }
    // Straight up with the elbow bent: R = 0 at q2 = atan2(−K, M).
    let (
        PumaLengths {
            a2,
            L3,
            q3_stretched,
        },
        q3,
    ) = (puma_lengths("puma560-ideal"), 2.6_f64);
    let theta = q3 - q3_stretched;
    let q2 = libm::atan2(-(a2 + L3 * libm::cos(theta)), -L3 * libm::sin(theta));
    for angle in [-0.6, 0.5] {
        predicted(
            "puma560-ideal",
            2,
            SVector::from([0.3, q2, q3, 0.2, 0.9, 0.1]),
            angle,
        );
    }
}
