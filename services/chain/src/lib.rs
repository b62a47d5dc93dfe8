//! The same five pure cycles on one thread, without shared memory: the same bytes as the processes give, only quicker to reach.
//! Tests, comparisons and sweeps use it, and `armplane run` tries its first tick here before it starts anything.
#![allow(non_snake_case)]

use model::{Robot, with_dof};
use shared_types::codes::PHASE_REFUSED;
use shared_types::scenario::Scenario;
use shared_types::{PlantState, SensorSample, SingularityReport, StateEstimate, TorqueCommand};

/// One tick of the whole chain: what each process would have published.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tick {
    /// From the plant.
    pub sensor: SensorSample,
    /// From the plant.
    pub truth: PlantState,
    /// From the estimator.
    pub estimate: StateEstimate,
    /// From the analyzer.
    pub report: SingularityReport,
    /// From the controller.
    pub command: TorqueCommand,
}

/// The chain for an arm of `N` joints.
pub struct Chain<const N: usize> {
    plant: plant::Cycle<N>,
    estimator: estimator::Cycle<N>,
    analyzer: analyzer::Cycle<N>,
    controller: controller::Cycle<N>,
    tick: u64,
}

/// Why a chain cannot be built: one of its cycles does not accept the robot or the scenario.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{process}: {reason}")]
pub struct ChainError {
    /// Which one.
    pub process: &'static str,
    /// Why.
    pub reason: String,
}

impl<const N: usize> Chain<N> {
    /// All cycles at tick 0.
    ///
    /// # Errors
    /// [`ChainError`] with the first cycle that refuses.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, ChainError> {
        fn refused<E: std::fmt::Display>(process: &'static str) -> impl Fn(E) -> ChainError {
            move |error| ChainError { process, reason: error.to_string() }
        }
        Ok(Self {
            plant: plant::Cycle::new(robot, scenario).map_err(refused("plant"))?,
            estimator: estimator::Cycle::new(robot, scenario).map_err(refused("estimator"))?,
            analyzer: analyzer::Cycle::new(robot, scenario).map_err(refused("analyzer"))?,
            controller: controller::Cycle::new(robot, scenario).map_err(refused("controller"))?,
            tick: 0,
        })
    }

    /// One tick: sample, estimate, analyse, control, move.
    pub fn step(&mut self) -> Tick {
        let (mut sensor, mut truth) = self.plant.sample(self.tick);
        (sensor.header.incarnation, truth.header.incarnation) = (1, 1);
        let mut estimate = self.estimator.step(&sensor);
        estimate.header.incarnation = 1;
        let mut report = self.analyzer.step(&estimate);
        report.header.incarnation = 1;
        let mut command = self.controller.step(&estimate, &report);
        command.header.incarnation = 1;
        self.plant.step(Some(&command));
        self.tick += 1;
        Tick { sensor, truth, estimate, report, command }
    }

    /// Whether the task is over.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.plant.is_over()
    }
}

/// Runs a scenario to its end, handing each tick to `each`.
///
/// # Errors
/// [`ChainError`] where a cycle refuses the robot or the scenario.
pub fn run(robot: &Robot, scenario: &Scenario, mut each: impl FnMut(&Tick)) -> Result<(), ChainError> {
    with_dof!(robot.dof(), N => {
        let mut chain = Chain::<N>::new(robot, scenario)?;
        while !chain.is_over() {
            each(&chain.step());
        }
        Ok(())
    })
    .unwrap_or_else(|| Err(unsupported(robot)))
}

/// Tries a scenario's first tick: what the control law refuses at once is refused before any process starts.
///
/// # Errors
/// [`ChainError`] where a cycle refuses the robot or the scenario, or the controller refuses the first tick.
pub fn try_first_tick(robot: &Robot, scenario: &Scenario) -> Result<(), ChainError> {
    let mut first = None;
    with_dof!(robot.dof(), N => {
        first = Some(Chain::<N>::new(robot, scenario)?.step());
        Ok(())
    })
    .unwrap_or_else(|| Err(unsupported(robot)))?;
    match first.map(|tick| tick.command.phase) {
        Some(PHASE_REFUSED) => Err(ChainError { process: "controller", reason: "the control law refuses the start posture".to_owned() }),
        _ => Ok(()),
    }
}

fn unsupported(robot: &Robot) -> ChainError {
    ChainError {
        process: "model",
        reason: format!("{} has {} joints; this program is built for arms of {:?} joints", robot.name, robot.dof(), model::SUPPORTED_DOF),
    }
}
