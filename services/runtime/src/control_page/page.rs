//! The control page of a run: one small shared-memory file with an entry per process.
//!
//! It holds doorbells, heartbeats, incarnations, counts and the stop flag. Everything in it is an
//! atomic integer, so any process may read it at any time (as `armplane top` does), and a dead one
//! cannot leave it locked.

use std::fs::OpenOptions;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use crate::control_page::doorbell::ANYTHING;
use crate::control_page::entry::ProcessEntry;
use crate::control_page::latest::Latest;
use crate::fault::table::FaultTable;
use crate::mapped::Mapped;
use crate::run_dir::RunDir;
use shared_types::process::MAX_PROCESSES;
use shared_types::topics::{COUNT, MAX_TOPICS, Topic};

/// "armbrd" and the version of this layout.
const MAGIC: u64 = u64::from_be_bytes(*b"armbrd\0\x08");

/// Phase of a run's start.
///
/// A message reaches the readers that are connected when it is sent, and survives its writer only in the buffers of the readers that were connected
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

/// Phase of a run's end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Stop {
    /// It continues.
    No = 0,
    /// No tick begins any more; the tick in hand comes to its end.
    Ticks = 1,
    /// All stop except polled processes (the recorder), which take in the messages still under way.
    Chain = 2,
    /// Everybody stops.
    Everything = 3,
    /// Everybody stops, and the run has not come to its end: it was interrupted, or it has failed.
    Early = 4,
}

#[repr(C, align(64))]
struct Page {
    magic: u64,
    phase: AtomicU32,
    stop: AtomicU32,
    /// Origin of the real-time grid on `CLOCK_MONOTONIC`; 0 until the source of ticks has set it.
    grid_origin_ns: AtomicU64,
    fault_table: FaultTable,
    latest: [Latest; COUNT],
    topics: [TopicEntry; MAX_TOPICS],
    entries: [ProcessEntry; MAX_PROCESSES],
}

/// One topic on the control page.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub(crate) struct TopicEntry {
    /// Messages sent; a writer adds each after it has been delivered. A new writer adds [`TopicEntry::INCARNATION`] first.
    sent: AtomicU64,
    /// The tick after the newest message's.
    ticks: AtomicU64,
}

impl TopicEntry {
    /// Distance between the counts of two writers, so that messages that a dead writer delivered
    /// but did not count are not mistaken for its replacement's.
    const INCARNATION: u64 = 1 << 32;

    /// A writer begins.
    pub(crate) fn begin_writer(&self) {
        self.sent.fetch_add(Self::INCARNATION, Ordering::AcqRel);
    }

    /// The one living writer has delivered a message of a tick.
    #[inline]
    pub(crate) fn count_sent(&self, tick: u64) {
        self.ticks.store(tick + 1, Ordering::Relaxed);
        self.sent
            .store(self.sent.load(Ordering::Relaxed) + 1, Ordering::Release);
    }

    /// The tick of the newest message, as far as the writer counts.
    pub(crate) fn newest(&self) -> Option<u64> {
        self.ticks.load(Ordering::Relaxed).checked_sub(1)
    }

    /// Whether a message of a tick, or of a later one, is still to be delivered, as far as the writer counts.
    pub(crate) fn is_behind(&self, tick: u64) -> bool {
        self.sent() > 0 && self.ticks.load(Ordering::Relaxed) <= tick
    }

    /// Changes with each message that is delivered; 0 if the writer, a program of others, does not count.
    #[inline]
    pub(crate) fn sent(&self) -> u64 {
        self.sent.load(Ordering::Acquire)
    }
}

/// The control page, mapped.
#[derive(Debug)]
pub struct ControlPage(Mapped);

// SAFETY: everything behind the pointer is atomic, apart from `magic`, which is not written after the creation.
unsafe impl Send for ControlPage {}
// SAFETY: as above.
unsafe impl Sync for ControlPage {}

