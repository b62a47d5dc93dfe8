//! The recorded inputs of a run, fed to the step of one process again.

use std::collections::VecDeque;
use std::fmt;
use std::path::Path;

use chain::Tick;
use model::Robot;
use process::{Inputs, Member, Scratch, apply_to_outgoing};
use recorder::{MESSAGES, Row, Ticks};
use serde::Serialize;
use session::table::{Fitted, number, table};
use session::{Failure, JOB, Observer, Progress, Run, SUMMARY};
use shared_types::codes::{DRIVE_ABSENT, DRIVE_ENCODER, DRIVE_STALE};
use shared_types::fault::{Kind, ScheduledFault, shaped_topic};
use shared_types::graph::Process;
use shared_types::job::Job;
use shared_types::process::Program;
use shared_types::scenario::Scenario;
use shared_types::summary::Summary;
use shared_types::topics::{OfTopic, Topic};
use shared_types::{Message, TorqueCommand};
use viz::digits;

use super::compared::Place;
use super::difference::{Differences, FieldDifference};

/// The replayed process's messages of one topic, beside those of the run.
#[derive(Serialize)]
pub struct Compared {
    /// Name of the topic.
    pub topic: &'static str,
    /// Messages compared.
    pub messages: u64,
    /// Largest difference per field.
    pub fields: Vec<FieldDifference>,
}

/// The result of a replay.
#[derive(Serialize)]
pub struct Replayed {
    /// Name of the run.
    pub run: String,
    /// Its scenario.
    pub scenario: String,
    /// Its seed.
    pub seed: u64,
    /// The version that made it.
    pub version: String,
    /// The process, by its name in the run's graph.
    pub process: String,
    /// The values that override those of the recorded scenario.
    pub set: Vec<String>,
    /// Whether all outputs that could be computed have the same bytes.
    pub identical: bool,
    /// The earliest difference; of one tick, that of the topic that is sent first.
    pub difference: Option<Place>,
    /// By topic.
    pub topics: Vec<Compared>,
    /// Recorded outputs whose inputs are not in the record; they cannot be computed again.
    pub without_input: u64,
    /// The last tick of the record.
    pub last_tick: u64,
    /// Each way in which the record is damaged or does not match the run's summary, in a clause.
    pub damage: Vec<String>,
    /// The same in one sentence, with the remedy.
    #[serde(skip)]
    pub lack: Option<String>,
    /// Why the replay ended before the record did; empty where it did not.
    pub ended: String,
    /// The run did not come to its end, so that its record may lack the last messages.
    #[serde(skip)]
    pub is_cut: bool,
}

impl Replayed {
    /// Whether every output of the run was computed again, with the same bytes.
    pub fn passed(&self) -> bool {
        self.identical && self.is_complete()
    }

    fn is_empty(&self) -> bool {
        self.topics.iter().all(|topic| topic.messages == 0) && self.without_input == 0
    }

    /// Why nothing could be compared.
    fn nothing(&self, run: &Run) -> Failure {
        if let Some(lack) = &self.lack {
            return Failure::Work(lack.clone());
        }
        let (run, name) = (run.folder.display(), &self.process);
        Failure::Input(format!(
            "{run} has no message of {name} to compare, because it ended before the first; {run}/{SUMMARY} has the reason"
        ))
    }

    fn is_complete(&self) -> bool {
        // The last messages of the topics of a cut run do not end at one tick.
        (self.is_cut || self.without_input == 0) && self.damage.is_empty() && self.ended.is_empty()
    }

    /// A row for each field that differs.
    fn differences(&self) -> Fitted {
        let mut rows = table(&[
            "topic and element",
            "messages",
            "largest",
            "at tick",
            "recorded",
            "replayed",
        ]);
        for (topic, field) in self
            .topics
            .iter()
            .flat_map(|one| one.fields.iter().map(|field| (one.topic, field)))
        {
            let FieldDifference {
                messages,
                largest,
                tick,
                difference,
                ..
            } = field;
            rows.add_row([
                format!("{topic} {}", difference.field).into(),
                number(messages),
                number(digits(*largest)),
                number(tick),
                number(&difference.expected),
                number(&difference.found),
            ]);
        }
        rows
    }
}

impl fmt::Display for Replayed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            scenario,
            seed,
            process,
            ..
        } = self;
        if let Some(place) = &self.difference {
            writeln!(f, "{}\n{process} {place}", self.differences())?;
        }
        if self.without_input > 0 {
            writeln!(
                f,
                "{} outputs could not be computed: their inputs are not in the record",
                self.without_input
            )?;
        }
        if !self.ended.is_empty() {
            writeln!(f, "{}", self.ended)?;
        }
        let messages: u64 = self.topics.iter().map(|topic| topic.messages).sum();
        let verdict = match (self.identical, self.is_complete()) {
            (false, _) => "NOT the same bytes",
            (true, true) => "the same bytes",
            (true, false) => "the same bytes, of an INCOMPLETE record",
        };
        writeln!(
            f,
            "{scenario}, seed {seed}, {process}, {messages} messages: {verdict}"
        )
    }
}

