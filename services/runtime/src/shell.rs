//! The shell of one process: joins the run, hands out ports, and keeps the rounds of a polled process.

use std::cell::{Cell, RefCell};
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use process::NamedSaved;
use shared_types::Message;
use shared_types::job::Mode;

use crate::bus::collector::Collector;
use crate::bus::depth::{CHAIN_DEPTH, RECORDER_DEPTH, least_depth};
use crate::bus::error::TopicError;
use crate::bus::reader::{Reader, Ticks};
use crate::bus::topic::Topic;
use crate::bus::writer::{Outlet, SendError, Writer};
use crate::bus::{format::Format, node::join, port::Receiver};
use crate::checkpoint::StateCell;
use crate::clock::now_ns;
use crate::context::{Attached, Connect, Context, FaultState, RECORDER_LAG};
use crate::control_page::{ControlPage, ControlPageError, Count, Patience, Watchdog};
use crate::disturbance::{self, Pauses};
use crate::fault::table::FaultTable;
use crate::look_out::LookOut;
use crate::manifest::{Manifest, ManifestError, Process};
use crate::realtime::{self, Lock};
use crate::rounds::Rounds;
use crate::run_dir::{RunDir, RunDirError};
use crate::saving::{cell_of, saved_at};
use crate::stamping::Stamping;
use crate::tick_source::TickSource;
use crate::turns::Turns;
use crate::wait::Interrupted;

