//! The recorded inputs of a run, fed to the step of one process again.

use std::fmt;
use std::path::Path;

use chain::Tick;
use model::Robot;
use process::{Inputs, Member, Scratch, apply_to_outgoing};
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
use shared_types::topics::{ByTopic, Each, TOPICS, Topic, named};
use shared_types::{Header, Message, TorqueCommand};
use viz::digits;

use super::compared::{Place, record_of};
use super::difference::FieldDifference;
use super::track::{self, Compared, Tracks};

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
    /// The message logs that do not hold what the run's summary counts, a clause for each.
    pub damage: Vec<String>,
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
        if !self.damage.is_empty() {
            return damaged(run, &self.damage);
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
}

impl Replayed {
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
        for damage in &self.damage {
            writeln!(f, "damaged: {damage}")?;
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
    let record = record_of(folder, &job);
    if has_holes || record.is_err() && !damage.is_empty() {
        // The state of no process goes on over messages that are lost.
        return Err(damaged(&run, &damage));
    }
    let record = record.map_err(|error| damaged(&run, &[error.to_string()]))?;
    let step = chain::step_of(program, &robot, &scenario).map_err(Failure::input)?;
    let step = step.ok_or_else(|| no_step(Some(&name), &job, folder))?;
    let reads: Vec<&str> = step.reads().iter().map(|port| port.topic).collect();
    let writes: Vec<&str> = writes.iter().map(String::as_str).collect();
    let topics = [&reads[..], &writes].concat();
    let mut player = Player {
        tracks: track::open(&record, &topics).map_err(Failure::work)?,
        member: Member::new(0, process, step),
        scratch: Scratch::default(),
        given: Tick::default(),
        now: Tick::default(),
        faults: scheduled_faults(summary.as_ref(), &job, &name)?,
        without_input: 0,
        observer,
    };
    let ended = player.play(&scenario, &writes);
    let (difference, topics) = player.compared(&writes);
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
        without_input: player.without_input,
        is_cut: summary.as_ref().is_none_or(|summary| !summary.completed),
        ended,
        damage,
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

/// The message logs of a run are not whole.
fn damaged(run: &Run, damage: &[String]) -> Failure {
    Failure::Work(format!(
        "{}: {}; {}",
        run.folder.display(),
        damage.join("; "),
        run.again()
    ))
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

/// The kept messages of a run, and the tick that is computed.
struct Player<'a> {
    tracks: ByTopic<Tracks>,
    member: Member,
    scratch: Scratch,
    /// The inputs of the tick.
    given: Tick,
    /// Its outputs.
    now: Tick,
    /// The faults that happened to the process.
    faults: Vec<ScheduledFault>,
    without_input: u64,
    observer: Observer<'a>,
}

/// The header of a topic's next message.
struct Next<'a>(&'a mut ByTopic<Tracks>);

impl Each for Next<'_> {
    type Output = Option<Header>;
    fn each<M: Topic>(&mut self) -> Self::Output {
        M::of_mut(self.0).header()
    }
}

/// Whether a topic has a message of a tick, which goes into the bundle.
struct Load<'a>(&'a mut ByTopic<Tracks>, &'a mut Tick, u64);

impl Each for Load<'_> {
    type Output = bool;
    fn each<M: Topic>(&mut self) -> Self::Output {
        let message = M::of_mut(self.0).at(self.2);
        message
            .iter()
            .for_each(|message| *M::of_mut(self.1) = *message);
        message.is_some()
    }
}

/// Compares a topic's message of a tick with the computed one, of which faults may have changed the content.
struct Compare<'a>(&'a mut ByTopic<Tracks>, &'a Tick, u64, &'a [ScheduledFault]);

impl Each for Compare<'_> {
    type Output = ();
    fn each<M: Topic>(&mut self) -> Self::Output {
        let mut computed = *M::of(self.1);
        apply_to_outgoing(&mut computed, self.3);
        M::of_mut(self.0).compare(computed, self.2)
    }
}

/// The result of a topic.
struct CompareAll<'a>(&'a mut ByTopic<Tracks>);

impl Each for CompareAll<'_> {
    type Output = (Option<Place>, Compared);
    fn each<M: Topic>(&mut self) -> Self::Output {
        M::of_mut(self.0).compared()
    }
}

