//! Routes for seeded lines through exactly singular postures, and for paths that have none.

use super::kinematics::SOLVED;
use super::*;
use crate::linear::rotation_exp;
use crate::reference::path::Path;
use crate::singularity::analyzer::Analyzer;
use crate::testing::robot;
use model::Robot;
use nalgebra::Matrix3;
use shared_types::random::Uniform;
use shared_types::scenario::{Analysis, Scenario, Segment, Start};

fn direction(random: &mut Uniform) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.within(-1.0, 1.0)).normalize()
}

fn plan_of<const N: usize>(robot: &Robot, scenario: &Scenario) -> Result<PathPlan<N>, Infeasible> {
    let model = Model::<N>::new(robot, None).unwrap();
    let q_start = crate::start_posture::<N>(robot, scenario).unwrap();
    let mut analyzer = Analyzer::new(robot, &scenario.analysis);
    let report = analyse(&mut analyzer.clone(), &model, &q_start);
    let path = Path::new(scenario, &report).unwrap();
    let _ = &mut analyzer;
    plan(&Request {
        model: &model,
        path: &path,
        q_start,
        postures: &[],
        analyzer: &analyzer,
        turning: &|_, _, _, _| None,
        task: robot.task.0,
        length_m: robot.length_m,
        rate_max: &scenario.control.aux_rate_max,
        position_m: 1e-3,
        orientation_rad: 0.5_f64.to_radians(),
    })
}

/// A line through the pose of `q`, between ends that some posture near `q` reaches within the limits.
fn line_through<const N: usize>(
    robot: &Robot,
    q: &SVector<f64, N>,
    random: &mut Uniform,
) -> Option<Scenario> {
    let model = Model::<N>::new(robot, None).unwrap();
    let arm = Kinematics {
        model: &model,
        p_EC: Vector3::zeros(),
        task: [true; 6],
        length_m: robot.length_m,
    };
    let at = arm.pose(q);
    let (along, turn) = (
        direction(random) * random.within(0.1, 0.2),
        direction(random) * random.within(0.0, 0.5),
    );
    let pose = |x: f64| Pose {
        R: rotation_exp(&(turn * x)) * at.R,
        p: at.p + along * x,
    };
    let inside = |q: &SVector<f64, N>| {
        (0..N).all(|i| q[i] > model.lower()[i] + 0.05 && q[i] < model.upper()[i] - 0.05)
    };
    let mut end = |x: f64| {
        let found = (0..60).filter_map(|_| {
            let guess = q + SVector::<f64, N>::from_fn(|_, _| random.within(-0.4, 0.4));
            let (there, e) = arm.solve(&pose(x), &guess, &SVector::zeros(), 0.0, SOLVED);
            (e.norm() < 1e-8 && inside(&there)).then_some(there)
        });
        found.min_by(|a, b| (a - q).norm().total_cmp(&(b - q).norm()))
    };
    let (q_start, _) = (end(-1.0)?, end(1.0)?);
    let goal = pose(1.0);
    let rows = |R: &Matrix3<f64>| std::array::from_fn(|i| std::array::from_fn(|j| R[(i, j)]));
    let text = format!(
        "name = \"line\"\nrobot = \"{}\"\n[start]\nposture = \"none\"\n[[segment]]\nduration_s = 2.0\n",
        robot.name
    );
    let template = Scenario::parse("line.toml", &text, &[]).unwrap();
    let segment = Segment {
        duration_s: 2.0,
        to_m: Some(goal.p.into()),
        rotation: Some(rows(&goal.R)),
        ..Segment::default()
    };
    let start = Start {
        q: Some(q_start.iter().copied().collect()),
        ..Start::default()
    };
    Some(Scenario {
        start,
        segment: vec![segment],
        ..template
    })
}

/// Whether the route's postures have the path's poses, within the limits, and do not jump.
fn holds<const N: usize>(robot: &Robot, scenario: &Scenario, plan: &PathPlan<N>) -> bool {
    let model = Model::<N>::new(robot, None).unwrap();
    let q_start = crate::start_posture::<N>(robot, scenario).unwrap();
    let report = analyse(
        &mut Analyzer::new(robot, &Analysis::default()),
        &model,
        &q_start,
    );
    let path = Path::new(scenario, &report).unwrap();
    let mut progress = Progress::at(model.forward_kinematics(&q_start));
    path.advance(&mut progress, 0.0, &report);
    let (mut last, mut worst) = (plan.at(0.0), [0.0_f64; 3]);
    for k in 1..=4000 {
        let now = plan.at(plan.duration_s() * f64::from(k) / 4000.0);
        let X_d = path.desired(
            &Progress {
                time_s: now.t.min(scenario.segment[0].duration_s - 1e-9),
                ..progress
            },
            1.0,
            0.0,
        );
        let X = model.forward_kinematics(&now.q);
        let (mm, deg) = (
            (X.p - X_d.p).norm() * 1e3,
            crate::linear::rotation_log(&(X.R * X_d.R.transpose()))
                .norm()
                .to_degrees(),
        );
        worst = [
            worst[0].max(mm),
            worst[1].max(deg),
            worst[2].max((now.q - last.q).amax()),
        ];
        assert!(
            (0..N).all(|i| now.q[i] > model.lower()[i] && now.q[i] < model.upper()[i]),
            "{}",
            now.q
        );
        assert!(now.t >= last.t);
        last = now;
    }
    // 1 mm and 0.5° are allowed at C; between the points the spline adds to it, and E lies beside C.
    println!("{worst:.3?}");
    worst[0] < 2.5 && worst[1] < 0.8 && worst[2] < 0.5
}