/// Why a process cannot join its run, or ends before its time.
#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    /// The run's directory.
    #[error(transparent)]
    RunDir(#[from] RunDirError),
    /// The run's manifest.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    /// The run's control page.
    #[error(transparent)]
    ControlPage(#[from] ControlPageError),
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
///     step(sample, estimates.loan(sample.header.tick)?);
///     estimates.send()?;
/// }
/// # Ok(()) }
/// ```
pub struct Shell {
    pub(crate) shared: Rc<Context>,
    pub(crate) rounds: Rounds,
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
    pub fn open(run: &Path, process: &str) -> Result<Self, ProcessError> {
        Self::open_as(run, process, Inhabitant::Ours)
    }

    pub(crate) fn open_as(
        run: &Path,
        process: &str,
        whose: Inhabitant,
    ) -> Result<Self, ProcessError> {
        let run = RunDir::open(run)?;
        let manifest = Manifest::read(&run)?;
        let Some(me) = manifest.index_of(process) else {
            return Err(ProcessError::NotInGraph {
                process: process.into(),
                run: run.path().display().to_string(),
                known: manifest.names(),
            });
        };
        let control_page = Arc::new(ControlPage::open(&run)?);
        let occupied = || ProcessError::Occupied {
            process: process.into(),
            run: run.name().into(),
            pid: control_page.process(me).pid(),
        };
        let occupancy = run
            .occupy(process)
            .map_err(ProcessError::Occupancy)?
            .ok_or_else(occupied)?;
        let signalled = Arc::new(AtomicUsize::new(0));
        // A guest's signals are its own.
        let caught = [libc::SIGTERM, libc::SIGINT].into_iter();
        for signal in caught.filter(|_| whose == Inhabitant::Ours) {
            let flag = Arc::clone(&signalled);
            signal_hook::flag::register_usize(signal, flag, signal as usize)
                .map_err(ProcessError::Signals)?;
        }
        // Before the process is pinned: the watchdog may run on any core.
        let patience = Arc::new(Patience::default());
        Watchdog::start(&control_page, me, &patience).map_err(ProcessError::Watchdog)?;
        settle(&manifest, me, whose);
        let own = &manifest.processes[me];
        let (hop, disturbance) = (own.hop, own.disturbance);
        disturbance::begin(disturbance);
        let bus = join(&run, process, false)?;
        let incarnation = control_page.process(me).incarnation();
        let from = manifest.from;
        let shared = Context {
            stamping: Stamping::at(hop),
            turns: Turns::of(&manifest, me),
            // A quarter of what is kept: faults make several messages of one tick, and a block of a message log is not in its file yet.
            recorder_lag: RECORDER_LAG.min(least_depth(&manifest) as u64 / 4),
            run,
            manifest,
            control_page,
            bus,
            me,
            signalled,
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
        Ok(Reader::new(self.inlet(Format::of::<M>())?))
    }

    /// Reads everything of a topic as bytes, in order, in rounds of [`Shell::poll`], also where only the graph knows its message.
    ///
    /// # Errors
    /// When there is no such message, or the graph does not name this process as a reader.
    pub fn collector(&self, topic: &str) -> Result<Collector, TopicError> {
        let format = Format::in_run(self.manifest(), topic);
        let Some(format) = format.filter(|_| self.reads(topic)) else {
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
        Ok(Writer::new(self.outlet(Format::of::<M>())?))
    }

    /// The writing end of a topic, whatever its messages.
    pub(crate) fn outlet(&self, format: Format) -> Result<Outlet, TopicError> {
        self.declared("write", format.topic, self.writes(format.topic))?;
        let sender = Rc::new(Topic::open(&self.shared.bus, format)?.sender()?);
        self.attach(Rc::clone(&sender) as Rc<dyn Connect>);
        Ok(Outlet::new(&self.shared, sender))
    }

    fn attach(&self, port: Rc<dyn Connect>) {
        self.shared.attached.ports.borrow_mut().push(port);
    }

    fn receiver(&self, format: Format, depth: usize) -> Result<Rc<Receiver>, TopicError> {
        let receiver = Rc::new(Topic::open(&self.shared.bus, format)?.receiver(depth)?);
        self.attach(Rc::clone(&receiver) as Rc<dyn Connect>);
        Ok(receiver)
    }

    /// The reading end of a topic, whatever its messages.
    pub(crate) fn inlet(&self, format: Format) -> Result<Ticks, TopicError> {
        self.declared("read", format.topic, self.reads(format.topic))?;
        let receiver = self.receiver(format, CHAIN_DEPTH)?;
        Ok(Ticks::new(Rc::clone(&self.shared), receiver))
    }

    /// The place for the state of this process, at most so many bytes, to fill at every tick before its last message; and in real time the state that the
    /// last incarnation committed.
    ///
    /// # Errors
    /// When there is no room for it, or what was committed is damaged.
    pub(crate) fn state_cell(
        &self,
        most: usize,
    ) -> Result<(Rc<StateCell>, Option<Vec<u8>>), ProcessError> {
        let shared = &self.shared;
        let path = cell_of(shared.run.path(), shared.name());
        let failed = |source| ProcessError::Checkpoint {
            process: shared.name().to_owned(),
            source,
        };
        let cell = Rc::new(StateCell::open(&path, most).map_err(failed)?);
        let earlier = cell.newest().map_err(failed)?;
        shared.attached.checkpoint.replace(Some(Rc::clone(&cell)));
        Ok((cell, earlier))
    }

    /// Before this tick every other process that sends messages has closed all: no message of an earlier one comes any more.
    pub fn closed_by_all(&self) -> u64 {
        let shared = &self.shared;
        let processes = shared.manifest.processes.iter().enumerate();
        let closed = processes
            .filter(|(_, process)| !process.is_polled())
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
        for process in processes.filter(|process| !process.is_polled() || saves(&process.name)) {
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

    /// How time passes in this run.
    pub fn mode(&self) -> Mode {
        self.shared.manifest.mode
    }

    /// Whether the graph lets this process read a topic.
    pub fn reads(&self, topic: &str) -> bool {
        self.own().reads.iter().any(|one| one == topic)
    }

    /// Whether the graph lets this process write a topic.
    pub fn writes(&self, topic: &str) -> bool {
        self.own().writes.iter().any(|one| one == topic)
    }

    /// This process, as the others see it.
    pub(crate) fn own(&self) -> &Process {
        self.shared.own()
    }

    /// The run as all its processes know it.
    pub fn manifest(&self) -> &Manifest {
        &self.shared.manifest
    }

    /// How often this process has been started in this run, from 1.
    pub fn incarnation(&self) -> u32 {
        self.shared.entry().incarnation()
    }

    /// Messages that all processes of the run have sent.
    pub fn sent_by_all(&self) -> u64 {
        (0..self.shared.manifest.processes.len())
            .map(|index| self.shared.control_page.process(index).count(Count::Sent))
            .sum()
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
            .map_err(ProcessError::Occupancy)?;
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

    /// Looks out, where a process sleeps in rounds.
    pub(crate) fn look(&self) -> Result<(), Interrupted> {
        let why = self.shared.look_out.look();
        why.map_or(Ok(()), |why| Err(self.shared.asked(why)))
    }

    fn declared(
        &self,
        action: &'static str,
        topic: &'static str,
        is_declared: bool,
    ) -> Result<(), TopicError> {
        match is_declared {
            true => Ok(()),
            false => Err(TopicError::Undeclared {
                process: self.name().to_owned(),
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

/// Pins the process where the graph wants it and, in real time, takes its scheduling class and locks its memory.
fn settle(manifest: &Manifest, me: usize, whose: Inhabitant) {
    if whose == Inhabitant::Visitor {
        return;
    }
    let process = &manifest.processes[me];
    let mut missing = Vec::new();
    missing.extend(process.core.and_then(|core| realtime::pin(core).err()));
    if !manifest.is_lockstep() {
        let is_guest = whose == Inhabitant::Guest;
        let lock = if is_guest && !realtime::Rights::query().lock_memory() {
            Lock::Never
        } else if is_guest || process.is_polled() {
            // No other process waits for one that only reads.
            Lock::AsTouched
        } else {
            Lock::AtOnce
        };
        missing.extend(realtime::enter(process.priority, lock));
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
