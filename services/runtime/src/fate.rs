//! What faults do to a process: its death, its standing still, its clock, its core. Messages are shaped in [`crate::ports`].

use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::process::{Resource, Rlimit, Signal, getpid, getrlimit, kill_process, setrlimit};
use shared_types::fault::{Kind, ScheduledFault, Way};

use crate::clock::now_ns;
use crate::control_page::{PROGRESS, State};
use crate::fault::table::Origin;
use crate::lockstep::{Outage, Progress, Protocol, Report, Role, View};
use crate::manifest::Process;
use crate::realtime;
use crate::shell::Shared;

/// An end of the process that a closing tick concerns: what is held back for it leaves, and its readers are told.
pub(crate) trait Outlet {
    /// Sends what is due at `tick` or before.
    fn flush(&self, tick: u64);
    /// Wakes the readers.
    fn ring(&self);
}

/// A stretch in which somebody else is busy on the core.
pub(crate) struct Hog {
    place: usize,
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Hog {
    /// Busy for so long at a time ...
    const BUSY_NS: u64 = 300_000;
    /// ... with so short a rest that the process it starves is not starved for ever under SCHED_FIFO.
    const REST: std::time::Duration = std::time::Duration::from_micros(30);

    fn start(place: usize, core: Option<usize>) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&stop);
        let work = move || {
            if let Some(core) = core {
                // Not pinned it is a hog all the same.
                let _ = realtime::pin(core);
            }
            while !told.load(Ordering::Relaxed) {
                let until = now_ns() + Self::BUSY_NS;
                while now_ns() < until {
                    std::hint::spin_loop();
                }
                std::thread::sleep(Self::REST);
            }
        };
        Self { place, stop, thread: std::thread::Builder::new().name("hog".into()).spawn(work).ok() }
    }
}

impl Drop for Hog {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Shared {
    /// Brings the copy of the fault table up to date; one load where nothing has changed.
    pub(crate) fn learn(&self) {
        let table = self.control_page.fault_table();
        if !self.fates.borrow().is_current(table) {
            self.fates.borrow_mut().renew(table);
        }
    }

    /// Whether the fault table, as this process knows it, is empty.
    pub(crate) fn is_unharmed(&self) -> bool {
        self.fates.borrow().strikes().is_empty()
    }

    /// Something is wrong with a message: if there are faults, they have been noticed.
    pub(crate) fn message_fault_detected(&self) {
        if !self.is_unharmed() {
            self.control_page.fault_table().mark_all_detected(self.tick.get(), now_ns());
        }
    }

    /// Whether any fault shapes messages: then a tick of this process ends when its inputs have, not with its one message.
    pub(crate) fn is_shaped(&self) -> bool {
        !self.is_unharmed() && self.fates.borrow().shapes_messages()
    }

    /// The decisions of the lockstep protocol for this process.
    pub(crate) fn protocol(&self) -> Protocol<'_, Self> {
        Protocol::new(self, self.me)
    }

    /// When this process, started again, may answer: the first tick after its last death. 0: no death is known.
    pub(crate) fn returns_at(&self) -> u64 {
        self.learn();
        self.protocol().returns_at()
    }

    /// Carries out what concerns the process itself at a tick, with the tick's first input in hand. Returns the tick at which it goes on:
    /// `tick`, or a later one if it stood still.
    pub(crate) fn meet_fate(&self, tick: u64) -> u64 {
        self.learn();
        if self.is_unharmed() {
            return tick;
        }
        self.starve(tick);
        let Some(outage) = self.protocol().downfall(tick) else { return tick };
        self.control_page.fault_table().mark_injected(outage.place, now_ns());
        let Some((strike, kind)) = self.fault(outage.place) else { return tick };
        match kind {
            Kind::Kill => self.die(),
            Kind::Crash => {
                self.leave(State::Gone);
                panic!("{} crashes at tick {tick}, as the fault plan says", self.name());
            }
            _ => self.stand_still(&strike),
        }
        strike.until
    }

    /// Dies where a replacement has died before it could answer, so that a run repeats the deaths of its plan.
    pub(crate) fn meet_fate_at_start(&self) {
        self.learn();
        if let Some(outage) = self.protocol().downfall_at_start() {
            self.control_page.fault_table().mark_injected(outage.place, now_ns());
            self.die();
        }
    }

    /// The fault at a place of the table, as this process knows it.
    fn fault(&self, place: usize) -> Option<(ScheduledFault, Kind)> {
        let fates = self.fates.borrow();
        let (_, fault) = fates.strikes().iter().find(|(one, _)| *one == place)?;
        Some((*fault, fault.kind()?))
    }

    /// The others are told before, so that nobody waits for what cannot come.
    fn leave(&self, state: State) {
        self.entry().set_state(state);
        self.control_page.ring_all();
    }

    fn die(&self) {
        self.leave(State::Gone);
        // It does not return; if it could fail, the next wait would find the process down at every tick of the fault.
        let _ = kill_process(getpid(), Signal::KILL);
    }

    fn stand_still(&self, strike: &ScheduledFault) {
        self.leave(State::Stopped);
        let _ = kill_process(getpid(), Signal::STOP);
        // Whoever is not continued (`Way::ForEver`) is replaced, and never comes here; a stray SIGCONT changes nothing about it.
        while strike.way() == Some(Way::ForEver) && !self.is_stopping() {
            let _ = kill_process(getpid(), Signal::STOP);
        }
        self.skip_to(strike.until);
        self.entry().set_state(State::Running);
        self.control_page.fault_table().mark_recovered(self.me, now_ns());
        self.control_page.ring_all();
    }

