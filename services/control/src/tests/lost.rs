//! Seven joints at postures of codimension two, closed loop on an exact plant: starts in them.

use crate::testing::{robot, run_on, scenario};
use model::{Model, Pose, Robot};
use nalgebra::SVector;
use shared_types::random::Uniform;
use shared_types::scenario::{Scenario, Segment, Start};

fn template(robot: &Robot) -> Scenario {
    let mut template = scenario(
        include_str!("../../../../sim/scenarios/seven-joints.toml"),
        &[],
    );
    template.robot.clone_from(&robot.name);
    template.settle_s = 1.0;
    template
}

/// A straight line from `start` to the pose of `end`.
fn line(
    robot: &Robot,
    start: &SVector<f64, 7>,
    end: &SVector<f64, 7>,
    duration_s: f64,
) -> Scenario {
    let goal: Pose = Model::<7>::new(robot, None)
        .unwrap()
        .forward_kinematics(end);
    let rotation = std::array::from_fn(|i| std::array::from_fn(|j| goal.R[(i, j)]));
    Scenario {
        start: Start {
            q: Some(start.iter().copied().collect()),
            ..Start::default()
        },
        segment: vec![Segment {
            duration_s,
            to_m: Some(goal.p.into()),
            rotation: Some(rotation),
            ..Segment::default()
        }],
        ..template(robot)
    }
}

fn at(q: [f64; 7]) -> SVector<f64, 7> {
    SVector::from(q)
}

/// Singular postures, one of each set.
fn locks() -> [(&'static str, SVector<f64, 7>); 3] {
    use std::f64::consts::FRAC_PI_2;
    [
        ("elbow", at([0.3, 0.7, 0.4, 0.0, 0.5, 0.9, 0.2])),
        ("shoulder", at([0.3, 0.0, FRAC_PI_2, -1.2, 0.5, 0.9, 0.2])),
        ("wrist", at([0.3, 0.7, 0.4, -1.2, FRAC_PI_2, 0.0, 0.2])),
    ]
}

#[test]
fn a_start_in_a_lock_is_left_without_a_leap() {
    let mut random = Uniform(23);
    let robot = robot("iiwa14");
    for (name, q) in locks() {
        for end in [0, 1].map(|_| q + SVector::<f64, 7>::from_fn(|_, _| random.within(-0.5, 0.5))) {
            let f = run_on::<7>(robot, &line(robot, &q, &end, 2.0), |_, _| {});
            println!("{name}: {f:?}");
            assert!(
                f.final_mm < 1.0
                    && f.final_deg < 0.5
                    && f.speed <= 1.0
                    && f.torque_step < 0.05
                    && !f.refused,
                "{name}: {f:?}"
            );
        }
    }
}
