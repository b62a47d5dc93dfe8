//! The law on whole paths, as a table: how a run ends, how far the hand leaves its path orthogonal to ζ, and where joints go.

use model::Robot;
use shared_types::MAX_DOF;
use shared_types::scenario::Scenario;

use crate::command::{Desk, Known};

/// A case: a scenario, or the robot, start and segment of one; values as `--set` takes them; how it ends; the range of the largest error orthogonal to ζ,
/// mm; how far joints move, ° (at least, at most).
struct Case<'a> {
    task: &'a [&'a str],
    set: &'a str,
    ends: &'a str,
    orthogonal_mm: [f64; 2],
    moved: &'a [(usize, f64, f64)],
}

const REACHED: Case<'_> = Case {
    task: &["fig5-wrist-rotation"],
    set: "",
    ends: "goal reached",
    orthogonal_mm: [0.0, 0.1],
    moved: &[],
};

const BOUNDARY: &str = "followed to the boundary";
const MISSED: &str = "goal missed";

/// Joints 4 and 6 turn ζ by 90°, joint 5 turns the hand by 45°.
const FIGURE_5: &[(usize, f64, f64)] = &[(3, 89.95, 90.05), (4, 44.95, 45.05), (5, -90.05, -89.95)];

/// Stretched on the way, in its elbow or its wrist: the other posture at the end.
const THROUGH: [Case<'_>; 4] = [
    Case {
        task: &["elbow-in-and-out"],
        moved: &[(2, -60.0, -50.0)],
        ..REACHED
    },
    Case {
        task: &["ur5-elbow"],
        moved: &[(2, -60.0, -50.0)],
        ..REACHED
    },
    Case {
        task: &["ur5-wrist"],
        moved: &[(4, -45.0, -35.0)],
        ..REACHED
    },
    // The posture of a spare joint changes on the way through.
    Case {
        task: &["iiwa-posture"],
        moved: &[(0, 20.0, 80.0)],
        ..REACHED
    },
];

/// The paper's Figure 5: ζ turned by 90° while the end-effector is held, then a rotation of 45° about ζ as it was. By the continuous form, the paper's own, at
/// the flange, and by number; then the first arm of every textbook, two joints in the size of six.
const FORMS: [Case<'_>; 5] = [
    Case {
        orthogonal_mm: [0.0, 0.05],
        moved: FIGURE_5,
        ..REACHED
    },
    Case {
        set: "--set control.strategy=\"chang-khatib\"",
        moved: FIGURE_5,
        ..REACHED
    },
    Case {
        set: "--set frame=\"flange\"",
        ..REACHED
    },
    Case {
        set: "--set analysis.numeric=true",
        moved: FIGURE_5,
        ..REACHED
    },
    Case {
        task: &[
            "planar2r",
            "posture = 'bent'",
            "by_m = [-0.1, 0.1, 0.0]\nduration_s = 0.8",
        ],
        orthogonal_mm: [0.0, 0.5],
        ..REACHED
    },
];

const SPARE: &str = "to_m = [-0.23675, -0.02773, 0.97316]\nrotation = [[0.9212542734065431, -0.3192085213852698, -0.22225319706409696], \
                     [0.38518427381478815, 0.8281374052841699, 0.40721187749742355], [0.054070684626300144, -0.46075411864055243, 0.8858792260911251]]\n\
                     duration_s = 7.481";

