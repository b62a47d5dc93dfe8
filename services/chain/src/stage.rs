//! The step of any process but the plant: it works in place on a tick's messages.

use bytemuck::{bytes_of, pod_read_unaligned};
use model::{Refused, Robot};
use shared_types::process::Program;
use shared_types::scenario::Scenario;
use shared_types::{AnalyzerCheckpoint, Checkpoint, ControllerCheckpoint, EstimatorCheckpoint};

use crate::Tick;
use crate::cycles::operator;

/// The step of a process.
pub enum Stage {
    /// The estimator.
    Estimator(Box<dyn estimator::Step>),
    /// The analyzer.
    Analyzer(Box<dyn analyzer::Step>),
    /// The controller on a path.
    Controller(Box<dyn controller::Step>),
    /// The controller of a steered run.
    Steered(Box<dyn controller::Step>),
    /// The operator.
    Operator(Box<operator::Cycle>),
}

impl Stage {
    /// At tick 0; `None` for a program whose step is none of these.
    ///
    /// # Errors
    /// [`Refused`] if the step does not accept the robot or the scenario.
    pub fn new(
        program: Option<Program>,
        robot: &Robot,
        scenario: &Scenario,
    ) -> Result<Option<Self>, Refused> {
        let is_steered = scenario.servo.is_some();
        Ok(match program {
            Some(Program::Estimator) => Some(Self::Estimator(estimator::cycle(robot, scenario)?)),
            Some(Program::Analyzer) => Some(Self::Analyzer(analyzer::cycle(robot, scenario)?)),
            Some(Program::Controller) => {
                let step = controller::cycle(robot, scenario)?;
                let of = if is_steered {
                    Self::Steered
                } else {
                    Self::Controller
                };
                Some(of(step))
            }
            Some(Program::Operator) => operator(scenario).map(Box::new).map(Self::Operator),
            _ => None,
        })
    }

    /// Computes the outputs of a tick from its inputs, of which the target may be missing.
    pub fn step(&mut self, m: &mut Tick, has_target: bool) {
        match self {
            Self::Estimator(step) => step.step(&m.sensor, &mut m.estimate),
            Self::Analyzer(step) => step.step(&m.estimate, &mut m.singularity),
            Self::Controller(step) => {
                step.step(
                    &m.estimate,
                    &m.singularity,
                    &mut m.control_state,
                    &mut m.torque,
                );
            }
            Self::Steered(step) => step.steer(
                (&m.estimate, &m.singularity),
                has_target.then_some(&m.target),
                &mut m.servo_state,
                &mut m.control_state,
                &mut m.torque,
            ),
            Self::Operator(step) => step.step(&m.sensor, &mut m.target),
        }
    }

    /// Its checkpoint; empty if it has none.
    pub fn save(&self) -> Vec<u8> {
        fn saved<C: Checkpoint>(save: impl FnOnce(&mut C)) -> Vec<u8> {
            let mut state = C::zeroed();
            save(&mut state);
            bytes_of(&state).to_vec()
        }
        match self {
            Self::Estimator(step) => saved::<EstimatorCheckpoint>(|state| step.save(state)),
            Self::Analyzer(step) => saved::<AnalyzerCheckpoint>(|state| step.save(state)),
            Self::Controller(step) | Self::Steered(step) => {
                saved::<ControllerCheckpoint>(|state| step.save(state))
            }
            Self::Operator(_) => Vec::new(),
        }
    }

    /// Goes on from a checkpoint that [`save`](Self::save) has made.
    pub fn restore(&mut self, state: &[u8]) {
        match self {
            Self::Estimator(step) => step.restore(&pod_read_unaligned(state)),
            Self::Analyzer(step) => step.restore(&pod_read_unaligned(state)),
            Self::Controller(step) | Self::Steered(step) => {
                step.restore(&pod_read_unaligned(state));
            }
            Self::Operator(_) => {}
        }
    }
}
