//! The shell of one process: joins the run, hands out ports, and keeps the rounds of a polled process.

use std::cell::{Cell, RefCell};
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use process::NamedSaved;
use shared_types::Message;
use shared_types::fault::{Kind, ScheduledFault};
use shared_types::job::Mode;

use crate::bus::collector::Collector;
use crate::bus::depth::{CHAIN_DEPTH, RECORDER_DEPTH, depth, least_depth};
use crate::bus::error::TopicError;
use crate::bus::reader::{Reader, Ticks};
use crate::bus::topic::Topic;
use crate::bus::writer::{Outlet, SendError, Writer};
use crate::bus::{format::Format, node::join, port::Receiver};
use crate::checkpoint::StateCell;
use crate::clock::now_ns;
use crate::context::{Attached, Connect, Context, FaultState, RECORDER_LAG, StopFlag};
use crate::control_page::{ControlPage, ControlPageError, Count, Patience, Watchdog};
use crate::disturbance::{self, Pauses};
use crate::fault::table::FaultTable;
use crate::look_out::LookOut;
use crate::manifest::{Manifest, ManifestError};
use crate::realtime::{self, Lock};
use crate::rounds::Rounds;
use crate::run_dir::{RunDir, RunDirError};
use crate::saving::{cell_of, saved_at};
use crate::stamping::Stamping;
use crate::tick_source::TickSource;
use crate::turns::Turns;
use crate::wait::Interrupted;

/// Why a process cannot join its run.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The run's directory.
    #[error(transparent)]
    RunDir(#[from] RunDirError),
    /// The run's manifest.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    /// The run's control page.
    #[error(transparent)]
    ControlPage(#[from] ControlPageError),
    /// One of its topics.
    #[error(transparent)]
    Topic(#[from] TopicError),
    /// It is not in the graph.
    #[error("the run at {run} has no process {process:?}; its graph has {known}")]
    NotInGraph {
        /// The name asked for.
        process: String,
        /// The run's directory.
        run: String,
        /// The names there are.
        known: String,
    },
    /// No graph started this program.
    #[error(
        "{variable} is not set: this program is a process of a graph, start it with `armplane run SCENARIO --graph FILE.toml`"
    )]
    NotStarted {
        /// The environment variable that is missing.
        variable: &'static str,
    },
    /// The process of that name runs already.
    #[error(
        "{process} of the run {run} is process {pid} already: the run starts each of its processes itself, once"
    )]
    Occupied {
        /// The name in the graph.
        process: String,
        /// The run.
        run: String,
        /// Its process id.
        pid: u32,
    },
    /// It has been in the run, and has left it.
    #[error("{process} has taken part in this run already: a program joins its run once")]
    Again {
        /// The name in the graph.
        process: String,
    },
    /// Its place in the run cannot be taken.
    #[error("cannot take a place in the run: {0}")]
    Occupancy(std::io::Error),
    /// Signals cannot be caught.
    #[error("cannot catch SIGTERM and SIGINT: {0}")]
    Signals(std::io::Error),
    /// No checkpoint.
    #[error("{process} cannot keep a checkpoint for its replacement: {source}")]
    Checkpoint {
        /// The process.
        process: String,
        /// Why.
        source: std::io::Error,
    },
    /// No thread.
    #[error(
        "cannot start the watchdog thread: {0} (the limits on processes and threads, `ulimit -u`, and on memory, `ulimit -v`)"
    )]
    Watchdog(std::io::Error),
}

