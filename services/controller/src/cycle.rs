//! The controller's pure step: torque from the estimated state and its singularity report.

use control::{Controller, Inputs, Refusal, Report, SetupError, start_posture, wire};
use model::{Model, Robot, Terms, embedded};
use nalgebra::SVector;
use shared_types::scenario::Scenario;
use shared_types::{
    ControlState, ControllerCheckpoint, Header, ServoState, SingularityReport, StateEstimate,
    Target, TorqueCommand,
};

/// One arm's control law, tick by tick.
#[derive(Clone, Debug)]
pub struct Cycle<const N: usize> {
    controller: Controller<N>,
    /// The arm's own joints; the places beyond them stay zero whatever a message or a checkpoint has there.
    dof: usize,
}

impl<const N: usize> Cycle<N> {
    /// A controller at the start of the scenario's task.
    ///
    /// # Errors
    /// [`SetupError`] if the scenario does not fit the robot.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, SetupError> {
        let q_start = start_posture(robot, scenario)?;
        Ok(Self {
            controller: Controller::new(
                Model::new(robot, scenario.frame())?,
                robot,
                scenario,
                q_start,
            )?,
            dof: robot.dof(),
        })
    }

    /// Position, velocity and disturbance torque of the arm's own joints.
    fn own(&self, estimate: &StateEstimate) -> [SVector<f64, N>; 3] {
        [&estimate.q, &estimate.qdot, &estimate.tau_disturbance]
            .map(|values| embedded::<N>(&values[..self.dof]))
    }

    /// The step, with the terms of the estimate and the content of its report where other steps in this address space have them.
    pub fn command(
        &mut self,
        (terms, report): (Option<&Terms<N>>, Option<&Report<N>>),
        (estimate, message): (&StateEstimate, &SingularityReport),
        target: Option<&Target>,
        state: &mut ControlState,
        torque: &mut TorqueCommand,
    ) -> Option<ServoState> {
        let (tick, [q, qdot, tau_disturbance]) = (estimate.header.tick, self.own(estimate));
        let read;
        let report = match report {
            Some(report) => Some(report).filter(|report| wire::is_readable(report)),
            None => {
                read = wire::report(message);
                read.as_ref().ok()
            }
        };
        let command = match report {
            Some(report) => self.controller.step(&Inputs {
                tick,
                q: &q,
                qdot: &qdot,
                tau_disturbance: &tau_disturbance,
                report,
                terms,
                target: target.map(|target| &target.target),
            }),
            None => self.controller.refuse(&q, &qdot, Refusal::Report),
        };
        wire::command_messages(tick, &command, state, torque);
        torque.tau[self.dof..].fill(0.0);
        command.session
    }
}

/// The pure step of an arm of any number of joints.
pub trait Step: Send + Sync {
    /// The torque for an estimate and the report of the same tick, and what the law did to arrive at it, at that tick. No allocation; a report
    /// that cannot be read is refused.
    fn step(
        &mut self,
        estimate: &StateEstimate,
        report: &SingularityReport,
        state: &mut ControlState,
        torque: &mut TorqueCommand,
    );
    /// The same towards the target of this tick, in a scenario that is steered; `None`: none has come.
    fn steer(
        &mut self,
        inputs: (&StateEstimate, &SingularityReport),
        target: Option<&Target>,
        servo: &mut ServoState,
        state: &mut ControlState,
        torque: &mut TorqueCommand,
    );
    /// Writes what must survive a restart: all that the next [`step`](Self::step) depends on besides its inputs.
    fn save(&self, out: &mut ControllerCheckpoint);
    /// Takes up what [`save`](Self::save) has written: the next step continues bit for bit.
    fn restore(&mut self, from: &ControllerCheckpoint);
    /// Begins a steered run with the arm at rest in another posture, one value per joint, rad: before the first tick, or [restored](Self::restore) to that.
    /// No allocation.
    fn begin(&mut self, q_start: &[f64]);
    /// The same, with its memory.
    fn copied(&self) -> Box<dyn Step>;
    /// Why the path cannot be followed, found before the first tick, in words.
    fn obstacle(&self) -> Option<&str>;
    /// A goal beyond reach, found before the first tick, in words.
    fn warning(&self) -> Option<String>;
}

impl<const N: usize> Step for Cycle<N> {
    fn begin(&mut self, q_start: &[f64]) {
        self.controller.begin(embedded(q_start));
    }

    fn copied(&self) -> Box<dyn Step> {
        Box::new(self.clone())
    }

    fn obstacle(&self) -> Option<&str> {
        self.controller.obstacle()
    }

    fn warning(&self) -> Option<String> {
        self.controller.warning()
    }

    fn save(&self, out: &mut ControllerCheckpoint) {
        self.controller.save(out);
    }

    fn restore(&mut self, from: &ControllerCheckpoint) {
        self.controller.restore(from);
    }

    fn step(
        &mut self,
        estimate: &StateEstimate,
        report: &SingularityReport,
        state: &mut ControlState,
        torque: &mut TorqueCommand,
    ) {
        self.command((None, None), (estimate, report), None, state, torque);
    }

    fn steer(
        &mut self,
        inputs: (&StateEstimate, &SingularityReport),
        target: Option<&Target>,
        servo: &mut ServoState,
        state: &mut ControlState,
        torque: &mut TorqueCommand,
    ) {
        let session = self.command((None, None), inputs, target, state, torque);
        *servo = ServoState {
            header: Header {
                tick: inputs.0.header.tick,
                ..Header::default()
            },
            ..session.unwrap_or_default()
        };
    }
}
