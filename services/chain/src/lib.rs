//! The same five pure cycles on one thread, without shared memory: the same bytes as the processes give, only quicker to reach.
//! Tests, comparisons and sweeps use it, and `armplane run` tries its first tick here before it starts anything.
#![allow(non_snake_case)]

use model::{Refused, Robot};
use shared_types::codes::{PHASE_REFUSED, REFUSALS, name_of};
use shared_types::scenario::Scenario;
use shared_types::topics::{ByTopic, Whole};

/// One tick of the whole chain: what each process would have published.
pub type Tick = ByTopic<Whole>;

/// The five cycles but the recorder's, hand in hand.
pub struct Chain {
    plant: Box<dyn plant::Step>,
    estimator: Box<dyn estimator::Step>,
    analyzer: Box<dyn analyzer::Step>,
    controller: Box<dyn controller::Step>,
    tick: u64,
}

impl Chain {
    /// All cycles at tick 0.
    ///
    /// # Errors
    /// [`Refused`] by the first cycle that does not accept the robot or the scenario, or where the scenario plans faults: they happen to
    /// processes, and there are none here. [`without_faults`] takes them out.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        if !scenario.fault.is_empty() {
            let what = format_args!("{} plans faults, and they happen to processes: one thread cannot compute it", scenario.name);
            return Err(Refused::because(what));
        }
        Ok(Self {
            plant: plant::cycle(robot, scenario)?,
            estimator: estimator::cycle(robot, scenario)?,
            analyzer: analyzer::cycle(robot, scenario)?,
            controller: controller::cycle(robot, scenario)?,
            tick: 0,
        })
    }

    /// One tick: sample, estimate, analyse, control, move.
    pub fn step(&mut self) -> Tick {
        let (mut sensor, mut plant_state) = self.plant.sample(self.tick);
        (sensor.header.incarnation, plant_state.header.incarnation) = (1, 1);
        let mut estimate = self.estimator.step(&sensor);
        estimate.header.incarnation = 1;
        let mut singularity = self.analyzer.step(&estimate);
        singularity.header.incarnation = 1;
        let mut torque = self.controller.step(&estimate, &singularity);
        torque.header.incarnation = 1;
        self.plant.step(Some(&torque));
        self.tick += 1;
        Tick { sensor, plant_state, estimate, singularity, torque }
    }

    /// Whether the task is over.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.plant.is_over()
    }
}

/// A scenario as one thread can compute it: nothing goes wrong in it.
#[must_use]
pub fn without_faults(scenario: &Scenario) -> Scenario {
    Scenario { fault: Vec::new(), ..scenario.clone() }
}

/// Runs a scenario to its end, handing each tick to `each`.
///
/// # Errors
/// As [`Chain::new`].
pub fn run(robot: &Robot, scenario: &Scenario, mut each: impl FnMut(&Tick)) -> Result<(), Refused> {
    let mut chain = Chain::new(robot, scenario)?;
    while !chain.is_over() {
        each(&chain.step());
    }
    Ok(())
}

/// Tries a scenario's first tick, nothing gone wrong: what the control law refuses at once is refused before any process starts.
///
/// # Errors
/// [`Refused`] where a cycle does not accept the robot or the scenario, or the control law refuses the first tick.
pub fn try_first_tick(robot: &Robot, scenario: &Scenario) -> Result<(), Refused> {
    let first = Chain::new(robot, &without_faults(scenario))?.step();
    match first.torque.phase {
        PHASE_REFUSED => {
            let why = name_of(REFUSALS, first.torque.refusal);
            Err(Refused::because(format_args!("the control law refuses the start: {why}")))
        }
        _ => Ok(()),
    }
}
