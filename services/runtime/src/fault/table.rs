//! The fault table: every planned and live fault of a run, in one place that all its processes
//! read.
//!
//! The launcher enters planned faults before the start, and in real time unplanned deaths when it
//! detects them. Any process may request a fault (`armplane fault`). The tick source adopts a
//! request for the next tick, before it sends any message of the tick in hand, so that all processes
//! know of the fault a tick before. From then on, a live fault is a planned one. Only the fault table
//! and the tick decide about a fault, so a run with faults is reproducible, also after the launcher
//! has started its processes again: it gives them a copy of the table.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use shared_types::fault::{Kind, MOST_DELAY_TICKS, ScheduledFault};

use shared_types::process::MAX_PROCESSES;

use crate::fault::exit::Exit;

/// Most faults a run may have.
pub const MOST_FAULTS: usize = 144;

/// Most faults in the table when a live one may still be requested: the rest is for deaths in real time that no plan has, five of each process.
pub const MOST_WHEN_REQUESTED: usize = MOST_FAULTS - 5 * MAX_PROCESSES;

/// Time after a fault in which its effect on messages may still show: twice the longest delay.
const AFTERMATH_TICKS: u64 = 2 * MOST_DELAY_TICKS;

/// 64-bit words of a scheduled fault.
const WORDS: usize = size_of::<ScheduledFault>() / size_of::<u64>();

/// Origin of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Origin {
    /// From the scenario.
    Planned = 0,
    /// By `armplane fault`, while the run went on.
    Live = 1,
    /// Detected by the launcher: an unplanned end of a process, or its silence.
    Detected = 2,
}

impl Origin {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Planned => "planned",
            Self::Live => "live",
            Self::Detected => "detected",
        }
    }
}

/// Not in force: 0 while it is being written.
const REQUESTED: u32 = 1;
const IN_FORCE: u32 = 2;

#[repr(C, align(64))]
#[derive(Debug, Default)]
struct Entry {
    standing: AtomicU32,
    origin: AtomicU32,
    /// Exit of the process because of it, as [`Exit`] writes it; 0: unknown.
    exit: AtomicU32,
    words: [AtomicU64; WORDS],
    injected_ns: AtomicU64,
    detected_ns: AtomicU64,
    recovered_ns: AtomicU64,
}

/// The fault table, in shared memory; an entry is never taken back.
#[repr(C, align(64))]
#[derive(Debug)]
pub struct FaultTable {
    taken: AtomicU32,
    /// Counts entries coming into force, so that others know whether their copy is current.
    changes: AtomicU32,
    entries: [Entry; MOST_FAULTS],
}

/// One fault, and what became of it. Times on `CLOCK_MONOTONIC`, 0: not yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultRecord {
    /// Kind, process and ticks.
    pub scheduled: ScheduledFault,
    /// Its origin.
    pub origin: Origin,
    /// When it took effect first.
    pub injected_ns: u64,
    /// When it was detected: by the launcher as an end or a silence, by a reader as a refused or missing message.
    pub detected_ns: u64,
    /// When the process sent again.
    pub recovered_ns: u64,
    /// Exit of the process, if it was not planned.
    pub exit: Option<Exit>,
}

impl FaultTable {
    /// Enters a fault that is in force from its tick on; `None` when the fault table is full.
    pub fn enter(&self, scheduled: &ScheduledFault, origin: Origin) -> Option<usize> {
        self.write(scheduled, origin, IN_FORCE)
    }

    /// Requests a fault from the next tick on (`at` 0), or from a tick still to come; `None` when the fault table is full.
    pub fn request(&self, scheduled: &ScheduledFault) -> Option<usize> {
        self.write(scheduled, Origin::Live, REQUESTED)
    }

    fn write(&self, scheduled: &ScheduledFault, origin: Origin, standing: u32) -> Option<usize> {
        let most = if origin == Origin::Live {
            MOST_WHEN_REQUESTED
        } else {
            MOST_FAULTS
        };
        let next = |taken: u32| ((taken as usize) < most).then(|| taken + 1);
        let place = self
            .taken
            .fetch_update(Ordering::AcqRel, Ordering::Acquire, next)
            .ok()? as usize;
        let entry = self.entries.get(place)?;
        entry.put(scheduled);
        entry.origin.store(origin as u32, Ordering::Relaxed);
        entry.standing.store(standing, Ordering::Release);
        if standing == IN_FORCE {
            self.changes.fetch_add(1, Ordering::Release);
        }
        Some(place)
    }

