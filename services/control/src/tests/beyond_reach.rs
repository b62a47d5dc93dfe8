//! Goals beyond reach on arms analysed by number.

use crate::Analyzer;
use crate::linear::Joints;
use crate::testing::{Bench, robot, scenario};
use crate::types::Class;
use model::Model;
use shared_types::scenario::Scenario;

/// A straight line of an arm of two joints, analysed by number.
fn line(q_rad: [f64; 2], by_m: [f64; 3]) -> Scenario {
    let text = format!(
        "name = \"x\"\nrobot = \"planar2r\"\n[start]\nq = {q_rad:?}\n[[segment]]\nby_m = {by_m:?}\nduration_s = 2.0\n[analysis]\nnumeric = true\n"
    );
    scenario(&text, &[])
}

#[test]
fn a_goal_beyond_reach_is_warned_of_and_no_other() {
    for (by_m, is_beyond) in [
        ([0.5, 0.4, 0.0], true),
        ([0.1, 0.9, 0.0], true),
        ([0.05, 0.05, 0.0], false),
    ] {
        let arm = Bench::<6>::of(&line([0.3, 0.8], by_m));
        let warned = arm.controller.warning();
        assert_eq!(warned.is_some(), is_beyond, "{by_m:?}: {warned:?}");
    }
}

#[test]
fn a_stretched_arm_of_two_joints_is_type_1_and_has_two_places() {
    let two = robot("planar2r");
    let scenario = line([0.3, 0.0], [0.0; 3]);
    let model = Model::<6>::new(two, None).unwrap();
    for elbow in [0.0, 0.1, -0.1] {
        let (q, zero) = (
            Joints::from([0.3, elbow, 0.0, 0.0, 0.0, 0.0]),
            Joints::zeros(),
        );
        let report =
            Analyzer::<6>::new(two, &scenario.analysis).step(&q, &zero, &model.evaluate(&q, &zero));
        let s = &report.listed()[0];
        assert_eq!(
            (report.count, s.class),
            (2, Class::Type1),
            "q2 = {elbow}: {s:?}"
        );
        assert!(s.kappa_1 > 0.05 && s.s.abs() < 0.2, "{s:?}");
        // Outwards, along the arm.
        assert!((s.axis().x - 0.3_f64.cos()).abs() < 0.1, "{s:?}");
    }
}
