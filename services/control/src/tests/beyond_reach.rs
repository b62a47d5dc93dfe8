//! Goals beyond reach on arms analysed by number, closed loop on an exact plant.

use crate::testing::{Figures, robot, run_on};
use crate::types::{Class, Mode};
use crate::{Analyzer, Controller, start_posture};
use model::{Model, Robot};
use nalgebra::SVector;
use shared_types::scenario::{Scenario, Segment, Start};

/// A straight line from the posture `q_rad` that ends beyond reach.
fn beyond(robot: &Robot, q_rad: &[f64], by_m: [f64; 3], duration_s: f64) -> Scenario {
    let mut scenario = crate::testing::scenario(
        include_str!("../../../../sim/scenarios/sweep.toml"),
        &["analysis.numeric=true"],
    );
    scenario.robot.clone_from(&robot.name);
    scenario.start = Start {
        q: Some(q_rad.to_vec()),
        ..Start::default()
    };
    scenario.segment = vec![Segment {
        duration_s,
        by_m: Some(by_m),
        ..Segment::default()
    }];
    scenario.settle_s = 1.0;
    scenario
}

/// The figures of such a run, its last error (mm), and how far the error has ever been beyond that: an arm that retreats is further off on its way.
fn slides(robot: &Robot, scenario: &Scenario) -> (Figures, f64) {
    let (mut farthest, mut clipped, mut slid) = (0.0_f64, false, false);
    let f = run_on::<6>(robot, scenario, |_, tick| {
        farthest = farthest.max(tick.error.fixed_rows::<3>(0).norm() * 1e3);
        clipped |= tick.command.clipped;
        slid |= tick.command.mode.contains(&Mode::Slide);
    });
    println!("{}: farthest {farthest} mm, {f:?}", robot.name);
    assert!(
        clipped && slid,
        "{}: clipped {clipped}, slid {slid}",
        robot.name
    );
    (f.clone(), farthest - f.final_mm)
}

fn warning(robot: &Robot, scenario: &Scenario) -> Option<String> {
    let q = start_posture::<6>(robot, scenario).unwrap();
    Controller::<6>::new(Model::new(robot, None).unwrap(), robot, scenario, q)
        .unwrap()
        .warning()
}

/// The planar arm of two joints, embedded in the size of six, with joints as fast as an arm's.
fn two_links() -> Robot {
    let mut two = robot("planar2r").clone();
    for joint in &mut two.joints {
        (joint.velocity, joint.effort) = (3.0, 100.0);
    }
    two
}

#[test]
fn two_links_stop_at_the_boundary_and_slide_along_it() {
    let two = two_links();
    // Outwards, and past the boundary at an angle: there the arm slides at the path's speed, and ζ turns.
    for (by, across_mm) in [([0.5, 0.4, 0.0], 1.0), ([0.1, 0.9, 0.0], 8.0)] {
        let scenario = beyond(&two, &[0.3, 0.8], by, 2.0);
        assert!(
            warning(&two, &scenario).is_some_and(|text| text.contains("segment 0 is beyond reach"))
        );
        let (f, retreat) = slides(&two, &scenario);
        assert!(
            f.orthogonal_mm < across_mm && retreat < 1.0,
            "{by:?}: {retreat} mm, {f:?}"
        );
        assert!(
            f.speed <= 1.0 && f.torque_step <= 0.0501 && !f.refused && f.saturated_ticks == 0,
            "{by:?}: {f:?}"
        );
    }
}

#[test]
fn six_joints_stop_at_the_boundary_and_slide_along_it() {
    let puma = robot("puma560");
    for (by, across_mm) in [([0.25, 0.1, 0.2], 1.0), ([0.1, 0.05, 0.5], 5.0)] {
        let scenario = beyond(puma, &[0.3, -0.9, 2.0, 0.3, 0.7, 0.1], by, 3.0);
        assert!(warning(puma, &scenario).is_some(), "{by:?}");
        let (f, retreat) = slides(puma, &scenario);
        assert!(
            f.orthogonal_mm < across_mm && f.orthogonal_deg < 0.5 && retreat < 1.0,
            "{by:?}: {retreat} mm, {f:?}"
        );
        assert!(
            f.speed <= 1.0 && f.torque_step <= 0.0501 && !f.refused,
            "{by:?}: {f:?}"
        );
    }
}

#[test]
fn a_goal_within_reach_is_warned_of_nowhere() {
    let two = two_links();
    assert_eq!(
        warning(&two, &beyond(&two, &[0.3, 0.8], [0.05, 0.05, 0.0], 2.0)),
        None
    );
}

#[test]
fn a_stretched_arm_of_two_joints_is_type_1_and_has_two_places() {
    let two = robot("planar2r");
    let scenario = beyond(two, &[0.3, 0.0], [0.0; 3], 1.0);
    let model = Model::<6>::new(two, None).unwrap();
    for elbow in [0.0, 0.1, -0.1] {
        let (q, zero) = (
            SVector::from([0.3, elbow, 0.0, 0.0, 0.0, 0.0]),
            SVector::zeros(),
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