impl Player<'_> {
    /// Computes the process's outputs again. The sentence: why the replay ended before the record did.
    fn play(&mut self, scenario: &Scenario, writes: &[&str]) -> String {
        (self.observer)(Progress::Begin {
            title: &scenario.name,
            length: scenario.planned_ticks(),
            unit: "ticks",
        });
        let ended = match self.member.makes_ticks() {
            true => self.plant(),
            false => self.cycle(writes),
        };
        (self.observer)(Progress::End);
        ended
    }

    /// The step of a tick, on the inputs that have been loaded.
    fn compute(&mut self, tick: u64, topics: &[&'static str], faults: &[ScheduledFault]) {
        let (parts, mut inputs) = (self.given.parts_mut(), Inputs::of(tick, faults));
        for (topic, message) in TOPICS.into_iter().zip(&parts) {
            let message = message.as_deref().filter(|_| topics.contains(&topic));
            message
                .into_iter()
                .for_each(|message| inputs.add(topic, message));
        }
        // The record says when the task was over.
        let _ = self
            .member
            .compute(&inputs, &mut self.now, &mut self.scratch);
    }

    /// The earliest difference, and all, of the process's topics.
    fn compared(&mut self, writes: &[&str]) -> (Option<Place>, Vec<Compared>) {
        let compared = writes
            .iter()
            .filter_map(|topic| named(topic, &mut CompareAll(&mut self.tracks)));
        let (firsts, topics): (Vec<_>, Vec<_>) = compared.unzip();
        (
            firsts
                .into_iter()
                .flatten()
                .min_by_key(|place: &Place| place.tick),
            topics,
        )
    }

    fn next(&mut self, topic: &str) -> Option<Header> {
        named(topic, &mut Next(&mut self.tracks)).flatten()
    }

    fn load(&mut self, topic: &str, tick: u64) -> bool {
        named(topic, &mut Load(&mut self.tracks, &mut self.given, tick)).unwrap_or(false)
    }

    /// Loads the inputs of a tick: their topics, or `None` where one is missing that the step needs.
    fn inputs(&mut self, tick: u64) -> Option<Vec<&'static str>> {
        let (mut there, mut is_whole) = (Vec::new(), true);
        for port in self.member.step().reads() {
            let is_there = self.load(port.topic, tick);
            there.extend(is_there.then_some(port.topic));
            is_whole &= is_there || !port.is_needed;
        }
        is_whole.then_some(there)
    }

    /// Computes every recorded output again from the inputs of its tick. Also computed is what a fault kept from leaving: the process's state goes on
    /// from it. A replacement goes on from the state of its predecessor: the tick before is the last that was computed.
    fn cycle(&mut self, writes: &[&str]) -> String {
        // Faults shape this one.
        let shaped = writes.iter().rfind(|topic| shaped_topic(topic));
        let shaped = shaped.copied().unwrap_or_default();
        let reads = self.member.step().reads();
        let first = reads.first().map_or("", |port| port.topic);
        while let Some(Header { tick, .. }) = self.next(shaped) {
            while let Some(earlier) = self
                .next(first)
                .map(|header| header.tick)
                .filter(|one| *one < tick)
            {
                if let Some(topics) = self.inputs(earlier)
                    && self.was_withheld(earlier)
                {
                    self.compute(earlier, &topics, &[]);
                }
            }
            if let Some(topics) = self.inputs(tick) {
                self.compute(tick, &topics, &[]);
                for topic in writes {
                    let faults = if *topic == shaped {
                        &self.faults[..]
                    } else {
                        &[]
                    };
                    named(
                        topic,
                        &mut Compare(&mut self.tracks, &self.now, tick, faults),
                    );
                }
            } else {
                self.without_input += 1;
                self.load(shaped, tick);
            }
            (self.observer)(Progress::Position(tick));
        }
        String::new()
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

    /// The plant answers its own last state: it must be fed without a gap. What was wrong with its sensors and drives is so again. The sentence: why the
    /// replay ended before the record did.
    fn plant(&mut self) -> String {
        for tick in 0.. {
            let Some(recorded) = self.tracks.sensor.header() else {
                break;
            };
            let truth = self.tracks.plant_state.header();
            let gap = recorded.tick != tick || truth.is_none_or(|truth| truth.tick != tick);
            if gap || recorded.incarnation > 1 {
                let what = if gap {
                    "is not in the record"
                } else {
                    "was made by a restarted plant"
                };
                return format!("tick {tick} {what}: the replay of the plant ends there");
            }
            let mut topics = Vec::new();
            if tick > 0
                && let Some(command) = torque_after(&mut self.tracks, tick - 1)
            {
                self.given.torque = command;
                topics.push(TorqueCommand::TOPIC);
            }
            let is_physical = |fault: &&ScheduledFault| {
                fault.concerns(tick) && fault.kind().is_some_and(Kind::concerns_joint)
            };
            let physical: Vec<_> = self.faults.iter().filter(is_physical).copied().collect();
            self.compute(tick, &topics, &physical);
            let mut sent = self.now.sensor;
            apply_to_outgoing(&mut sent, &self.faults);
            self.tracks.sensor.compare(sent, tick);
            self.tracks.plant_state.compare(self.now.plant_state, tick);
            (self.observer)(Progress::Position(tick));
        }
        String::new()
    }
}

/// The torque that the plant followed from a tick on. Which came in time, and how old it was, is what the plant said next.
fn torque_after(tracks: &mut ByTopic<Tracks>, tick: u64) -> Option<TorqueCommand> {
    let flags = tracks
        .plant_state
        .peek()
        .map_or(0, |truth| truth.drive_flags);
    let age = tracks
        .sensor
        .peek()
        .map_or(0, |next| u64::from(next.stale_ticks));
    match flags {
        flags if flags & (DRIVE_STALE | DRIVE_ENCODER) != 0 => Some(TorqueCommand::default()),
        flags if flags & DRIVE_ABSENT != 0 => None,
        _ => tracks.torque.at(tick.saturating_sub(age)),
    }
}
