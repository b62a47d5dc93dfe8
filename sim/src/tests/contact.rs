//! Contact in sub-steps whose number follows its changes, beside one in equal sub-steps, each against a far finer one.

use shared_types::checkpoints::PlantCheckpoint;

use super::*;

/// A scene and the arm's motion in it: the floor (m), dry friction, damping (N·m·s/rad), the share of gravity that is compensated, and the torques of
/// joints 1 and 2 beside at a time (s).
struct Scene {
    name: &'static str,
    floor_m: Option<f64>,
    friction: bool,
    damping: f64,
    gravity: f64,
    beside: fn(f64) -> [f64; 2],
}

const PRESSED: Scene = Scene {
    name: "pressed",
    floor_m: Some(-0.35),
    friction: false,
    damping: 10.0,
    gravity: 1.0,
    beside: |_| [0.0, 20.0],
};

const SCENES: [Scene; 6] = [
    PRESSED,
    Scene {
        name: "sliding",
        beside: |t| [15.0 * libm::sin(6.0 * t), 20.0],
        ..PRESSED
    },
    Scene {
        name: "dropped",
        damping: 0.5,
        gravity: 0.5,
        beside: |_| [0.0; 2],
        ..PRESSED
    },
    Scene {
        name: "struck and lifted",
        beside: |t| [0.0, if t % 0.6 < 0.3 { 60.0 } else { -30.0 }],
        ..PRESSED
    },
    Scene {
        name: "sliding with dry friction",
        friction: true,
        beside: |t| [25.0 * libm::sin(6.0 * t), 25.0],
        ..PRESSED
    },
    Scene {
        name: "at a stop",
        floor_m: None,
        beside: |_| [40.0, 0.0],
        ..PRESSED
    },
];

impl Scene {
    fn arm(&self, substeps: u32) -> Plant<6> {
        let options = Options {
            floor_m: self.floor_m,
            friction: self.friction,
            substeps,
            ..Options::default()
        };
        plant(&puma(), &options, &nominal())
    }

    fn step(&self, arm: &mut Plant<6>, tick: u32) {
        let State { q, qdot } = *arm.state();
        let [first, second] = (self.beside)(f64::from(tick) / f64::from(RATE));
        let carried = arm.model().gravity(&q) * self.gravity - qdot * self.damping;
        arm.step(&(carried + only(0, first) + only(1, second)))
            .unwrap();
    }
}

/// Ticks of a scene.
const TICKS: u32 = 3 * RATE / 2;

/// Positions and energies tick by tick, and sub-steps of rapier3d.
fn course(scene: &Scene, substeps: u32, equally: bool) -> (Vec<(Joints, f64)>, f64) {
    let mut arm = scene.arm(substeps);
    arm.hybrid.as_mut().unwrap().equal = equally;
    let mut course = Vec::new();
    for tick in 0..TICKS {
        scene.step(&mut arm, tick);
        course.push((arm.state().q, arm.energy()));
    }
    (course, f64::from(arm.hybrid.unwrap().asked))
}

/// The same in sub-steps that follow contact, every 100 ticks with nothing but what is saved: a second arm goes on from there, bit for bit.
fn forgetful_course(scene: &Scene) -> Vec<(Joints, f64)> {
    let (mut arm, mut other) = (scene.arm(4), scene.arm(4));
    let mut course = Vec::new();
    for tick in 0..TICKS {
        if tick % 100 == 50 {
            let mut saved = PlantCheckpoint::default();
            arm.save(&mut saved);
            arm.forget();
            other = scene.arm(4);
            other.restore(&saved);
        }
        scene.step(&mut arm, tick);
        scene.step(&mut other, tick);
        assert_eq!(other.state(), arm.state(), "{} at tick {tick}", scene.name);
        assert_eq!(other.touch(), arm.touch(), "{} at tick {tick}", scene.name);
        course.push((arm.state().q, arm.energy()));
    }
    course
}

/// Largest errors of position (rad) and of energy (J).
fn errors(course: &[(Joints, f64)], fine: &[(Joints, f64)]) -> [f64; 2] {
    let pairs = course.iter().zip(fine);
    pairs.fold([0.0; 2], |[q, e], (a, b)| {
        [q.max((a.0 - b.0).amax()), e.max((a.1 - b.1).abs())]
    })
}

#[test]
fn sub_steps_that_follow_contact_are_fewer_and_nearer_to_fine_ones() {
    let (mut logs, mut asked, mut forgetting) = ([0.0; 2], [0.0; 2], 0.0);
    for scene in &SCENES {
        let (fine, _) = course(scene, 64, true);
        let (equal, most) = course(scene, 4, true);
        let (following, fewer) = course(scene, 4, false);
        let (before, now) = (errors(&equal, &fine), errors(&following, &fine));
        let ratio = [now[0] / before[0], now[1] / before[1]];
        println!(
            "{}: {fewer} of {most} sub-steps, errors {ratio:.2?} of {before:.1?}",
            scene.name
        );
        // An impact that is just missed or met makes a scene a little worse, or much better.
        assert!(ratio[0] < 1.5 && ratio[1] < 1.2);
        // Where the arm does not bounce, half of them are enough.
        let bounces = scene.name == "dropped" || scene.name == "struck and lifted";
        assert!(bounces || fewer < 0.6 * most);
        asked = [asked[0] + fewer, asked[1] + most];
        logs = [0, 1].map(|k| logs[k] + libm::log(ratio[k]) / SCENES.len() as f64);
        let forgetful = errors(&forgetful_course(scene), &fine);
        forgetting += libm::log(forgetful[0] / now[0]) / SCENES.len() as f64;
    }
    // To forget contacts costs no accuracy: 1.0004 is measured.
    assert!(libm::exp(forgetting) < 1.02, "{forgetting}");
    let mean = logs.map(libm::exp);
    assert!(
        mean[0] < 0.9 && mean[1] < 0.8 && asked[0] < 0.8 * asked[1],
        "{mean:?}"
    );
}