    /// Takes over all that the table of an earlier start of the processes has: what has happened there does not happen again.
    ///
    /// Requires that nobody writes to either.
    pub fn take_over(&self, earlier: &Self) {
        for (entry, earlier) in self.entries.iter().zip(earlier.taken()) {
            entry.put(&earlier.scheduled());
            for (place, value) in [
                (&entry.origin, &earlier.origin),
                (&entry.exit, &earlier.exit),
                (&entry.standing, &earlier.standing),
            ] {
                place.store(value.load(Ordering::Relaxed), Ordering::Relaxed);
            }
            for (place, value) in [
                (&entry.injected_ns, &earlier.injected_ns),
                (&entry.detected_ns, &earlier.detected_ns),
                (&entry.recovered_ns, &earlier.recovered_ns),
            ] {
                place.store(value.load(Ordering::Relaxed), Ordering::Relaxed);
            }
        }
        self.taken
            .store(earlier.taken().len() as u32, Ordering::Release);
        self.changes.fetch_add(1, Ordering::Release);
    }

    /// Called by the tick source before it sends any message of `tick`: puts requested faults into
    /// force that concern the next tick, or have been waiting for one.
    pub(crate) fn adopt(&self, tick: u64) {
        for entry in self.taken() {
            if entry.standing.load(Ordering::Acquire) != REQUESTED {
                continue;
            }
            let asked = entry.scheduled();
            let next = tick.saturating_add(1);
            if asked.at > next {
                continue;
            }
            let until = if asked.until == u64::MAX {
                u64::MAX
            } else {
                next.saturating_add(asked.until.saturating_sub(asked.at))
            };
            entry.put(&ScheduledFault {
                at: next,
                until,
                ..asked
            });
            entry.standing.store(IN_FORCE, Ordering::Release);
            self.changes.fetch_add(1, Ordering::Release);
        }
    }

    fn taken(&self) -> &[Entry] {
        &self.entries[..(self.taken.load(Ordering::Acquire) as usize).min(MOST_FAULTS)]
    }

    #[inline]
    pub(crate) fn changes(&self) -> u32 {
        self.changes.load(Ordering::Acquire)
    }

    /// Whether a requested fault is in force.
    pub fn is_in_force(&self, place: usize) -> bool {
        self.entries
            .get(place)
            .is_some_and(|entry| entry.standing.load(Ordering::Acquire) == IN_FORCE)
    }

    /// One fault, if there is one at that place.
    pub fn record(&self, place: usize) -> Option<FaultRecord> {
        let entry = self.entries.get(place)?;
        (entry.standing.load(Ordering::Acquire) == IN_FORCE).then(|| FaultRecord {
            scheduled: entry.scheduled(),
            origin: match entry.origin.load(Ordering::Relaxed) {
                0 => Origin::Planned,
                1 => Origin::Live,
                _ => Origin::Detected,
            },
            injected_ns: entry.injected_ns.load(Ordering::Relaxed),
            detected_ns: entry.detected_ns.load(Ordering::Relaxed),
            recovered_ns: entry.recovered_ns.load(Ordering::Relaxed),
            exit: Exit::of_word(entry.exit.load(Ordering::Relaxed)),
        })
    }

    /// All faults in force, with their places, in the order in which they came.
    pub fn records(&self) -> impl Iterator<Item = (usize, FaultRecord)> + '_ {
        (0..self.taken().len()).filter_map(|place| Some((place, self.record(place)?)))
    }

    /// A fault takes effect now.
    pub fn mark_injected(&self, place: usize, now_ns: u64) {
        if let Some(entry) = self.entries.get(place) {
            first(&entry.injected_ns, now_ns);
        }
    }

    /// This process has ended so: for those of its ends that no plan had and of which it is not known yet.
    pub fn mark_exit(&self, process: usize, exit: Exit) {
        let unplanned = self
            .of(process)
            .filter(|entry| entry.origin.load(Ordering::Relaxed) == Origin::Detected as u32);
        unplanned.for_each(|entry| {
            let _ =
                entry
                    .exit
                    .compare_exchange(0, exit.word(), Ordering::Relaxed, Ordering::Relaxed);
        });
    }

    /// A fault of this process is detected at a tick: the one that ended it, and others that are in force or has been shortly before.
    pub fn mark_detected(&self, process: usize, tick: u64, now_ns: u64) {
        let is_it = |entry: &&Entry| {
            entry.is_at_work(tick) || entry.scheduled().kind().is_some_and(Kind::takes_down)
        };
        let injected = self.of(process).filter(|entry| entry.is_injected());
        injected
            .filter(is_it)
            .for_each(|entry| first(&entry.detected_ns, now_ns));
    }

    /// A message is missing, or came twice, or was refused, at a tick: every injected fault that is in force, or has been shortly before, has
    /// been detected by that.
    pub(crate) fn mark_all_detected(&self, tick: u64, now_ns: u64) {
        let injected = self.taken().iter().filter(|entry| entry.is_injected());
        injected
            .filter(|entry| entry.is_at_work(tick))
            .for_each(|entry| first(&entry.detected_ns, now_ns));
    }

    /// This process sends again at a tick.
    pub(crate) fn mark_recovered(&self, process: usize, tick: u64, now_ns: u64) {
        self.of(process)
            .filter(|entry| {
                let fault = entry.scheduled();
                entry.is_injected()
                    && fault.at <= tick
                    && fault.kind().is_some_and(Kind::takes_down)
            })
            .for_each(|entry| first(&entry.recovered_ns, now_ns));
    }

    fn of(&self, process: usize) -> impl Iterator<Item = &Entry> {
        self.taken().iter().filter(move |entry| {
            entry.standing.load(Ordering::Acquire) == IN_FORCE
                && entry.scheduled().process as usize == process
        })
    }
}