/// Anything that ends a process before its time.
#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    /// It could not join.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A topic could not be opened.
    #[error(transparent)]
    Topic(#[from] TopicError),
    /// A wait ended without its message.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
    /// A message was refused or could not be sent.
    #[error(transparent)]
    Send(#[from] SendError),
    /// Its own work cannot begin.
    #[error("{0}")]
    Setup(String),
}

impl ProcessError {
    /// The process's own work cannot begin, for this reason.
    pub fn setup(reason: impl std::fmt::Display) -> Self {
        Self::Setup(reason.to_string())
    }
}

/// One process of a run.
///
/// ```no_run
/// # use runtime::{ProcessError, Shell};
/// # use shared_types::{SensorSample, StateEstimate};
/// # fn step(_: &SensorSample, _: &mut StateEstimate) {}
/// # fn main() -> Result<(), ProcessError> {
/// let shell = Shell::open("/dev/shm/…".as_ref(), "estimator")?;
/// let mut sensors = shell.reader::<SensorSample>()?;
/// let mut estimates = shell.writer::<StateEstimate>()?;
/// while let Some(sample) = sensors.next()? {
///     let mut estimate = estimates.loan(sample.header.tick)?;
///     step(sample, &mut estimate);
///     estimate.send()?;
/// }
/// # Ok(()) }
/// ```
pub struct Shell {
    shared: Rc<Context>,
    rounds: Rounds,
    patience: Arc<Patience>,
    /// Held open for as long as this process has its place in the run.
    _occupancy: std::fs::File,
}

impl Shell {
    /// Joins a run: catches SIGTERM and SIGINT, pins the process, takes its real-time settings, maps the control_page.
    ///
    /// A missing right is reported in one warning, and the run continues.
    ///
    /// # Errors
    /// When the run, its files or the process's entry in its graph cannot be used.
    pub fn open(run: &Path, process: &str) -> Result<Self, OpenError> {
        Self::open_as(run, process, Inhabitant::Ours)
    }

    pub(crate) fn open_as(run: &Path, process: &str, whose: Inhabitant) -> Result<Self, OpenError> {
        let run = RunDir::open(run)?;
        let manifest = Manifest::read(&run)?;
        let Some(me) = manifest.index_of(process) else {
            return Err(OpenError::NotInGraph {
                process: process.into(),
                run: run.path().display().to_string(),
                known: manifest.names(),
            });
        };
        let control_page = Arc::new(ControlPage::open(&run)?);
        let occupied = || OpenError::Occupied {
            process: process.into(),
            run: run.name().into(),
            pid: control_page.process(me).pid(),
        };
        let occupancy = run
            .occupy(process)
            .map_err(OpenError::Occupancy)?
            .ok_or_else(occupied)?;
        let is_polled = manifest.processes[me].polled;
        let stop = whose.stop_flag(is_polled).map_err(OpenError::Signals)?;
        // Before the process is pinned: the watchdog may run on any core.
        let patience = Arc::new(Patience::default());
        Watchdog::start(&control_page, me, &patience).map_err(OpenError::Watchdog)?;
        settle(&manifest, me, whose);
        let own = &manifest.processes[me];
        let (hop, disturbance) = (own.hop, own.disturbance);
        disturbance::begin(disturbance);
        let bus = join(&run, process, false)?;
        let incarnation = control_page.process(me).incarnation();
        let from = manifest.from;
        let foreign = manifest.messages.iter().map(|message| depth(message.bytes));
        let least = foreign.fold(least_depth(&manifest.topics()), usize::min);
        let shared = Context {
            stamping: Stamping::at(hop),
            turns: Turns::of(&manifest, me),
            // A quarter of what is kept: faults make several messages of one tick, and a block of a message log is not in its file yet.
            recorder_lag: RECORDER_LAG.min(least as u64 / 4),
            run,
            manifest,
            control_page,
            bus,
            me,
            stop,
            has_started: Cell::new(false),
            tick: Cell::new(from),
            incarnation: Cell::new(incarnation),
            pauses: RefCell::new(disturbance.pauses.map(Pauses::new)),
            faults: FaultState::default(),
            attached: Attached::default(),
            look_out: LookOut::default(),
        };
        Ok(Self {
            shared: Rc::new(shared),
            rounds: Rounds::default(),
            patience,
            _occupancy: occupancy,
        })
    }

    /// Reads a topic message by message: the next tick in lockstep, the newest in real time.
    ///
    /// # Errors
    /// When the graph does not list this process as its reader, or the wire formats differ.
    pub fn reader<M: Message>(&self) -> Result<Reader<M>, TopicError> {
        self.declared("read", M::TOPIC)?;
        Ok(Reader::new(
            Rc::clone(&self.shared),
            self.receiver(Format::of::<M>(), CHAIN_DEPTH)?,
        ))
    }

    /// The messages of a topic, also where only the graph knows them; `None`: there is no such topic.
    pub(crate) fn format(&self, topic: &str) -> Option<Format> {
        let foreign = || Some(Format::foreign(self.shared.manifest.message(topic)?));
        Format::named(topic).or_else(foreign)
    }

    /// Reads everything of a topic as bytes, in order, in rounds of [`Shell::poll`], also where only the graph knows its message.
    ///
    /// # Errors
    /// When there is no such message, or the graph does not name this process as a reader.
    pub fn collector(&self, topic: &str) -> Result<Collector, TopicError> {
        let Some(format) = self.format(topic).filter(|_| self.reads(topic)) else {
            return Err(TopicError::Unknown {
                topic: topic.to_owned(),
                known: self.shared.manifest.topics().join(", "),
            });
        };
        let receiver = self.receiver(format, RECORDER_DEPTH)?;
        Ok(Collector::new(Rc::clone(&self.shared), receiver))
    }

    /// Writes a topic; wakes the processes that the graph names as its readers. A process opens all topics that it declares before its first wait.
    ///
    /// # Errors
    /// When the graph does not list this process as its writer, or the wire formats differ.
    pub fn writer<M: Message>(&self) -> Result<Writer<M>, TopicError> {
        self.declared("write", M::TOPIC)?;
        Ok(Writer::new(self.outlet(Format::of::<M>())?))
    }

    /// The writing end of a topic, whatever its messages.
    pub(crate) fn outlet(&self, format: Format) -> Result<Outlet, TopicError> {
        let sender = Rc::new(Topic::open(&self.shared.bus, format)?.sender()?);
        self.shared
            .attached
            .ports
            .borrow_mut()
            .push(Rc::clone(&sender) as Rc<dyn Connect>);
        Ok(Outlet::new(&self.shared, format, sender))
    }

    fn receiver(&self, format: Format, depth: usize) -> Result<Rc<Receiver>, TopicError> {
        let receiver = Rc::new(Topic::open(&self.shared.bus, format)?.receiver(depth)?);
        self.shared
            .attached
            .ports
            .borrow_mut()
            .push(Rc::clone(&receiver) as Rc<dyn Connect>);
        Ok(receiver)
    }

    /// The reading end of a topic, whatever its messages.
    pub(crate) fn inlet(&self, format: Format) -> Result<Ticks, TopicError> {
        let receiver = self.receiver(format, CHAIN_DEPTH)?;
        Ok(Ticks::new(Rc::clone(&self.shared), receiver))
    }

    /// The state of this process, at most so many bytes: in real time that which the last incarnation committed, and the place to fill at every tick before its last
    /// message.
    ///
    /// # Errors
    /// When there is no room for it.
    pub fn state_cell(&self, most: usize) -> Result<StateCell, OpenError> {
        let shared = &self.shared;
        let path = cell_of(shared.run.path(), shared.name());
        let failed = |source| OpenError::Checkpoint {
            process: shared.name().to_owned(),
            source,
        };
        let cell = StateCell::open(&path, most).map_err(failed)?;
        shared.attached.checkpoint.replace(Some(cell.slots()));
        Ok(cell)
    }

    /// Before this tick every other process that sends messages has closed all: no message of an earlier one comes any more.
    pub fn closed_by_all(&self) -> u64 {
        let shared = &self.shared;
        let processes = shared.manifest.processes.iter().enumerate();
        let closed = processes
            .filter(|(_, process)| !process.polled)
            .map(|(index, _)| shared.control_page.process(index).ticks());
        closed.min().unwrap_or_default()
    }

    /// The state that every process has saved at the cut of a tick, with its name, in the order of the graph; `None` if one has saved nothing there, or not
    /// yet. One that only reads need not save itself.
    ///
    /// # Errors
    /// When a cell cannot be read.
    pub fn cut(&self, tick: u64) -> std::io::Result<Option<Vec<NamedSaved>>> {
        let processes = self.shared.manifest.processes.iter();
        let mut saved = Vec::new();
        let saves = |name: &str| cell_of(self.run_dir(), name).exists();
        for process in processes.filter(|process| !process.polled || saves(&process.name)) {
            match saved_at(self.run_dir(), &process.name, tick)? {
                Some(state) => saved.push((process.name.clone(), state)),
                None => return Ok(None),
            }
        }
        Ok(Some(saved))
    }

    /// Gives out ticks from `first` on: on the grid in real time, as fast as the recorder follows in lockstep.
    pub fn tick_source(&self, first: u64) -> TickSource {
        TickSource::new(Rc::clone(&self.shared), first)
    }

    /// A polled process's rhythm: ends a round, sleeps until `every` has passed since that began, begins the next; `false` after the round in which
    /// nothing more can come. It sleeps less where ticks are so quick, or messages so large, that more than a quarter of its buffers would be full by then.
    ///
    /// Messages drained in the round count as received: in lockstep the tick source may go on.
    ///
    /// # Errors
    /// When the run does not start within the limit.
    pub fn poll(&self, every: Duration) -> Result<bool, Interrupted> {
        self.rounds.poll(&self.shared, every)
    }

    /// For a polled process: it holds all messages of the round in hand itself, or their logs do. In lockstep the tick source may go on at once, not only
    /// at the end of the round, when all has been made of them; in a run with faults at the end.
    pub fn has_taken_in(&self) {
        self.rounds.have_taken_in(&self.shared);
    }

    /// How time passes in this run.
    pub fn mode(&self) -> Mode {
        self.shared.manifest.mode
    }

    /// Whether the graph lets this process read a topic.
    pub fn reads(&self, topic: &str) -> bool {
        self.shared.manifest.processes[self.shared.me]
            .reads
            .iter()
            .any(|one| one == topic)
    }

    /// Whether the graph lets this process write a topic.
    pub fn writes(&self, topic: &str) -> bool {
        let own = &self.shared.manifest.processes[self.shared.me];
        own.writes.iter().any(|one| one == topic)
    }

    /// Whether this process only reads.
    pub(crate) fn writes_nothing(&self) -> bool {
        self.shared.manifest.processes[self.shared.me]
            .writes
            .is_empty()
    }

    /// Whether this process makes the ticks.
    pub(crate) fn makes_ticks(&self) -> bool {
        self.shared.manifest.processes[self.shared.me].makes_ticks
    }

    /// The run as all its processes know it.
    pub fn manifest(&self) -> &Manifest {
        &self.shared.manifest
    }

    /// How often this process has been started in this run, from 1.
    pub fn incarnation(&self) -> u32 {
        self.shared.entry().incarnation()
    }

    /// The faults that concern this process at a tick, and their places in the fault table: for the plant, whose faults are physical, and the
    /// recorder, whose faults are those of its volume.
    pub fn faults_at(&self, tick: u64, mut each: impl FnMut(usize, &ScheduledFault, Kind)) {
        let shared = &self.shared;
        shared.learn();
        if !shared.is_unharmed() {
            shared
                .faults
                .known
                .borrow()
                .of(shared.me, tick)
                .for_each(|(place, scheduled, kind)| each(place, scheduled, kind));
        }
    }

    /// Messages that all processes of the run have sent.
    pub fn sent_by_all(&self) -> u64 {
        (0..self.shared.manifest.processes.len())
            .map(|index| self.shared.control_page.process(index).count(Count::Sent))
            .sum()
    }

    /// A fault of [`Shell::faults_at`] takes effect now.
    pub fn mark_injected(&self, place: usize) {
        self.shared
            .control_page
            .fault_table()
            .mark_injected(place, now_ns());
    }

    /// This process has detected its fault.
    pub fn mark_detected(&self) {
        self.mark_detected_at(self.shared.tick.get());
    }

    /// The same, of the messages of a tick.
    pub(crate) fn mark_detected_at(&self, tick: u64) {
        let table = self.shared.control_page.fault_table();
        table.mark_detected(self.shared.me, tick, now_ns());
    }

    /// A message's content is refused: the faults in force are thereby detected.
    pub fn mark_message_fault_detected(&self) {
        self.shared.message_fault_detected();
    }

    /// All faults of the run so far.
    pub fn fault_table(&self) -> &FaultTable {
        self.shared.control_page.fault_table()
    }

    /// Whether the run is to stop.
    pub fn is_stopping(&self) -> bool {
        self.shared.is_stopping()
    }

    /// One of this process's counts so far.
    pub fn count(&self, count: Count) -> u64 {
        self.shared.entry().count(count)
    }

    /// The directory of the run.
    pub fn run_dir(&self) -> &Path {
        self.shared.run.path()
    }

    /// Takes a place, besides the one of its own name, that only one process of the run may have,
    /// while the file is open.
    ///
    /// # Errors
    /// When another process has it, or the file cannot be made.
    pub fn hold(&self, place: &str) -> Result<std::fs::File, ProcessError> {
        let held = self
            .shared
            .run
            .occupy(place)
            .map_err(OpenError::Occupancy)?;
        held.ok_or_else(|| {
            ProcessError::setup(format!(
                "another process of the run has the place `{place}`, which only one can have"
            ))
        })
    }

    /// The name of this process in the graph.
    pub fn name(&self) -> &str {
        self.shared.name()
    }

    /// How long the program of the process may take for a tick.
    pub(crate) fn patience(&self) -> Arc<Patience> {
        Arc::clone(&self.patience)
    }

    /// Calls `look` between the sleeps of every wait.
    pub(crate) fn look_out(&self, look: impl FnMut() -> bool + 'static) {
        self.shared.look_out.call(look);
    }

    /// Looks out, where a process sleeps in rounds.
    pub(crate) fn look(&self) -> Result<(), Interrupted> {
        let why = self.shared.look_out.look();
        why.map_or(Ok(()), |why| Err(self.shared.asked(why)))
    }

    /// Whether all processes have begun.
    pub(crate) fn has_started(&self) -> bool {
        self.shared.has_started.get()
    }

    pub(crate) fn shared(&self) -> Rc<Context> {
        Rc::clone(&self.shared)
    }

    pub(crate) fn declared(
        &self,
        action: &'static str,
        topic: &'static str,
    ) -> Result<(), TopicError> {
        let process = &self.shared.manifest.processes[self.shared.me];
        let topics = if action == "read" {
            &process.reads
        } else {
            &process.writes
        };
        match topics.iter().any(|one| one == topic) {
            true => Ok(()),
            false => Err(TopicError::Undeclared {
                process: process.name.clone(),
                action,
                topic,
            }),
        }
    }
}

/// Whose memory and signals the process has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Inhabitant {
    /// Those of a program that is nothing but this process.
    Ours,
    /// Those of a program that uses this crate as a library: its signals are its own, and it may need more memory later.
    Guest,
    /// Likewise, of a program that does more than this process, and keeps its core and its scheduling.
    Visitor,
}

