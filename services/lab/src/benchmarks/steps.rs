//! One tick of each process on one thread, without any message.

use std::hint::black_box;

use chain::Chain;
use hdrhistogram::Histogram;
use model::Robot;
use runtime::now_ns;
use session::{Failure, load};
use shared_types::process::Program;
use shared_types::scenario::Scenario;

use super::{Distribution, Row, histogram};

/// The default scenario, and one of an arm of seven joints.
const SCENARIOS: [&str; 2] = [load::DEFAULT_SCENARIO, "seven-joints"];

/// The processes of a tick in their order. The plant's step moves the arm and reads its sensors.
const STEPS: [Program; 4] = [
    Program::Plant,
    Program::Estimator,
    Program::Analyzer,
    Program::Controller,
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
            rows.push(Row {
                bench: "steps",
                mechanism: format!("{step}, {name}"),
                placement: "one thread",
                payload_bytes: 0,
                times: Distribution::of(times, 1.0),
                ratio_p50: None,
                ratio_p99: None,
            });
        };
        let steps = one_after_the_other(robot, scenario)?;
        let steps = STEPS.iter().zip(&steps);
        steps.for_each(|(step, times)| row(step.name(), times));
        let mut chain = Chain::new(robot, scenario).map_err(Failure::work)?;
        let (mut m, mut times) = (chain::Tick::default(), histogram());
        while timed(&mut times, || chain.step(black_box(&mut m))) {}
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
    let alone = STEPS.map(|program| chain::alone(program, robot, scenario).map_err(Failure::work));
    let mut alone = alone.into_iter().collect::<Result<Vec<_>, _>>()?;
    let (mut m, mut times) = (chain::Tick::default(), STEPS.map(|_| histogram()));
    loop {
        for (thread, own) in alone.iter_mut().zip(&mut times) {
            let step = || thread.tick(black_box(&mut m), &mut |_, _| ());
            if !timed(own, step).map_err(Failure::work)? {
                return Ok(times);
            }
        }
    }
}
