//! `armplane replay`: the recorded inputs of a run, fed to one process's step; where its outputs first differ from the recorded ones.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;

use indicatif::ProgressBar;
use message_log::{Difference, Differences, FieldDifference, LogError, LogReader, first_difference};
use model::{Refused, Robot};
use runtime::leaves_as;
use serde_json::json;
use shared_types::codes::{DRIVE_ABSENT, DRIVE_STALE};
use shared_types::fault::{Fault, Kind, MOST_DELAY_TICKS, ScheduledFault};
use shared_types::job::Job;
use shared_types::scenario::Scenario;
use shared_types::summary::Summary;
use shared_types::{Message, PlantState, SensorSample, SingularityReport, StateEstimate, TorqueCommand};

use super::failure::Failure;
use super::out::say;
use super::process::JOB;
use super::table::{digits, number, table};
use super::{ReplayArgs, Replayable, load, run};

/// What the replayed process said on one topic, beside what the run recorded.
struct Topic {
    name: &'static str,
    messages: u64,
    first: Option<(u64, Difference)>,
    fields: Vec<FieldDifference>,
}

/// What came of a replay.
struct Replayed {
    topics: Vec<Topic>,
    /// Recorded outputs whose inputs are not in the record; they cannot be computed again.
    without_input: u64,
    /// Why the replay ended before the record did; empty where it did not.
    ended: String,
}

impl Replayed {
    /// The earliest difference; of one tick, that of the topic that is sent first.
    fn first(&self) -> Option<(u64, &'static str, &Difference)> {
        let firsts = self.topics.iter().filter_map(|topic| topic.first.as_ref().map(|(tick, place)| (*tick, topic.name, place)));
        firsts.min_by_key(|(tick, ..)| *tick)
    }
}

pub(crate) fn replay(args: &ReplayArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let job = job(&args.run)?;
    let robot = load::robot_of(&job.robot).map_err(Failure::input)?;
    let scenario = with_settings(&job.scenario, &args.set)?;
    let tape = Tape {
        folder: args.run.join(recorder::MESSAGES),
        run: &args.run,
        bar: run::progress_bar(&scenario),
        process: args.process.name(),
        strikes: strikes(&args.run, &job, args.process.name())?,
    };
    let refused = |error: Refused| Failure::input(error);
    let replayed = match args.process {
        Replayable::Estimator => tape.step::<_, _, StateEstimate>(
            tape.open::<SensorSample>()?,
            || estimator::cycle(&robot, &scenario).map_err(refused),
            |cycle, sample| cycle.step(&sample),
            |cycle, last| cycle.resume(last),
        ),
        Replayable::Analyzer => tape.step::<_, _, SingularityReport>(
            tape.open::<StateEstimate>()?,
            || analyzer::cycle(&robot, &scenario).map_err(refused),
            |cycle, estimate| cycle.step(&estimate),
            |cycle, last| cycle.resume(last),
        ),
        Replayable::Controller => tape.step::<_, _, TorqueCommand>(
            (tape.open::<SingularityReport>()?, tape.open::<StateEstimate>()?),
            || controller::cycle(&robot, &scenario).map_err(refused),
            |cycle, (report, estimate)| cycle.step(&estimate, &report),
            |cycle, last| cycle.resume(last),
        ),
        Replayable::Plant => tape.plant(&robot, &scenario),
    }?;
    tape.bar.finish_and_clear();
    if as_json {
        tell_machine(args, &job, &replayed);
    } else {
        tell(args, &job, &replayed);
    }
    Ok(ExitCode::from(u8::from(replayed.first().is_some())))
}

/// What the run was made from.
fn job(run: &Path) -> Result<Job, Failure> {
    let path = run.join(JOB);
    let text = std::fs::read(&path).map_err(|error| {
        Failure::Input(format!("{} is not the results folder of a run: cannot read {}: {error}", run.display(), path.display()))
    })?;
    let job: Job = serde_json::from_slice(&text).map_err(|error| {
        Failure::Input(format!("{} was not written by this version of armplane: {error}; run the scenario again", path.display()))
    })?;
    job.check().map_err(|complaint| Failure::Input(format!("{}: {complaint}", path.display())))?;
    Ok(job)
}