    /// In lockstep: nothing before `tick` will come of this process any more.
    pub(crate) fn skip_to(&self, tick: u64) {
        if let Some(ticks) = self.protocol().skips_to(tick) {
            self.entry().set_ticks(ticks);
        }
    }

    /// Has somebody be busy on the process's core as long as a fault says so.
    pub(crate) fn starve(&self, tick: u64) {
        let fates = self.fates.borrow();
        let starving = fates.of(self.me, tick).find(|(_, _, kind)| *kind == Kind::Starve).map(|(place, ..)| place);
        let mut hog = self.hog.borrow_mut();
        match (starving, hog.as_ref().map(|hog| hog.place)) {
            (Some(place), was) if was != Some(place) => {
                self.control_page.fault_table().mark_injected(place, now_ns());
                *hog = Some(Hog::start(place, self.manifest.processes[self.me].core));
            }
            (None, Some(_)) => *hog = None,
            _ => {}
        }
    }

    /// What a volume does to the polled process that writes to it: full, by the kernel's own limit on the size of files; or slow.
    pub(crate) fn trouble_volume(&self, tick: u64, is_last: bool) {
        let (mut is_full, mut pause_ms) = (false, 0.0);
        for (place, strike, kind) in self.fates.borrow().of(self.me, tick) {
            match kind {
                Kind::DiskFull => is_full = true,
                Kind::SlowDisk => pause_ms += strike.amount,
                _ => continue,
            }
            self.control_page.fault_table().mark_injected(place, now_ns());
        }
        // What is left to be written at the end belongs to another volume.
        self.fill_volume(is_full && !is_last);
        if pause_ms > 0.0 && !is_last {
            std::thread::sleep(std::time::Duration::from_secs_f64(pause_ms * 1e-3));
        }
    }

    pub(crate) fn fill_volume(&self, is_full: bool) {
        if self.is_volume_full.replace(is_full) != is_full {
            // Without this the signal would end the process; the error is what a full volume gives.
            let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
            let limit = getrlimit(Resource::Fsize);
            let _ = setrlimit(Resource::Fsize, Rlimit { current: if is_full { Some(0) } else { limit.maximum }, ..limit });
        }
    }

    /// This process's clock: the machine's, unless a fault has it jump or run fast.
    pub(crate) fn clock_ns(&self) -> u64 {
        let now = now_ns();
        now.saturating_add_signed(self.clock_error_ns(now))
    }

    /// How far this process's clock is ahead of the machine's at an instant of that; negative where it is behind.
    pub(crate) fn clock_error_ns(&self, now: u64) -> i64 {
        if self.is_unharmed() {
            return 0;
        }
        let fates = self.fates.borrow();
        let ms = 1e6;
        let wrong = |(place, strike, kind): (usize, &ScheduledFault, Kind)| {
            if kind != Kind::Clock {
                return 0.0;
            }
            self.control_page.fault_table().mark_injected(place, now);
            let since = self.control_page.fault_table().record(place).map_or(0, |account| now.saturating_sub(account.injected_ns));
            if strike.way() == Some(Way::Skew) { strike.amount * since as f64 } else { strike.amount * ms }
        };
        fates.of(self.me, self.tick.get()).map(wrong).sum::<f64>() as i64
    }

    /// In lockstep: nothing more of `tick` will come out of this process.
    pub(crate) fn close(&self, tick: u64) {
        for outlet in self.outlets.borrow().iter() {
            outlet.flush(tick);
        }
        self.entry().set_ticks(tick + 1);
        for outlet in self.outlets.borrow().iter() {
            outlet.ring();
        }
        self.report_progress();
    }

    pub(crate) fn add_outlet(&self, outlet: Rc<dyn Outlet>) {
        self.outlets.borrow_mut().push(outlet);
    }

    /// Tells those that wait for no message but for the others' progress that this process has closed a tick.
    pub(crate) fn report_progress(&self) {
        match self.protocol().reports_to() {
            Report::Everybody => self.control_page.ring_all(),
            Report::Source(source) => self.control_page.process(source).bell().ring(PROGRESS),
            Report::Nobody => {}
        }
    }
}

impl View for Shared {
    fn processes(&self) -> usize {
        self.manifest.processes.len()
    }

    fn role(&self, process: usize) -> Role {
        let Process { makes_ticks, polled, .. } = self.manifest.processes[process];
        Role { makes_ticks, polled }
    }

    fn progress(&self, process: usize) -> Progress {
        let entry = self.control_page.process(process);
        Progress {
            ticks: entry.ticks(),
            incarnation: entry.incarnation(),
            is_running: entry.state() == State::Running,
            awaits_progress: entry.bell().is_armed_for(PROGRESS),
        }
    }

    fn has_faults(&self) -> bool {
        !self.is_unharmed()
    }

    fn outages(&self) -> impl Iterator<Item = Outage> {
        let outage = |index: usize| {
            let (place, fault) = *self.fates.borrow().strikes().get(index)?;
            let kind = fault.kind().filter(|kind| kind.takes_down())?;
            let record = self.control_page.fault_table().record(place)?;
            Some(Outage {
                place,
                process: fault.process as usize,
                at: fault.at,
                until: fault.until,
                has_struck: record.injected_ns != 0,
                is_death: kind != Kind::Hang || fault.way() == Some(Way::ForEver),
                is_unplanned: record.origin == Origin::Detected,
            })
        };
        let count = self.fates.borrow().strikes().len();
        (0..count).filter_map(outage)
    }

    fn is_lockstep(&self) -> bool {
        Shared::is_lockstep(self)
    }
}
