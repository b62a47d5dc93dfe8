//! One process's view of its run: its place in the graph, the current tick, its faults, and its
//! single way to wait.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use shared_types::wire::Header;

use crate::bus::node::Bus;
use crate::bus::writer::Sending;
use crate::checkpoint::StateCell;
use crate::clock::now_ns;
use crate::control_page::{ControlPage, ProcessEntry};
use crate::disturbance::Pauses;
use crate::fault::table::KnownFaults;
use crate::look_out::LookOut;
use crate::manifest::{Manifest, Process};
use crate::run_dir::RunDir;
use crate::stamping::Stamping;
use crate::turns::Turns;
use crate::wait::{Interrupted, Wait, Waited};

mod absence;
mod beginning;
mod cut;
mod order;
mod outputs;
mod volume;

pub(crate) use order::{CHAIN_LAG, RECORDER_LAG};

/// The faults of the run as read by this process, and their present effect on it.
#[derive(Default)]
pub(crate) struct FaultState {
    pub(crate) known: RefCell<KnownFaults>,
    is_volume_full: Cell<bool>,
}

/// Everything that takes part in the beginning or the end of a tick.
#[derive(Default)]
pub(crate) struct Attached {
    /// The ports to connect at the start.
    pub(crate) ports: RefCell<Vec<Rc<dyn Connect>>>,
    pub(crate) outlets: RefCell<Vec<Rc<Sending>>>,
    /// The checkpoint to commit when a tick closes.
    pub(crate) checkpoint: RefCell<Option<Rc<StateCell>>>,
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
    /// The number of the SIGTERM or SIGINT that has arrived; 0: none has.
    pub(crate) signalled: Arc<AtomicUsize>,
    pub(crate) has_started: Cell<bool>,
    /// The tick in hand: everything before it is closed.
    pub(crate) tick: Cell<u64>,
    /// In the header of its messages. In lockstep one more than its planned deaths so far, and in real time than all.
    pub(crate) incarnation: Cell<u32>,
    pub(crate) stamping: Stamping,
    pub(crate) turns: Turns,
    /// Ticks that the source may be ahead of a polled process.
    pub(crate) recorder_lag: u64,
    /// Deliberate pauses, in a run of `verify`.
    pub(crate) pauses: RefCell<Option<Pauses>>,
    pub(crate) faults: FaultState,
    pub(crate) attached: Attached,
    /// Of a program in another language: what it does between the sleeps of a wait.
    pub(crate) look_out: LookOut,
}

impl Context {
    /// This process, as the others see it.
    #[inline]
    pub(crate) fn own(&self) -> &Process {
        &self.manifest.processes[self.me]
    }

    pub(crate) fn name(&self) -> &str {
        &self.own().name
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
        self.own().disturbance.unfenced
    }

    /// Whether this process is deliberately content with a message of the tick before.
    #[inline]
    pub(crate) fn is_unordered(&self) -> bool {
        self.own().disturbance.unordered
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
        self.is_run_stopping() || self.signalled.load(Ordering::Relaxed) != 0
    }

    /// Whether the end of the run has come to this process.
    #[inline]
    pub(crate) fn is_run_stopping(&self) -> bool {
        self.control_page.stop() >= self.own().stops_at()
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
        let ended = loop {
            // Read before the look: a message that comes after the look has its ring counted by then, and the sleep does not begin.
            let seen = doorbell.rings();
            let found = look();
            if self.is_stopping() || !matches!(found, Ok(None)) {
                break found.map(|found| found.map_or(Waited::Stopped, Waited::Ready));
            }
            if !is_first_look && let Err(error) = self.meet_readers() {
                break Err(error);
            }
            let mut sleep_ns = None;
            // Without a deadline the clock is only read after a first sleep without a message: the usual hop does without it.
            if deadline_ns.is_some() || !is_first_look {
                let now = now_ns();
                let waited = Duration::from_nanos(now - *began_ns.get_or_insert(now));
                if deadline_ns.is_some_and(|deadline| now >= deadline) {
                    break Ok(Waited::Late);
                }
                if self
                    .manifest
                    .wait_limit
                    .is_some_and(|limit| waited >= limit)
                {
                    let Wait { what, from } = describe();
                    break Err(Interrupted::TimedOut {
                        process: self.name().to_owned(),
                        what,
                        from,
                        waited,
                    });
                }
                sleep_ns = deadline_ns.map(|deadline| deadline - now);
            }
            if std::mem::take(&mut is_first_look) && self.has_started.get() && self.turns.pass() {
                // Another look, now that the process waited for has had its turn.
                has_passed = true;
                continue;
            }
            if std::mem::take(&mut has_passed) {
                self.turns.note_vain();
            }
            doorbell.arm(bits);
            doorbell.sleep(seen, self.look_out.limited(sleep_ns));
            if let Some(why) = self.look_out.look() {
                break Err(self.asked(why));
            }
        };
        doorbell.disarm();
        ended
    }

    /// In real time: gives a reader that was started again what it has missed. Otherwise only the next message does, and after the last tick none comes.
    fn meet_readers(&self) -> Result<(), Interrupted> {
        if self.is_lockstep() {
            return Ok(());
        }
        let outlets = self.attached.outlets.borrow();
        outlets.iter().try_for_each(|outlet| outlet.connect(self))
    }

    /// The wait has ended, because the process has looked out.
    pub(crate) fn asked(&self, why: &'static str) -> Interrupted {
        Interrupted::Asked {
            process: self.name().to_owned(),
            why,
        }
    }

    /// Commits the checkpoint that was written for the tick in hand.
    #[inline]
    pub(crate) fn commit(&self) {
        let checkpoint = self.attached.checkpoint.borrow();
        checkpoint.iter().for_each(|cell| cell.commit());
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
        self.stamping.note_input(header, now_ns(), self.entry());
    }

    /// Fills an output's header with this hop's stamps and those before it.
    #[inline]
    pub(crate) fn stamp(&self, header: &mut Header) {
        header.incarnation = self.incarnation.get();
        self.stamping.stamp(header, now_ns(), self.entry());
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

    /// The fault at a place of the table takes effect now.
    pub(crate) fn mark_injected(&self, place: usize) {
        let table = self.control_page.fault_table();
        table.mark_injected(place, now_ns());
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

    /// In lockstep: nothing more of `tick` will come out of this process.
    pub(crate) fn close(&self, tick: u64) {
        for outlet in self.attached.outlets.borrow().iter() {
            outlet.flush(tick);
        }
        self.pass(tick);
    }

    /// As [`close`](Self::close), of a tick in which this process is absent: what it holds back stays there.
    pub(crate) fn pass(&self, tick: u64) {
        self.entry().set_ticks(tick + 1);
        for outlet in self.attached.outlets.borrow().iter() {
            outlet.ring();
        }
        self.report_progress();
    }
}

/// A port that can connect to its counterparts at a time of the shell's choosing, not in the first tick.
pub(crate) trait Connect {
    fn connect(&self, context: &Context) -> Result<(), Interrupted>;
}