impl Inhabitant {
    /// It leaves signals to the program of a guest.
    fn stop_flag(self, is_polled: bool) -> std::io::Result<StopFlag> {
        match self {
            Self::Ours => StopFlag::new(is_polled),
            Self::Guest | Self::Visitor => Ok(StopFlag::without_signals(is_polled)),
        }
    }
}

/// Pins the process where the graph wants it and, in real time, takes its scheduling class and locks its memory.
fn settle(manifest: &Manifest, me: usize, whose: Inhabitant) {
    if whose == Inhabitant::Visitor {
        return;
    }
    let process = &manifest.processes[me];
    let mut missing = Vec::new();
    missing.extend(process.core.and_then(|core| realtime::pin(core).err()));
    if !manifest.is_lockstep() {
        // No other process waits for one that writes nothing.
        let lock = if process.writes.is_empty() || whose == Inhabitant::Guest {
            Lock::AsTouched
        } else {
            Lock::AtOnce
        };
        match whose == Inhabitant::Guest && !realtime::Rights::query().lock_memory() {
            // A later request of a guest would be refused.
            true => missing.extend(realtime::enter_unlocked(process.priority)),
            false => missing.extend(realtime::enter(process.priority, lock)),
        }
    }
    if !missing.is_empty() {
        let missing = missing
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>()
            .join("; ");
        tracing::warn!("{} runs without: {missing}", process.name);
    }
}
