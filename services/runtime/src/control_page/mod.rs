//! The control page of a run: one small shared-memory file with a line per process.
//!
//! It carries what must be known without a message: doorbells, heartbeats, incarnations, counts, the stop flag. Everything in it is
//! an atomic integer, so any process may read it at any time (`armplane top` does) and a dead one cannot leave it locked.

pub(crate) mod live_statistics;

use std::fs::OpenOptions;
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use rustix::thread::futex;

use crate::clock::timespec;
use crate::control_page::live_statistics::{Distribution, LiveState, LiveStateCells, Times};
use crate::fault::table::FaultTable;
use crate::run_dir::RunDir;

/// Most processes a run may have.
pub const MAX_PROCESSES: usize = 16;

/// "armboard" and the version of this layout.
const MAGIC: u64 = u64::from_be_bytes(*b"armbrd\0\x02");

/// The bit of a doorbell on which a source of ticks waits for the recorder; below it one bit per topic.
pub(crate) const PROGRESS: u32 = 1 << 31;
/// The bit for which every sleeper waits: stop, next phase, watchdog.
const ATTENTION: u32 = 1 << 30;
/// Every bit: wakes a process whatever it waits for.
pub(crate) const ANYTHING: u32 = u32::MAX;

/// A doorbell: the futex word on which one process sleeps and that others ring.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub(crate) struct Bell {
    /// Counts rings; the futex word.
    rings: AtomicU32,
    /// For which topics (bits) the owner sleeps; 0 while it is awake, so that ringing costs no system call then.
    awaited: AtomicU32,
    /// Counts the owner's sleeps; only the owner writes it.
    sleeps: AtomicU32,
}

impl Bell {
    /// Tells the owner that something arrived on the topics `bits`; a system call only if it sleeps for one of them.
    pub(crate) fn ring(&self, bits: u32) {
        self.rings.fetch_add(1, Ordering::SeqCst);
        if self.awaited.load(Ordering::SeqCst) & bits != 0 && self.awaited.swap(0, Ordering::SeqCst) != 0 {
            // It cannot fail on a mapped word, and a lost wake costs one time slice of the sleeper.
            let _ = futex::wake(&self.rings, futex::Flags::empty(), 1);
        }
    }

    pub(crate) fn rings(&self) -> u32 {
        self.rings.load(Ordering::SeqCst)
    }

    /// Announces the sleep; the caller must look for data once more before [`Bell::sleep`].
    pub(crate) fn arm(&self, bits: u32) {
        self.sleeps.store(self.sleeps.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
        self.awaited.store(bits | ATTENTION, Ordering::SeqCst);
    }

    pub(crate) fn disarm(&self) {
        self.awaited.store(0, Ordering::SeqCst);
    }

    pub(crate) fn is_armed_for(&self, bits: u32) -> bool {
        self.awaited.load(Ordering::SeqCst) & bits != 0
    }

    /// Sleeps until the next ring after the count `seen`, a signal, or the end of the time. Every return is a hint only.
    ///
    /// Without a limit it is the [`Watchdog`] who ends a sleep in vain: a timer for each sleep would cost a sixth of a hop.
    pub(crate) fn sleep(&self, seen: u32, limit_ns: Option<u64>) {
        let limit = limit_ns.map(timespec);
        let _ = futex::wait(&self.rings, futex::Flags::empty(), seen, limit.as_ref());
    }
}

/// A thread that wakes its own process out of a long sleep, so that it looks at its stop flag and its clock.
pub(crate) struct Watchdog;

impl Watchdog {
    /// The longest sleep lasts between one and two of these.
    const PERIOD: Duration = Duration::from_millis(50);
    const STACK: usize = 64 * 1024;

