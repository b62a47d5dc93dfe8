//! Doorbells: wake-ups between processes by a futex in shared memory.

use std::sync::atomic::{AtomicU32, Ordering};

use rustix::thread::futex;

use crate::clock::timespec;

/// The bit of a doorbell on which a source of ticks waits for the recorder; below it one bit per topic.
pub(crate) const PROGRESS: u32 = 1 << 31;
/// The bit for which every sleeper waits: stop, next phase, watchdog.
pub(crate) const ATTENTION: u32 = 1 << 30;
/// Every bit: wakes a process whatever it waits for.
pub(crate) const ANYTHING: u32 = u32::MAX;

/// A doorbell: the futex word on which one process sleeps and that others ring.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub(crate) struct Doorbell {
    /// Counts rings; the futex word.
    rings: AtomicU32,
    /// For which topics (bits) the owner sleeps; 0 while it is awake, so that ringing costs no system call then.
    awaited: AtomicU32,
    /// Counts the owner's sleeps; only the owner writes it.
    sleeps: AtomicU32,
}

impl Doorbell {
    /// Tells the owner that something arrived on the topics `bits`; a system call only if it sleeps for one of them.
    #[inline]
    pub(crate) fn ring(&self, bits: u32) {
        self.rings.fetch_add(1, Ordering::SeqCst);
        if self.awaited.load(Ordering::SeqCst) & bits != 0 && self.awaited.swap(0, Ordering::SeqCst) != 0 {
            // It cannot fail on a mapped word, and a lost wake costs one time slice of the sleeper.
            let _ = futex::wake(&self.rings, futex::Flags::empty(), 1);
        }
    }

    /// How often the owner has gone to sleep.
    pub(crate) fn sleeps(&self) -> u32 {
        self.sleeps.load(Ordering::Relaxed)
    }

    #[inline]
    pub(crate) fn rings(&self) -> u32 {
        self.rings.load(Ordering::SeqCst)
    }

    /// Announces a sleep. The caller has read [`Doorbell::rings`] before it last looked for data: a ring since then ends [`Doorbell::sleep`] at once.
    #[inline]
    pub(crate) fn arm(&self, bits: u32) {
        self.sleeps.store(self.sleeps.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
        self.awaited.store(bits | ATTENTION, Ordering::SeqCst);
    }

    /// Takes the announcement back, where no ringer has done so; a ring that comes meanwhile costs a system call and changes nothing.
    #[inline]
    pub(crate) fn disarm(&self) {
        if self.awaited.load(Ordering::Relaxed) != 0 {
            self.awaited.store(0, Ordering::Release);
        }
    }

    #[inline]
    pub(crate) fn is_armed_for(&self, bits: u32) -> bool {
        self.awaited.load(Ordering::SeqCst) & bits != 0
    }

    /// Sleeps until the next ring after the count `seen`, a signal, or the end of the time. Every return is a hint only.
    ///
    /// Without a limit the [`Watchdog`] ends a sleep that brings nothing: a timer for each sleep would cost a sixth of a hop.
    #[inline]
    pub(crate) fn sleep(&self, seen: u32, limit_ns: Option<u64>) {
        let limit = limit_ns.map(timespec);
        let _ = futex::wait(&self.rings, futex::Flags::empty(), seen, limit.as_ref());
    }
}
