//! The shell of one process: joins the run, hands out ports, and owns every wait.

use std::cell::{Cell, RefCell};
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use iceoryx2::prelude::{Node, ipc};
use shared_types::fault::{Kind, ScheduledFault};
use shared_types::wire::{HOPS, Header, Stamps};
use shared_types::{Checkpoint, Message};

use crate::bus::collector::Collector;
use crate::bus::inlet::Connect;
use crate::bus::reader::Reader;
use crate::bus::topic::{self, CHAIN_DEPTH, RECORDER_DEPTH, Subscribing, TopicError};
use crate::bus::writer::{SendError, Writer};
use crate::checkpoint::{CheckpointSlots, Commit};
use crate::clock::now_ns;
use crate::control_page::{ANYTHING, ControlPage, ControlPageError, Count, PROGRESS, Phase, ProcessEntry, State, Stop, Watchdog};
use crate::fate::{Hog, Outlet};
use crate::fault::table::{Copied, FaultTable};
use crate::manifest::{Disturbance, Manifest, ManifestError, Mode};
use crate::realtime;
use crate::run_dir::{RunDir, RunDirError};
use crate::tick_source::TickSource;
use crate::validation::Pauses;

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
    /// Signals cannot be caught.
    #[error("cannot catch SIGTERM and SIGINT: {0}")]
    Signals(std::io::Error),
    /// No checkpoint.
    #[error("{process} cannot keep a checkpoint for its replacement: {source}")]
    Checkpoint {
        /// Whose.
        process: String,
        /// Why.
        source: std::io::Error,
    },
    /// No thread.
    #[error("cannot start the watchdog thread: {0}")]
    Watchdog(std::io::Error),
}

/// Why a wait ended without what was waited for. A stop of the run is not among them: waits return `None` then.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Interrupted {
    /// Nothing came within the limit.
    #[error("{process} waited {waited:?} for {what} and gave up: is {from} alive?")]
    TimedOut {
        /// Who waited.
        process: String,
        /// For what.
        what: String,
        /// Who should have brought it.
        from: String,
        /// How long.
        waited: Duration,
    },
    /// In lockstep a tick was skipped; nothing may be lost there.
    #[error("{process} expected tick {expected} of topic {topic:?} and got tick {found}: a message was lost in lockstep")]
    Lost {
        /// Who reads.
        process: String,
        /// Which topic.
        topic: &'static str,
        /// The tick that should have come.
        expected: u64,
        /// The tick that came.
        found: u64,
    },
    /// iceoryx2 failed.
    #[error("{process} cannot use topic {topic:?}: {reason}")]
    Port {
        /// Who.
        process: String,
        /// Which topic.
        topic: &'static str,
        /// What iceoryx2 says.
        reason: String,
    },
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
    /// A wait ended in vain.
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

/// How a wait ended.
pub(crate) enum Waited<T> {
    Ready(T),
    Late,
    Stopped,
}

/// What one process has of the run; shared by its ports.
pub(crate) struct Shared {
    pub(crate) run: RunDir,
    pub(crate) manifest: Manifest,
    pub(crate) control_page: Arc<ControlPage>,
    pub(crate) node: Node<ipc::Service>,
    pub(crate) me: usize,
    stops_at: Stop,
    /// Its place in [`HOPS`], if it has one.
    hop: Option<usize>,
    signalled: Arc<AtomicBool>,
    started: Cell<bool>,
    /// The ports to connect at the start.
    ports: RefCell<Vec<Rc<dyn Connect>>>,
    /// The stamps of the inputs of the tick in hand.
    input: Cell<Input>,
    /// When the source's tick in hand was due; 0 in lockstep.
    pub(crate) due_ns: Cell<u64>,
    /// The last tick of which something was sent.
    sent_tick: Cell<Option<u64>>,
    /// Deliberate pauses, in a run of `verify`.
    pauses: RefCell<Option<Pauses>>,
    /// The tick in hand: everything before it is closed.
    pub(crate) tick: Cell<u64>,
    /// What the process knows of the fault table.
    pub(crate) fates: RefCell<Copied>,
    pub(crate) hog: RefCell<Option<Hog>>,
    pub(crate) is_volume_full: Cell<bool>,
    pub(crate) outlets: RefCell<Vec<Rc<dyn Outlet>>>,
    /// The outputs sent of a tick, a bit each.
    outputs_sent: Cell<(u64, u32)>,
    /// What is committed when a tick closes.
    checkpoints: RefCell<Vec<Rc<dyn Commit>>>,
}

