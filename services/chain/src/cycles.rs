//! The cycles of the chain, one after the other.

use model::{Refused, Robot};
use plant::Step as _;
use shared_types::fault::ScheduledFault;
use shared_types::scenario::Scenario;

use crate::Tick;

/// The pure steps of all processes of the chain, for an arm of `N` joints.
struct Cycles<const N: usize> {
    plant: plant::Cycle<N>,
    estimator: estimator::Cycle<N>,
    analyzer: analyzer::Cycle<N>,
    controller: controller::Cycle<N>,
    /// Of a steered run.
    operator: Option<operator::Cycle>,
    in_force: InForce,
}

/// The same for an arm of any number of joints.
pub(crate) trait Step {
    /// Sample, estimate, analyse, control, move.
    fn step(&mut self, number: u64, faults: &[ScheduledFault], tick: &mut Tick);
    /// See [`controller::Step::obstacle`].
    fn obstacle(&self) -> Option<&str>;
    /// See [`controller::Step::warning`].
    fn warning(&self) -> Option<String>;
    /// Whether the task is over.
    fn is_over(&self) -> bool;
}

/// All of them at tick 0.
///
/// # Errors
/// [`Refused`] by the first that does not accept the robot or the scenario.
pub(crate) fn cycles(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn Step>, Refused> {
    model::boxed!(robot, N => Cycles::<N>::new(robot, scenario), dyn Step)
}

impl<const N: usize> Cycles<N> {
    fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        Ok(Self {
            plant: plant::Cycle::new(robot, scenario).map_err(Refused::because)?,
            estimator: estimator::Cycle::new(robot, scenario).map_err(Refused::because)?,
            analyzer: analyzer::Cycle::new(robot, scenario).map_err(Refused::because)?,
            controller: controller::Cycle::new(robot, scenario).map_err(Refused::because)?,
            operator: operator(scenario),
            in_force: InForce::of(scenario),
        })
    }
}

impl<const N: usize> Step for Cycles<N> {
    fn step(&mut self, number: u64, faults: &[ScheduledFault], tick: &mut Tick) {
        use controller::Step as _;
        use estimator::Step as _;
        let Self {
            plant,
            estimator,
            analyzer,
            controller,
            operator,
            in_force,
        } = self;
        in_force.apply(plant, number, faults);
        let Tick {
            sensor,
            plant_state,
            estimate,
            singularity,
            target,
            servo_state,
            control_state,
            torque,
            ..
        } = tick;
        plant.sample(number, sensor, plant_state);
        estimator.step(sensor, estimate);
        let terms = estimator.terms();
        let report = analyzer.analyse(terms, estimate, singularity);
        let inputs = (&*estimate, &*singularity);
        if let Some(operator) = operator {
            operator.step(sensor, target);
            controller.steer(inputs, Some(target), servo_state, control_state, torque);
        } else {
            let known = (Some(terms), Some(report));
            controller.command(known, inputs, None, control_state, torque);
        }
        plant.step(Some(torque));
    }

    fn obstacle(&self) -> Option<&str> {
        controller::Step::obstacle(&self.controller)
    }

    fn warning(&self) -> Option<String> {
        controller::Step::warning(&self.controller)
    }

    fn is_over(&self) -> bool {
        self.plant.is_over()
    }
}

/// The faults of sensors and drives that concern the tick in hand.
pub(crate) struct InForce(Vec<ScheduledFault>);

impl InForce {
    /// None yet, with room for all of a scenario: no tick allocates.
    pub(crate) fn of(scenario: &Scenario) -> Self {
        Self(Vec::with_capacity(scenario.fault.len()))
    }

    /// Gives the plant those of `faults`, the scenario's, that concern a tick. As the plant process does it: also at the first tick that none concerns any
    /// more.
    pub(crate) fn apply(
        &mut self,
        plant: &mut (impl plant::Step + ?Sized),
        tick: u64,
        faults: &[ScheduledFault],
    ) {
        let had_faults = !self.0.is_empty();
        self.0.clear();
        let is_of_joint = |fault: &ScheduledFault| {
            fault.concerns(tick) && fault.kind().is_some_and(|kind| kind.concerns_joint())
        };
        self.0.extend(faults.iter().copied().filter(is_of_joint));
        if had_faults || !self.0.is_empty() {
            plant.apply_faults(tick, &self.0);
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
