//! Routes that begin in a lock, and those of spare joints.

use super::*;
use crate::linear::Joints;
use crate::reference::path::Path;
use crate::singularity::analyzer::Analyzer;
use crate::testing::{Bench, robot};
use crate::types::Refusal;
use model::Robot;
use shared_types::scenario::Scenario;

/// A line from a posture to a pose; see [`assert_followed`].
fn assert_planned<const N: usize>(name: &str, [q_rad, to_m, rotation]: [&str; 3], duration_s: f64) {
    let segment = format!("to_m = {to_m}\nrotation = {rotation}");
    assert_followed::<N>(name, q_rad, &segment, duration_s);
}

fn task(name: &str, q_rad: &str, segment: &str, duration_s: f64) -> Scenario {
    let text = format!(
        "name = \"line\"\nrobot = \"{name}\"\n[start]\nq = {q_rad}\n[[segment]]\n{segment}\nduration_s = {duration_s}\n"
    );
    Scenario::parse("line.toml", &text, &[]).unwrap()
}

/// A segment is one leg; the postures of its route have the path's poses, within the limits, and do not jump. Returns the plan.
fn assert_followed<const N: usize>(
    name: &str,
    q_rad: &str,
    segment: &str,
    duration_s: f64,
) -> PathPlan<N> {
    let scenario = task(name, q_rad, segment, duration_s);
    let robot = Robot::builtin(name).unwrap();
    let model = Model::<N>::new(&robot, None).unwrap();
    let q_start = crate::start_posture::<N>(&robot, &scenario).unwrap();
    let analyzer = Analyzer::new(&robot, &scenario.analysis);
    let report = analyse(&mut analyzer.clone(), &model, &q_start);
    let path = Path::new(&scenario, model.forward_kinematics(&q_start), &report).unwrap();
    let request = Request {
        model: &model,
        path: &path,
        q_start,
        postures: &[],
        analyzer: &analyzer,
        robot: &robot,
        scenario: &scenario,
        allowed: Deviation {
            position_m: 1e-3,
            orientation_rad: 0.5_f64.to_radians(),
        },
    };
    let plan = plan(&request, &|| false).unwrap().unwrap();
    assert_eq!(plan.legs(), 1);
    let mut progress = Progress::at(model.forward_kinematics(&q_start));
    path.advance(&mut progress, 0.0, &report);
    let (mut last, mut worst) = (plan.at(0.0), [0.0_f64; 3]);
    for k in 1..=4000 {
        let now = plan.at(plan.duration_s() * f64::from(k) / 4000.0);
        progress.time_s = now.t.min(duration_s - 1e-9);
        let desired = path.desired(&progress, 1.0, 0.0);
        let X = model.forward_kinematics(&now.q);
        let turn = crate::linear::rotation_log(&(X.R * desired.R.transpose()));
        let errors = [
            (X.p - desired.p).norm() * 1e3,
            turn.norm().to_degrees(),
            (now.q - last.q).amax(),
        ];
        worst = [0, 1, 2].map(|i| worst[i].max(errors[i]));
        let is_within = |i: usize| now.q[i] > model.lower()[i] && now.q[i] < model.upper()[i];
        assert!((0..N).all(is_within) && now.t >= last.t, "{}", now.q);
        last = now;
    }
    // 1 mm and 0.5° are allowed at C; between the points the spline adds to it, and E lies beside C.
    assert!(
        worst[0] < 2.5 && worst[1] < 0.8 && worst[2] < 0.5,
        "{worst:?}"
    );
    plan
}

/// The last joint turns, or the arm moves in its plane, while the wrist's lost direction is not needed: the path stays in the lock, or beside it, and the
/// arm has nothing to wait for.
#[test]
fn a_path_that_stays_in_a_lock_is_followed_at_once() {
    const ROLL: &str = "rotation = [[-0.2960020074919586, -0.12192667672380783, 0.9473735784070706], \
                        [0.6486010047909772, 0.7024488147603513, 0.2930569897236919], \
                        [-0.7012129121350126, 0.7012129121350128, -0.12884449429552466]]";
    for q5 in [0.0, 1e-6, -1e-6] {
        for (name, q, segment) in [
            (
                "puma560",
                "[0.3, -0.9, 2.6, 0.0, Q5, 0.0]",
                "by_m = [0.0, 0.0, 0.1]",
            ),
            (
                "ur5",
                "[0.3, -1.2, 1.6, -1.0, Q5, 0.2]",
                "by_m = [0.0, 0.0, 0.1]",
            ),
            ("puma560", "[0.3, -0.9, 2.6, 0.0, Q5, 0.0]", ROLL),
        ] {
            let q = q.replace("Q5", &q5.to_string());
            let plan = assert_followed::<6>(name, &q, segment, 2.0);
            assert!(plan.duration_s() < 3.5, "{name} {q}: {}", plan.duration_s());
        }
    }
}