#[derive(Clone, Copy, Default)]
struct Input {
    tick: u64,
    received_ns: u64,
    stamps: Stamps,
}

impl Shared {
    pub(crate) fn name(&self) -> &str {
        &self.manifest.processes[self.me].name
    }

    pub(crate) fn entry(&self) -> &ProcessEntry {
        self.control_page.process(self.me)
    }

    pub(crate) fn is_lockstep(&self) -> bool {
        self.manifest.mode == Mode::Lockstep
    }

    /// Whether this process is deliberately content with a message of the tick before.
    pub(crate) fn is_unordered(&self) -> bool {
        self.manifest.processes[self.me].disturbance.unordered
    }

    /// Sleeps where the run's disturbance says so.
    pub(crate) fn pause(&self) {
        if let Some(pause) = self.pauses.borrow_mut().as_mut().and_then(Pauses::next) {
            std::thread::sleep(pause);
        }
    }

    pub(crate) fn is_stopping(&self) -> bool {
        self.control_page.stop() >= self.stops_at || self.signalled.load(Ordering::Relaxed)
    }

    pub(crate) fn topic_bit(&self, topic: &str) -> u32 {
        self.manifest.topics().iter().position(|&t| t == topic).map_or(0, |index| 1 << index)
    }

    /// Goes with all others through the phases of the beginning; from here on nothing can be lost.
    pub(crate) fn start(&self) -> Result<Waited<()>, Interrupted> {
        if self.started.get() {
            return Ok(Waited::Ready(()));
        }
        self.entry().set_state(State::Ready);
        if matches!(self.wait_for_phase(Phase::Connect)?, Waited::Stopped) {
            return Ok(Waited::Stopped);
        }
        for port in self.ports.take() {
            port.connect(self)?;
        }
        self.entry().set_state(State::Connected);
        if matches!(self.wait_for_phase(Phase::Work)?, Waited::Stopped) {
            return Ok(Waited::Stopped);
        }
        self.started.set(true);
        self.meet_fate_at_start();
        self.skip_to(self.tick.get());
        self.entry().set_state(State::Running);
        if self.entry().incarnation() > 1 {
            self.control_page.fault_table().mark_recovered(self.me, now_ns());
            self.control_page.ring_all();
        }
        Ok(Waited::Ready(()))
    }

    fn wait_for_phase(&self, phase: Phase) -> Result<Waited<()>, Interrupted> {
        let describe = || Wait { what: format!("the beginning of the run's phase \"{phase:?}\""), from: "the launcher".into() };
        self.wait(0, None, describe, || Ok(self.control_page.has_begun(phase).then_some(())))
    }

    /// The one wait: look, then sleep until somebody rings for one of `bits`, look again; never longer than the limit.
    pub(crate) fn wait<T>(
        &self,
        bits: u32,
        deadline_ns: Option<u64>,
        describe: impl Fn() -> Wait,
        mut look: impl FnMut() -> Result<Option<T>, Interrupted>,
    ) -> Result<Waited<T>, Interrupted> {
        if self.is_stopping() {
            return Ok(Waited::Stopped);
        }
        let bell = self.entry().bell();
        let limit_ns = self.manifest.wait_limit.as_nanos() as u64;
        let (mut is_first_look, mut began_ns) = (true, None);
        loop {
            // Armed before the look: whoever brings it after the look rings.
            let seen = bell.rings();
            bell.arm(bits);
            let found = look();
            if self.is_stopping() || !matches!(found, Ok(None)) {
                bell.disarm();
                return Ok(found?.map_or(Waited::Stopped, Waited::Ready));
            }
            let mut sleep_ns = None;
            // Without a deadline the clock is only read when the first sleep was in vain: the usual hop does without it.
            if deadline_ns.is_some() || !is_first_look {
                let now = now_ns();
                let waited_ns = now - *began_ns.get_or_insert(now);
                if deadline_ns.is_some_and(|deadline| now >= deadline) {
                    bell.disarm();
                    return Ok(Waited::Late);
                }
                if waited_ns >= limit_ns {
                    bell.disarm();
                    let Wait { what, from } = describe();
                    let waited = Duration::from_nanos(waited_ns);
                    return Err(Interrupted::TimedOut { process: self.name().to_owned(), what, from, waited });
                }
                sleep_ns = deadline_ns.map(|deadline| deadline - now);
            }
            is_first_look = false;
            bell.sleep(seen, sleep_ns);
        }
    }

