//! The controller as a whole: restarts and refusals.

use crate::testing::{puma, rk4, robot, scenario};
use crate::types::{Command, Phase, Refusal, Report};
use crate::{Analyzer, Controller, Inputs, start_posture};
use model::Terms;
use nalgebra::SVector;
use shared_types::scenario::Scenario;
use shared_types::{AnalyzerCheckpoint, ControllerCheckpoint};

/// The command for a state without disturbance.
fn step(
    controller: &mut Controller<6>,
    [q, qdot]: [&SVector<f64, 6>; 2],
    report: &Report<6>,
    terms: Option<&Terms<6>>,
) -> Command<6> {
    controller.step(&Inputs {
        tick: 0,
        q,
        qdot,
        tau_disturbance: &SVector::zeros(),
        report,
        terms,
        target: None,
    })
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
