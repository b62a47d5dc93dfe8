//! One tick of each process on one thread, without any message.

use std::hint::black_box;

use chain::Chain;
use hdrhistogram::Histogram;
use model::Robot;
use runtime::now_ns;
use session::{Failure, load};
use shared_types::scenario::Scenario;

use super::{Distribution, Row, histogram};

/// The default scenario, and one of an arm of seven joints.
const SCENARIOS: [&str; 2] = [load::DEFAULT_SCENARIO, "seven-joints"];

/// The steps of a tick in their order.
const STEPS: [&str; 5] = [
    "plant, sample",
    "estimator",
    "analyzer",
    "controller",
    "plant, move",
];

/// The pure steps of the chain over whole scenarios, as the processes compute them, and all of them as one chain runs them.
///
/// # Errors
/// [`Failure`] where a scenario cannot be loaded, or does not fit its robot.
pub fn steps() -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for name in SCENARIOS {
        let loaded = load::scenario(name, &[], None)?;
        let (robot, scenario) = (&loaded.robot, &loaded.scenario);
        let mut row = |step: &str, times: &Histogram<u64>| {
            let times = Distribution::of(times, 1.0);
            rows.push(Row::alone("steps", &format!("{step}, {name}"), times));
        };
        let steps = one_after_the_other(robot, scenario)?;
        let steps = STEPS.iter().zip(&steps);
        steps.for_each(|(step, times)| row(step, times));
        let mut chain = Chain::new(robot, scenario).map_err(Failure::work)?;
        let (mut m, mut times) = (chain::Tick::default(), histogram());
        while !chain.is_over() {
            timed(&mut times, || chain.step(black_box(&mut m)));
        }
        row("whole tick", &times);
    }
    Ok(rows)
}

/// Takes the time of some work.
fn timed<T>(times: &mut Histogram<u64>, work: impl FnOnce() -> T) -> T {
    let began = now_ns();
    let result = work();
    times.saturating_record(now_ns() - began);
    result
}

/// The pure steps over a whole scenario, one after the other, as the processes compute them.
fn one_after_the_other(
    robot: &Robot,
    scenario: &Scenario,
) -> Result<[Histogram<u64>; STEPS.len()], Failure> {
    let mut plant = plant::cycle(robot, scenario).map_err(Failure::work)?;
    let mut estimator = estimator::cycle(robot, scenario).map_err(Failure::work)?;
    let mut analyzer = analyzer::cycle(robot, scenario).map_err(Failure::work)?;
    let mut controller = controller::cycle(robot, scenario).map_err(Failure::work)?;
    let mut m = chain::Tick::default();
    let mut steps = [(); STEPS.len()].map(|()| histogram());
    let [sampling, estimating, analyzing, controlling, moving] = &mut steps;
    for tick in 0.. {
        if plant.is_over() {
            break;
        }
        timed(sampling, || {
            plant.sample(tick, &mut m.sensor, &mut m.plant_state)
        });
        timed(estimating, || estimator.step(&m.sensor, &mut m.estimate));
        timed(analyzing, || analyzer.step(&m.estimate, &mut m.singularity));
        timed(controlling, || {
            controller.step(
                &m.estimate,
                &m.singularity,
                &mut m.control_state,
                &mut m.torque,
            )
        });
        timed(moving, || plant.step(Some(&m.torque)));
    }
    Ok(steps)
}