/// Feeds the recorded inputs of a run to the step of one process, with values of the scenario overridden, and compares its outputs. Without a
/// name the process is the one that armplane's controller runs in.
///
/// # Errors
/// [`Failure`] where the run wrote no messages, cannot be read, has no such process, or the step refuses the scenario.
pub fn replay(
    folder: &Path,
    process: Option<&str>,
    settings: &[String],
    observer: Observer<'_>,
) -> Result<Replayed, Failure> {
    let run = Run {
        folder: folder.to_owned(),
    };
    let job = job_of(&run)?;
    let robot = Robot::from_source(&job.robot).map_err(Failure::input)?;
    let scenario = with_settings(&job.scenario, settings)?;
    let (process, program) = chosen(&job, process).ok_or_else(|| no_step(process, &job, folder))?;
    let (name, writes) = (process.name.clone(), &process.writes);
    let (summary, damage, has_holes) = damage_of(&run, &job);
    let lack = (!damage.is_empty()).then(|| damage.join("; "));
    if let Some(lack) = lack.as_ref().filter(|_| has_holes) {
        // The state of no process goes on over messages that are lost.
        let lack = format_args!("{lack}; so nothing was replayed");
        return Err(Failure::Work(run.with_remedy(&lack)));
    }
    let record = Ticks::open(&folder.join(MESSAGES), &job).map_err(Failure::work)?;
    let step = chain::step_of(program, &robot, &scenario).map_err(Failure::input)?;
    let step = step.ok_or_else(|| no_step(Some(&name), &job, folder))?;
    let outputs = writes.iter().filter_map(|topic| Output::named(topic));
    let mut player = Player {
        member: Member::new(0, process, step),
        scratch: Scratch::default(),
        now: Tick::default(),
        outputs: outputs.collect(),
        torques: VecDeque::new(),
        faults: scheduled_faults(summary.as_ref(), &job, &name)?,
        without_input: 0,
    };
    let mut last_tick = 0;
    let rows = record.inspect(|row| last_tick = row.tick);
    let ended = player.play(rows, &scenario, observer);
    if summary.is_none() && damage.is_empty() {
        run.say_end(last_tick, observer);
    }
    let without_input = player.without_input;
    let (difference, topics) = player.compared();
    let replayed = Replayed {
        run: job.run,
        scenario: job.scenario.name,
        seed: job.scenario.seed,
        version: job.version,
        process: name,
        set: settings.to_vec(),
        identical: difference.is_none(),
        difference,
        topics,
        without_input,
        is_cut: summary.as_ref().is_none_or(|summary| !summary.completed),
        last_tick,
        ended,
        damage,
        lack: lack.map(|lack| run.with_remedy(&lack)),
    };
    if replayed.is_empty() {
        return Err(replayed.nothing(&run));
    }
    Ok(replayed)
}

/// The job of a run that kept its messages.
fn job_of(run: &Run) -> Result<Job, Failure> {
    let (job, shown) = (run.job()?, run.folder.display());
    if job.record {
        return Ok(job);
    }
    Err(Failure::Input(format!(
        "{shown} has no messages to replay: run it again without --no-record"
    )))
}

/// The summary of a run, if there is one, the defects of summary and record, and whether messages are lost amid the record.
fn damage_of(run: &Run, job: &Job) -> (Option<Summary>, Vec<String>, bool) {
    // One that is there and cannot be read is a defect of the run, as a record is.
    let (summary, defect) = run
        .summary_if_any()
        .map_or_else(|defect| (None, Some(defect)), |summary| (summary, None));
    let (mut damage, has_holes) = run.message_damage(job, summary.as_ref());
    damage.extend(defect);
    (summary, damage, has_holes)
}

/// The process that is asked for, where armplane knows its step.
fn chosen<'a>(job: &'a Job, name: Option<&str>) -> Option<(&'a Process, Program)> {
    let is_asked = |one: &&Process| {
        name.map_or(one.program() == Some(Program::Controller), |name| {
            one.name == name
        })
    };
    let process = job.graph.process.iter().find(is_asked).filter(has_step)?;
    Some((process, process.program()?))
}

/// Whether armplane knows the step of a process: not of another program's, the recorder's, the operator's.
fn has_step(process: &&Process) -> bool {
    process
        .program()
        .is_some_and(|program| !matches!(program, Program::Recorder | Program::Operator))
}

