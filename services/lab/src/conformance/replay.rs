//! The recorded inputs of a run, fed to the step of one process again.

use std::collections::BTreeMap;
use std::path::Path;

use message_log::{Difference, LogError, LogReader, Logs};
use model::{Refused, Robot};
use runtime::apply_to_outgoing;
use session::{Failure, JOB, Observer, Progress, Run, SUMMARY};
use shared_types::codes::{DRIVE_ABSENT, DRIVE_ENCODER, DRIVE_STALE};
use shared_types::fault::{Fault, Kind, ScheduledFault};
use shared_types::graph::Process;
use shared_types::job::Job;
use shared_types::process::Program;
use shared_types::scenario::Scenario;
use shared_types::summary::Summary;
use shared_types::{
    AnalyzerCheckpoint, Checkpoint, ControlState, ControllerCheckpoint, EstimatorCheckpoint,
    Message, PlantState, SensorSample, ServoState, SingularityReport, StateEstimate, Target,
    TorqueCommand,
};

use super::inputs::{Cursor, InOrder, Inputs};
use super::outputs::{Comparison, Topic};

/// The result of a replay.
pub struct Replayed {
    /// The process, by its name in the run's graph.
    pub process: String,
    /// By topic.
    pub topics: Vec<Topic>,
    /// Recorded outputs whose inputs are not in the record; they cannot be computed again.
    pub without_input: u64,
    /// The message logs that do not hold what the run's summary counts, a clause for each.
    pub damage: Vec<String>,
    /// The run did not come to its end, so that its record may lack the last messages.
    pub is_cut: bool,
    /// Why the replay ended before the record did; empty where it did not.
    pub ended: String,
}

impl Replayed {
    /// Whether every output of the run was computed again.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        // The last messages of the topics of a cut run do not end at one tick.
        (self.is_cut || self.without_input == 0) && self.damage.is_empty() && self.ended.is_empty()
    }

    /// The earliest difference; of one tick, that of the topic that is sent first.
    pub fn first(&self) -> Option<(u64, &'static str, &Difference)> {
        let firsts = self.topics.iter().filter_map(|topic| {
            topic
                .first
                .as_ref()
                .map(|(tick, place)| (*tick, topic.name, place))
        });
        firsts.min_by_key(|(tick, ..)| *tick)
    }
}

