//! The engine of every experiment: draw trials, run them, look at their rows.
//!
//! ```text
//! [Trial]   a scenario (settings, seed, faults) on a robot          compare: one a law; drill: one a fault; Python: any
//!    │ Trial::run                     on one thread
//!    ▼
//! [Row]     the result, named as in summary.json
//!    ▼
//! table     headings, and the cells of a row (session::table); JSON by serde
//! ```
//!
//! A new experiment is a function that makes a list of trials, calls [`Trial::run`] of each on all cores, and prints a table. One that must look at each
//! tick uses [`Trial::watch`]; what it adds to a row it keeps in a structure of its own with the row flattened into it.

use std::sync::mpsc;
use std::thread;

use chain::Tick;
use model::{Refused, Robot};
use process::Step;
use recorder::{Account, Assembler, Contents, Judge, TaskError, TopicHash, Verdict};
use session::{Failure, load};
use shared_types::graph::Graph;
use shared_types::job::{Job, Mode};
use shared_types::scenario::{Scenario, Strategy};
use shared_types::summary::{FAILED, Summary};
use shared_types::topics::{COUNT, TOPICS};

use crate::folder::scratch;
use crate::row::Row;

/// The step of a controller of others.
pub type Controller = Box<dyn Step + Send>;

/// Ticks of a run that wait to be shown.
const WAITING: usize = 1000;

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
    // A file's name may hold quotes and line breaks.
    let robot = toml::Value::from(robot);
    let text = format!(
        "name = \"{name}\"\nrobot = {robot}\n[start]\nposture = \"none\"\n[[segment]]\nduration_s = 2.0\n"
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

    /// Runs it on one thread: the same bytes on every topic as in five processes. With a graph, in its processes.
    ///
    /// # Errors
    /// [`Refused`] where a cycle does not accept the robot or the scenario, or one thread cannot have one of its faults; of processes, where they
    /// cannot be started.
    pub fn run(&self) -> Result<Row, Refused> {
        let summary = match self.graph {
            Some(graph) => self.run_in(graph).map_err(Refused::because)?,
            None if chain::plans_faults_of_processes(&self.scenario) => self.assembled(None)?,
            None => self.judged()?,
        };
        Ok(Row::of(self.scenario.control.strategy, summary))
    }

    /// The same on one thread under a controller of others.
    ///
    /// # Errors
    /// [`Refused`] as [`run`](Self::run).
    pub fn run_under(&self, controller: Controller) -> Result<Row, Refused> {
        let summary = self.assembled(Some(controller))?;
        Ok(Row::of(self.scenario.control.strategy, summary))
    }

    /// Each tick is whole: nothing is to be assembled.
    fn judged(&self) -> Result<Summary, Refused> {
        let is_sent = TOPICS.map(|topic| self.scenario.sends(topic));
        let mut hashes = [TopicHash::default(); COUNT];
        let summary = self.watch(|tick, _| {
            let messages = tick.parts().into_iter().zip(&mut hashes).zip(is_sent);
            for ((message, hash), _) in messages.filter(|(_, is_sent)| *is_sent) {
                hash.add(message);
            }
        })?;
        let topics = TOPICS.into_iter().map(str::to_owned);
        Ok(Summary {
            topics: topics.zip(hashes.map(|hash| hash.summary())).collect(),
            ..summary
        })
    }

    fn assembled(&self, controller: Option<Controller>) -> Result<Summary, Refused> {
        let mut judge = Judge::new(self.robot, &self.scenario)?;
        let (accounts, ended) = self.assemble(controller, |row| {
            judge.take(&row.messages().lent());
        })?;
        let mut summary = judge.verdict();
        if let Some(sentence) = ended {
            (summary.completed, summary.outcome) = (false, FAILED.to_owned());
            summary.reason = format!("{sentence}; {}", summary.reason);
        }
        let topic = |account: Account| (account.topic, account.hash.summary());
        summary.topics = accounts.into_iter().map(topic).collect();
        Ok(summary)
    }

    /// Runs it on one thread under all its faults, and hands each tick's messages to `each` as the recorder assembles them. The sentence: why it ended
    /// before its task did.
    fn assemble(
        &self,
        controller: Option<Controller>,
        mut each: impl FnMut(&recorder::Row),
    ) -> Result<(Vec<Account>, Option<String>), Refused> {
        let is_sent = |topic: &str| self.scenario.sends(topic);
        let contents = Contents::of_topics(0, self.scenario.rate_hz, is_sent);
        let mut assembler = Assembler::new(&contents);
        let mut take = |topic: usize, message: &[u8]| {
            if let Some(channel) = contents.channel(TOPICS[topic]) {
                assembler.take(channel, message);
            }
            while let Some(row) = assembler.next_row() {
                each(&row);
            }
        };
        let controller = controller.map(|step| -> Box<dyn Step> { step });
        let ended = chain::run_under_faults(self.robot, &self.scenario, controller, &mut take)?;
        while let Some(row) = assembler.rest() {
            each(&row);
        }
        Ok((assembler.accounts().to_vec(), ended))
    }

    /// Its signals, a row a tick, as a stream of Arrow's IPC format: the columns of `armplane export`.
    ///
    /// # Errors
    /// As [`run`](Self::run) on one thread.
    pub fn trace(&self, controller: Option<Controller>) -> Result<Vec<u8>, Failure> {
        let graph = load::graph_of(&self.scenario, None)?;
        let scenario = self.scenario.clone();
        let job = load::job(self.robot, scenario, graph, Mode::Lockstep, "".into());
        self.shown(controller, |ticks| {
            viz::signals(&job, self.robot, ticks).map_err(Failure::work)
        })
    }

    /// Runs it on a thread of its own, and hands its ticks to `show` as they come.
    ///
    /// # Errors
    /// As [`trace`](Self::trace), and the failure of `show`.
    pub(crate) fn shown<T>(
        &self,
        controller: Option<Controller>,
        show: impl FnOnce(&mut dyn Iterator<Item = viz::Tick>) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let (send, ticks) = mpsc::sync_channel(WAITING);
        let keep = move |row: &recorder::Row| {
            // Without a reader `show` has failed, and says why.
            let _ = send.send(viz::Tick {
                tick: row.tick,
                messages: *row.messages(),
                events: Vec::new(),
            });
        };
        thread::scope(|scope| {
            let run = scope.spawn(|| self.assemble(controller, keep));
            let shown = show(&mut ticks.into_iter());
            let ran = run.join().map_err(|_| Failure::work("the run panicked"))?;
            ran.map_err(Failure::input)?;
            shown
        })
    }

    /// Runs it in the processes of a graph, in lockstep; nothing of the run is kept.
    fn run_in(&self, graph: &Graph) -> Result<Summary, Failure> {
        let folder = scratch()?;
        let (scenario, out) = (self.scenario.clone(), folder.path().to_owned());
        let job = Job {
            record: false,
            ..load::job(self.robot, scenario, graph.clone(), Mode::Lockstep, out)
        };
        let plan = session::plan(&job)?;
        let (outcome, account) = session::launch_watched(&job, plan, &mut |_| Ok(()), &mut |_| ())?;
        Ok(session::summarise(&job, &outcome, account))
    }

    /// Runs it on one thread, shows each tick with its error to `each`, and judges it.
    ///
    /// # Errors
    /// [`Refused`] as [`run`](Self::run), and where a fault of a process is planned.
    pub fn watch(&self, mut each: impl FnMut(&Tick, TaskError)) -> Result<Verdict, Refused> {
        let mut judge = Judge::new(self.robot, &self.scenario)?;
        chain::run(self.robot, &self.scenario, |tick| {
            each(tick, judge.take(&tick.lent()));
        })?;
        Ok(judge.verdict())
    }
}
