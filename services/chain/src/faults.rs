//! The chain under the faults that its scenario plans for processes and messages: the same steps, in turn, under the lockstep protocol.

use lockstep::{Checkpoints, Ended, Run, Sink};
use model::{Refused, Robot};
use shared_types::fault::ScheduledFault;
use shared_types::graph::{Graph, Role};
use shared_types::process::Program;
use shared_types::scenario::Scenario;
use shared_types::{
    AnalyzerCheckpoint, ControlState, ControllerCheckpoint, EstimatorCheckpoint, Message,
    PlantState, SensorSample, ServoState, SingularityReport, StateEstimate, Target, TorqueCommand,
};

use crate::cycles::{Cycles, operator};

/// The process graph of a scenario on one thread: the built-in one.
///
/// # Errors
/// [`Refused`] where it cannot be read.
pub fn graph(scenario: &Scenario) -> Result<Graph, Refused> {
    Graph::built_in(scenario.servo.is_some()).map_err(Refused::because)
}

/// The faults that a scenario plans, where one thread can have them: those of sensors and drives, of messages, and deaths and pauses of all processes that
/// are replaced. What costs a process time alone changes nothing in lockstep.
///
/// # Errors
/// [`Refused`] where a fault ends the run with the plant, or happens to the recorder, which one thread has not; or where it makes no sense.
pub fn planned_faults(scenario: &Scenario) -> Result<Vec<ScheduledFault>, Refused> {
    if scenario.fault.is_empty() {
        return Ok(Vec::new());
    }
    let graph = graph(scenario)?;
    for fault in &scenario.fault {
        let role = graph
            .process(&fault.process)
            .map(shared_types::process::Process::role);
        let (name, kind, process) = (&scenario.name, fault.kind.name(), &fault.process);
        let because = match role {
            Some(Role::World) if fault.kind.ends_process(fault.way) => "it ends the run",
            Some(Role::Observer) => "one thread has no such process",
            _ => continue,
        };
        return Err(Refused::because(format_args!(
            "{name} plans the `{kind}` of the {process}, and {because}: take it out, or run it in processes"
        )));
    }
    scenario.scheduled_faults(&graph).map_err(Refused::because)
}

/// Whether a scenario plans faults of processes or of their messages, besides those of the arm's own sensors and drives.
#[must_use]
pub fn plans_faults_of_processes(scenario: &Scenario) -> bool {
    scenario
        .fault
        .iter()
        .any(|fault| !fault.kind.concerns_joint())
}

/// The places of the processes in their graph.
#[derive(Clone, Copy)]
struct Places {
    plant: usize,
    estimator: usize,
    analyzer: usize,
    operator: Option<usize>,
    controller: usize,
}

impl Places {
    fn of(graph: &Graph) -> Result<Self, Refused> {
        let place = |program| {
            graph
                .process
                .iter()
                .position(|process| process.program() == Some(program))
        };
        let needed = |program: Program| {
            place(program).ok_or_else(|| {
                Refused::because(format_args!("the graph has no {}", program.name()))
            })
        };
        Ok(Self {
            plant: needed(Program::Plant)?,
            estimator: needed(Program::Estimator)?,
            analyzer: needed(Program::Analyzer)?,
            operator: place(Program::Operator),
            controller: needed(Program::Controller)?,
        })
    }
}

/// The cycles of the chain, each with what its process keeps for a replacement.
struct UnderFaults<'a, O> {
    run: Run<'a, O>,
    at: Places,
    robot: &'a Robot,
    scenario: &'a Scenario,
    tick: u64,
    cycles: Cycles,
    estimator_states: Checkpoints<EstimatorCheckpoint>,
    analyzer_states: Checkpoints<AnalyzerCheckpoint>,
    controller_states: Checkpoints<ControllerCheckpoint>,
}

/// Runs a scenario under its faults to its end, handing each message that counts to `sink`. The sentence: why it ended before its task did.
///
/// # Errors
/// As [`planned_faults`], and [`Refused`] by the first cycle that does not accept the robot or the scenario.
pub fn run_under_faults(
    robot: &Robot,
    scenario: &Scenario,
    sink: &mut impl Sink,
) -> Result<Option<String>, Refused> {
    let (graph, faults) = (graph(scenario)?, planned_faults(scenario)?);
    let mut chain = UnderFaults {
        at: Places::of(&graph)?,
        run: Run::new(&graph, faults, sink),
        robot,
        scenario,
        tick: 0,
        cycles: Cycles::new(robot, scenario)?,
        estimator_states: Checkpoints::default(),
        analyzer_states: Checkpoints::default(),
        controller_states: Checkpoints::default(),
    };
    while !chain.cycles.plant.is_over() {
        if let Err(ended) = chain.step() {
            return Ok(Some(ended.to_string()));
        }
    }
    Ok(None)
}

/// A message of a tick, to be filled in.
fn of_tick<M: Message>(tick: u64) -> M {
    let mut message = M::zeroed();
    message.header_mut().tick = tick;
    message
}