/// Feeds the recorded inputs of a run to the step of one process, with values of the scenario overridden, and compares its outputs. Without a
/// name the process is the one that armplane's controller runs in.
///
/// # Errors
/// [`Failure`] where the run wrote no messages, cannot be read, has no such process, or the step refuses the scenario.
pub fn replay(
    run: &Path,
    process: Option<&str>,
    settings: &[String],
    observer: Observer<'_>,
) -> Result<(Job, Replayed), Failure> {
    let found = Run {
        folder: run.to_owned(),
        parts: Vec::new(),
    };
    let job = found.job()?;
    if !job.messages {
        let run = run.display();
        return Err(Failure::Input(format!(
            "{run} was run without its messages, which `armplane replay` reads: run it again without --no-messages and --no-record"
        )));
    }
    let robot = Robot::from_source(&job.robot).map_err(Failure::input)?;
    let scenario = with_settings(&job.scenario, settings)?;
    let is_asked = |one: &Process| {
        process.map_or(one.program() == Some(Program::Controller), |name| {
            one.name == name
        })
    };
    let asked = job
        .graph
        .process
        .iter()
        .find(|one| is_asked(one))
        .and_then(|one| Some((one.name.clone(), one.program()?)));
    let Some((name, program)) = asked else {
        return Err(no_step(process.unwrap_or("controller"), &job, run));
    };
    // One that is there and cannot be read is a defect of the run, as a log is.
    let (summary, defect) = match found.summary_if_any() {
        Ok(summary) => (summary, None),
        Err(defect) => (None, Some(defect)),
    };
    let scheduled_faults = scheduled_faults(summary.as_ref(), &job, &name)?;
    let is_cut = summary.as_ref().is_none_or(|summary| !summary.completed);
    let folder = run.join(recorder::MESSAGES);
    let mut damage = found.message_damage(&job, summary.as_ref());
    damage.extend(defect);
    let logs = Logs::of(&job);
    let tape = Tape {
        folder,
        run: &found,
        logs,
        observer,
        process: name.clone(),
        is_cut,
        damage,
        scheduled_faults,
    };
    observer(Progress::Begin {
        title: &scenario.name,
        length: scenario.planned_ticks(),
        unit: "ticks",
    });
    let refused = |error: Refused| Failure::input(error);
    let replayed = match program {
        Program::Estimator => tape.step::<_, StateEstimate, EstimatorCheckpoint, _>(
            tape.open::<SensorSample>()?,
            || estimator::cycle(&robot, &scenario).map_err(refused),
            |cycle, sample, estimate| cycle.step(&sample, estimate),
            |cycle, out| cycle.save(out),
            |cycle, last| cycle.restore(last),
        ),
        Program::Analyzer => tape.step::<_, SingularityReport, AnalyzerCheckpoint, _>(
            tape.open::<StateEstimate>()?,
            || analyzer::cycle(&robot, &scenario).map_err(refused),
            |cycle, estimate, report| cycle.step(&estimate, report),
            |cycle, out| cycle.save(out),
            |cycle, last| cycle.restore(last),
        ),
        Program::Controller if scenario.servo.is_some() => tape
            .step::<_, Steered, ControllerCheckpoint, _>(
                (
                    tape.open::<SingularityReport>()?,
                    tape.open::<StateEstimate>()?,
                    tape.open::<Target>()?,
                ),
                || controller::cycle(&robot, &scenario).map_err(refused),
                |cycle, (report, estimate, target), out| {
                    let Control { state, torque } = &mut out.control;
                    cycle.steer(
                        (&estimate, &report),
                        target.as_ref(),
                        &mut out.servo,
                        state,
                        torque,
                    );
                },
                |cycle, out| cycle.save(out),
                |cycle, last| cycle.restore(last),
            ),
        Program::Controller => tape.step::<_, Control, ControllerCheckpoint, _>(
            (
                tape.open::<SingularityReport>()?,
                tape.open::<StateEstimate>()?,
            ),
            || controller::cycle(&robot, &scenario).map_err(refused),
            |cycle, (report, estimate), out| {
                cycle.step(&estimate, &report, &mut out.state, &mut out.torque)
            },
            |cycle, out| cycle.save(out),
            |cycle, last| cycle.restore(last),
        ),
        Program::Plant => tape.plant(&robot, &scenario),
        Program::Recorder | Program::Operator => Err(no_step(&name, &job, run)),
    }?;
    observer(Progress::End);
    if replayed.topics.iter().all(|topic| topic.messages == 0) && replayed.without_input == 0 {
        if !replayed.damage.is_empty() {
            return Err(damaged(&found, &replayed.damage));
        }
        let run = run.display();
        return Err(Failure::Input(format!(
            "{run} has no message of {name} to compare: the run ended before its first one; see the reason in {run}/{SUMMARY}"
        )));
    }
    Ok((job, replayed))
}

/// The message logs of a run are not whole.
fn damaged(run: &Run, damage: &[String]) -> Failure {
    Failure::Work(format!(
        "{}: {}; {}",
        run.folder.display(),
        damage.join("; "),
        run.again()
    ))
}

/// The refusal of a process that the run does not have, or whose step armplane does not know: another program's, the recorder's, the operator's.
fn no_step(process: &str, job: &Job, run: &Path) -> Failure {
    let has_step = |one: &&Process| {
        one.program()
            .is_some_and(|program| !matches!(program, Program::Recorder | Program::Operator))
    };
    let known: Vec<&str> = job
        .graph
        .process
        .iter()
        .filter(has_step)
        .map(|one| one.name.as_str())
        .collect();
    let run = run.display();
    Failure::Input(match known.is_empty() {
        true => format!(
            "no process of {run} can be replayed: its graph has other programs in the places of armplane's"
        ),
        false => format!(
            "{run} has no process `{process}` that can be replayed: --process takes {}",
            known.join(", ")
        ),
    })
}

/// The faults that happened to a process, planned or not: the summary knows of all, and without one (the run was stopped) the plan counts.
fn scheduled_faults(
    summary: Option<&Summary>,
    job: &Job,
    process: &str,
) -> Result<Vec<ScheduledFault>, Failure> {
    let happened = |summary: &Summary| {
        summary
            .faults
            .iter()
            .filter_map(|fault| fault.plan.clone())
            .collect::<Vec<Fault>>()
    };
    let faults = summary.map_or_else(|| job.scenario.fault.clone(), happened);
    let scenario = Scenario {
        fault: faults,
        ..job.scenario.clone()
    };
    let all = scenario
        .scheduled_faults(&job.graph)
        .map_err(|complaint| Failure::Input(complaint.to_string()))?;
    let index = job.graph.target(process).map(|target| target.index);
    Ok(all
        .into_iter()
        .filter(|scheduled| Some(scheduled.process) == index)
        .collect())
}