/// The faults that happened to a process, planned or not: the summary knows of all, and without one (the run was stopped) the plan counts.
fn strikes(run: &Path, job: &Job, process: &str) -> Result<Vec<ScheduledFault>, Failure> {
    let summary = std::fs::read(run.join("summary.json")).ok().and_then(|text| serde_json::from_slice::<Summary>(&text).ok());
    let happened = |summary: Summary| summary.faults.into_iter().filter_map(|fault| fault.fault).collect::<Vec<Fault>>();
    let faults = summary.map_or_else(|| job.scenario.fault.clone(), happened);
    let scenario = Scenario { fault: faults, ..job.scenario.clone() };
    let all = scenario.strikes(|name| Some(u32::from(name != process))).map_err(|complaint| Failure::Input(complaint.to_string()))?;
    Ok(all.into_iter().filter(|strike| strike.process == 0).collect())
}

/// The recorded scenario with other values laid over it. The arm stays: its inputs are in the record.
fn with_settings(scenario: &Scenario, settings: &[String]) -> Result<Scenario, Failure> {
    if settings.is_empty() {
        return Ok(scenario.clone());
    }
    let text = toml::to_string(scenario).map_err(Failure::work)?;
    let changed = Scenario::parse(JOB, &text, settings)?;
    if changed.robot != scenario.robot {
        return Err(Failure::Input(format!("a replay keeps the robot of its run ({}): leave out --set robot=…", scenario.robot)));
    }
    Ok(changed)
}

/// The kept messages of a run.
struct Tape<'a> {
    folder: std::path::PathBuf,
    run: &'a Path,
    bar: ProgressBar,
    /// Who is computed again ...
    process: &'a str,
    /// ... and what happened to it.
    strikes: Vec<ScheduledFault>,
}

impl Tape<'_> {
    fn open<M: Message>(&self) -> Result<Cursor<M>, Failure> {
        match LogReader::open(&self.folder) {
            Ok(kept) => Ok(Cursor { kept, ahead: None }),
            Err(error) if error.is_absent() => Err(Failure::Input(format!(
                "the run in {} kept no messages of topic {:?}: run it again without --no-messages, `armplane replay` reads {}",
                self.run.display(),
                M::TOPIC,
                self.folder.display()
            ))),
            Err(error) => Err(Failure::input(error)),
        }
    }

    fn in_order<M: Message>(&self) -> Result<InOrder<M>, Failure> {
        Ok(InOrder { kept: self.open::<M>()?.kept, ahead: BTreeMap::new(), next: 0 })
    }

    /// Computes every recorded output again from the inputs of its tick. A process that was started again in the run is so here: a fresh
    /// step that takes up what its predecessor said last. What the process computed and a fault kept from leaving is computed too: its state
    /// goes on from it.
    fn step<Step, In: Inputs, Out: Message>(
        &self,
        mut inputs: In,
        fresh: impl Fn() -> Result<Step, Failure>,
        compute: impl Fn(&mut Step, In::Of) -> Out,
        resume: impl Fn(&mut Step, &Out),
    ) -> Result<Replayed, Failure> {
        let mut outputs = self.in_order::<Out>()?;
        let (mut step, mut comparison) = (fresh()?, Comparison::<Out>::default());
        let (mut last, mut incarnation, mut without_input) = (None::<Out>, 1, 0);
        while let Some(recorded) = outputs.next_message().map_err(Failure::work)? {
            let header = *recorded.header();
            while let Some(tick) = inputs.next_tick().map_err(Failure::work)?.filter(|tick| *tick < header.tick) {
                let input = inputs.at(tick).map_err(Failure::work)?;
                if let Some(input) = input.filter(|_| self.was_withheld(tick)) {
                    last = Some(compute(&mut step, input));
                }
            }
            if incarnation != header.incarnation {
                (step, incarnation) = (fresh()?, header.incarnation);
                if let Some(last) = &last {
                    resume(&mut step, last);
                }
            }
            match inputs.at(header.tick).map_err(Failure::work)? {
                Some(input) => {
                    let computed = compute(&mut step, input);
                    let mut sent = computed;
                    leaves_as(&mut sent, &self.strikes, self.process);
                    comparison.take(&recorded, sent);
                    last = Some(if self.was_shaped(header.tick) { computed } else { recorded });
                }
                None => {
                    without_input += 1;
                    last = Some(recorded);
                }
            }
            self.bar.set_position(header.tick);
        }
        Ok(Replayed { topics: vec![comparison.topic()], without_input, ended: String::new() })
    }

    fn was_shaped(&self, tick: u64) -> bool {
        self.strikes.iter().any(|strike| strike.concerns(tick) && strike.kind().is_some_and(Kind::shapes_messages))
    }

    /// Whether the process worked at a tick of which nothing of it is in the record.
    fn was_withheld(&self, tick: u64) -> bool {
        let was_down = self.strikes.iter().any(|strike| strike.concerns(tick) && strike.kind().is_some_and(Kind::takes_down));
        self.was_shaped(tick) && !was_down
    }

    /// The plant answers its own last state: it must be fed without a gap. What was wrong with its sensors and drives is so again.
    fn plant(&self, robot: &Robot, scenario: &Scenario) -> Result<Replayed, Failure> {
        let (mut samples, mut truths, mut commands) = (self.in_order::<SensorSample>()?, self.open()?, self.open::<TorqueCommand>()?);
        let mut cycle = plant::cycle(robot, scenario).map_err(Failure::input)?;
        let of_physics = |strike: &&ScheduledFault| matches!(strike.kind(), Some(Kind::Sensor | Kind::Drive));
        let faults: Vec<ScheduledFault> = self.strikes.iter().filter(of_physics).copied().collect();
        let (mut sensor, mut state) = (Comparison::<SensorSample>::default(), Comparison::<PlantState>::default());
        let mut ended = String::new();
        let mut truth: Option<PlantState> = truths.next_message().map_err(Failure::work)?;
        let mut next = samples.next_message().map_err(Failure::work)?;
        for tick in 0.. {
            let Some(recorded) = next else { break };
            let gap = recorded.header.tick != tick || truth.is_none_or(|truth: PlantState| truth.header.tick != tick);
            if gap || recorded.header.incarnation > 1 {
                let what = if gap { "is not in the record" } else { "was made by a restarted plant" };
                ended = format!("tick {tick} {what}: the replay of the plant ends there");
                break;
            }
            let strikes: Vec<ScheduledFault> = faults.iter().filter(|strike| strike.concerns(tick)).copied().collect();
            let was_struck = faults.iter().any(|strike| tick > 0 && strike.concerns(tick - 1));
            if was_struck || !strikes.is_empty() {
                cycle.afflict(tick, &strikes);
            }
            let (mut sampled, moved) = cycle.sample(tick);
            leaves_as(&mut sampled, &self.strikes, self.process);
            sensor.take(&recorded, sampled);
            if let Some(truth) = &truth {
                state.take(truth, moved);
            }
            (truth, next) = (truths.next_message().map_err(Failure::work)?, samples.next_message().map_err(Failure::work)?);
            // Which torque came in time, and how old it was, is what the plant said next.
            let flags = truth.map_or(0, |truth| truth.drive_flags);
            let age = next.map_or(0, |next| u64::from(next.stale_ticks));
            let command = match flags {
                flags if flags & DRIVE_STALE != 0 => Some(TorqueCommand::default()),
                flags if flags & DRIVE_ABSENT != 0 => None,
                _ => commands.at(tick.saturating_sub(age)).map_err(Failure::work)?,
            };
            cycle.step(command.as_ref());
            self.bar.set_position(tick);
        }
        Ok(Replayed { topics: vec![sensor.topic(), state.topic()], without_input: 0, ended })
    }
}