impl<O: Sink> UnderFaults<'_, O> {
    /// One tick: each process in turn.
    fn step(&mut self) -> Result<(), Ended> {
        self.sample()?;
        self.estimate()?;
        self.analyse()?;
        self.steer()?;
        self.control()?;
        let torque = self.run.arriving::<TorqueCommand>(self.at.plant);
        self.cycles.plant.step(torque.as_ref());
        self.tick += 1;
        Ok(())
    }

    fn sample(&mut self) -> Result<(), Ended> {
        let (me, tick) = (self.at.plant, self.tick);
        self.run.begin(me, tick);
        self.cycles.apply_faults(tick, self.run.faults());
        let (mut sample, mut truth) = (of_tick::<SensorSample>(tick), of_tick::<PlantState>(tick));
        self.cycles.plant.sample(tick, &mut sample, &mut truth);
        self.run.send(me, sample)?;
        self.run.send(me, truth).map(drop)
    }

    fn estimate(&mut self) -> Result<(), Ended> {
        let me = self.at.estimator;
        while let Some(sample) = self.run.next::<SensorSample>(me, self.tick) {
            let mut estimate = of_tick::<StateEstimate>(sample.header.tick);
            self.cycles.estimator.step(&sample, &mut estimate);
            self.cycles.estimator.save(self.estimator_states.slot());
            if self.run.send(me, estimate)? {
                self.estimator_states.commit(sample.header.tick);
            }
        }
        if self.run.has_fallen(me) {
            self.run.restart(me)?;
            self.cycles.estimator =
                estimator::cycle(self.robot, self.scenario).map_err(Ended::because)?;
            let last = self
                .estimator_states
                .resume(|tick| self.run.may_resume_from(me, tick));
            last.into_iter()
                .for_each(|last| self.cycles.estimator.restore(last));
        }
        Ok(())
    }

    fn analyse(&mut self) -> Result<(), Ended> {
        let me = self.at.analyzer;
        while let Some(estimate) = self.run.next::<StateEstimate>(me, self.tick) {
            let mut report = of_tick::<SingularityReport>(estimate.header.tick);
            self.cycles.analyzer.step(&estimate, &mut report);
            self.cycles.analyzer.save(self.analyzer_states.slot());
            if self.run.send(me, report)? {
                self.analyzer_states.commit(estimate.header.tick);
            }
        }
        if self.run.has_fallen(me) {
            self.run.restart(me)?;
            self.cycles.analyzer =
                analyzer::cycle(self.robot, self.scenario).map_err(Ended::because)?;
            let last = self
                .analyzer_states
                .resume(|tick| self.run.may_resume_from(me, tick));
            last.into_iter()
                .for_each(|last| self.cycles.analyzer.restore(last));
        }
        Ok(())
    }

    fn steer(&mut self) -> Result<(), Ended> {
        let (Some(me), Some(cycle)) = (self.at.operator, &mut self.cycles.operator) else {
            return Ok(());
        };
        while let Some(sample) = self.run.next::<SensorSample>(me, self.tick) {
            let mut target = of_tick::<Target>(sample.header.tick);
            cycle.step(&sample, &mut target);
            self.run.send(me, target)?;
        }
        if self.run.has_fallen(me) {
            self.run.restart(me)?;
            self.cycles.operator = operator(self.scenario);
        }
        Ok(())
    }

    fn control(&mut self) -> Result<(), Ended> {
        let me = self.at.controller;
        while let Some(report) = self.run.next::<SingularityReport>(me, self.tick) {
            let tick = report.header.tick;
            let Some(estimate) = self.run.at::<StateEstimate>(me, tick) else {
                continue;
            };
            let (mut state, mut torque) = (
                of_tick::<ControlState>(tick),
                of_tick::<TorqueCommand>(tick),
            );
            if self.cycles.operator.is_some() {
                let (target, mut servo) =
                    (self.run.at::<Target>(me, tick), of_tick::<ServoState>(tick));
                self.cycles.controller.steer(
                    (&estimate, &report),
                    target.as_ref(),
                    &mut servo,
                    &mut state,
                    &mut torque,
                );
                self.cycles.controller.save(self.controller_states.slot());
                self.run.send(me, servo)?;
            } else {
                self.cycles
                    .controller
                    .step(&estimate, &report, &mut state, &mut torque);
                self.cycles.controller.save(self.controller_states.slot());
            }
            self.run.send(me, state)?;
            if self.run.send(me, torque)? {
                self.controller_states.commit(tick);
            }
        }
        if self.run.has_fallen(me) {
            self.run.restart(me)?;
            self.cycles.controller =
                controller::cycle(self.robot, self.scenario).map_err(Ended::because)?;
            let last = self
                .controller_states
                .resume(|tick| self.run.may_resume_from(me, tick));
            last.into_iter()
                .for_each(|last| self.cycles.controller.restore(last));
        }
        Ok(())
    }
}
