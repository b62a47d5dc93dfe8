//! What faults do to a process: its death, its standing still, its clock, its core. Messages are shaped in [`crate::ports`].

use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::process::{Resource, Rlimit, Signal, getpid, getrlimit, kill_process, setrlimit};
use shared_types::fault::{Kind, ScheduledFault, Way};

use crate::clock::now_ns;
use crate::control_page::{PROGRESS, State};
use crate::fault::table::Origin;
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

    /// Whether a process is dead or stands still at a tick.
    pub(crate) fn is_down(&self, process: usize, tick: u64) -> bool {
        self.fates.borrow().is_down(process, tick)
    }

    /// When this process, started again, may answer: the first tick after its last death. 0: no death is known.
    ///
    /// In real time a death that nobody planned has no length: its replacement answers as soon as it can.
    pub(crate) fn returns_at(&self) -> u64 {
        if self.line().incarnation() < 2 {
            return 0;
        }
        self.learn();
        let (fates, done) = (self.fates.borrow(), self.line().ticks());
        let down = |(place, strike): &&(usize, ScheduledFault)| {
            let account = self.control_page.fault_table().record(*place);
            let has_struck = account.is_some_and(|account| account.injected_ns != 0);
            let has_length = self.is_lockstep() || account.is_none_or(|account| account.origin != Origin::Detected);
            let is_mine = strike.process as usize == self.me && strike.kind().is_some_and(Kind::takes_down);
            // Who died between sending a tick and saying so is down from the next one on.
            is_mine && has_length && (strike.at <= done || has_struck)
        };
        fates.strikes().iter().filter(down).map(|(_, strike)| strike.until).max().unwrap_or(0)
    }

    /// Carries out what concerns the process itself at a tick, with the tick's first input in hand. Returns the tick at which it goes on:
    /// `tick`, or a later one if it stood still.
    pub(crate) fn meet_fate(&self, tick: u64) -> u64 {
        self.learn();
        if self.is_unharmed() {
            return tick;
        }
        self.starve(tick);
        let Some((place, strike, kind)) = self.downfall(tick) else { return tick };
        self.control_page.fault_table().mark_injected(place, now_ns());
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

    /// What takes this process down at a tick. Who makes the ticks, and who takes in what others have sent, is down at no tick but the first,
    /// because no tick passes meanwhile: it falls once. In real time everybody does: a replacement that is there early is not struck again.
    pub(crate) fn downfall(&self, tick: u64) -> Option<(usize, ScheduledFault, Kind)> {
        let process = &self.manifest.processes[self.me];
        let falls_once = process.polled || process.makes_ticks || !self.is_lockstep();
        let has_struck = |place| self.control_page.fault_table().record(place).is_some_and(|account| account.injected_ns != 0);
        let fates = self.fates.borrow();
        let mut falls = fates.of(self.me, tick).filter(|(place, _, kind)| kind.takes_down() && !(falls_once && has_struck(*place)));
        falls.next().map(|(place, strike, kind)| (place, *strike, kind))
    }

    /// The others are told before, so that nobody waits for what cannot come.
    fn leave(&self, state: State) {
        self.line().set_state(state);
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
        self.line().set_state(State::Running);
        self.control_page.fault_table().mark_recovered(self.me, now_ns());
        self.control_page.ring_all();
    }

    /// In lockstep: nothing before `tick` will come of this process any more.
    pub(crate) fn skip_to(&self, tick: u64) {
        let process = &self.manifest.processes[self.me];
        if self.is_lockstep() && !process.polled && !process.makes_ticks && tick > self.line().ticks() {
            self.line().set_ticks(tick);
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
        self.line().set_ticks(tick + 1);
        for outlet in self.outlets.borrow().iter() {
            outlet.ring();
        }
        self.report_progress();
    }

    pub(crate) fn add_outlet(&self, outlet: Rc<dyn Outlet>) {
        self.outlets.borrow_mut().push(outlet);
    }

    /// Whether a writer has nothing more to send at a tick: it said so, or it is down and the tick has begun.
    pub(crate) fn has_closed(&self, writer: Option<usize>, tick: u64) -> bool {
        let Some(writer) = writer else { return false };
        // Where the maker of ticks stands still there are none: nothing is passed over. And nobody runs ahead of it: what leaves late would
        // arrive in a tick of its own choosing.
        let has_begun = || self.source().is_none_or(|source| source != writer && self.control_page.process(source).ticks() > tick);
        self.control_page.process(writer).ticks() > tick || (!self.is_unharmed() && self.is_down(writer, tick) && has_begun())
    }

    /// Who makes the ticks.
    fn source(&self) -> Option<usize> {
        self.manifest.processes.iter().position(|process| process.makes_ticks)
    }

    /// In lockstep, before a tick begins: who is not through with the ticks before it. Where there is no torque to wait for the maker of ticks
    /// would run ahead, and what it sends in a later tick would be taken for what is missing in this one.
    pub(crate) fn straggler(&self, tick: u64) -> Option<usize> {
        if self.is_unharmed() {
            return None;
        }
        let lags = |index: &usize| {
            let (process, done) = (&self.manifest.processes[*index], self.control_page.process(*index).ticks());
            *index != self.me && !process.polled && done < tick && !self.is_down(*index, done)
        };
        (0..self.manifest.processes.len()).find(lags)
    }

    /// Whether nothing of the ticks before `tick` is still to be sent: in lockstep the maker of ticks waits, and all others have come as far.
    pub(crate) fn is_settled(&self, tick: u64) -> bool {
        let has_come = |index: usize| {
            let (process, line) = (&self.manifest.processes[index], self.control_page.process(index));
            let done = line.ticks();
            match process.makes_ticks {
                true => line.bell().is_armed_for(PROGRESS),
                false => index == self.me || process.polled || done >= tick || self.is_down(index, done),
            }
        };
        !self.is_lockstep() || (0..self.manifest.processes.len()).all(has_come)
    }

    /// Tells those that wait for no message but for the others' progress: the maker of ticks that everybody follows it, and everybody who
    /// reads of a dead one that a tick has begun.
    pub(crate) fn report_progress(&self) {
        if self.is_unharmed() {
            return;
        }
        match self.source() {
            Some(source) if source == self.me => self.control_page.ring_all(),
            Some(source) => self.control_page.process(source).bell().ring(PROGRESS),
            None => {}
        }
    }

    /// In lockstep, before a tick begins: whether all are back who were to be back by then, and the recorder has let go of what it must not lose.
    pub(crate) fn awaited(&self, tick: u64) -> Option<usize> {
        if self.is_unharmed() {
            return None;
        }
        let fates = self.fates.borrow();
        let late = |(place, strike): &(usize, ScheduledFault)| {
            let process = strike.process as usize;
            let line = self.control_page.process(process);
            if process == self.me || !strike.kind().is_some_and(Kind::takes_down) {
                return false;
            }
            if self.manifest.processes[process].polled {
                // Nothing may be lost: everything waits at the tick of its death until its replacement works.
                let struck = self.control_page.fault_table().record(*place).is_some_and(|account| account.injected_ns != 0);
                return strike.at <= tick && !(struck && line.state() == State::Running);
            }
            // Who is busy still may not have fallen yet: back is who has these ticks behind it.
            let is_back = line.state() == State::Running && line.ticks() >= strike.until;
            strike.until <= tick && !is_back && !self.manifest.processes[process].makes_ticks
        };
        fates.strikes().iter().find(|strike| late(strike)).map(|(_, strike)| strike.process as usize)
    }
}
