//! The cost of a tick: model, analyzer and controller, by formula, by geometry and by number. `cargo bench -p control`
#![allow(non_snake_case, missing_docs)]

use control::{Analyzer, Controller, Inputs, start_posture};
use divan::{AllocProfiler, Bencher};
use model::{Model, Robot};
use nalgebra::SVector;
use shared_types::scenario::Scenario;

#[global_allocator]
static ALLOC: AllocProfiler = AllocProfiler::system();

fn main() {
    divan::main();
}

/// Name, joints, scenario, whether its formulas are ignored.
const SCENARIOS: [(&str, usize, &str, bool); 7] = [
    (
        "fig5: wrist",
        6,
        include_str!("../../../sim/scenarios/fig5-wrist-rotation.toml"),
        false,
    ),
    (
        "straight-up: all three",
        6,
        include_str!("../../../sim/scenarios/straight-up.toml"),
        false,
    ),
    (
        "straight-up, by number",
        6,
        include_str!("../../../sim/scenarios/straight-up.toml"),
        true,
    ),
    (
        "sweep: regular",
        6,
        include_str!("../../../sim/scenarios/sweep.toml"),
        false,
    ),
    (
        "ur5: wrist",
        6,
        include_str!("../../../sim/scenarios/ur5-wrist.toml"),
        false,
    ),
    (
        "iiwa: elbow",
        7,
        include_str!("../../../sim/scenarios/iiwa-posture.toml"),
        false,
    ),
    (
        "iiwa: elbow, by number",
        7,
        include_str!("../../../sim/scenarios/iiwa-posture.toml"),
        true,
    ),
];

struct Loop<const N: usize> {
    model: Model<N>,
    analyzer: Analyzer<N>,
    controller: Controller<N>,
    q: SVector<f64, N>,
}

fn start<const N: usize>(text: &str, numeric: bool) -> Loop<N> {
    let mut scenario = Scenario::parse("bench.toml", text, &[]).unwrap();
    scenario.analysis.numeric = numeric;
    let robot = Robot::builtin(&scenario.robot).unwrap();
    let model = Model::<N>::new(&robot, None).unwrap();
    let q = start_posture(&robot, &scenario).unwrap();
    let controller = Controller::new(model.clone(), &robot, &scenario, q).unwrap();
    Loop {
        model,
        analyzer: Analyzer::new(&robot, &scenario.analysis),
        controller,
        q,
    }
}

fn analyse<const N: usize>(bencher: Bencher, text: &str, numeric: bool) {
    let mut arm = start::<N>(text, numeric);
    let qdot = SVector::<f64, N>::zeros();
    bencher.bench_local(|| {
        let terms = arm.model.evaluate(&arm.q, &qdot);
        arm.analyzer.step(&arm.q, &qdot, &terms)
    });
}

fn control<const N: usize>(bencher: Bencher, text: &str, numeric: bool) {
    let mut arm = start::<N>(text, numeric);
    let qdot = SVector::<f64, N>::zeros();
    let report = arm
        .analyzer
        .step(&arm.q, &qdot, &arm.model.evaluate(&arm.q, &qdot));
    let mut state = shared_types::ControllerCheckpoint::default();
    arm.controller.save(&mut state);
    bencher.bench_local(|| {
        arm.controller.restore(&state);
        arm.controller.step(&Inputs {
            tick: 0,
            q: &arm.q,
            qdot: &qdot,
            tau_disturbance: &qdot,
            report: &report,
            terms: None,
            target: None,
        })
    });
}

#[divan::bench(args = SCENARIOS.map(|(name, ..)| name))]
fn analyzer(bencher: Bencher, name: &str) {
    let (_, joints, text, numeric) = *SCENARIOS.iter().find(|(known, ..)| *known == name).unwrap();
    if joints == 7 {
        analyse::<7>(bencher, text, numeric)
    } else {
        analyse::<6>(bencher, text, numeric)
    }
}

#[divan::bench(args = SCENARIOS.map(|(name, ..)| name))]
fn controller(bencher: Bencher, name: &str) {
    let (_, joints, text, numeric) = *SCENARIOS.iter().find(|(known, ..)| *known == name).unwrap();
    if joints == 7 {
        control::<7>(bencher, text, numeric)
    } else {
        control::<6>(bencher, text, numeric)
    }
}