/// What a step takes, tick by tick.
trait Inputs {
    /// All of one tick.
    type Of;
    /// The next tick that there is something of.
    fn next_tick(&mut self) -> Result<Option<u64>, LogError>;
    /// All of a tick; nothing where something is missing.
    fn at(&mut self, tick: u64) -> Result<Option<Self::Of>, LogError>;
}

impl<M: Message> Inputs for Cursor<M> {
    type Of = M;
    fn next_tick(&mut self) -> Result<Option<u64>, LogError> {
        self.ahead = self.next_message()?;
        Ok(self.ahead.as_ref().map(|message| message.header().tick))
    }
    fn at(&mut self, tick: u64) -> Result<Option<M>, LogError> {
        self.at(tick)
    }
}

impl<A: Message, B: Message> Inputs for (Cursor<A>, Cursor<B>) {
    type Of = (A, B);
    fn next_tick(&mut self) -> Result<Option<u64>, LogError> {
        self.0.next_tick()
    }
    fn at(&mut self, tick: u64) -> Result<Option<(A, B)>, LogError> {
        Ok(self.0.at(tick)?.zip(self.1.at(tick)?))
    }
}

/// Kept messages in the order of their ticks, each tick once: faults make them late, old, or two.
struct InOrder<M> {
    kept: LogReader<M>,
    ahead: BTreeMap<u64, M>,
    /// The first tick that has not been handed out.
    next: u64,
}

impl<M: Message> InOrder<M> {
    /// More than a fault can hold a message back; messages.
    const AHEAD: usize = 2 * MOST_DELAY_TICKS as usize + 4;