/// Why the control page cannot be made or opened.
#[derive(Debug, thiserror::Error)]
pub enum ControlPageError {
    /// The file cannot be made, opened or mapped.
    #[error("cannot map the control page {path}: {source}")]
    File {
        /// The path.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is of another version.
    #[error(
        "the control page {path} is not of this version of armplane ({size} bytes, mark {magic:016x}): use the program that started the run"
    )]
    Version {
        /// The path.
        path: PathBuf,
        /// Its size.
        size: u64,
        /// The value found in place of [`MAGIC`].
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
        let make = || {
            let mut options = OpenOptions::new();
            options.read(true).write(true).create_new(true).mode(0o600);
            let file = options.open(&path)?;
            // Written, not only truncated: the memory is there now, or the error is.
            file.write_all_at(&vec![0; size_of::<Page>()], 0)?;
            file.write_all_at(&MAGIC.to_ne_bytes(), 0)?;
            Mapped::of(&file, size_of::<Page>())
        };
        let mapped = make().map(Self);
        mapped.map_err(|source| ControlPageError::File { path, source })
    }

    /// Opens the control page of a run.
    ///
    /// # Errors
    /// When there is none, or it is of another version.
    pub fn open(run: &RunDir) -> Result<Self, ControlPageError> {
        let path = run.path().join("control_page");
        let open = || {
            let file = OpenOptions::new().read(true).write(true).open(&path)?;
            let mut magic = [0; 8];
            file.read_exact_at(&mut magic, 0)?;
            let found = (file.metadata()?.len(), u64::from_ne_bytes(magic), file);
            Ok::<_, std::io::Error>(found)
        };
        let mapped = match open() {
            Ok((size, magic, _)) if (size, magic) != (size_of::<Page>() as u64, MAGIC) => {
                return Err(ControlPageError::Version { path, size, magic });
            }
            Ok((.., file)) => Mapped::of(&file, size_of::<Page>()).map(Self),
            Err(error) => Err(error),
        };
        mapped.map_err(|source| ControlPageError::File { path, source })
    }

    #[inline]
    fn page(&self) -> &Page {
        // SAFETY: mapped for the life of `self`, page-aligned, and every bit pattern is a valid `Page`.
        unsafe { self.0.start().cast().as_ref() }
    }

    /// The line of a process, by its index in the manifest.
    #[inline]
    pub fn process(&self, index: usize) -> &ProcessEntry {
        &self.page().entries[index]
    }

    /// The line of a topic, by its index in [`Manifest::topics`](crate::Manifest::topics).
    #[inline]
    pub(crate) fn topic(&self, index: usize) -> &TopicEntry {
        &self.page().topics[index]
    }

    /// The latest message of a topic, as far as `armplane top` shows it and zero elsewhere; numbers of neighbouring ticks may stand side by side.
    pub fn latest<M: Topic>(&self) -> M {
        self.latest_of(M::INDEX).load()
    }

    /// That of the topic at a place of the list.
    #[inline]
    pub(crate) fn latest_of(&self, place: usize) -> &Latest {
        &self.page().latest[place]
    }

    /// The launcher, when all processes are through with the phase before.
    pub fn begin(&self, phase: Phase) {
        self.page().phase.fetch_max(phase as u32, Ordering::AcqRel);
        self.ring_all();
    }

    pub(crate) fn has_begun(&self, phase: Phase) -> bool {
        self.page().phase.load(Ordering::Acquire) >= phase as u32
    }

    /// Phase of the run's end.
    #[inline]
    pub fn stop(&self) -> Stop {
        match self.page().stop.load(Ordering::Acquire) {
            0 => Stop::No,
            1 => Stop::Ticks,
            2 => Stop::Chain,
            3 => Stop::Everything,
            _ => Stop::Early,
        }
    }

    /// Asks the processes to stop; a request is never taken back.
    pub fn request_stop(&self, stop: Stop) {
        self.page().stop.fetch_max(stop as u32, Ordering::AcqRel);
        self.ring_all();
    }

    /// The faults of the run.
    #[inline]
    pub fn fault_table(&self) -> &FaultTable {
        &self.page().fault_table
    }

    /// Wakes all processes: a change that is no message.
    pub fn ring_all(&self) {
        for line in &self.page().entries {
            line.doorbell().ring(ANYTHING);
        }
    }

    /// Start of the real-time grid. The first caller decides; a replacement keeps the phase.
    pub(crate) fn grid_origin(&self, proposal_ns: u64) -> u64 {
        match self.page().grid_origin_ns.compare_exchange(
            0,
            proposal_ns,
            Ordering::AcqRel,
            Ordering::Acquire,
        ) {
            Ok(_) => proposal_ns,
            Err(earlier) => earlier,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use super::*;
    use crate::control_page::doorbell::Doorbell;
    use crate::control_page::entry::{Count, State};
    use crate::control_page::watchdog::Watchdog;

    #[test]
    fn two_mappings_see_one_page() {
        let run = RunDir::create().unwrap();
        let ours = ControlPage::create(&run).unwrap();
        let theirs = ControlPage::open(&run).unwrap();
        let (line, seen) = (ours.process(3), theirs.process(3));
        assert_eq!(line.begin_incarnation(), 1);
        line.set_ticks(42);
        seen.add(Count::Lost, 2);
        ours.request_stop(Stop::Everything);
        ours.request_stop(Stop::Chain);
        assert_eq!((seen.incarnation(), seen.ticks()), (1, 42));
        assert_eq!(
            (seen.state(), line.count(Count::Lost)),
            (State::Starting, 2)
        );
        assert_eq!(
            theirs.stop(),
            Stop::Everything,
            "a stop is never taken back"
        );
        // The first one sets the phase.
        assert_eq!((ours.grid_origin(10), theirs.grid_origin(20)), (10, 10));
        let again = ControlPage::create(&run);
        assert!(matches!(again, Err(ControlPageError::File { .. })));
        let file = OpenOptions::new()
            .write(true)
            .open(run.path().join("control_page"));
        file.unwrap().write_all_at(&[0xff; 8], 0).unwrap();
        let other = ControlPage::open(&run);
        assert!(matches!(
            other,
            Err(ControlPageError::Version {
                magic: u64::MAX,
                ..
            })
        ));
    }

    #[test]
    fn a_sleep_without_limit_is_ended_by_the_watchdog_though_others_ring() {
        let run = RunDir::create().unwrap();
        let control_page = Arc::new(ControlPage::create(&run).unwrap());
        Watchdog::start(&control_page, 0, &Arc::default()).unwrap();
        let doorbell = control_page.process(0).doorbell();
        let is_over = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            // Rings for a topic that the sleeper does not wait for must not pass for wakes.
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    doorbell.ring(0b10);
                    std::thread::sleep(Duration::from_millis(1));
                }
            });
            for ended in 0..3 {
                doorbell.arm(0b01);
                // Sleeps through all rings for other topics: only a wake ends it.
                while doorbell.is_armed_for(0b01) {
                    doorbell.sleep(doorbell.rings(), None);
                }
                assert_eq!(doorbell.sleeps(), ended + 1, "one sleep, and it has ended");
            }
            is_over.store(true, Ordering::Relaxed);
        });
    }

    #[test]
    fn a_ring_wakes_only_who_waits_for_it_and_is_not_lost_before_the_sleep() {
        let doorbell = Doorbell::default();
        let wakes = |awaited, rung| {
            let seen = doorbell.rings();
            doorbell.arm(awaited);
            doorbell.ring(rung);
            // Would sleep for an hour if the ring were lost.
            doorbell.sleep(seen, Some(3_600_000_000_000));
            !doorbell.is_armed_for(ANYTHING)
        };
        assert!(wakes(0b01, 0b01) && wakes(0b10, ANYTHING) && !wakes(0b10, 0b01));
        assert!(
            wakes(0, ANYTHING),
            "a sleeper that waits for no topic hears of a stop"
        );
    }
}