    /// Starts the thread; it ends with the control_page.
    pub(crate) fn start(control_page: &Arc<ControlPage>, index: usize) -> std::io::Result<()> {
        let control_page = Arc::downgrade(control_page);
        let watch = move || {
            let mut seen = 0;
            while let Some(control_page) = control_page.upgrade() {
                let bell = &control_page.process(index).bell;
                let sleeps = bell.sleeps.load(Ordering::Relaxed);
                // The same sleep as the last time, whoever has rung for other topics meanwhile.
                if sleeps == seen {
                    bell.ring(ATTENTION);
                }
                seen = sleeps;
                drop(control_page);
                std::thread::sleep(Self::PERIOD);
            }
        };
        std::thread::Builder::new().name("watchdog".into()).stack_size(Self::STACK).spawn(watch).map(drop)
    }
}

/// What a process is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum State {
    /// Not started yet.
    Absent = 0,
    /// Started, opening its ports.
    Starting = 1,
    /// All its ports are open; it waits for everybody else's.
    Ready = 2,
    /// It is connected to everybody; it waits for the first tick.
    Connected = 3,
    /// Working.
    Running = 4,
    /// It has ended.
    Gone = 5,
    /// It stands still (SIGSTOP).
    Stopped = 6,
}

/// Declares what is counted: the variants, and the record of all of them.
macro_rules! counts {
    ($( $(#[$meta:meta])* $variant:ident $field:ident ),* $(,)?) => {
        /// What a process counts.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(usize)]
        pub enum Count { $( $(#[$meta])* $variant ),* }

        /// Everything a process has counted.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
        pub struct Counts { $( $(#[$meta])* pub $field: u64 ),* }

        const COUNTS: usize = [$(Count::$variant),*].len();

        impl ProcessEntry {
            /// All its counts.
            #[must_use]
            pub fn counts(&self) -> Counts {
                Counts { $( $field: self.count(Count::$variant) ),* }
            }
        }
    };
}
counts! {
    /// Deadlines missed with a major page fault in the period.
    MissedMajorFault missed_major_fault,
    /// Deadlines missed with an involuntary context switch in the period.
    MissedPreempted missed_preempted,
    /// Deadlines missed while a peer was being restarted.
    MissedPeerRestart missed_peer_restart,
    /// Deadlines missed because the input was late already.
    MissedLateInput missed_late_input,
    /// Deadlines missed with no other cause: the computation took too long.
    MissedOverrun missed_overrun,
    /// Own messages refused because a number in them was not finite.
    NotFinite not_finite,
    /// Received messages refused because a dead incarnation had sent them.
    Fenced fenced,
    /// Received messages of a tick already passed.
    Repeated repeated,
    /// Ticks never received.
    Lost lost,
    /// Received messages refused because a number in them was not finite.
    Refused refused,
    /// Messages sent.
    Sent sent,
}

/// One process on the control_page.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub struct ProcessEntry {
    bell: Bell,
    /// Ticks done: the heartbeat. Tick k done is k + 1.
    ticks: AtomicU64,
    pid: AtomicU32,
    incarnation: AtomicU32,
    state: AtomicU32,
    counts: [AtomicU64; COUNTS],
    step: Times,
    age: Times,
}

impl ProcessEntry {
    /// Its doorbell.
    #[must_use]
    pub(crate) fn bell(&self) -> &Bell {
        &self.bell
    }

    /// Ticks done.
    #[must_use]
    pub fn ticks(&self) -> u64 {
        self.ticks.load(Ordering::Acquire)
    }

    pub(crate) fn set_ticks(&self, ticks: u64) {
        self.ticks.store(ticks, Ordering::Release);
    }

    /// Its process id; 0 before its first start.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.pid.load(Ordering::Relaxed)
    }

    /// How often it has been started.
    #[must_use]
    pub fn incarnation(&self) -> u32 {
        self.incarnation.load(Ordering::Acquire)
    }

    /// What it is doing.
    #[must_use]
    pub fn state(&self) -> State {
        match self.state.load(Ordering::Acquire) {
            1 => State::Starting,
            2 => State::Ready,
            3 => State::Connected,
            4 => State::Running,
            5 => State::Gone,
            6 => State::Stopped,
            _ => State::Absent,
        }
    }

    pub(crate) fn set_state(&self, state: State) {
        self.state.store(state as u32, Ordering::Release);
    }

    /// The launcher, before it starts the process (again): from now on the next incarnation's messages count.
    pub fn begin_incarnation(&self) -> u32 {
        self.set_state(State::Starting);
        self.incarnation.fetch_add(1, Ordering::AcqRel) + 1
    }

    /// The launcher, when it has started the process.
    pub fn set_pid(&self, pid: u32) {
        self.pid.store(pid, Ordering::Relaxed);
    }

    /// The launcher, when the process has ended.
    pub fn end(&self) {
        self.set_state(State::Gone);
        self.bell.disarm();
    }

    /// One of its counts.
    #[must_use]
    pub fn count(&self, count: Count) -> u64 {
        self.counts[count as usize].load(Ordering::Relaxed)
    }

    /// How long it takes from its input in hand to its output sent; for the source of ticks in real time from the tick's due time.
    #[must_use]
    pub fn step(&self) -> Distribution {
        self.step.read()
    }

    /// How old the tick is when its output is sent, or for the source of ticks, when its answer is in hand; in real time since it was due.
    #[must_use]
    pub fn age(&self) -> Distribution {
        self.age.read()
    }

    /// How often it has looked for what it waits for: who only waits looks again and again, who is stuck or stopped does not.
    #[must_use]
    pub fn looks(&self) -> u32 {
        self.bell.sleeps.load(Ordering::Relaxed)
    }

    pub(crate) fn note_step(&self, ns: u64) {
        self.step.record(ns);
    }

    pub(crate) fn note_age(&self, ns: u64) {
        self.age.record(ns);
    }

    pub(crate) fn add(&self, count: Count, n: u64) {
        self.counts[count as usize].fetch_add(n, Ordering::Relaxed);
    }
}

/// How far a run has come in its beginning.
///
/// A message reaches those who are connected when it is sent, and survives its writer only in the buffers of those who were connected
/// before the writer ended. So first all open their ports, then all connect them, and only then the first message is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Phase {
    /// The processes open their ports.
    Open = 0,
    /// They connect them.
    Connect = 1,
    /// They work.
    Work = 2,
}

/// How far a run has come to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Stop {
    /// It goes on.
    No = 0,
    /// All stop but the polled processes (the recorder), which take in what is still on the way.
    Chain = 1,
    /// Everybody stops.
    Everything = 2,
}

#[repr(C, align(64))]
struct Page {
    magic: u64,
    phase: AtomicU32,
    stop: AtomicU32,
    /// Origin of the real-time grid on `CLOCK_MONOTONIC`; 0 until the source of ticks has set it.
    grid_origin_ns: AtomicU64,
    fault_table: FaultTable,
    live_state: LiveStateCells,
    entries: [ProcessEntry; MAX_PROCESSES],
}

/// The control page, mapped.
#[derive(Debug)]
pub struct ControlPage {
    page: NonNull<Page>,
}

// SAFETY: everything behind the pointer is atomic, apart from `magic`, which nobody writes after the creation.
unsafe impl Send for ControlPage {}
// SAFETY: as above.
unsafe impl Sync for ControlPage {}

/// Why the control page cannot be made or opened.
#[derive(Debug, thiserror::Error)]
pub enum ControlPageError {
    /// The file cannot be made, opened or mapped.
    #[error("cannot map the control page {path}: {source}")]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is of another version.
    #[error(
        "the control page {path} is not of this version of armplane ({size} bytes, mark {magic:016x}): use the program that started the run"
    )]
    Version {
        /// Which.
        path: PathBuf,
        /// Its size.
        size: u64,
        /// What stands where [`MAGIC`] should.
        magic: u64,
    },
}

impl ControlPage {
    /// Makes the control page of a run, all entries empty.
    ///
    /// # Errors
    /// When the file exists already or cannot be made.
    pub fn create(run: &RunDir) -> Result<Self, ControlPageError> {
        let path = run.path().join("control_page");
        let failed = |source| ControlPageError::File { path: path.clone(), source };
        let file = OpenOptions::new().read(true).write(true).create_new(true).mode(0o600).open(&path).map_err(failed)?;
        // Written, not only truncated: the memory is there now, or the error is.
        std::io::Write::write_all(&mut &file, &vec![0; size_of::<Page>()]).map_err(failed)?;
        std::os::unix::fs::FileExt::write_all_at(&file, &MAGIC.to_ne_bytes(), 0).map_err(failed)?;
        Self::map(&file).map_err(failed)
    }

    /// Opens the control page of a run.
    ///
    /// # Errors
    /// When there is none, or it is of another version.
    pub fn open(run: &RunDir) -> Result<Self, ControlPageError> {
        let path = run.path().join("control_page");
        let failed = |source| ControlPageError::File { path: path.clone(), source };
        let file = OpenOptions::new().read(true).write(true).open(&path).map_err(failed)?;
        let size = file.metadata().map_err(failed)?.len();
        let mut magic = [0; 8];
        std::os::unix::fs::FileExt::read_exact_at(&file, &mut magic, 0).map_err(failed)?;
        let magic = u64::from_ne_bytes(magic);
        if size != size_of::<Page>() as u64 || magic != MAGIC {
            return Err(ControlPageError::Version { path, size, magic });
        }
        Self::map(&file).map_err(failed)
    }

    fn map(file: &std::fs::File) -> std::io::Result<Self> {
        // SAFETY: a fresh shared mapping of a file that is at least this long; nothing else in this process lies there.
        let address =
            unsafe { mmap(std::ptr::null_mut(), size_of::<Page>(), ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED, file, 0)? };
        NonNull::new(address.cast()).map(|page| Self { page }).ok_or_else(|| std::io::Error::other("mapped at address 0"))
    }

    fn page(&self) -> &Page {
        // SAFETY: mapped for the life of `self`, page-aligned, and every bit pattern is a valid `Page`.
        unsafe { self.page.as_ref() }
    }

    /// The line of a process, by its index in the manifest.
    #[must_use]
    pub fn process(&self, index: usize) -> &ProcessEntry {
        &self.page().entries[index]
    }

    /// What the arm is doing.
    #[must_use]
    pub fn live_state(&self) -> LiveState {
        self.page().live_state.read()
    }

    pub(crate) fn live_state_cells(&self) -> &LiveStateCells {
        &self.page().live_state
    }

    /// The launcher, when all processes are through with the phase before.
    pub fn begin(&self, phase: Phase) {
        self.page().phase.fetch_max(phase as u32, Ordering::AcqRel);
        self.ring_all();
    }

    pub(crate) fn has_begun(&self, phase: Phase) -> bool {
        self.page().phase.load(Ordering::Acquire) >= phase as u32
    }

    /// How far the run has come to its end.
    #[must_use]
    pub fn stop(&self) -> Stop {
        match self.page().stop.load(Ordering::Acquire) {
            0 => Stop::No,
            1 => Stop::Chain,
            _ => Stop::Everything,
        }
    }

    /// Asks the processes to stop; a request is never taken back.
    pub fn request_stop(&self, stop: Stop) {
        self.page().stop.fetch_max(stop as u32, Ordering::AcqRel);
        self.ring_all();
    }

    /// The faults of the run.
    #[must_use]
    pub fn fault_table(&self) -> &FaultTable {
        &self.page().fault_table
    }

    /// Wakes everybody: something has changed that is no message.
    pub fn ring_all(&self) {
        for line in &self.page().entries {
            line.bell.ring(ANYTHING);
        }
    }

    /// Where the real-time grid begins: the first caller decides, a replacement keeps the phase.
    pub(crate) fn grid_origin(&self, proposal_ns: u64) -> u64 {
        match self.page().grid_origin_ns.compare_exchange(0, proposal_ns, Ordering::AcqRel, Ordering::Acquire) {
            Ok(_) => proposal_ns,
            Err(earlier) => earlier,
        }
    }
}

impl Drop for ControlPage {
    fn drop(&mut self) {
        // SAFETY: mapped by `map` with this size, and no reference outlives `self`.
        let _ = unsafe { munmap(self.page.as_ptr().cast(), size_of::<Page>()) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_mappings_see_one_board() {
        let run = RunDir::create().unwrap();
        let ours = ControlPage::create(&run).unwrap();
        let theirs = ControlPage::open(&run).unwrap();
        assert_eq!(ours.process(3).begin_incarnation(), 1);
        ours.process(3).set_ticks(42);
        theirs.process(3).add(Count::Lost, 2);
        ours.request_stop(Stop::Everything);
        ours.request_stop(Stop::Chain);
        assert_eq!((theirs.process(3).incarnation(), theirs.process(3).ticks()), (1, 42));
        assert_eq!(theirs.process(3).state(), State::Starting);
        assert_eq!(ours.process(3).count(Count::Lost), 2);
        assert_eq!(theirs.stop(), Stop::Everything, "a stop is never taken back");
        assert_eq!((ours.grid_origin(10), theirs.grid_origin(20)), (10, 10), "the first one sets the phase");
        assert!(matches!(ControlPage::create(&run), Err(ControlPageError::File { .. })));
    }

    #[test]
    fn a_board_of_another_version_is_refused() {
        let run = RunDir::create().unwrap();
        drop(ControlPage::create(&run).unwrap());
        let file = OpenOptions::new().write(true).open(run.path().join("control_page")).unwrap();
        std::os::unix::fs::FileExt::write_all_at(&file, &[0xff; 8], 0).unwrap();
        assert!(matches!(ControlPage::open(&run), Err(ControlPageError::Version { magic: u64::MAX, .. })));
    }

    #[test]
    fn a_ring_between_looking_and_sleeping_is_not_lost() {
        let bell = Bell::default();
        let seen = bell.rings();
        bell.arm(1);
        bell.ring(1);
        // Would sleep for an hour if the ring were lost.
        bell.sleep(seen, Some(3_600_000_000_000));
        assert!(!bell.is_armed_for(1), "the ringer has disarmed it: the next ring costs no system call");
    }

    #[test]
    fn a_sleep_without_limit_is_ended_by_the_watchdog_though_others_ring() {
        let run = RunDir::create().unwrap();
        let control_page = Arc::new(ControlPage::create(&run).unwrap());
        Watchdog::start(&control_page, 0).unwrap();
        let is_over = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            // Rings for a topic that the sleeper does not wait for must not pass for wakes.
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    control_page.process(0).bell().ring(0b10);
                    std::thread::sleep(Duration::from_millis(1));
                }
            });
            for _ in 0..3 {
                let bell = control_page.process(0).bell();
                bell.arm(0b01);
                // Sleeps through all rings for other topics: only a wake ends it.
                while bell.is_armed_for(0b01) {
                    bell.sleep(bell.rings(), None);
                }
            }
            is_over.store(true, Ordering::Relaxed);
        });
    }

    #[test]
    fn a_ring_wakes_only_who_waits_for_it() {
        let bell = Bell::default();
        bell.arm(0);
        bell.ring(ANYTHING);
        assert!(!bell.is_armed_for(ANYTHING), "a sleeper that waits for no topic still hears of a stop");
        bell.arm(0b10);
        bell.ring(0b01);
        assert!(bell.is_armed_for(0b10));
        bell.ring(ANYTHING);
        assert!(!bell.is_armed_for(ANYTHING));
    }
}
