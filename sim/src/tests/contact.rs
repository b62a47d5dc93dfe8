//! Contact in sub-steps whose number follows its changes, beside one in equal sub-steps, each against a far finer one.

use super::*;
use shared_types::scenario::Plant as Options;

/// A scene and the arm's motion in it: its name, the floor (m), dry friction, and the torque at a time (s).
struct Scene {
    name: &'static str,
    floor_m: Option<f64>,
    friction: bool,
    torque: fn(&Model<6>, &State<6>, f64) -> Joints,
}

/// Gravity compensated, all joints damped by `damping` N·m·s/rad, and a torque beside.
fn damped(arm: &Model<6>, x: &State<6>, damping: f64, beside: [f64; 6]) -> Joints {
    arm.gravity(&x.q) - x.qdot * damping + Joints::from(beside)
}

const SCENES: [Scene; 6] = [
    Scene {
        name: "pressed",
        floor_m: Some(-0.35),
        friction: false,
        torque: |arm, x, _| damped(arm, x, 10.0, [0.0, 20.0, 0.0, 0.0, 0.0, 0.0]),
    },
    Scene {
        name: "sliding",
        floor_m: Some(-0.35),
        friction: false,
        torque: |arm, x, t| {
            damped(
                arm,
                x,
                10.0,
                [15.0 * libm::sin(6.0 * t), 20.0, 0.0, 0.0, 0.0, 0.0],
            )
        },
    },
    Scene {
        name: "dropped",
        floor_m: Some(-0.35),
        friction: false,
        torque: |arm, x, _| arm.gravity(&x.q) * 0.5 - x.qdot * 0.5,
    },
    Scene {
        name: "struck and lifted",
        floor_m: Some(-0.35),
        friction: false,
        torque: |arm, x, t| {
            damped(
                arm,
                x,
                10.0,
                [
                    0.0,
                    if t % 0.6 < 0.3 { 60.0 } else { -30.0 },
                    0.0,
                    0.0,
                    0.0,
                    0.0,
                ],
            )
        },
    },
    Scene {
        name: "sliding with dry friction",
        floor_m: Some(-0.35),
        friction: true,
        torque: |arm, x, t| {
            damped(
                arm,
                x,
                10.0,
                [25.0 * libm::sin(6.0 * t), 25.0, 0.0, 0.0, 0.0, 0.0],
            )
        },
    },
    Scene {
        name: "at a stop",
        floor_m: None,
        friction: false,
        torque: |arm, x, _| damped(arm, x, 10.0, [40.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    },
];

/// States, mean forces and energies tick by tick, and sub-steps of rapier3d.
struct Course {
    states: Vec<State<6>>,
    forces: Vec<Vector3<f64>>,
    energies: Vec<f64>,
    asked: u32,
}

fn course(scene: &Scene, substeps: u32, equally: bool) -> Course {
    let options = Options {
        floor_m: scene.floor_m,
        friction: scene.friction,
        substeps,
        ..options(PlantModel::Rapier)
    };
    let mut arm = plant(&puma(), &options, &nominal());
    if equally {
        arm.divide_equally();
    }
    let mut course = Course {
        states: Vec::new(),
        forces: Vec::new(),
        energies: Vec::new(),
        asked: 0,
    };
    for tick in 0..3 * RATE / 2 {
        let tau = (scene.torque)(arm.model(), arm.state(), f64::from(tick) / f64::from(RATE));
        arm.step(&tau).unwrap();
        course.states.push(*arm.state());
        course.forces.push(arm.touch().force);
        course.energies.push(arm.energy());
    }
    course.asked = arm.asked();
    course
}

/// Largest error of position (rad), mean square error of velocity (rad/s) and of the mean force over 20 ms (N), largest error of energy (J).
fn errors(course: &Course, fine: &Course) -> [f64; 4] {
    let states = || course.states.iter().zip(&fine.states);
    let mean_square =
        |squares: Vec<f64>| libm::sqrt(squares.iter().sum::<f64>() / squares.len() as f64);
    let windows = course.forces.chunks(20).zip(fine.forces.chunks(20));
    let force = windows.map(|(a, b)| {
        ((a.iter().sum::<Vector3<f64>>() - b.iter().sum::<Vector3<f64>>()) / 20.0).norm_squared()
    });
    [
        states()
            .map(|(a, b)| (a.q - b.q).amax())
            .fold(0.0, f64::max),
        mean_square(
            states()
                .map(|(a, b)| (a.qdot - b.qdot).norm_squared())
                .collect(),
        ),
        mean_square(force.collect()),
        course
            .energies
            .iter()
            .zip(&fine.energies)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max),
    ]
}

#[test]
fn sub_steps_that_follow_contact_are_fewer_and_nearer_to_fine_ones() {
    let words = |errors: [f64; 4]| errors.map(|error| format!("{error:.1e}")).join(", ");
    let (mut ratios, mut asked) = (Vec::new(), [0.0; 2]);
    for scene in &SCENES {
        let (fine, equal, following) = (
            course(scene, 64, true),
            course(scene, 4, true),
            course(scene, 4, false),
        );
        let (before, now) = (errors(&equal, &fine), errors(&following, &fine));
        println!(
            "{}: {} sub-steps, errors {}; equal ones {}, {}",
            scene.name,
            following.asked,
            words(now),
            equal.asked,
            words(before)
        );
        ratios.push([now[0] / before[0], now[3] / before[3]]);
        asked = [
            asked[0] + f64::from(following.asked),
            asked[1] + f64::from(equal.asked),
        ];
        // Where the arm does not bounce, half of them are enough.
        let is_steady = scene.name != "dropped" && scene.name != "struck and lifted";
        assert!(
            !is_steady || f64::from(following.asked) < 0.6 * f64::from(equal.asked),
            "{} sub-steps {}",
            following.asked,
            scene.name
        );
    }
    // An impact that is just missed or met makes a scene a little worse, or much better.
    let mean = |k: usize| {
        libm::exp(ratios.iter().map(|ratio| libm::log(ratio[k])).sum::<f64>() / ratios.len() as f64)
    };
    println!(
        "errors of position {:.2} of those of equal sub-steps, of energy {:.2}; {:.2} of the sub-steps",
        mean(0),
        mean(1),
        asked[0] / asked[1]
    );
    assert!(
        ratios
            .iter()
            .all(|[position, energy]| *position < 1.5 && *energy < 1.2),
        "{ratios:?}"
    );
    assert!(mean(0) < 0.9 && mean(1) < 0.8 && asked[0] < 0.8 * asked[1]);
}