/// The recorded scenario with values of it overridden. The arm stays: its inputs are in the record.
fn with_settings(scenario: &Scenario, settings: &[String]) -> Result<Scenario, Failure> {
    if settings.is_empty() {
        return Ok(scenario.clone());
    }
    let text = toml::to_string(scenario).map_err(Failure::work)?;
    let changed = Scenario::parse(JOB, &text, settings)?;
    if changed.robot != scenario.robot {
        return Err(Failure::Input(format!(
            "a replay keeps the robot of its run ({}): leave out --set robot=…",
            scenario.robot
        )));
    }
    Ok(changed)
}

/// The kept messages of a run.
struct Tape<'a> {
    folder: std::path::PathBuf,
    run: &'a Run,
    logs: Logs,
    observer: Observer<'a>,
    /// As in [`Replayed`].
    is_cut: bool,
    /// As in [`Replayed`].
    damage: Vec<String>,
    /// The process that is computed again, by its name in the graph.
    process: String,
    /// The faults that happened to it.
    scheduled_faults: Vec<ScheduledFault>,
}

impl Tape<'_> {
    fn open<M: Message>(&self) -> Result<Cursor<M>, Failure> {
        LogReader::open_of(&self.folder, &self.logs)
            .map(|log| Cursor { log, ahead: None })
            .map_err(|error| self.unreadable(&error))
    }

    /// A message log that is gone or not as it was written: all that is wrong with the logs.
    fn unreadable(&self, error: &LogError) -> Failure {
        let reason = [error.to_string()];
        damaged(
            self.run,
            if self.damage.is_empty() {
                &reason
            } else {
                &self.damage
            },
        )
    }

    fn in_order<M: Message>(&self) -> Result<InOrder<M>, Failure> {
        Ok(InOrder {
            log: self.open::<M>()?.log,
            ahead: BTreeMap::new(),
            next: 0,
        })
    }

    /// Computes every recorded output again from the inputs of its tick. A process that was started again in the run is so here: a fresh
    /// step that takes up the checkpoint of the last tick that was computed before. Also computed is what a fault kept from leaving: the
    /// process's state goes on from it.
    fn step<In: Inputs, Out: Outputs, C: Checkpoint, Step>(
        &self,
        mut inputs: In,
        fresh: impl Fn() -> Result<Step, Failure>,
        compute: impl Fn(&mut Step, In::Of, &mut Out),
        save: impl Fn(&Step, &mut C),
        restore: impl Fn(&mut Step, &C),
    ) -> Result<Replayed, Failure> {
        let mut outputs = Out::open(self)?;
        let mut step = fresh()?;
        let (mut computed, mut checkpoint, mut has_computed) = (Out::empty(), C::zeroed(), false);
        let (mut incarnation, mut without_input) = (1, 0);
        while let Some(recorded) =
            Out::next(&mut outputs).map_err(|error| self.unreadable(&error))?
        {
            let header = *recorded.header();
            while let Some(tick) = inputs
                .next_tick()
                .map_err(|error| self.unreadable(&error))?
                .filter(|tick| *tick < header.tick)
            {
                let input = inputs.at(tick).map_err(|error| self.unreadable(&error))?;
                if let Some(input) = input.filter(|_| self.was_withheld(tick)) {
                    compute(&mut step, input, &mut computed);
                    save(&step, &mut checkpoint);
                    has_computed = true;
                }
            }
            if incarnation != header.incarnation {
                (step, incarnation) = (fresh()?, header.incarnation);
                if has_computed {
                    restore(&mut step, &checkpoint);
                }
            }
            match inputs
                .at(header.tick)
                .map_err(|error| self.unreadable(&error))?
            {
                Some(input) => {
                    compute(&mut step, input, &mut computed);
                    save(&step, &mut checkpoint);
                    has_computed = true;
                    Out::compare(&mut outputs, &recorded, computed, self)
                        .map_err(|error| self.unreadable(&error))?;
                }
                None => without_input += 1,
            }
            (self.observer)(Progress::Position(header.tick));
        }
        Ok(self.replayed(Out::topics(outputs), without_input, String::new()))
    }

    fn replayed(&self, topics: Vec<Topic>, without_input: u64, ended: String) -> Replayed {
        Replayed {
            process: self.process.clone(),
            topics,
            without_input,
            damage: self.damage.clone(),
            is_cut: self.is_cut,
            ended,
        }
    }

    fn was_shaped(&self, tick: u64) -> bool {
        self.scheduled_faults.iter().any(|scheduled| {
            scheduled.concerns(tick) && scheduled.kind().is_some_and(Kind::shapes_messages)
        })
    }

    /// Whether the process worked at a tick of which nothing of it is in the record.
    fn was_withheld(&self, tick: u64) -> bool {
        let was_down = self.scheduled_faults.iter().any(|scheduled| {
            scheduled.concerns(tick) && scheduled.kind().is_some_and(Kind::takes_down)
        });
        self.was_shaped(tick) && !was_down
    }

    /// The plant answers its own last state: it must be fed without a gap. What was wrong with its sensors and drives is so again.
    fn plant(&self, robot: &Robot, scenario: &Scenario) -> Result<Replayed, Failure> {
        let (mut samples, mut truths, mut commands) = (
            self.in_order::<SensorSample>()?,
            self.open()?,
            self.open::<TorqueCommand>()?,
        );
        let mut cycle = plant::cycle(robot, scenario).map_err(Failure::input)?;
        let of_physics =
            |scheduled: &&ScheduledFault| scheduled.kind().is_some_and(Kind::concerns_joint);
        let faults: Vec<ScheduledFault> = self
            .scheduled_faults
            .iter()
            .filter(of_physics)
            .copied()
            .collect();
        let (mut sensor, mut state) = (
            Comparison::<SensorSample>::default(),
            Comparison::<PlantState>::default(),
        );
        let (mut sampled, mut moved) = <(SensorSample, PlantState)>::default();
        let mut ended = String::new();
        let mut truth: Option<PlantState> = truths
            .next_message()
            .map_err(|error| self.unreadable(&error))?;
        let mut next = samples
            .next_message()
            .map_err(|error| self.unreadable(&error))?;
        for tick in 0.. {
            let Some(recorded) = next else { break };
            let gap = recorded.header.tick != tick
                || truth.is_none_or(|truth: PlantState| truth.header.tick != tick);
            if gap || recorded.header.incarnation > 1 {
                let what = if gap {
                    "is not in the record"
                } else {
                    "was made by a restarted plant"
                };
                ended = format!("tick {tick} {what}: the replay of the plant ends there");
                break;
            }
            let scheduled_faults: Vec<ScheduledFault> = faults
                .iter()
                .filter(|scheduled| scheduled.concerns(tick))
                .copied()
                .collect();
            let had_faults = faults
                .iter()
                .any(|scheduled| tick > 0 && scheduled.concerns(tick - 1));
            if had_faults || !scheduled_faults.is_empty() {
                cycle.apply_faults(tick, &scheduled_faults);
            }
            cycle.sample(tick, &mut sampled, &mut moved);
            let mut sent = sampled;
            apply_to_outgoing(&mut sent, &self.scheduled_faults);
            sensor.take(&recorded, sent);
            if let Some(truth) = &truth {
                state.take(truth, moved);
            }
            (truth, next) = (
                truths
                    .next_message()
                    .map_err(|error| self.unreadable(&error))?,
                samples
                    .next_message()
                    .map_err(|error| self.unreadable(&error))?,
            );
            // Which torque came in time, and how old it was, is what the plant said next.
            let flags = truth.map_or(0, |truth| truth.drive_flags);
            let age = next.map_or(0, |next| u64::from(next.stale_ticks));
            let command = match flags {
                flags if flags & (DRIVE_STALE | DRIVE_ENCODER) != 0 => {
                    Some(TorqueCommand::default())
                }
                flags if flags & DRIVE_ABSENT != 0 => None,
                _ => commands
                    .at(tick.saturating_sub(age))
                    .map_err(|error| self.unreadable(&error))?,
            };
            cycle.step(command.as_ref());
            (self.observer)(Progress::Position(tick));
        }
        Ok(self.replayed(vec![sensor.topic(), state.topic()], 0, ended))
    }
}

