//! The cycles of the chain, side by side.

use model::{Refused, Robot};
use shared_types::fault::ScheduledFault;
use shared_types::scenario::Scenario;

/// The pure steps of all processes of the chain.
pub(crate) struct Cycles {
    pub(crate) plant: Box<dyn plant::Step>,
    pub(crate) estimator: Box<dyn estimator::Step>,
    pub(crate) analyzer: Box<dyn analyzer::Step>,
    pub(crate) controller: Box<dyn controller::Step>,
    /// Of a steered run.
    pub(crate) operator: Option<operator::Cycle>,
    /// The faults of sensors and drives that concern the tick in hand.
    in_force: Vec<ScheduledFault>,
}

impl Cycles {
    /// All of them at tick 0.
    ///
    /// # Errors
    /// [`Refused`] by the first that does not accept the robot or the scenario.
    pub(crate) fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        Ok(Self {
            plant: plant::cycle(robot, scenario)?,
            estimator: estimator::cycle(robot, scenario)?,
            analyzer: analyzer::cycle(robot, scenario)?,
            controller: controller::cycle(robot, scenario)?,
            operator: operator(scenario),
            in_force: Vec::with_capacity(scenario.fault.len()),
        })
    }

    /// Gives the plant those of `faults`, the scenario's, that concern a tick. As the plant process does it: also at the first tick that none concerns any
    /// more.
    pub(crate) fn apply_faults<'a>(
        &mut self,
        tick: u64,
        faults: impl Iterator<Item = &'a ScheduledFault>,
    ) {
        let had_faults = !self.in_force.is_empty();
        self.in_force.clear();
        let is_of_joint = |fault: &ScheduledFault| {
            fault.concerns(tick) && fault.kind().is_some_and(|kind| kind.concerns_joint())
        };
        self.in_force.extend(faults.copied().filter(is_of_joint));
        if had_faults || !self.in_force.is_empty() {
            self.plant.apply_faults(tick, &self.in_force);
        }
    }
}

/// The operator of a steered run, at tick 0.
pub(crate) fn operator(scenario: &Scenario) -> Option<operator::Cycle> {
    scenario
        .servo
        .as_ref()
        .map(|session| operator::Cycle::new(session, scenario.rate_hz))
}
