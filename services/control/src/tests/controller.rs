//! The controller as a whole: restarts and refusals.

use crate::testing::{puma, rk4, robot, scenario, undisturbed};
use crate::types::{Command, Phase, Refusal, Report};
use crate::{Analyzer, Controller, Inputs, start_posture};
use model::{Model, Robot, Terms};
use nalgebra::{SVector, Vector3};
use shared_types::scenario::Scenario;
use shared_types::{AnalyzerCheckpoint, ControllerCheckpoint};

/// The command at any tick.
fn step(
    controller: &mut Controller<6>,
    state: [&SVector<f64, 6>; 2],
    report: &Report<6>,
    terms: Option<&Terms<6>>,
) -> Command<6> {
    undisturbed(controller, 0, state, report, terms, None)
}

fn figure_5() -> (Scenario, Controller<6>, Analyzer<6>, SVector<f64, 6>) {
    let scenario = scenario(
        include_str!("../../../../sim/scenarios/fig5-wrist-rotation.toml"),
        &[],
    );
    let q = start_posture::<6>(robot("puma560"), &scenario).unwrap();
    let controller = Controller::new(puma().clone(), robot("puma560"), &scenario, q).unwrap();
    let analyzer = Analyzer::new(robot("puma560"), &scenario.analysis);
    (scenario, controller, analyzer, q)
}

#[test]
fn a_restarted_controller_and_analyzer_continue_bit_for_bit() {
    let (scenario, mut controller, mut analyzer, mut q) = figure_5();
    let mut qdot = SVector::zeros();
    let mut twins: Option<(Controller<6>, Analyzer<6>)> = None;
    for k in 0..2600 {
        if k % 333 == 0 {
            let (_, mut other, mut eyes, _) = figure_5();
            let (mut control, mut analysis) =
                <(ControllerCheckpoint, AnalyzerCheckpoint)>::default();
            controller.save(&mut control);
            analyzer.save(&mut analysis);
            other.restore(&control);
            eyes.restore(&analysis);
            twins = Some((other, eyes));
        }
        let terms = puma().evaluate(&q, &qdot);
        let report = analyzer.step(&q, &qdot, &terms);
        let command = step(&mut controller, [&q, &qdot], &report, None);
        let (other, eyes) = twins.as_mut().unwrap();
        assert_eq!(eyes.step(&q, &qdot, &terms), report, "tick {k}");
        let known = step(other, [&q, &qdot], &report, Some(&terms));
        assert_eq!(known, command, "tick {k}: with terms that are known");
        (q, qdot) = rk4(puma(), &q, &qdot, &command.tau, scenario.dt_s());
    }
}

#[test]
fn a_nan_is_refused_for_good_and_the_arm_held() {
    let (_, mut controller, mut analyzer, q) = figure_5();
    let zero = SVector::zeros();
    let report = analyzer.step(&q, &zero, &puma().evaluate(&q, &zero));
    let mut bad = q;
    bad[3] = f64::NAN;
    let command = step(&mut controller, [&bad, &zero], &report, None);
    assert!(
        command.refusal == Refusal::State
            && command.phase == Phase::Refused
            && command.tau.iter().all(|x| x.is_finite())
    );
    let command = step(&mut controller, [&q, &zero], &report, None);
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
    let (_, mut controller, mut analyzer, q) = figure_5();
    let zero = SVector::zeros();
    let mut report = analyzer.step(&q, &zero, &puma().evaluate(&q, &zero));
    report.singularities[1].aux_row = SVector::zeros();
    let command = step(&mut controller, [&q, &zero], &report, None);
    assert!(
        command.refusal == Refusal::Singular
            && command.phase == Phase::Refused
            && command.tau.iter().all(|x| x.is_finite())
    );
}

#[test]
fn a_damaged_checkpoint_is_refused_and_the_arm_held() {
    let (_, controller, mut analyzer, q) = figure_5();
    let zero = SVector::zeros();
    let report = analyzer.step(&q, &zero, &puma().evaluate(&q, &zero));
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
        let (_, mut other, ..) = figure_5();
        let mut checkpoint = ControllerCheckpoint::default();
        controller.save(&mut checkpoint);
        damage(&mut checkpoint);
        other.restore(&checkpoint);
        let command = step(&mut other, [&q, &zero], &report, None);
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
    let scenario = scenario(text, &[]);
    let q = start_posture::<6>(robot("puma560"), &scenario).unwrap();
    let mut controller = Controller::new(puma().clone(), robot("puma560"), &scenario, q).unwrap();
    let mut analyzer = Analyzer::new(robot("puma560"), &scenario.analysis);
    let (qdot, X) = (SVector::zeros(), puma().forward_kinematics(&q));
    let report = analyzer.step(&q, &qdot, &puma().evaluate(&q, &qdot));
    let mut last = step(&mut controller, [&q, &qdot], &report, None);
    for _ in 0..300 {
        last = step(&mut controller, [&q, &qdot], &report, None);
    }
    let refused = controller.refuse(&q, &qdot, Refusal::Limit);
    assert!(refused.phase == Phase::Refused && (last.X_BE_d.p - X.p).norm() > 1e-3);
    let by = (refused.X_BE_d.p - last.X_BE_d.p).norm();
    assert!(by < 1e-3, "{by}");
}

/// A load that the model does not know pulls on an arm that was refused, too: it is carried, but not by an estimate that is not to be trusted.
#[test]
fn a_refused_arm_carries_an_unknown_load() {
    let (_, mut controller, mut analyzer, q) = figure_5();
    let (qdot, terms) = (SVector::zeros(), puma().evaluate(&q, &SVector::zeros()));
    let report = analyzer.step(&q, &qdot, &terms);
    let load = terms
        .J
        .fixed_rows::<3>(0)
        .tr_mul(&Vector3::new(0.0, 0.0, -20.0));
    for (why, carried) in [(Refusal::Limit, 1.0), (Refusal::Estimate, 0.0)] {
        controller.refuse(&q, &qdot, why);
        let ticks = (0..500).map(|tick| {
            controller.step(&Inputs {
                tick,
                q: &q,
                qdot: &qdot,
                tau_disturbance: &load,
                wrist: None,
                report: &report,
                terms: None,
                target: None,
            })
        });
        let off = ticks.last().unwrap().tau - terms.bias() + load * carried;
        assert!(load.amax() > 5.0 && off.amax() < 1e-9, "{why:?}: {off}");
    }
}