fn first(time: &AtomicU64, now_ns: u64) {
    let _ = time.compare_exchange(0, now_ns, Ordering::Relaxed, Ordering::Relaxed);
}

impl Entry {
    fn put(&self, scheduled: &ScheduledFault) {
        let words: [u64; WORDS] = bytemuck::cast(*scheduled);
        self.words
            .iter()
            .zip(words)
            .for_each(|(place, word)| place.store(word, Ordering::Relaxed));
    }

    fn is_injected(&self) -> bool {
        self.injected_ns.load(Ordering::Relaxed) != 0
    }

    /// Whether it is in force at a tick, or its effect may still show.
    fn is_at_work(&self, tick: u64) -> bool {
        let ScheduledFault { at, until, .. } = self.scheduled();
        (at..until.saturating_add(AFTERMATH_TICKS)).contains(&tick)
    }

    fn scheduled(&self) -> ScheduledFault {
        bytemuck::cast::<[u64; WORDS], ScheduledFault>(std::array::from_fn(|i| {
            self.words[i].load(Ordering::Relaxed)
        }))
    }
}

/// One process's copy of the fault table, without deaths that no plan had, whose end nobody waits for; renewed when the fault table has changed. Never
/// allocates after its making.
#[derive(Debug)]
pub(crate) struct KnownFaults {
    changes: u32,
    faults: Vec<(usize, ScheduledFault)>,
}

impl Default for KnownFaults {
    fn default() -> Self {
        Self {
            changes: 0,
            faults: Vec::with_capacity(MOST_FAULTS),
        }
    }
}

impl KnownFaults {
    /// The faults in force, and their places.
    #[inline]
    pub(crate) fn faults(&self) -> &[(usize, ScheduledFault)] {
        &self.faults
    }

    #[inline]
    pub(crate) fn is_current(&self, table: &FaultTable) -> bool {
        self.changes == table.changes()
    }

    pub(crate) fn renew(&mut self, table: &FaultTable) {
        self.changes = table.changes();
        self.faults.clear();
        let records = table.records();
        let of_plan = records.filter(|(_, record)| record.origin != Origin::Detected);
        self.faults
            .extend(of_plan.map(|(place, record)| (place, record.scheduled)));
    }

    /// The faults of a process at a tick.
    pub(crate) fn of(
        &self,
        process: usize,
        tick: u64,
    ) -> impl Iterator<Item = (usize, &ScheduledFault, Kind)> {
        self.faults
            .iter()
            .filter(move |(_, scheduled)| {
                scheduled.process as usize == process && scheduled.concerns(tick)
            })
            .filter_map(|(place, scheduled)| Some((*place, scheduled, scheduled.kind()?)))
    }

    /// The faults that end or stop a process, at whatever tick.
    pub(crate) fn downs(&self, process: usize) -> impl Iterator<Item = (usize, &ScheduledFault)> {
        let of = move |fault: &ScheduledFault| {
            fault.process as usize == process && fault.kind().is_some_and(Kind::takes_down)
        };
        self.faults
            .iter()
            .filter(move |(_, fault)| of(fault))
            .map(|(place, fault)| (*place, fault))
    }

    /// Whether any fault makes more or fewer than one message of a topic leave in a tick.
    pub(crate) fn shapes_messages(&self) -> bool {
        self.faults
            .iter()
            .any(|(_, scheduled)| scheduled.kind().is_some_and(Kind::shapes_messages))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ControlPage, RunDir};
    use shared_types::TorqueCommand;
    use shared_types::fault::{Fault, Target};
    use shared_types::process::Role;

