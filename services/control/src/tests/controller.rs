//! The controller as a whole: restarts and refusals.

use crate::linear::{Joints, Vector3, Vector6};
use crate::testing::{Bench, puma, robot, scenario};
use crate::types::{Phase, Refusal};
use crate::{Controller, start_posture};
use model::{Model, Robot};
use shared_types::{AnalyzerCheckpoint, ControllerCheckpoint};

fn figure_5() -> Bench<6> {
    Bench::new(include_str!(
        "../../../../sim/scenarios/fig5-wrist-rotation.toml"
    ))
}

const NOTHING: Vector6 = Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);

#[test]
fn a_restarted_controller_and_analyzer_continue_bit_for_bit() {
    let mut arm = figure_5();
    let (begun, mut twin) = (arm.clone(), arm.clone());
    for k in 0..2600 {
        if k % 333 == 0 {
            let (mut control, mut analysis) =
                <(ControllerCheckpoint, AnalyzerCheckpoint)>::default();
            arm.controller.save(&mut control);
            arm.analyzer.save(&mut analysis);
            twin = begun.clone();
            twin.controller.restore(&control);
            twin.analyzer.restore(&analysis);
        }
        // The twin is told the model's terms where the arm is not.
        (twin.q, twin.qdot, twin.tick) = (arm.q, arm.qdot, k + 1);
        let command = arm.command(None);
        assert_eq!(twin.command(None), command, "tick {k}");
        assert_eq!(twin.report, arm.report, "tick {k}");
        arm.moves(&command.tau);
    }
}

#[test]
fn a_nan_is_refused_for_good_and_the_arm_held() {
    let mut arm = figure_5();
    arm.command(None);
    let q = arm.q;
    arm.q[3] = f64::NAN;
    let command = arm.again(&NOTHING);
    assert!(
        command.refusal == Refusal::State
            && command.phase == Phase::Refused
            && command.tau.iter().all(|x| x.is_finite())
    );
    arm.q = q;
    let command = arm.again(&NOTHING);
    assert_eq!(
        (command.phase, command.refusal),
        (Phase::Refused, Refusal::State),
        "and stays so"
    );
    assert!(
        (command.tau - puma().gravity(&q)).amax() < 1e-9,
        "gravity is held"
    );
}

#[test]
fn a_report_that_makes_no_sense_is_refused() {
    let mut arm = figure_5();
    arm.command(None);
    arm.report.singularities[1].aux_row = Joints::zeros();
    let command = arm.again(&NOTHING);
    assert!(
        command.refusal == Refusal::Singular
            && command.phase == Phase::Refused
            && command.tau.iter().all(|x| x.is_finite())
    );
}

#[test]
fn a_damaged_checkpoint_is_refused_and_the_arm_held() {
    let begun = figure_5();
    let damages: [fn(&mut ControllerCheckpoint); 7] = [
        |one| one.loops[0].mode = 99,
        |one| one.refusal = 99,
        |one| one.servo.stop = 99,
        |one| one.tau[2] = f64::NAN,
        |one| one.loops[1].trust = f64::INFINITY,
        |one| one.qdot_plausible[0] = f64::NAN,
        |one| one.R_BE_start = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0],
    ];
    for damage in damages {
        let (mut arm, mut checkpoint) = (begun.clone(), ControllerCheckpoint::default());
        arm.controller.save(&mut checkpoint);
        damage(&mut checkpoint);
        arm.controller.restore(&checkpoint);
        let command = arm.command(None);
        assert_eq!(
            (command.phase, command.refusal),
            (Phase::Refused, Refusal::Checkpoint)
        );
        assert!(command.tau.iter().all(|x| x.is_finite()));
    }
}

/// A start on a joint limit, where noise takes the joint beyond, and one that gravity holds with nothing left: both are refused before the first tick.
#[test]
fn a_start_without_a_margin_is_refused() {
    let puma = robot("puma560");
    let (limit, line) = (puma.joints[5].upper, "by_m = [0.0, 0.0, -0.05]");
    let obstacle = |robot: &Robot, gap: f64| {
        let q6 = limit - gap;
        let text = format!(
            "name = \"x\"\nrobot = \"puma560\"\n[start]\nq = [0.3, -0.9, 2.6, 0.2, 0.8, {q6}]\n[[segment]]\n{line}\nduration_s = 2.0\n"
        );
        let scenario = scenario(&text, &[]);
        let q = start_posture::<6>(robot, &scenario).unwrap();
        let model = Model::<6>::new(robot, None).unwrap();
        let gravity = model.gravity(&q);
        let controller = Controller::new(model, robot, &scenario, q).unwrap();
        (controller.obstacle().is_some(), gravity)
    };
    let (is_refused, gravity) = obstacle(puma, 0.01);
    assert!(!is_refused && obstacle(puma, 0.0).0 && obstacle(puma, 1e-4).0);
    for (share, refused) in [(0.99, true), (0.96, true), (0.9, false)] {
        let mut heavy = puma.clone();
        heavy.joints[1].effort = gravity[1].abs() / share;
        assert_eq!(obstacle(&heavy, 0.01).0, refused, "{share}");
    }
}

/// The desired pose of an arm that is brought to rest is the one at which its path has stopped.
#[test]
fn a_refusal_states_the_pose_at_which_the_path_stopped() {
    let text = "name = \"x\"\nrobot = \"puma560\"\n[start]\nq = [0.3, -0.9, 2.6, 0.2, 0.8, 0.1]\n[[segment]]\nby_m = [0.0, 0.0, -0.05]\nduration_s = 0.5\n";
    let mut arm = Bench::<6>::new(text);
    let (q, qdot, X) = (arm.q, arm.qdot, arm.model.forward_kinematics(&arm.q));
    let last = (0..=300).map(|_| arm.command(None)).last().unwrap();
    let refused = arm.controller.refuse(&q, &qdot, Refusal::Limit);
    assert!(refused.phase == Phase::Refused && (last.X_BE_d.p - X.p).norm() > 1e-3);
    let by = (refused.X_BE_d.p - last.X_BE_d.p).norm();
    assert!(by < 1e-3, "{by}");
}

/// A load that the model does not know pulls on an arm that was refused, too: it is carried, but not by an estimate that is not to be trusted.
#[test]
fn a_refused_arm_carries_an_unknown_load() {
    let mut arm = figure_5();
    let (q, qdot, terms) = (arm.q, arm.qdot, arm.model.evaluate(&arm.q, &arm.qdot));
    let down = Vector3::new(0.0, 0.0, -20.0);
    let load = terms.J.fixed_rows::<3>(0).tr_mul(&down);
    for (why, carried) in [(Refusal::Limit, 1.0), (Refusal::Estimate, 0.0)] {
        arm.controller.refuse(&q, &qdot, why);
        let ticks = (0..500).map(|_| arm.again(&load));
        let off = ticks.last().unwrap().tau - terms.bias() + load * carried;
        assert!(load.amax() > 5.0 && off.amax() < 1e-9, "{why:?}: {off}");
    }
}