fn no_step(process: Option<&str>, job: &Job, folder: &Path) -> Failure {
    let known: Vec<&str> = job
        .graph
        .process
        .iter()
        .filter(has_step)
        .map(|one| one.name.as_str())
        .collect();
    let (run, process) = (folder.display(), process.unwrap_or("controller"));
    Failure::Input(match known.is_empty() {
        true => format!(
            "no process of {run} can be replayed: other programs replace armplane's in its graph"
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
            .collect()
    };
    let fault = summary.map_or_else(|| job.scenario.fault.clone(), happened);
    let scenario = Scenario {
        fault,
        ..job.scenario.clone()
    };
    let mut all = scenario
        .scheduled_faults(&job.graph)
        .map_err(Failure::input)?;
    let index = job.graph.target(process).map(|target| target.index);
    all.retain(|scheduled| Some(scheduled.process) == index);
    Ok(all)
}

/// The recorded scenario with values of it overridden. The arm stays: its inputs are in the record.
fn with_settings(scenario: &Scenario, settings: &[String]) -> Result<Scenario, Failure> {
    if settings.is_empty() {
        return Ok(scenario.clone());
    }
    let text = toml::to_string(scenario).map_err(Failure::work)?;
    let changed = Scenario::parse(JOB, &text, settings)?;
    if changed.robot != scenario.robot {
        let robot = &scenario.robot;
        return Err(Failure::Input(format!(
            "a replay keeps the robot of its run ({robot}): leave out --set robot=…"
        )));
    }
    Ok(changed)
}

/// A process that is computed again.
struct Player {
    member: Member,
    scratch: Scratch,
    /// Its outputs of the tick.
    now: Tick,
    /// Its topics, in the order in which they leave.
    outputs: Vec<Output>,
    /// The torques that a plant has not followed yet.
    torques: VecDeque<TorqueCommand>,
    /// The faults that happened to the process.
    faults: Vec<ScheduledFault>,
    without_input: u64,
}

/// A topic that the process writes.
struct Output {
    topic: &'static str,
    messages: u64,
    differences: Differences,
    compare: fn(&mut Self, &Row, &Tick, &[ScheduledFault]),
}

impl OfTopic for Output {
    fn of_topic<M: Topic>() -> Self {
        Self {
            topic: M::TOPIC,
            messages: 0,
            differences: Differences::new(M::FIELDS),
            compare: Self::compare::<M>,
        }
    }
}

impl Output {
    /// Compares the message of a tick, if there is one, with the computed one, of which faults may have changed the content.
    fn compare<M: Topic>(&mut self, row: &Row, now: &Tick, faults: &[ScheduledFault]) {
        let mut computed = *M::of(now);
        apply_to_outgoing(&mut computed, faults);
        if let Some(recorded) = M::of(row.messages()) {
            // The runtime sets the incarnation, not the step.
            computed.header_mut().incarnation = recorded.header().incarnation;
            self.messages += 1;
            let [recorded, computed] = [recorded, &computed].map(bytemuck::bytes_of);
            self.differences.add(row.tick, recorded, computed);
        }
    }
}

/// The bytes of a topic's message.
struct Bytes(fn(&Row) -> Option<&[u8]>);

impl OfTopic for Bytes {
    fn of_topic<M: Topic>() -> Self {
        Self(|row| M::of(row.messages()).as_ref().map(bytemuck::bytes_of))
    }
}

fn bytes<'a>(row: &'a Row, topic: &str) -> Option<&'a [u8]> {
    Bytes::named(topic)?.0(row)
}

impl Player {
    /// Computes the process's outputs again. The sentence: why the replay ended before the record did.
    fn play(
        &mut self,
        record: impl Iterator<Item = Box<Row>>,
        scenario: &Scenario,
        observer: Observer<'_>,
    ) -> String {
        observer(Progress::Begin {
            title: &scenario.name,
            length: scenario.planned_ticks(),
            unit: "ticks",
        });
        let mut gap = None;
        for row in record {
            if !self.member.makes_ticks() {
                self.cycle(&row);
            } else if let Some(sentence) = self.plant(&row, &mut gap) {
                observer(Progress::End);
                return sentence;
            }
            observer(Progress::Position(row.tick));
        }
        observer(Progress::End);
        String::new()
    }