    fn scheduled(kind: Kind, at: u64) -> ScheduledFault {
        let fault = Fault {
            at_tick: Some(at),
            ..Fault::new("controller", kind)
        };
        let on = Target::sending::<TorqueCommand>(3, Role::Stage);
        fault.schedule(&on, 1000, 7).unwrap()
    }

    /// A control page, with the run that it lies in.
    fn page() -> (RunDir, ControlPage) {
        let run = RunDir::create().unwrap();
        let page = ControlPage::create(&run).unwrap();
        (run, page)
    }

    fn detected(table: &FaultTable) -> Vec<u64> {
        table.records().map(|(_, one)| one.detected_ns).collect()
    }

    #[test]
    fn a_request_is_in_force_from_the_tick_after_the_one_that_adopts_it() {
        let (run, page) = page();
        let other_mapping = ControlPage::open(&run).unwrap();
        let (ours, theirs) = (page.fault_table(), other_mapping.fault_table());
        let mut copied = KnownFaults::default();
        let place = theirs.request(&scheduled(Kind::Kill, 0)).unwrap();
        assert!(copied.is_current(theirs) && !theirs.is_in_force(place));
        ours.adopt(499);
        assert!(!copied.is_current(theirs) && theirs.is_in_force(place));
        copied.renew(theirs);
        let is_down = |process, tick| copied.of(process, tick).any(|(.., kind)| kind.takes_down());
        let downs = [(3, 499), (3, 500), (3, 599), (3, 600), (2, 500)];
        let downs = downs.map(|(process, tick)| is_down(process, tick));
        assert_eq!(downs, [false, true, true, false, false]);
        assert!(!copied.shapes_messages());
    }

    #[test]
    fn the_course_of_a_fault_is_reported_once() {
        let (_run, page) = page();
        let table = page.fault_table();
        let place = table
            .enter(&scheduled(Kind::Hang, 10), Origin::Planned)
            .unwrap();
        table.mark_detected(3, 10, 50);
        assert_eq!(detected(table), [0], "not injected yet");
        table.mark_injected(place, 60);
        table.mark_detected(3, 10, 70);
        table.mark_detected(3, 10, 80);
        table.mark_recovered(3, 9, 85);
        table.mark_recovered(3, 10, 90);
        table.mark_exit(3, Exit::Code(1));
        let expected = FaultRecord {
            scheduled: scheduled(Kind::Hang, 10),
            origin: Origin::Planned,
            injected_ns: 60,
            detected_ns: 70,
            recovered_ns: 90,
            // The plan says how it ends.
            exit: None,
        };
        assert_eq!(table.record(place), Some(expected));
    }

    #[test]
    fn an_end_that_no_plan_had_is_told_as_it_was() {
        let (_run, page) = page();
        let table = page.fault_table();
        let enter = |at| {
            table
                .enter(&scheduled(Kind::Kill, at), Origin::Detected)
                .unwrap()
        };
        let first = enter(10);
        table.mark_exit(2, Exit::Signal(9));
        table.mark_exit(3, Exit::Code(3));
        let second = enter(200);
        table.mark_exit(3, Exit::Signal(11));
        let exits = [first, second].map(|place| table.record(place).unwrap().exit);
        assert_eq!(exits, [Some(Exit::Code(3)), Some(Exit::Signal(11))]);
    }

    #[test]
    fn a_message_that_is_missing_tells_of_what_is_in_force_and_of_nothing_else() {
        let (_run, page) = page();
        let table = page.fault_table();
        for at in [10, 1_000, 3_000] {
            let place = table
                .enter(&scheduled(Kind::Drop, at), Origin::Planned)
                .unwrap();
            table.mark_injected(place, 5);
        }
        // The second lasts 100 ticks from 1000.
        table.mark_all_detected(1_150, 77);
        assert_eq!(detected(table), [0, 77, 0]);
        table.mark_detected(3, 3_000, 88);
        assert_eq!(detected(table), [0, 77, 88]);
    }

    #[test]
    fn a_full_fault_table_says_so() {
        let (_run, page) = page();
        let (table, drop) = (page.fault_table(), scheduled(Kind::Drop, 1));
        let requested = (0..).map_while(|_| table.request(&drop)).count();
        assert_eq!(requested, MOST_WHEN_REQUESTED, "the rest is for deaths");
        table.adopt(1);
        let entered = (0..)
            .map_while(|_| table.enter(&drop, Origin::Planned))
            .count();
        assert_eq!(requested + entered, MOST_FAULTS);
        assert_eq!(
            (table.request(&drop), table.records().count()),
            (None, MOST_FAULTS)
        );
    }
}