    /// Notes that an output of a tick is about to leave; whether it is the last of those that the graph declares.
    pub(crate) fn is_last_output(&self, tick: u64, output: usize) -> bool {
        let (of, sent) = self.outputs_sent.get();
        let sent = if of == tick { sent } else { 0 } | 1 << output;
        self.outputs_sent.set((tick, sent));
        sent.count_ones() as usize >= self.manifest.processes[self.me].writes.len()
    }

    /// Commits the checkpoint that was written for a tick.
    pub(crate) fn commit(&self, tick: u64) {
        self.checkpoints.borrow().iter().for_each(|checkpoint| checkpoint.commit(tick));
    }

    pub(crate) fn port_failed(&self, topic: &'static str, error: impl std::fmt::Display) -> Interrupted {
        Interrupted::Port { process: self.name().to_owned(), topic, reason: error.to_string() }
    }

    /// A message is in the process's hands: remember when, and which way it came.
    pub(crate) fn note_input(&self, header: &Header) {
        let mut input = self.input.get();
        if input.tick != header.tick || input.received_ns == 0 {
            input = Input { tick: header.tick, ..Input::default() };
        }
        input.received_ns = self.clock_ns();
        for hop in 0..HOPS.len() {
            let (mine, theirs) = (&mut input.stamps, &header.stamps);
            mine.received_ns[hop] = mine.received_ns[hop].max(theirs.received_ns[hop]);
            mine.sent_ns[hop] = mine.sent_ns[hop].max(theirs.sent_ns[hop]);
        }
        input.stamps.due_ns = input.stamps.due_ns.max(header.stamps.due_ns);
        self.input.set(input);
        if self.hop == Some(0) {
            // The answer to its own tick.
            self.entry().note_age(input.received_ns.saturating_sub(input.stamps.origin_ns()));
        }
    }

    /// Fills an output's header: the stamps of the inputs of the same tick, and this hop's own. Returns the time of sending.
    pub(crate) fn stamp(&self, header: &mut Header) -> u64 {
        let input = self.input.get();
        header.incarnation = self.entry().incarnation();
        header.stamps = if input.tick == header.tick { input.stamps } else { Stamps::default() };
        let now = self.clock_ns();
        if let Some(hop) = self.hop {
            if hop == 0 {
                header.stamps = Stamps { due_ns: self.due_ns.get(), ..Stamps::default() };
            }
            header.stamps.received_ns[hop] = input.received_ns;
            header.stamps.sent_ns[hop] = now;
            self.note_times(hop, header, now);
        }
        now
    }

    /// Shows on the control page how long the tick in hand took; once a tick, whatever is sent of it.
    fn note_times(&self, hop: usize, header: &Header, now_ns: u64) {
        if self.sent_tick.replace(Some(header.tick)) == Some(header.tick) {
            return;
        }
        let Stamps { received_ns, due_ns, .. } = header.stamps;
        let began_ns = if hop == 0 && due_ns > 0 { due_ns } else { received_ns[hop] };
        if began_ns > 0 {
            self.entry().note_step(now_ns.saturating_sub(began_ns));
        }
        if hop > 0 && header.stamps.origin_ns() > 0 {
            self.entry().note_age(now_ns.saturating_sub(header.stamps.origin_ns()));
        }
    }

    /// In lockstep: waits until no polled process lags so far that it could lose this tick, and all are back whom the fault table has back by then.
    pub(crate) fn wait_for_others(&self, tick: u64) -> Result<Waited<()>, Interrupted> {
        let laggard = || self.protocol().holds_back(tick);
        let describe = || Wait {
            what: format!("its turn to begin tick {tick}"),
            from: laggard().map_or("the others".into(), |index| self.manifest.processes[index].name.clone()),
        };
        self.wait(PROGRESS, None, describe, || {
            self.learn();
            Ok(laggard().is_none().then_some(()))
        })
    }
}