const AT_LOCKS: [Case<'_>; 6] = [
    // At the edge of a fold: |s| lies between η_in and η_out, and has one sign on both sides of this elbow.
    Case {
        task: &[
            "panda",
            "q = [-0.0001, 0.569, 0.0005, -0.7782, 0.0, 1.3453, 0.7845]",
            "by_m = [0.001, 0.0, 0.0]",
        ],
        set: "--set control.governor=false --set segment.0.duration_s=0.5",
        moved: &[(3, 0.5, 1.5)],
        ..REACHED
    },
    // Joint 7 begins 6° from its limit, and is led back and forth.
    Case {
        task: &[
            "iiwa14",
            "q = [1.17101, -0.86039, 0.82946, -0.98377, 1.92768, -0.36457, 2.95253]",
            SPARE,
        ],
        ..REACHED
    },
    // In an elbow, a shoulder and a wrist: two directions are lost.
    Case {
        task: &[
            "iiwa14",
            "q = [0.3, 0.7, 0.4, 0.0, 0.5, 0.9, 0.2]",
            "by_m = [-0.1, 0.05, -0.1]",
        ],
        ..REACHED
    },
    Case {
        task: &[
            "iiwa14",
            "q = [0.3, 0.7, 0.4, 0.0, 0.5, 0.9, 0.2]",
            "by_m = [0.1, 0.1, -0.1]",
        ],
        ends: BOUNDARY,
        orthogonal_mm: [0.0, 1.0],
        ..REACHED
    },
    Case {
        task: &[
            "iiwa14",
            "q = [0.3, 0.0, 1.5707963267948966, -1.2, 0.5, 0.9, 0.2]",
            "by_m = [0.1, 0.1, -0.1]",
        ],
        ..REACHED
    },
    Case {
        task: &[
            "iiwa14",
            "q = [0.3, 0.7, 0.4, -1.2, 1.5707963267948966, 0.0, 0.2]",
            "by_m = [-0.1, 0.05, -0.1]",
        ],
        orthogonal_mm: [0.0, 0.5],
        ..REACHED
    },
];

/// Goals beyond reach: the hand stops at the boundary, and slides along it at the path's speed where it meets it at an angle.
const BEYOND: [Case<'_>; 4] = [
    Case {
        task: &["planar2r", "q = [0.3, 0.8]", "by_m = [0.5, 0.4, 0.0]"],
        ends: MISSED,
        orthogonal_mm: [0.0, 2.0],
        moved: &[(1, -45.9, -45.7)],
        ..REACHED
    },
    Case {
        task: &["planar2r", "q = [0.3, 0.8]", "by_m = [0.1, 0.9, 0.0]"],
        ends: MISSED,
        orthogonal_mm: [1.0, 8.0],
        moved: &[(0, 30.0, 45.0), (1, -45.9, -45.7)],
        ..REACHED
    },
    Case {
        task: &[
            "puma560",
            "q = [0.3, -0.9, 2.0, 0.3, 0.7, 0.1]",
            "by_m = [0.25, 0.1, 0.2]\nduration_s = 3.0",
        ],
        set: "--set analysis.numeric=true",
        ends: BOUNDARY,
        orthogonal_mm: [0.0, 1.0],
        moved: &[(2, -22.5, -21.5)],
    },
    Case {
        task: &[
            "puma560",
            "q = [0.3, -0.9, 2.0, 0.3, 0.7, 0.1]",
            "by_m = [0.1, 0.05, 0.5]\nduration_s = 3.0",
        ],
        set: "--set analysis.numeric=true",
        ends: MISSED,
        orthogonal_mm: [1.0, 5.0],
        moved: &[(2, -22.5, -21.5), (4, 20.0, 30.0)],
    },
];

/// Hold-and-blend as it is published: turning about the lost direction moves the hand (by 164 mm in the original), and a straight elbow stays straight.
const PUBLISHED: &str = "--set control.strategy=\"hold-and-blend\" --set control.baseline.hold_and_blend={blend=[0.006,0.06],hold_k_p=50.0,hold_k_v=14.0,push=0.01,push_k_v=5.0}";
const HELD: [Case<'_>; 2] = [
    Case {
        set: PUBLISHED,
        ends: MISSED,
        orthogonal_mm: [80.0, 250.0],
        ..REACHED
    },
    Case {
        task: &["elbow-in-and-out"],
        set: PUBLISHED,
        ends: MISSED,
        moved: &[(2, -3.0, 3.0)],
        ..REACHED
    },
];