fn lines<const N: usize>(
    robot: &Robot,
    seed: u64,
    count: usize,
    lock: impl Fn(&mut SVector<f64, N>, &mut Uniform),
) -> usize {
    let model = Model::<N>::new(robot, None).unwrap();
    let mut random = Uniform(seed);
    let (mut drawn, mut planned) = (0, 0);
    while drawn < count {
        let mut q = SVector::<f64, N>::from_fn(|i, _| {
            let (low, high) = (model.lower()[i].max(-3.0), model.upper()[i].min(3.0));
            random.within(0.85 * low + 0.15 * high, 0.15 * low + 0.85 * high)
        });
        lock(&mut q, &mut random);
        let Some(scenario) = line_through(robot, &q, &mut random) else {
            continue;
        };
        drawn += 1;
        let began = std::time::Instant::now();
        let found = plan_of::<N>(robot, &scenario);
        let ms = began.elapsed().as_secs_f64() * 1e3;
        match found {
            Ok(plan) if plan.legs() == 1 => {
                println!(
                    "{} {drawn}: {} points, {:.2} s, {ms:.1} ms",
                    robot.name,
                    plan.points_count(),
                    plan.duration_s()
                );
                planned += usize::from(holds(robot, &scenario, &plan));
            }
            other => println!(
                "{} {drawn}: {:?} after {ms:.1} ms, q {}",
                robot.name,
                other.err(),
                q.transpose()
            ),
        }
    }
    planned
}

#[test]
fn lines_through_a_wrist_lock_have_routes() {
    let n = lines::<6>(robot("puma560"), 1, 12, |q, _| q[4] = 0.0);
    assert!(n >= 10, "{n} of 12");
    let n = lines::<6>(robot("ur5"), 2, 12, |q, _| q[4] = 0.0);
    assert!(n >= 10, "{n} of 12");
}

#[test]
fn lines_through_the_locks_of_seven_joints_have_routes() {
    let n = lines::<7>(robot("iiwa14"), 3, 6, |q, _| (q[1], q[5]) = (0.0, 0.0));
    assert!(n >= 5, "{n} of 6");
    let n = lines::<7>(robot("iiwa14"), 4, 6, |q, _| {
        (q[4], q[5]) = (std::f64::consts::FRAC_PI_2, 0.0)
    });
    assert!(n >= 5, "{n} of 6");
}

/// A scenario of one line, from a posture to a pose.
fn line_to(robot: &str, q_rad: &str, to_m: &str, rotation: &str, duration_s: f64) -> Scenario {
    let text = format!(
        "name = \"line\"\nrobot = \"{robot}\"\n[start]\nq = {q_rad}\n[[segment]]\nto_m = {to_m}\nrotation = {rotation}\nduration_s = {duration_s}\n"
    );
    Scenario::parse("line.toml", &text, &[]).unwrap()
}

/// Elbow and wrist are locked at the start, with one direction lost: the self-motion folds the arm and stretches it again, and there the lost direction
/// touches what the path needs.
#[test]
fn a_self_motion_leads_to_the_posture_in_which_a_fold_opens() {
    let scenario = line_to(
        "ur5",
        "[2.3358562273126307, -0.4808617754356229, 0.0, -0.5809155455306835, 0.0, 2.0515414539299233]",
        "[0.42696022709707954, -0.291693307110614, 0.2811488474230306]",
        "[[-0.42046401599940536, 0.5962321875655425, 0.68389852299918], [0.3437960545647685, -0.5928603861522544, 0.7282313062462356], \
         [0.8396512872111557, 0.5413166735305757, 0.04429418519898062]]",
        2.3,
    );
    let plan = plan_of::<6>(robot("ur5"), &scenario).unwrap();
    assert!(plan.legs() == 1 && holds(robot("ur5"), &scenario, &plan));
}

/// The cheap routes of spare joints end in a fold; one that first moves them far goes on.
#[test]
fn a_dear_route_is_kept_where_the_cheap_ones_end() {
    let scenario = line_to(
        "fr3",
        "[-0.4714209084614231, -1.1759497327954163, 0.6529140976927561, -1.0106071293870083, 1.7862306633989768, 3.5843310451252584, \
         -2.619045879997899]",
        "[-0.5151235244169481, 0.37014794405986967, 0.8000669507653935]",
        "[[-0.624254133192405, -0.7161674244212864, -0.31210734914445676], [0.5628271777488643, -0.689356403806157, 0.45608476900537964], \
         [-0.5417862541440555, 0.10905030366405749, 0.8334120746013519]]",
        1.891,
    );
    let fr3 = Robot::builtin("fr3").unwrap();
    let plan = plan_of::<7>(&fr3, &scenario).unwrap();
    assert!(plan.legs() == 1 && holds(&fr3, &scenario, &plan));
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
    let spectrum = arm.spectrum(&SVector::from([0.3, 0.9, 0.8, 0.0, 0.0, 0.0]));
    let [spare] = spectrum.spare() else {
        panic!("{:?}", spectrum.spare())
    };
    assert!(
        spare.rows(3, 3).amax() == 0.0 && (arm.spectrum(&SVector::zeros()).J * spare).amax() > 0.0
    );
    assert!((spectrum.J * spare).norm() < 1e-12);
}
