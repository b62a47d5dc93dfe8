//! The controller's pure step: torque from the estimated state and its singularity report.

use control::linear::{Joints, is_finite};
use control::{Controller, Refusal, SetupError, start_posture, wire};
use model::{LastTerms, Model, Robot, embedded, stack};
use process::{Damaged, Flow, Inputs, Outputs, Port, Process, Snapshot};
use shared_types::scenario::Scenario;
use shared_types::{
    ControlState, ControllerCheckpoint, Header, ServoState, SingularityReport, StateEstimate,
    Target, TorqueCommand, WristForce,
};

/// One arm's control law, tick by tick.
#[derive(Clone, Debug)]
pub struct Cycle<const N: usize> {
    model: Model<N>,
    /// The arm's own joints; the places beyond them stay zero whatever a message or a checkpoint has there.
    dof: usize,
    obstacle: Option<String>,
    warning: Option<String>,
}

/// The law with what it remembers.
#[derive(Clone, Debug)]
pub struct Law<const N: usize>(pub Controller<N>);

impl<const N: usize> Cycle<N> {
    /// A controller at the start of the scenario's task.
    ///
    /// # Errors
    /// [`SetupError`] if the scenario does not fit the robot.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<(Self, Law<N>), SetupError> {
        let q_start = start_posture(robot, scenario)?;
        let model = Model::new(robot, scenario.frame())?;
        let law = Controller::new(model.clone(), robot, scenario, q_start)?;
        let cycle = Self {
            model,
            dof: robot.dof(),
            obstacle: law.obstacle().map(str::to_owned),
            warning: law.warning(),
        };
        Ok((cycle, Law(law)))
    }

    /// Position, velocity and disturbance torque of the arm's own joints.
    fn own(&self, estimate: &StateEstimate) -> [Joints<N>; 3] {
        [&estimate.q, &estimate.qdot, &estimate.tau_disturbance]
            .map(|values| embedded::<N>(&values[..self.dof]))
    }

    /// The torque for an estimate and the report of the same tick, towards the target of a steered run, and what the law did to arrive at it; a report that
    /// cannot be read is refused. No allocation.
    pub fn control(
        &self,
        Law(law): &mut Law<N>,
        read: &Read<'_>,
        out: &mut Commanded<'_>,
        last: &mut LastTerms<N>,
    ) {
        let Read {
            estimate,
            report,
            target,
            wrist,
        } = *read;
        let wrist = wrist.map(|wrist| stack(&wrist.force_n.into(), &wrist.torque_nm.into()));
        let (tick, [q, qdot, tau_disturbance]) = (estimate.header.tick, self.own(estimate));
        let is_state = is_finite(&q) && is_finite(&qdot);
        let terms = is_state.then(|| last.at(&self.model, &q, &qdot));
        let command = match wire::report(report) {
            Some(report) => law.step(&control::Inputs {
                tick,
                q: &q,
                qdot: &qdot,
                tau_disturbance: &tau_disturbance,
                wrist: wrist.as_ref(),
                report: &report,
                terms,
                target: target.map(|target| &target.target),
            }),
            None => law.refuse(&q, &qdot, Refusal::Report),
        };
        wire::command_messages(tick, &command, out.state, out.torque);
        out.torque.tau[self.dof..].fill(0.0);
        if let Some(servo) = &mut out.servo {
            **servo = ServoState {
                header: Header {
                    tick,
                    ..Header::default()
                },
                ..command.session.unwrap_or_default()
            };
        }
    }
}

/// The messages that a controller reads.
#[derive(Clone, Copy, Debug)]
pub struct Read<'a> {
    /// The estimated state.
    pub estimate: &'a StateEstimate,
    /// The report of the same tick.
    pub report: &'a SingularityReport,
    /// The target of this tick in a steered run; `None`: none has come.
    pub target: Option<&'a Target>,
    /// The force on the hand, where its wrist has a sensor.
    pub wrist: Option<&'a WristForce>,
}

/// The messages of a controller, to be filled.
pub struct Commanded<'a> {
    /// Of a steered run.
    pub servo: Option<&'a mut ServoState>,
    /// The law's account of the tick.
    pub state: &'a mut ControlState,
    /// The torque.
    pub torque: &'a mut TorqueCommand,
}

impl<const N: usize> Snapshot for Law<N> {
    fn layout(&self) -> u64 {
        ControllerCheckpoint::default().layout()
    }

    fn write(&self, out: &mut Vec<u8>) {
        let mut checkpoint = ControllerCheckpoint::default();
        self.0.save(&mut checkpoint);
        checkpoint.write(out)
    }

    fn read(&mut self, from: &[u8]) -> Result<(), Damaged> {
        let mut checkpoint = ControllerCheckpoint::default();
        checkpoint.read(from)?;
        self.0.restore(&checkpoint);
        Ok(())
    }
}

impl<const N: usize> Process for Cycle<N> {
    type State = Law<N>;
    const READS: &'static [Port] = &[
        Port::of::<SingularityReport>(),
        Port::of::<StateEstimate>(),
        Port::optional::<Target>(),
        Port::optional::<WristForce>(),
    ];
    const WRITES: &'static [Port] = &[
        Port::optional::<ServoState>(),
        Port::of::<ControlState>(),
        Port::of::<TorqueCommand>(),
    ];

    fn step(&self, law: &mut Law<N>, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>) -> Flow {
        if let (Some(report), Some(estimate), Some(state), Some(torque)) =
            (inputs.get(), inputs.get(), outputs.place(), outputs.place())
        {
            let mut out = Commanded {
                servo: outputs.place(),
                state,
                torque,
            };
            let last = outputs.scratch.of(|| LastTerms::of(&self.model));
            let read = Read {
                estimate,
                report,
                target: inputs.get(),
                wrist: inputs.get(),
            };
            self.control(law, &read, &mut out, last);
        }
        Flow::Go
    }

    fn obstacle(&self) -> Option<&str> {
        self.obstacle.as_deref()
    }

    fn warning(&self) -> Option<String> {
        self.warning.clone()
    }
}
