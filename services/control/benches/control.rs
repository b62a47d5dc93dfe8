//! What a tick costs: analyzer and controller, PUMA 560. `cargo bench -p control`
#![allow(non_snake_case, missing_docs)]

use control::{Analyzer, Controller, start_posture};
use divan::{AllocProfiler, Bencher};
use model::{Model, Robot};
use nalgebra::SVector;
use shared_types::scenario::Scenario;

#[global_allocator]
static ALLOC: AllocProfiler = AllocProfiler::system();

fn main() {
    divan::main();
}

const SCENARIOS: [(&str, &str); 3] = [
    ("fig5: wrist", include_str!("../../../sim/scenarios/fig5-wrist-rotation.toml")),
    ("straight-up: all three", include_str!("../../../sim/scenarios/straight-up.toml")),
    ("sweep: regular", include_str!("../../../sim/scenarios/sweep.toml")),
];

struct Loop {
    model: Model<6>,
    analyzer: Analyzer<6>,
    controller: Controller<6>,
    q: SVector<f64, 6>,
}

fn start(text: &str) -> Loop {
    let scenario = Scenario::parse("bench.toml", text, &[]).unwrap();
    let robot = Robot::builtin(&scenario.robot).unwrap();
    let model = Model::<6>::new(&robot, None).unwrap();
    let q = start_posture(&robot, &scenario).unwrap();
    let controller = Controller::new(model.clone(), &robot, &scenario, q).unwrap();
    Loop { model, analyzer: Analyzer::new(&robot, &scenario.analysis), controller, q }
}

#[divan::bench(args = SCENARIOS.map(|(name, _)| name))]
fn analyzer(bencher: Bencher, name: &str) {
    let text = SCENARIOS.iter().find(|(n, _)| *n == name).unwrap().1;
    let mut arm = start(text);
    let qdot = SVector::<f64, 6>::zeros();
    bencher.bench_local(|| {
        let terms = arm.model.evaluate(&arm.q, &qdot);
        arm.analyzer.step(&arm.q, &qdot, &terms)
    });
}

#[divan::bench(args = SCENARIOS.map(|(name, _)| name))]
fn controller(bencher: Bencher, name: &str) {
    let text = SCENARIOS.iter().find(|(n, _)| *n == name).unwrap().1;
    let mut arm = start(text);
    let qdot = SVector::<f64, 6>::zeros();
    let report = arm.analyzer.step(&arm.q, &qdot, &arm.model.evaluate(&arm.q, &qdot));
    let state = arm.controller.state();
    bencher.bench_local(|| {
        arm.controller.restore(&state);
        arm.controller.step(&arm.q, &qdot, &qdot, &report)
    });
}