/// The numbers of a run, which must be those of the case.
fn assert_holds(desk: &Desk, case: &Case<'_>) {
    let Case { task, set, .. } = case;
    let name = match task {
        [name] => *name,
        [robot, start, segment] => {
            let duration = if segment.contains("duration_s") {
                ""
            } else {
                "duration_s = 2.0"
            };
            let text = format!(
                "name = \"t\"\nrobot = \"{robot}\"\nsettle_s = 1.0\n[start]\n{start}\n[[segment]]\n{segment}\n{duration}\n"
            );
            desk.file("case.toml", &text);
            "case.toml"
        }
        _ => panic!("{task:?}: a name, or robot, start and segment"),
    };
    let args = format!("run {name} --no-record --json {set}");
    let json = desk.armplane(&args).json();
    let what = format!("{task:?} {set}: {}", json["reason"]);
    assert_eq!(json["outcome"], case.ends, "{what}");
    let [low, high] = case.orthogonal_mm;
    let orthogonal_mm = json["task"]["orthogonal_max_mm"].number();
    assert!(
        (low..high).contains(&orthogonal_mm),
        "{orthogonal_mm} mm, {what}"
    );
    let joints = &json["joints"];
    for (joint, least, most) in case.moved {
        let [start, end] = ["q_start", "q_end"].map(|end| joints[end][joint].number());
        let moved = (end - start).to_degrees();
        assert!(
            (*least..*most).contains(&moved),
            "joint {joint}: {moved}°, {what}"
        );
    }
    let [speed, torque, step] = ["speed", "torque_commanded", "torque_step"]
        .map(|what| joints[&format!("{what}_max_ratio")].number());
    assert!(
        speed < 1.0 && torque < 1.0 && step < 0.0501,
        "{what}: {joints}"
    );
}

// covers: CK95 Figure 5
#[test]
fn paths_through_and_at_singularities_end_as_they_should() {
    let desk = Desk::new();
    let cases = THROUGH.iter().chain(&FORMS).chain(&AT_LOCKS).chain(&HELD);
    cases.for_each(|case| assert_holds(&desk, case));
}

#[test]
fn goals_beyond_reach_are_followed_to_the_boundary() {
    let desk = Desk::new();
    BEYOND.iter().for_each(|case| assert_holds(&desk, case));
}

#[test]
fn a_fold_is_left_on_the_side_that_is_asked_for_from_anywhere_beside_it() {
    let desk = Desk::new();
    for (degrees, branch) in [
        (2.0, -1.0),
        (-2.0, 1.0),
        (0.3, -1.0),
        (-0.3, 1.0),
        (0.003, -1.0),
        (2.0, 1.0),
    ] {
        let start = format!("q_deg = [20, -70, {degrees}, -40, 60, 0]");
        let segment = format!(
            "slide = {{ along = \"zeta:elbow\", by_m = -0.05 }}\nbranch = {branch}\nduration_s = 1.5"
        );
        let ends = [30.0, 60.0].map(|end: f64| branch * end - degrees);
        let (least, most) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        assert_holds(
            &desk,
            &Case {
                task: &["ur5", &start, &segment],
                moved: &[(2, least, most)],
                ..REACHED
            },
        );
    }
}

#[test]
fn a_turn_of_zeta_goes_as_it_was_announced() {
    let text = sim::scenarios::text("ur5-wrist").unwrap();
    let scenario = Scenario::parse("ur5-wrist", text, &[]).unwrap();
    let robot = Robot::builtin(&scenario.robot).unwrap();
    let (mut start, mut planned, mut moved) = (None, [0.0; MAX_DOF], [0.0; MAX_DOF]);
    chain::run(&robot, &scenario, |tick| {
        let (q, control) = (tick.plant_state.q, tick.control_state);
        let start = *start.get_or_insert(q);
        if control.segment == 0 && control.planned != 0 {
            (planned, moved) = (control.planned_dq, std::array::from_fn(|i| q[i] - start[i]));
        }
    })
    .unwrap();
    assert!(planned[3].abs() > 0.5, "{planned:?}");
    for (planned, moved) in planned.iter().zip(moved) {
        assert!((planned - moved).abs() < 2e-3, "{planned} {moved}");
    }
}

#[test]
fn a_turn_without_room_is_refused_before_anything_moves() {
    // Joint 4 may go to 170°, joint 6 to 266°: +60° is too much for the one, −120° for the other.
    let args = "run fig5-wrist-rotation --set 'start={q_deg = [20, -60, 170, 150, 0, 250]}' \
                --set 'segment=[{reorient = {singularity = \"wrist\", by_deg = 60}, duration_s = 1.0}]'";
    Desk::new().refuses(2, args, "fig5-wrist-rotation:");
}

#[test]
fn every_law_keeps_within_the_torques_limits() {
    let json = Desk::new().json("compare fig5-wrist-rotation fig4-elbow-and-wrist overhead-pass");
    for scenario in json["scenarios"].list() {
        let laws = scenario["laws"].list();
        assert!(laws.len() > 5, "{scenario}");
        for law in laws {
            let torque = law["torque_commanded_max_ratio"].number();
            assert!(torque <= 1.0 + 1e-12 && law["ticks"].count() > 100, "{law}");
        }
    }
}