    /// The topic whose messages faults shape.
    fn shaped(&self) -> &'static str {
        let mut outputs = self.outputs.iter().map(|output| output.topic);
        outputs
            .rfind(|topic| shaped_topic(topic))
            .unwrap_or_default()
    }

    fn compare(&mut self, row: &Row) {
        let shaped = self.shaped();
        for output in &mut self.outputs {
            let faults = match output.topic == shaped {
                true => &self.faults[..],
                false => &[],
            };
            (output.compare)(output, row, &self.now, faults);
        }
    }

    /// Computes an output again from the inputs of its tick. Also computed is what a fault kept from leaving: the process's state goes on from it. A
    /// replacement goes on from the state of its predecessor: the tick before is the last that was computed.
    fn cycle(&mut self, row: &Row) {
        let (mut inputs, mut is_whole) = (Inputs::of(row.tick, &[]), true);
        for port in self.member.step().reads() {
            let message = bytes(row, port.topic);
            message
                .iter()
                .for_each(|message| inputs.add(port.topic, message));
            is_whole &= message.is_some() || !port.is_needed;
        }
        let has_left = bytes(row, self.shaped()).is_some();
        if is_whole && (has_left || self.was_withheld(row.tick)) {
            // The record says when the task was over.
            let _ = self
                .member
                .step_on(&inputs, 1, &mut self.now, &mut self.scratch);
        }
        match (has_left, is_whole) {
            (true, true) => self.compare(row),
            (true, false) => self.without_input += 1,
            (false, _) => {}
        }
    }

    /// Whether the process worked at a tick of which nothing of it is in the record.
    fn was_withheld(&self, tick: u64) -> bool {
        let had = |is: fn(Kind) -> bool| {
            self.faults
                .iter()
                .any(|fault| fault.concerns(tick) && fault.kind().is_some_and(is))
        };
        had(Kind::shapes_messages) && !had(Kind::takes_down)
    }

    /// The plant answers its own last state: it must be fed without a gap, whose first tick is kept until something follows it. What was wrong with its
    /// sensors and drives is so again. The sentence: why the replay ended before the record did.
    fn plant(&mut self, row: &Row, gap: &mut Option<u64>) -> Option<String> {
        let (tick, messages) = (row.tick, row.messages());
        let Some(sensor) = &messages.sensor else {
            gap.get_or_insert(tick);
            return None;
        };
        let is_next = tick == 0 || self.outputs.iter().any(|output| output.messages == tick);
        let missing = gap.or((!is_next || messages.plant_state.is_none()).then_some(tick));
        let sentence = match (missing, sensor.header.incarnation) {
            (Some(tick), _) => format!("tick {tick} is not in the record"),
            (None, 2..) => format!("tick {tick} was made by a restarted plant"),
            (None, _) => String::new(),
        };
        if !sentence.is_empty() {
            return Some(sentence + ": the replay of the plant ends there");
        }
        let flags = messages.plant_state.map_or(0, |truth| truth.drive_flags);
        let command = self.torque_before(tick, flags, u64::from(sensor.stale_ticks));
        let is_physical = |fault: &&ScheduledFault| {
            fault.concerns(tick) && fault.kind().is_some_and(Kind::concerns_joint)
        };
        let physical: Vec<_> = self.faults.iter().filter(is_physical).copied().collect();
        let mut inputs = Inputs::of(tick, &physical);
        if let Some(command) = &command {
            inputs.add(TorqueCommand::TOPIC, bytemuck::bytes_of(command));
        }
        let _ = self
            .member
            .step_on(&inputs, 1, &mut self.now, &mut self.scratch);
        self.compare(row);
        self.torques.extend(messages.torque);
        None
    }

    /// The torque that the plant followed until a tick. Which came in time, and how old it was, is what the plant says at the tick.
    fn torque_before(&mut self, tick: u64, flags: u32, age: u64) -> Option<TorqueCommand> {
        let before = tick.checked_sub(1)?;
        if flags & (DRIVE_STALE | DRIVE_ENCODER) != 0 {
            return Some(TorqueCommand::default());
        }
        if flags & DRIVE_ABSENT != 0 {
            return None;
        }
        let wanted = before.saturating_sub(age);
        let is_past = |torque: &mut TorqueCommand| torque.header.tick < wanted;
        while self.torques.pop_front_if(is_past).is_some() {}
        self.torques
            .pop_front_if(|torque| torque.header.tick == wanted)
    }

    /// The earliest difference, and all, of the process's topics.
    fn compared(self) -> (Option<Place>, Vec<Compared>) {
        let firsts = self.outputs.iter().filter_map(|output| {
            let (tick, difference) = output.differences.first.clone()?;
            Some(Place::new(tick, output.topic, difference))
        });
        let first = firsts.min_by_key(|place| place.tick);
        let all = self.outputs.into_iter().map(|output| Compared {
            topic: output.topic,
            messages: output.messages,
            fields: output.differences.fields(),
        });
        (first, all.collect())
    }
}
