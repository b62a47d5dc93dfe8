//! The engine of every experiment: draw trials, run them, look at their rows.
//!
//! ```text
//! [Trial]   a scenario (settings, seed, faults) on a robot          compare: one a law; sweep: one a point; drill: one a fault
//!    │ Trial::run, on_all_cores       on one thread
//!    ▼
//! [Row]     the result, named as in summary.json
//!    ▼
//! table     a list of columns, each a heading and the text of a row (text.rs); JSON by serde; Parquet (sweeps)
//! ```
//!
//! A new experiment is a function that makes a list of trials, `on_all_cores` with [`Trial::run`], and a list of columns. One that must look at each tick
//! uses [`Trial::watch`]; what it adds to a row it keeps in a structure of its own with the row flattened into it.

use chain::{Sink, Tick};
use model::{Refused, Robot};
use recorder::{Assembler, Contents, Judge, TaskError, TopicHash, Verdict};
use session::{Failure, load};
use shared_types::graph::Graph;
use shared_types::job::{Job, Mode};
use shared_types::scenario::{Scenario, Strategy};
use shared_types::topics::{self, COUNT, Each, STEERED, Topic};

use crate::folder::scratch;
use crate::row::Row;

/// A run that is to be made.
#[derive(Clone, Debug)]
pub struct Trial<'a> {
    /// The arm.
    pub robot: &'a Robot,
    /// The task with all settings, faults and the seed.
    pub scenario: Scenario,
    /// The processes in which it runs, where its plant is another program.
    pub graph: Option<&'a Graph>,
}

/// A scenario of an arm without a task: as `name` is called in errors.
pub(crate) fn bare(name: &str, robot: &str, settings: &[String]) -> Result<Scenario, Failure> {
    let text = format!(
        "name = \"{name}\"\nrobot = \"{robot}\"\n[start]\nposture = \"none\"\n[[segment]]\nduration_s = 2.0\n"
    );
    Ok(Scenario::parse(&format!("{name}.toml"), &text, settings)?)
}

impl<'a> Trial<'a> {
    /// A scenario under another law than its own.
    pub fn under(law: Strategy, robot: &'a Robot, scenario: &Scenario) -> Self {
        let mut scenario = scenario.clone();
        scenario.control.strategy = law;
        Self {
            robot,
            scenario,
            graph: None,
        }
    }

    /// The same with a plant that is another program's.
    pub fn on(self, graph: Option<&'a Graph>) -> Self {
        Self { graph, ..self }
    }

    /// Runs it on one thread: the same bytes on every topic as in five processes. With a graph, in its processes.
    ///
    /// # Errors
    /// [`Refused`] where a cycle does not accept the robot or the scenario, or one thread cannot have one of its faults; of processes, where they
    /// cannot be started.
    pub fn run(&self) -> Result<Row, Refused> {
        if let Some(graph) = self.graph {
            return self.run_in(graph).map_err(Refused::because);
        }
        let Self {
            robot, scenario, ..
        } = self;
        let mut hashes = Hashes::default();
        let is_sent = |topic: &str| scenario.servo.is_some() || !STEERED.contains(&topic);
        let verdict = if chain::plans_faults_of_processes(scenario) {
            let contents = Contents::of_topics(0, scenario.rate_hz, is_sent);
            let mut assembled = Assembled {
                hashes: &mut hashes,
                assembler: Assembler::new(&contents),
                contents,
                judge: Judge::new(robot, scenario)?,
            };
            let ended = chain::run_under_faults(robot, scenario, &mut assembled)?;
            while let Some(row) = assembled.assembler.rest() {
                assembled.judge(&row);
            }
            let mut verdict = assembled.judge.verdict();
            if let Some(sentence) = ended {
                (verdict.completed, verdict.outcome) = (false, "failed".to_owned());
                verdict.reason = format!("{sentence}; {}", verdict.reason);
            }
            verdict
        } else {
            // Each tick is whole: nothing is to be assembled.
            self.watch(|tick, _| {
                topics::each(&mut Pass {
                    hashes: &mut hashes,
                    tick,
                    is_sent,
                });
            })?
        };
        let topics = topics::TOPICS.iter().zip(&hashes.0);
        Ok(Row {
            hash: topics
                .filter(|(_, hash)| hash.count() > 0)
                .map(|(topic, hash)| ((*topic).to_owned(), hash.summary().hash))
                .collect(),
            ..Row::of(scenario.control.strategy, verdict)
        })
    }

    /// Runs it in the processes of a graph, in lockstep; nothing of the run is kept.
    fn run_in(&self, graph: &Graph) -> Result<Row, Failure> {
        let folder = scratch()?;
        let (scenario, out) = (self.scenario.clone(), folder.path().to_owned());
        let job = Job {
            record: false,
            ..load::job(self.robot, scenario, graph.clone(), Mode::Lockstep, out)
        };
        let plan = session::plan(&job)?;
        let (outcome, account) = session::launch_watched(&job, plan, &mut |_| Ok(()), &mut |_| ())?;
        let summary = session::summarise(&job, &outcome, account);
        let topics = summary.topics.iter();
        Ok(Row {
            hash: topics
                .map(|(topic, one)| (topic.clone(), one.hash.clone()))
                .collect(),
            ..Row::of(self.scenario.control.strategy, summary)
        })
    }

    /// Runs it on one thread, shows each tick with its error to `each`, and judges it.
    ///
    /// # Errors
    /// [`Refused`] as [`run`](Self::run), and where a fault of a process is planned.
    pub fn watch(&self, mut each: impl FnMut(&Tick, TaskError)) -> Result<Verdict, Refused> {
        let mut judge = Judge::new(self.robot, &self.scenario)?;
        chain::run(self.robot, &self.scenario, |tick| {
            let error = recorder::Tick::of(&tick.lent()).map(|messages| judge.tick(messages));
            each(tick, error.unwrap_or(TaskError::UNKNOWN));
        })?;
        Ok(judge.verdict())
    }
}

/// The hash of each topic.
#[derive(Default)]
pub(crate) struct Hashes(pub(crate) [TopicHash; COUNT]);

impl Sink for Hashes {
    fn take<M: Topic>(&mut self, message: &M) {
        self.0[M::INDEX].add(message);
    }
}

/// Hashes the messages of a tick, those of the topics that the run has.
struct Pass<'a, S> {
    hashes: &'a mut Hashes,
    tick: &'a Tick,
    is_sent: S,
}

impl<S: Fn(&str) -> bool> Each for Pass<'_, S> {
    type Output = ();
    fn each<M: Topic>(&mut self) {
        if (self.is_sent)(M::TOPIC) {
            self.hashes.take(M::of(self.tick));
        }
    }
}

/// Judges the ticks that messages make, as the recorder does.
struct Assembled<'a> {
    hashes: &'a mut Hashes,
    contents: Contents,
    assembler: Assembler,
    judge: Judge,
}

impl Assembled<'_> {
    fn judge(&mut self, row: &recorder::Row) {
        if let Some(tick) = recorder::Tick::of(&row.messages().lent()) {
            self.judge.tick(tick);
        }
    }
}

impl Sink for Assembled<'_> {
    fn take<M: Topic>(&mut self, message: &M) {
        self.hashes.take(message);
        if let Some(channel) = self.contents.channel(M::TOPIC) {
            self.assembler.take(channel, bytemuck::bytes_of(message));
        }
        while let Some(row) = self.assembler.next_row() {
            self.judge(&row);
        }
    }
}