/// What a wait waits for, told only when it fails.
pub(crate) struct Wait {
    pub(crate) what: String,
    pub(crate) from: String,
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
    shared: Rc<Shared>,
    round: Cell<Round>,
    /// A polled process is in its last round before a fault takes it down.
    is_falling: Cell<bool>,
}

/// Where a polled process is between two rounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Round {
    Before,
    /// In a round that began when the run had done so many ticks.
    From(u64),
    /// In the round after which nothing more can come.
    Last,
}

impl Shell {
    /// Joins a run: catches SIGTERM and SIGINT, pins the process, takes its real-time settings, maps the control_page.
    ///
    /// A right that is missing is one warning that names it, and the run goes on.
    ///
    /// # Errors
    /// When the run, its files or the process's entry in its graph cannot be used.
    pub fn open(run: &Path, process: &str) -> Result<Self, OpenError> {
        let run = RunDir::open(run)?;
        let manifest = Manifest::read(&run)?;
        let Some(me) = manifest.index_of(process) else {
            let known = manifest.processes.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ");
            return Err(OpenError::NotInGraph { process: process.into(), run: run.path().display().to_string(), known });
        };
        let signalled = Arc::new(AtomicBool::new(false));
        for signal in [libc::SIGTERM, libc::SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&signalled)).map_err(OpenError::Signals)?;
        }
        let control_page = Arc::new(ControlPage::open(&run)?);
        // Before the process is pinned: the watchdog may run on any core.
        Watchdog::start(&control_page, me).map_err(OpenError::Watchdog)?;
        settle(&manifest, me);
        let disturbance = manifest.processes[me].disturbance;
        begin_disturbed(disturbance);
        let node = topic::join(&run, process, false)?;
        let stops_at = if manifest.processes[me].polled { Stop::Everything } else { Stop::Chain };
        let hop = HOPS.iter().position(|&hop| hop == process);
        let shared = Shared {
            run,
            manifest,
            control_page,
            node,
            me,
            stops_at,
            hop,
            signalled,
            started: Cell::new(false),
            ports: RefCell::default(),
            input: Cell::default(),
            due_ns: Cell::new(0),
            sent_tick: Cell::new(None),
            pauses: RefCell::new(disturbance.pauses.map(Pauses::new)),
            tick: Cell::new(0),
            fates: RefCell::new(Copied::new()),
            hog: RefCell::default(),
            is_volume_full: Cell::new(false),
            outlets: RefCell::default(),
            outputs_sent: Cell::new((0, 0)),
            checkpoints: RefCell::default(),
        };
        shared.learn();
        shared.tick.set(shared.returns_at());
        let shared = Rc::new(shared);
        Ok(Self { shared, round: Cell::new(Round::Before), is_falling: Cell::new(false) })
    }

    /// Reads a topic message by message: the next tick in lockstep, the newest in real time.
    ///
    /// # Errors
    /// When the graph does not say that this process reads it, or the wire formats differ.
    pub fn reader<M: Message>(&self) -> Result<Reader<M>, TopicError> {
        self.declared::<M>("read")?;
        Ok(Reader::new(Rc::clone(&self.shared), self.subscriber(CHAIN_DEPTH)?))
    }

    /// Reads everything of a topic, in order, in rounds of [`Shell::poll`]: for the recorder.
    ///
    /// # Errors
    /// As [`Shell::reader`].
    pub fn collector<M: Message>(&self) -> Result<Collector<M>, TopicError> {
        self.declared::<M>("read")?;
        Ok(Collector::new(Rc::clone(&self.shared), self.subscriber(RECORDER_DEPTH)?))
    }

    /// Writes a topic; wakes the processes that the graph names as its readers.
    ///
    /// # Errors
    /// When the graph does not say that this process writes it, or the wire formats differ.
    pub fn writer<M: Message>(&self) -> Result<Writer<M>, TopicError> {
        self.declared::<M>("write")?;
        let publisher = Rc::new(topic::publisher(&self.shared.node)?);
        self.shared.ports.borrow_mut().push(Rc::clone(&publisher) as Rc<dyn Connect>);
        Writer::new(&self.shared, publisher)
    }

    fn subscriber<M: Message>(&self, depth: usize) -> Result<Rc<Subscribing<M>>, TopicError> {
        let subscriber = Rc::new(topic::subscriber(&self.shared.node, depth)?);
        self.shared.ports.borrow_mut().push(Rc::clone(&subscriber) as Rc<dyn Connect>);
        Ok(subscriber)
    }

    /// The checkpoint of this process: what the incarnation before committed, and the slot to fill at every tick before its last message.
    ///
    /// # Errors
    /// When there is no room for it, or the predecessor's has another layout.
    pub fn checkpoint<C: Checkpoint>(&self) -> Result<CheckpointSlots<C>, OpenError> {
        let shared = &self.shared;
        let path = shared.run.path().join(format!("checkpoint-{}", shared.name()));
        let failed = |source| OpenError::Checkpoint { process: shared.name().to_owned(), source };
        shared.learn();
        let slots = CheckpointSlots::open(&path, shared.protocol().resumes_before()).map_err(failed)?;
        shared.checkpoints.borrow_mut().push(slots.committer());
        Ok(slots)
    }

    /// Gives out ticks from `first` on: on the grid in real time, as fast as the recorder follows in lockstep.
    #[must_use]
    pub fn tick_source(&self, first: u64) -> TickSource {
        TickSource::new(Rc::clone(&self.shared), first)
    }

    /// A polled process's rhythm: ends a round, sleeps, begins the next; `false` after the round in which nothing more can come.
    ///
    /// What the process drained in the round counts as taken in: in lockstep the source of ticks may go on.
    ///
    /// # Errors
    /// When the run does not start within the limit.
    pub fn poll(&self, every: Duration) -> Result<bool, Interrupted> {
        let shared = &self.shared;
        match self.round.get() {
            Round::Last => return Ok(false),
            Round::From(ticks) => {
                if ticks > shared.entry().ticks() {
                    shared.entry().set_ticks(ticks);
                    self.each_other(|line| line.bell().ring(PROGRESS));
                }
                shared.tick.set(shared.entry().ticks());
                if self.is_falling.replace(false) {
                    shared.meet_fate(shared.tick.get());
                }
                // Not before one more round: everything before the tick of its fall is taken in and safe by then.
                shared.learn();
                self.is_falling.set(shared.protocol().downfall(ticks).is_some() && shared.protocol().is_settled(ticks));
            }
            Round::Before => {
                if matches!(shared.start()?, Waited::Stopped) {
                    self.round.set(Round::Last);
                    return Ok(true);
                }
            }
        }
        let is_awaited = Cell::new(false);
        self.each_other(|line| is_awaited.set(is_awaited.get() || line.bell().is_armed_for(PROGRESS)));
        if !is_awaited.get() && !shared.is_stopping() && !self.is_falling.get() {
            let bell = shared.entry().bell();
            let seen = bell.rings();
            bell.arm(ANYTHING);
            if !shared.is_stopping() {
                bell.sleep(seen, Some(every.as_nanos() as u64));
            }
            bell.disarm();
        }
        // Read before the round: everything of these ticks is in the buffers now.
        let last = shared.is_stopping();
        shared.trouble_volume(shared.entry().ticks(), last);
        shared.starve(shared.entry().ticks());
        let ticks = Cell::new(0);
        self.each_other(|line| ticks.set(ticks.get().max(line.ticks())));
        self.round.set(if last { Round::Last } else { Round::From(ticks.get()) });
        Ok(true)
    }

    fn each_other(&self, act: impl Fn(&ProcessEntry)) {
        let me = self.shared.me;
        (0..self.shared.manifest.processes.len()).filter(|&index| index != me).for_each(|i| act(self.shared.control_page.process(i)));
    }

    /// How time passes in this run.
    #[must_use]
    pub fn mode(&self) -> Mode {
        self.shared.manifest.mode
    }

    /// Whether the graph lets this process read a topic.
    #[must_use]
    pub fn reads(&self, topic: &str) -> bool {
        self.shared.manifest.processes[self.shared.me].reads.iter().any(|one| one == topic)
    }

    /// The run as all its processes know it.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.shared.manifest
    }

    /// How often this process has been started in this run, from 1.
    #[must_use]
    pub fn incarnation(&self) -> u32 {
        self.shared.entry().incarnation()
    }

    /// The faults that concern this process at a tick, and their places in the fault table: for the plant, whose faults are physical, and the
    /// recorder, whose faults are those of its volume.
    pub fn faults_at(&self, tick: u64, mut each: impl FnMut(usize, &ScheduledFault, Kind)) {
        let shared = &self.shared;
        shared.learn();
        if !shared.is_unharmed() {
            shared.fates.borrow().of(shared.me, tick).for_each(|(place, strike, kind)| each(place, strike, kind));
        }
    }

    /// For a polled process: ticks that had begun before the round in hand.
    #[must_use]
    pub fn ticks_begun(&self) -> u64 {
        if let Round::From(ticks) = self.round.get() { ticks } else { 0 }
    }

    /// Whether this polled process dies, or stands still, when it has said how far it is: what it has taken in must be safe before.
    #[must_use]
    pub fn is_about_to_go_down(&self) -> bool {
        self.is_falling.get()
    }

    /// Does something that writes to another volume than the one that a fault may have filled.
    pub fn elsewhere<T>(&self, work: impl FnOnce() -> T) -> T {
        let is_full = self.shared.is_volume_full.get();
        self.shared.fill_volume(false);
        let done = work();
        self.shared.fill_volume(is_full);
        done
    }

    /// Messages that all processes of the run have sent.
    #[must_use]
    pub fn sent_by_all(&self) -> u64 {
        (0..self.shared.manifest.processes.len()).map(|index| self.shared.control_page.process(index).count(Count::Sent)).sum()
    }

    /// A fault of [`Shell::faults_at`] takes effect now.
    pub fn mark_injected(&self, place: usize) {
        self.shared.control_page.fault_table().mark_injected(place, now_ns());
    }

    /// This process has noticed what has struck it.
    pub fn mark_detected(&self) {
        self.shared.control_page.fault_table().mark_detected(self.shared.me, self.shared.tick.get(), now_ns());
    }

    /// Something is wrong with what a message says: whatever is at work has been noticed by that.
    pub fn mark_message_fault_detected(&self) {
        self.shared.message_fault_detected();
    }

    /// All faults of the run so far.
    #[must_use]
    pub fn fault_table(&self) -> &FaultTable {
        self.shared.control_page.fault_table()
    }

    /// Whether the run is to stop.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.shared.is_stopping()
    }

    /// One of this process's counts so far.
    #[must_use]
    pub fn count(&self, count: Count) -> u64 {
        self.shared.entry().count(count)
    }

    pub(crate) fn shared(&self) -> Rc<Shared> {
        Rc::clone(&self.shared)
    }

    fn declared<M: Message>(&self, action: &'static str) -> Result<(), TopicError> {
        let process = &self.shared.manifest.processes[self.shared.me];
        let topics = if action == "read" { &process.reads } else { &process.writes };
        match topics.iter().any(|topic| topic == M::TOPIC) {
            true => Ok(()),
            false => Err(TopicError::Undeclared { process: process.name.clone(), action, topic: M::TOPIC }),
        }
    }
}

/// Takes the nice value and sleeps as the disturbance says.
fn begin_disturbed(Disturbance { start_delay, nice, .. }: Disturbance) {
    if nice != 0
        && let Err(errno) = rustix::process::setpriority_process(None, nice)
    {
        tracing::warn!("cannot take the nice value {nice}: {errno}");
    }
    if !start_delay.is_zero() {
        std::thread::sleep(start_delay);
    }
}

/// Pins the process where the graph wants it and, in real time, takes its scheduling class and locks its memory.
fn settle(manifest: &Manifest, me: usize) {
    let process = &manifest.processes[me];
    let mut missing = Vec::new();
    missing.extend(process.core.and_then(|core| realtime::pin(core).err()));
    if manifest.mode == Mode::Realtime {
        missing.extend(realtime::enter(process.priority));
    }
    if !missing.is_empty() {
        let missing = missing.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
        tracing::warn!("{} runs without: {missing}", process.name);
    }
}