    fn next_message(&mut self) -> Result<Option<M>, LogError> {
        while self.ahead.len() < Self::AHEAD
            && let Some(message) = self.kept.next_message()?
        {
            let tick = message.header().tick;
            if tick >= self.next {
                self.ahead.entry(tick).or_insert(message);
            }
        }
        let first = self.ahead.pop_first();
        self.next = first.as_ref().map_or(self.next, |(tick, _)| tick.saturating_add(1));
        Ok(first.map(|(_, message)| message))
    }
}

/// Kept messages, looked for by tick.
struct Cursor<M: Message> {
    kept: LogReader<M>,
    /// A message that came before it was asked for.
    ahead: Option<M>,
}

impl<M: Message> Cursor<M> {
    fn next_message(&mut self) -> Result<Option<M>, LogError> {
        match self.ahead.take() {
            Some(message) => Ok(Some(message)),
            None => self.kept.next_message(),
        }
    }

    /// The message of a tick; those of earlier ones are passed over.
    fn at(&mut self, tick: u64) -> Result<Option<M>, LogError> {
        while let Some(message) = self.next_message()? {
            if message.header().tick == tick {
                return Ok(Some(message));
            }
            if message.header().tick > tick {
                self.ahead = Some(message);
                break;
            }
        }
        Ok(None)
    }
}

/// Recorded and computed messages of one topic, compared.
struct Comparison<M> {
    messages: u64,
    first: Option<(u64, Difference)>,
    differences: Differences<M>,
}

impl<M: Message> Default for Comparison<M> {
    fn default() -> Self {
        Self { messages: 0, first: None, differences: Differences::default() }
    }
}

impl<M: Message> Comparison<M> {
    fn take(&mut self, recorded: &M, mut computed: M) {
        // Who computed it is the runtime's to say, not the step's.
        computed.header_mut().incarnation = recorded.header().incarnation;
        self.messages += 1;
        if self.first.is_none() {
            self.first = first_difference(recorded, &computed).map(|difference| (recorded.header().tick, difference));
        }
        self.differences.add(recorded, &computed);
    }

    fn topic(self) -> Topic {
        Topic { name: M::TOPIC, messages: self.messages, first: self.first, fields: self.differences.fields() }
    }
}

fn tell(args: &ReplayArgs, job: &Job, replayed: &Replayed) {
    let process = args.process.name();
    if let Some((tick, topic, Difference { field, expected, found })) = replayed.first() {
        let mut rows = table(&["topic", "field", "messages", "largest", "at tick", "element", "recorded", "replayed"]);
        for topic in &replayed.topics {
            for FieldDifference { field, messages, largest, tick, difference } in &topic.fields {
                rows.add_row([
                    topic.name.into(),
                    field.clone().into(),
                    number(format!("{messages} of {}", topic.messages)),
                    number(digits(*largest)),
                    number(tick),
                    difference.field.clone().into(),
                    number(&difference.expected),
                    number(&difference.found),
                ]);
            }
        }
        say!("{rows}");
        say!("{process} first differs at tick {tick}, topic {topic}, field {field}: {found} instead of {expected}");
    }
    if replayed.without_input > 0 {
        say!("{} outputs could not be computed: their inputs are not in the record", replayed.without_input);
    }
    if !replayed.ended.is_empty() {
        say!("{}", replayed.ended);
    }
    let messages: u64 = replayed.topics.iter().map(|topic| topic.messages).sum();
    let verdict = if replayed.first().is_none() { "the same bytes" } else { "NOT the same bytes" };
    say!("{}, seed {}, {process}, {messages} messages: {verdict}", job.scenario.name, job.scenario.seed);
}

fn tell_machine(args: &ReplayArgs, job: &Job, replayed: &Replayed) {
    let first = replayed.first().map(|(tick, topic, Difference { field, expected, found })| {
        json!({"tick": tick, "topic": topic, "field": field, "recorded": expected, "replayed": found})
    });
    let topic = |topic: &Topic| {
        let field = |field: &FieldDifference| {
            json!({
                "field": field.field, "messages": field.messages, "largest": field.largest, "tick": field.tick,
                "element": field.difference.field, "recorded": field.difference.expected, "replayed": field.difference.found,
            })
        };
        json!({"topic": topic.name, "messages": topic.messages, "fields": topic.fields.iter().map(field).collect::<Vec<_>>()})
    };
    say!(
        "{}",
        json!({
            "run": job.run, "scenario": job.scenario.name, "seed": job.scenario.seed, "version": job.version, "process": args.process.name(),
            "set": args.set, "identical": first.is_none(), "difference": first, "topics": replayed.topics.iter().map(topic).collect::<Vec<_>>(),
            "without_input": replayed.without_input, "ended": replayed.ended,
        })
    );
}
