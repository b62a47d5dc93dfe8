//! One process's view of its run: its place in the graph, the current tick, its faults, and its
//! single way to wait.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use lockstep::{Protocol, Report};
use shared_types::fault::{Kind, ScheduledFault, Way};
use shared_types::wire::Header;

use crate::bus::node::Bus;
use crate::checkpoint::Commit;
use crate::clock::now_ns;
use crate::control_page::{ControlPage, PROGRESS, ProcessEntry, State, Stop};
use crate::disturbance::Pauses;
use crate::fault::process::{CpuLoad, bus_error, kill_self, stop_self};
use crate::fault::table::KnownFaults;
use crate::fault::{burden, clock};
use crate::manifest::Manifest;
use crate::run_dir::RunDir;
use crate::stamping::Stamping;
use crate::turns::Turns;
use crate::wait::{Interrupted, Wait, Waited};

mod beginning;
mod cut;
mod outputs;
mod view;
mod volume;

/// Why this process is to stop.
pub(crate) struct StopFlag {
    /// The stage of the run's end that concerns it.
    pub(crate) at: Stop,
    /// SIGTERM or SIGINT has arrived.
    pub(crate) signalled: Arc<AtomicBool>,
}

impl StopFlag {
    /// Catches SIGTERM and SIGINT.
    pub(crate) fn new(is_polled: bool) -> std::io::Result<Self> {
        let signalled = Arc::new(AtomicBool::new(false));
        for signal in [libc::SIGTERM, libc::SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&signalled))?;
        }
        let at = match is_polled {
            true => Stop::Everything,
            false => Stop::Chain,
        };
        Ok(Self { at, signalled })
    }
}

/// The faults of the run as read by this process, and their present effect on it.
#[derive(Default)]
pub(crate) struct FaultState {
    pub(crate) known: RefCell<KnownFaults>,
    cpu_load: RefCell<Option<CpuLoad>>,
    is_volume_full: Cell<bool>,
}

/// The next action after a poll that found no message.
enum Patience {
    /// A sleep of at most so many ns; `None` until a ring.
    Sleep(Option<u64>),
    /// The deadline has passed.
    Late,
    /// The limit of every wait has passed.
    Exhausted(Duration),
}

/// Interval between checks whether the launcher has handed over missed messages.
const HAND_OVER_LOOK: Duration = Duration::from_micros(200);

/// Everything that takes part in the beginning or the end of a tick.
#[derive(Default)]
pub(crate) struct Attached {
    /// The ports to connect at the start.
    pub(crate) ports: RefCell<Vec<Rc<dyn Connect>>>,
    pub(crate) outlets: RefCell<Vec<Rc<dyn Closing>>>,
    /// The checkpoint to commit when a tick closes.
    pub(crate) checkpoints: RefCell<Vec<Rc<dyn Commit>>>,
    /// The outputs sent of a tick, a bit each.
    outputs_sent: Cell<(u64, u32)>,
}

/// One process's view of the run; shared by its ports.
pub(crate) struct Context {
    pub(crate) run: RunDir,
    pub(crate) manifest: Manifest,
    pub(crate) control_page: Arc<ControlPage>,
    pub(crate) bus: Bus,
    /// Its index in the manifest.
    pub(crate) me: usize,
    pub(crate) stop: StopFlag,
    pub(crate) has_started: Cell<bool>,
    /// The tick in hand: everything before it is closed.
    pub(crate) tick: Cell<u64>,
    pub(crate) stamping: Stamping,
    pub(crate) turns: Turns,
    /// Ticks that the source may be ahead of a polled process.
    pub(crate) recorder_lag: u64,
    /// Deliberate pauses, in a run of `verify`.
    pub(crate) pauses: RefCell<Option<Pauses>>,
    pub(crate) faults: FaultState,
    pub(crate) attached: Attached,
}

impl Context {
    pub(crate) fn name(&self) -> &str {
        &self.manifest.processes[self.me].name
    }

    #[inline]
    pub(crate) fn entry(&self) -> &ProcessEntry {
        self.control_page.process(self.me)
    }

    #[inline]
    pub(crate) fn is_lockstep(&self) -> bool {
        self.manifest.is_lockstep()
    }

    /// Whether this process deliberately takes in messages of dead incarnations.
    #[inline]
    pub(crate) fn is_unfenced(&self) -> bool {
        self.manifest.processes[self.me].disturbance.unfenced
    }

    /// Whether this process is deliberately content with a message of the tick before.
    #[inline]
    pub(crate) fn is_unordered(&self) -> bool {
        self.manifest.processes[self.me].disturbance.unordered
    }