/// Out of an exact wrist lock: a line that the law follows by itself, where a route of the search finds no end, and one on which a joint would be too fast.
#[test]
fn a_plan_is_made_where_the_law_needs_one() {
    let short = "[1.16660, -1.04720, 1.07645, -1.67837, 0.0, -1.38465]";
    let fast = "[-1.92178, -2.06535, 1.46373, 3.04704, 0.0, -2.44722]";
    for (name, q, by_m, is_planned) in [
        ("ur10", short, "[-0.0135, -0.0212, -0.042]", false),
        ("ur5", fast, "[0.0265, 0.0232, -0.0267]", true),
    ] {
        let scenario = task(name, q, &format!("by_m = {by_m}"), 2.0);
        let controller = Bench::<6>::of(&scenario).controller;
        assert_eq!(controller.obstacle(), None);
        let guide = &controller.setup.guide;
        assert_eq!(guide.at(0, 0.0).is_some(), is_planned, "{name}");
    }
}

/// On one side of this stretched elbow the line leads into a joint limit: the law leaves the lock on the other, which it has rehearsed, whatever the noise.
#[test]
fn noise_does_not_choose_the_side_on_which_a_lock_is_left() {
    let start = "[-1.8276893, 1.2177208, 1.0317532, 2.7417633, 3.35e-7, -0.6894259, -1.3826564]";
    let goal = "to_m = [-0.219059, -0.507449, 0.292570]\nquaternion = [0.7274106, 0.1574273, -0.5877969, 0.3171519]";
    let scenario = task("xarm7", start, goal, 1.8);
    for noise in [1e-5, -1e-5] {
        let mut arm = Bench::<7>::of(&scenario);
        arm.q[3] += noise;
        for tick in 0..2000 {
            let command = arm.command(None);
            assert_eq!(command.refusal, Refusal::None, "tick {tick}: {}", arm.q);
            arm.moves(&command.tau);
        }
        assert!(arm.q[3] < 2.0, "{}", arm.q);
    }
}

/// A short turn asks for more torque than there is, were the clock not slowed down for it.
#[test]
fn the_clock_of_a_plan_leaves_the_torque_within_its_limits() {
    let turn = "turn = { about = \"x\", by_deg = 10 }";
    let plan = assert_followed::<6>("puma560", "[0.35, -1.05, 2.97, 0.0, 0.0, 0.0]", turn, 0.05);
    let model = Model::<6>::new(robot("puma560"), None).unwrap();
    let (mut slowest, step) = (1.0_f64, 1e-3);
    let times = (plan.duration_s() / step) as usize;
    for k in 1..times {
        let u = step * k as f64;
        let (before, now, after) = (plan.at(u - step), plan.at(u), plan.at(u + step));
        let clock = plan.speed(u, u);
        slowest = slowest.min(clock);
        let bend = (after.dq - before.dq) / (2.0 * step);
        let tau = model.gravity(&now.q) + model.mass_matrix(&now.q) * bend * (clock * clock);
        let within = (0..6).all(|i| tau[i].abs() < model.effort()[i]);
        assert!(within, "{tau} at {u}");
    }
    assert!(slowest < 0.9, "{slowest}");
}

/// Advice is given only for what has been seen to succeed, as it is printed.
#[test]
fn advice_is_tried_as_it_is_printed() {
    // Joint 6 begins near its limit, and the path leads it beyond.
    let line = "by_m = [0.0, 0.0, -0.05]";
    let scenario = task("puma560", "[0.3, -0.9, 2.6, 0.2, 0.8, -4.6416]", line, 2.0);
    let puma = robot("puma560");
    let model = Model::<6>::new(puma, None).unwrap();
    let pose = |scenario: &Scenario| {
        let q = crate::start_posture::<6>(puma, scenario).unwrap();
        model.forward_kinematics(&q)
    };
    let mut tried = vec![];
    let mut fails = |changed: &Scenario| {
        tried.push(changed.clone());
        false
    };
    scenario::advice(puma, &scenario, &mut fails).unwrap();
    assert!(!tried.is_empty());
    for changed in &tried {
        let by = pose(changed).p - pose(&scenario).p;
        assert!(by.norm() < 1e-5, "the start pose stays: {by}");
        let is_changed = changed.start != scenario.start || changed.goal != scenario.goal;
        assert!(is_changed && changed.segment == scenario.segment);
        let deg = changed.start.q_deg.iter().flatten();
        assert!(
            deg.into_iter()
                .all(|deg| (deg * 1e4 - (deg * 1e4).round()).abs() < 1e-6)
        );
    }
}