/// A step's outputs at a tick; faults shape the last of the messages, which also carries the incarnation that computed it.
trait Outputs: Copy {
    /// Messages to be filled.
    fn empty() -> Self;
    /// The recorded ones, and how they compare with the computed ones.
    type Recorded;
    /// The message that faults shape.
    type Last: Message;
    /// Opens the record.
    fn open(tape: &Tape<'_>) -> Result<Self::Recorded, Failure>;
    /// The next recorded message.
    fn next(recorded: &mut Self::Recorded) -> Result<Option<Self::Last>, LogError>;
    /// Compares what was recorded at the tick of `last` with what was computed.
    fn compare(
        recorded: &mut Self::Recorded,
        last: &Self::Last,
        computed: Self,
        tape: &Tape<'_>,
    ) -> Result<(), LogError>;
    /// The result per topic.
    fn topics(recorded: Self::Recorded) -> Vec<Topic>;
}

impl<M: Message> Outputs for M {
    type Recorded = (InOrder<M>, Comparison<M>);
    type Last = M;
    fn empty() -> Self {
        M::zeroed()
    }
    fn open(tape: &Tape<'_>) -> Result<Self::Recorded, Failure> {
        Ok((tape.in_order()?, Comparison::default()))
    }
    fn next((messages, _): &mut Self::Recorded) -> Result<Option<M>, LogError> {
        messages.next_message()
    }
    fn compare(
        (_, comparison): &mut Self::Recorded,
        last: &M,
        mut computed: M,
        tape: &Tape<'_>,
    ) -> Result<(), LogError> {
        apply_to_outgoing(&mut computed, &tape.scheduled_faults);
        comparison.take(last, computed);
        Ok(())
    }
    fn topics((_, comparison): Self::Recorded) -> Vec<Topic> {
        vec![comparison.topic()]
    }
}

/// The controller's outputs at a tick.
#[derive(Clone, Copy, Default)]
struct Control {
    state: ControlState,
    torque: TorqueCommand,
}

/// The record of the controller's topics, each with how it compares.
struct ControlRecord {
    states: Cursor<ControlState>,
    torques: InOrder<TorqueCommand>,
    state: Comparison<ControlState>,
    torque: Comparison<TorqueCommand>,
}

impl Outputs for Control {
    type Recorded = ControlRecord;
    type Last = TorqueCommand;
    fn empty() -> Self {
        Self::default()
    }
    fn open(tape: &Tape<'_>) -> Result<ControlRecord, Failure> {
        let (states, torques) = (tape.open()?, tape.in_order()?);
        Ok(ControlRecord {
            states,
            torques,
            state: Comparison::default(),
            torque: Comparison::default(),
        })
    }
    fn next(recorded: &mut ControlRecord) -> Result<Option<TorqueCommand>, LogError> {
        recorded.torques.next_message()
    }
    fn compare(
        recorded: &mut ControlRecord,
        last: &TorqueCommand,
        computed: Self,
        tape: &Tape<'_>,
    ) -> Result<(), LogError> {
        if let Some(state) = recorded.states.at(last.header.tick)? {
            recorded.state.take(&state, computed.state);
        }
        let mut torque = computed.torque;
        apply_to_outgoing(&mut torque, &tape.scheduled_faults);
        recorded.torque.take(last, torque);
        Ok(())
    }
    fn topics(recorded: ControlRecord) -> Vec<Topic> {
        vec![recorded.state.topic(), recorded.torque.topic()]
    }
}

/// The controller's outputs at a tick of a steered run.
#[derive(Clone, Copy, Default)]
struct Steered {
    servo: ServoState,
    control: Control,
}

impl Outputs for Steered {
    type Recorded = (Cursor<ServoState>, Comparison<ServoState>, ControlRecord);
    type Last = TorqueCommand;
    fn empty() -> Self {
        Self::default()
    }
    fn open(tape: &Tape<'_>) -> Result<Self::Recorded, Failure> {
        Ok((tape.open()?, Comparison::default(), Control::open(tape)?))
    }
    fn next((.., control): &mut Self::Recorded) -> Result<Option<TorqueCommand>, LogError> {
        Control::next(control)
    }
    fn compare(
        (servos, servo, control): &mut Self::Recorded,
        last: &TorqueCommand,
        computed: Self,
        tape: &Tape<'_>,
    ) -> Result<(), LogError> {
        if let Some(recorded) = servos.at(last.header.tick)? {
            servo.take(&recorded, computed.servo);
        }
        Control::compare(control, last, computed.control, tape)
    }
    fn topics((_, servo, control): Self::Recorded) -> Vec<Topic> {
        std::iter::once(servo.topic())
            .chain(Control::topics(control))
            .collect()
    }
}