    /// Sleeps where the run's disturbance requires it.
    #[inline]
    pub(crate) fn pause(&self) {
        if let Some(pause) = self.pauses.borrow_mut().as_mut().and_then(Pauses::next) {
            std::thread::sleep(pause);
        }
    }

    #[inline]
    pub(crate) fn is_stopping(&self) -> bool {
        self.control_page.stop() >= self.stop.at || self.stop.signalled.load(Ordering::Relaxed)
    }

    /// The topic's place on the control page.
    pub(crate) fn topic_index(&self, topic: &str) -> usize {
        self.manifest.topic_index(topic)
    }

    /// The topic's bit on every doorbell.
    pub(crate) fn topic_bit(&self, topic: &str) -> u32 {
        1 << self.topic_index(topic)
    }

    /// The one wait: look, let those of the same core go first, look, then sleep until a process rings for one of `bits`, look again; never longer than
    /// the limit.
    #[inline]
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
        let doorbell = self.entry().doorbell();
        let (mut is_first_look, mut has_passed, mut began_ns) = (true, false, None);
        loop {
            // Read before the look: a message that comes after the look has its ring counted by then, and the sleep does not begin.
            let seen = doorbell.rings();
            let found = look();
            if self.is_stopping() || !matches!(found, Ok(None)) {
                doorbell.disarm();
                return Ok(found?.map_or(Waited::Stopped, Waited::Ready));
            }
            // Without a deadline the clock is only read after a first sleep without a message: the usual hop does without it.
            let patience = if deadline_ns.is_some() || !is_first_look {
                self.patience(deadline_ns, &mut began_ns)
            } else {
                Patience::Sleep(None)
            };
            let sleep_ns = match patience {
                Patience::Sleep(sleep_ns) => sleep_ns,
                Patience::Late => {
                    doorbell.disarm();
                    return Ok(Waited::Late);
                }
                Patience::Exhausted(waited) => {
                    doorbell.disarm();
                    let Wait { what, from } = describe();
                    return Err(Interrupted::TimedOut {
                        process: self.name().to_owned(),
                        what,
                        from,
                        waited,
                    });
                }
            };
            if std::mem::take(&mut is_first_look) && self.has_started.get() && self.turns.pass() {
                // Another look, now that the process waited for has had its turn.
                has_passed = true;
                continue;
            }
            if std::mem::take(&mut has_passed) {
                self.turns.note_vain();
            }
            doorbell.arm(bits);
            doorbell.sleep(seen, sleep_ns);
        }
    }

    /// Whether a wait that has found nothing continues, and for how long.
    fn patience(&self, deadline_ns: Option<u64>, began_ns: &mut Option<u64>) -> Patience {
        let now = now_ns();
        let waited = Duration::from_nanos(now - *began_ns.get_or_insert(now));
        match deadline_ns {
            Some(deadline) if now >= deadline => Patience::Late,
            _ if self
                .manifest
                .wait_limit
                .is_some_and(|limit| waited >= limit) =>
            {
                Patience::Exhausted(waited)
            }
            _ => Patience::Sleep(deadline_ns.map(|deadline| deadline - now)),
        }
    }

    /// Commits the checkpoint that was written for a tick.
    #[inline]
    pub(crate) fn commit(&self, tick: u64) {
        self.attached
            .checkpoints
            .borrow()
            .iter()
            .for_each(|checkpoint| checkpoint.commit(tick));
    }

    pub(crate) fn port_failed(
        &self,
        topic: &'static str,
        error: impl std::fmt::Display,
    ) -> Interrupted {
        Interrupted::Port {
            process: self.name().to_owned(),
            topic,
            reason: error.to_string(),
        }
    }

    /// A message is in the process's hands: notes when, and which way it came.
    #[inline]
    pub(crate) fn note_input(&self, header: &Header) {
        self.stamping
            .note_input(header, self.clock_ns(), self.entry());
    }

    /// Fills an output's header with this hop's stamps and those before it.
    #[inline]
    pub(crate) fn stamp(&self, header: &mut Header) {
        self.stamping.stamp(header, self.clock_ns(), self.entry());
    }

    /// Waits until the launcher has handed over all that the retainers of the topics held at the call: for a process that misses messages of `topic`.
    ///
    /// A stop of the run does not end it: the process takes in missing messages before it ends.
    pub(crate) fn await_hand_over(&self, topic: &'static str) -> Result<(), Interrupted> {
        let (request, began_ns) = (self.control_page.request_hand_over(), now_ns());
        while !self.control_page.is_handed_over(request) {
            let waited = Duration::from_nanos(now_ns() - began_ns);
            if self.manifest.wait_limit.is_some_and(|limit| waited > limit) {
                let what = format!("the messages of topic {topic:?} that it has missed");
                return Err(Interrupted::TimedOut {
                    process: self.name().to_owned(),
                    what,
                    from: "the launcher".into(),
                    waited,
                });
            }
            std::thread::sleep(HAND_OVER_LOOK);
        }
        Ok(())
    }

    /// In lockstep: waits until no polled process lags so far that it could lose this tick, and all are back whom the fault table has back by then.
    pub(crate) fn wait_for_others(&self, tick: u64) -> Result<Waited<()>, Interrupted> {
        let laggard = || self.protocol().holds_back(tick);
        let describe = || Wait {
            what: format!("its turn to begin tick {tick}"),
            from: laggard().map_or("the others".into(), |index| {
                self.manifest.processes[index].name.clone()
            }),
        };
        self.wait(PROGRESS, None, describe, || {
            self.learn();
            Ok(laggard().is_none().then_some(()))
        })
    }

    /// Brings the copy of the fault table up to date; one load where nothing has changed.
    #[inline]
    pub(crate) fn learn(&self) {
        if !self
            .faults
            .known
            .borrow()
            .is_current(self.control_page.fault_table())
        {
            self.learn_anew();
        }
    }

    #[cold]
    fn learn_anew(&self) {
        self.faults
            .known
            .borrow_mut()
            .renew(self.control_page.fault_table());
    }

    /// Whether the fault table, as this process knows it, is empty.
    #[inline]
    pub(crate) fn is_unharmed(&self) -> bool {
        self.faults.known.borrow().faults().is_empty()
    }

    /// A message is wrong: faults in force are thereby detected.
    pub(crate) fn message_fault_detected(&self) {
        if !self.is_unharmed() {
            self.control_page
                .fault_table()
                .mark_all_detected(self.tick.get(), now_ns());
        }
    }

    /// Whether any fault shapes messages: then a tick of this process ends when its inputs have, not with its one message.
    #[inline]
    pub(crate) fn is_shaped(&self) -> bool {
        !self.is_unharmed() && self.faults.known.borrow().shapes_messages()
    }

    /// The decisions of the lockstep protocol for this process.
    #[inline]
    pub(crate) fn protocol(&self) -> Protocol<'_, Self> {
        Protocol::new(self, self.me)
    }

    /// When this process, started again, may answer: the first tick after its last death. 0: no death is known.
    pub(crate) fn returns_at(&self) -> u64 {
        self.learn();
        self.protocol().returns_at()
    }

    /// Applies the faults of this process at a tick, with the tick's first input in hand. Returns
    /// the tick at which it continues: `tick`, or a later one if it was stopped.
    #[inline]
    pub(crate) fn apply_process_faults(&self, tick: u64) -> u64 {
        self.learn();
        if self.is_unharmed() {
            tick
        } else {
            self.apply_known_faults(tick)
        }
    }

    /// Applies the faults of this process at a tick that cost it time.
    pub(crate) fn burden(&self, tick: u64) {
        let (known, mut load) = (
            self.faults.known.borrow(),
            self.faults.cpu_load.borrow_mut(),
        );
        let injected = |place| {
            self.control_page
                .fault_table()
                .mark_injected(place, now_ns())
        };
        burden::burden(
            known.of(self.me, tick),
            &mut load,
            self.manifest.processes[self.me].core,
            injected,
        );
    }

    #[cold]
    fn apply_known_faults(&self, tick: u64) -> u64 {
        self.burden(tick);
        let Some(outage) = self.protocol().downfall(tick) else {
            return tick;
        };
        self.control_page
            .fault_table()
            .mark_injected(outage.place, now_ns());
        let Some((fault, kind)) = self.fault(outage.place) else {
            return tick;
        };
        match kind {
            Kind::Kill => {
                self.leave(State::Gone);
                kill_self();
            }
            Kind::Crash => {
                self.leave(State::Gone);
                if fault.way() == Some(Way::BusError) {
                    bus_error();
                }
                panic!(
                    "{} crashes at tick {tick}, as the fault plan says",
                    self.name()
                );
            }
            _ => self.stand_still(&fault),
        }
        fault.until
    }

    /// Ends this process where the fault table has it end between the outputs of a tick.
    #[inline]
    pub(crate) fn apply_faults_between_outputs(&self, tick: u64) {
        if !self.is_unharmed() {
            self.fall_between_outputs(tick);
        }
    }

    #[cold]
    fn fall_between_outputs(&self, tick: u64) {
        let (of, sent) = self.attached.outputs_sent.get();
        if let Some(outage) = self
            .protocol()
            .downfall_after(tick, sent.count_ones())
            .filter(|_| of == tick)
        {
            self.control_page
                .fault_table()
                .mark_injected(outage.place, now_ns());
            self.leave(State::Gone);
            kill_self();
        }
    }

    /// Attached where a replacement has died before it could answer, so that a run repeats the deaths of its plan.
    fn apply_faults_at_start(&self) {
        self.learn();
        if let Some(outage) = self.protocol().downfall_at_start() {
            self.control_page
                .fault_table()
                .mark_injected(outage.place, now_ns());
            self.leave(State::Gone);
            kill_self();
        }
    }

    /// The fault at a place of the table, as this process knows it.
    fn fault(&self, place: usize) -> Option<(ScheduledFault, Kind)> {
        let known = self.faults.known.borrow();
        let (_, fault) = known.faults().iter().find(|(one, _)| *one == place)?;
        Some((*fault, fault.kind()?))
    }

    /// The others are informed before, so that none waits for a message that cannot come.
    fn leave(&self, state: State) {
        self.entry().set_state(state);
        self.control_page.ring_all();
    }

    fn stand_still(&self, fault: &ScheduledFault) {
        self.leave(State::Stopped);
        stop_self();
        // A process that is not continued (`Way::ForEver`) is replaced and never comes here; a stray SIGCONT changes nothing about it.
        while fault.way() == Some(Way::ForEver) && !self.is_stopping() {
            stop_self();
        }
        self.skip_to(fault.until);
        self.entry().set_state(State::Running);
        self.control_page
            .fault_table()
            .mark_recovered(self.me, now_ns());
        self.control_page.ring_all();
    }

    /// In lockstep: nothing before `tick` will come of this process any more.
    pub(crate) fn skip_to(&self, tick: u64) {
        if let Some(ticks) = self.protocol().skips_to(tick) {
            self.entry().set_ticks(ticks);
        }
    }

    /// This process's clock: the machine's, unless a fault has it jump or run fast.
    #[inline]
    pub(crate) fn clock_ns(&self) -> u64 {
        let now = now_ns();
        now.saturating_add_signed(self.clock_error_ns(now))
    }

    /// Lead of this process's clock over the machine's at an instant of the latter; negative if it
    /// lags.
    #[inline]
    pub(crate) fn clock_error_ns(&self, now: u64) -> i64 {
        if self.is_unharmed() {
            0
        } else {
            self.injected_clock_error_ns(now)
        }
    }

    #[cold]
    fn injected_clock_error_ns(&self, now: u64) -> i64 {
        clock::error_ns(
            self.faults.known.borrow().of(self.me, self.tick.get()),
            self.control_page.fault_table(),
            now,
        )
    }

    /// In lockstep: nothing more of `tick` will come out of this process.
    pub(crate) fn close(&self, tick: u64) {
        for outlet in self.attached.outlets.borrow().iter() {
            outlet.flush(tick);
        }
        self.entry().set_ticks(tick + 1);
        for outlet in self.attached.outlets.borrow().iter() {
            outlet.ring();
        }
        self.report_progress();
    }

    pub(crate) fn add_outlet(&self, outlet: Rc<dyn Closing>) {
        self.attached.outlets.borrow_mut().push(outlet);
    }

    /// Wakes processes that wait for the progress of others rather than for a message, because this
    /// process has closed a tick.
    #[inline]
    pub(crate) fn report_progress(&self) {
        // In real time without faults every process waits for messages alone.
        if self.is_unharmed() && !self.is_lockstep() {
            return;
        }
        match self.protocol().reports_to() {
            Report::Everybody => self.control_page.ring_all(),
            Report::Source(source) => self.control_page.process(source).doorbell().ring(PROGRESS),
            Report::Unneeded => {}
        }
    }
}

/// A port that can connect to its counterparts at a time of the shell's choosing, not in the first tick.
pub(crate) trait Connect {
    fn connect(&self, context: &Context) -> Result<(), Interrupted>;
}

/// An end of the process that a closing tick concerns: messages held back for it are sent, and its readers are woken.
pub(crate) trait Closing {
    /// Its topic.
    fn topic(&self) -> &'static str;
    /// Sends the messages due at `tick` or before.
    fn flush(&self, tick: u64);
    /// Wakes the readers.
    fn ring(&self);
}