/// Elbow and wrist are locked at the start, with one direction lost: the self-motion folds the arm and stretches it again, and there the lost direction
/// touches what the path needs.
#[test]
fn a_self_motion_leads_to_the_posture_in_which_a_fold_opens() {
    let line = [
        "[2.3358562273126307, -0.4808617754356229, 0.0, -0.5809155455306835, 0.0, 2.0515414539299233]",
        "[0.42696022709707954, -0.291693307110614, 0.2811488474230306]",
        "[[-0.42046401599940536, 0.5962321875655425, 0.68389852299918], [0.3437960545647685, -0.5928603861522544, 0.7282313062462356], \
         [0.8396512872111557, 0.5413166735305757, 0.04429418519898062]]",
    ];
    assert_planned::<6>("ur5", line, 2.3);
}

/// The cheap routes of spare joints end in a fold; one that first moves them far goes on.
#[test]
fn a_dear_route_is_kept_where_the_cheap_ones_end() {
    let line = [
        "[-0.4714209084614231, -1.1759497327954163, 0.6529140976927561, -1.0106071293870083, 1.7862306633989768, 3.5843310451252584, \
         -2.619045879997899]",
        "[-0.5151235244169481, 0.37014794405986967, 0.8000669507653935]",
        "[[-0.624254133192405, -0.7161674244212864, -0.31210734914445676], [0.5628271777488643, -0.689356403806157, 0.45608476900537964], \
         [-0.5417862541440555, 0.10905030366405749, 0.8334120746013519]]",
    ];
    assert_planned::<7>("fr3", line, 1.891);
}

/// A chain is compiled for six joints, and an arm of three is embedded in it: what moves nothing is no spare joint.
#[test]
fn an_absent_joint_is_not_searched() {
    let model = Model::<6>::new(robot("planar3r"), None).unwrap();
    let arm = Kinematics {
        model: &model,
        p_EC: Vector3::zeros(),
        task: [true, true, false, false, false, false],
        length_m: 1.0,
    };
    let spectrum = arm.spectrum(&Joints::from([0.3, 0.9, 0.8, 0.0, 0.0, 0.0]));
    let [spare] = spectrum.spare() else {
        panic!("{:?}", spectrum.spare())
    };
    assert!(
        spare.rows(3, 3).amax() == 0.0 && (arm.spectrum(&Joints::zeros()).J * spare).amax() > 0.0
    );
    assert!((spectrum.J * spare).norm() < 1e-12);
}

/// The straight continuation of this line takes a quarter longer than the path, because one joint turns around a lock: the spare joint leads around it.
#[test]
fn a_spare_joint_is_led_so_that_no_joint_makes_the_path_wait() {
    let q = "[1.940179, 0.236308, -1.38968, -1.303589, 0.796066, -1.670541, -2.311866]";
    let to = "to_m = [0.410003, -0.047411, 0.991185]\nrotation = [[-0.00149506, 0.99742618, -0.07168534], [-0.86898843, -0.03676799, -0.49346451], \
              [-0.49483014, 0.06155597, 0.86680678]]";
    let plan = assert_followed::<7>("iiwa14", q, to, 2.0897);
    assert!(plan.is_in_time(), "{}", plan.takes_s);
}

/// An eight through wrist lock, written to 0.1 µm: where it comes to rest in the lock, rounding decides where it goes, and no posture follows that.
#[test]
fn a_table_that_ends_in_a_lock_is_followed_as_far_as_it_is_written() {
    let row = |k: u32| {
        let x = f64::from(k) / 200.0;
        let angle = std::f64::consts::TAU * x.powi(3) * (10.0 - 15.0 * x + 6.0 * x * x);
        let (a, b) = (angle.sin(), (2.0 * angle).sin());
        format!(
            "{},{:.7},{:.7},{:.7},-0.4088532,-0.5769220,0.7047495,-0.0576904\n",
            2.0 * x,
            -0.3280804 - 0.02563946 * a - 0.00641997 * b,
            0.2255801 + 0.01691675 * a + 0.00039046 * b,
            0.1663399 - 0.0113679 * a + 0.01506083 * b,
        )
    };
    let rows: String = (0..=200).map(row).collect();
    let table = format!("table = {{ rows = \"\"\"t,x,y,z,qx,qy,qz,qw\n{rows}\"\"\" }}");
    let q = "[2.606742178956, -1.915457767842, -1.89903804756, 3.218878839703, 3.14159265359, -3.039004370528]";
    assert_followed::<6>("ur5", q, &table, 2.0);
}
