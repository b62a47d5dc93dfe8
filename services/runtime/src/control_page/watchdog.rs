//! Wakes a process whose wait has lasted beyond its limit, and ends a program that does not answer.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use crate::control_page::doorbell::ATTENTION;
use crate::control_page::page::{ControlPage, Stop};

/// A thread that wakes its own process out of a long sleep, so that it looks at its stop flag and its clock.
pub(crate) struct Watchdog;

/// How long the program of a process in another language may take for a tick. The thread counts its own sleeps, so a time in which the whole process
/// is stopped does not count.
#[derive(Debug, Default)]
pub(crate) struct Patience {
    /// The process, and whether it only reads; not set: no limit.
    of: OnceLock<(String, bool)>,
    /// Most sleeps for an answer.
    most: AtomicU64,
    /// Ticks given and answered: odd while one is in hand.
    turns: AtomicU64,
    tick: AtomicU64,
}

impl Patience {
    /// After a stop of the run, the time that a program has for the tick in hand.
    const GRACE: u64 = 20;

    /// From now on an answer of this process may take so long.
    pub(crate) fn limit(&self, process: &str, only_reads: bool, limit: Duration) {
        let _ = self.of.set((process.to_owned(), only_reads));
        let sleeps = limit.as_millis().div_ceil(Watchdog::PERIOD.as_millis());
        self.most.store(sleeps as u64, Ordering::Relaxed);
    }

    /// A tick is given.
    pub(crate) fn begin(&self, tick: u64) {
        self.tick.store(tick, Ordering::Relaxed);
        self.turns.store(
            self.turns.load(Ordering::Relaxed).wrapping_add(1) | 1,
            Ordering::Relaxed,
        );
    }

    /// It is answered.
    pub(crate) fn end(&self) {
        let turns = self.turns.load(Ordering::Relaxed);
        self.turns
            .store(turns.wrapping_add(turns & 1), Ordering::Relaxed);
    }

    /// After each sleep of the thread; `seen`: the turn in hand at the last one, and for how many sleeps it has been.
    fn look(&self, seen: &mut (u64, u64), stop: Stop) {
        let Some((name, only_reads)) = self.of.get() else {
            return;
        };
        let (most, turns) = (
            self.most.load(Ordering::Relaxed),
            self.turns.load(Ordering::Relaxed),
        );
        if turns.is_multiple_of(2) || turns != seen.0 {
            *seen = (turns, 0);
            return;
        }
        seen.1 += 1;
        let tick = self.tick.load(Ordering::Relaxed);
        if seen.1 > most {
            let limit_s = most * Watchdog::PERIOD.as_millis() as u64 / 1000;
            crate::complain(&format_args!(
                "armplane: the program of {name} has not answered tick {tick} within {limit_s} s; `answer_limit_s` in the graph allows it longer"
            ));
            // Not `exit`: the program's own thread is busy, and what it runs at its end may wait for it.
            // SAFETY: it ends the process at once.
            unsafe { libc::_exit(1) };
        }
        let is_stopped = stop == Stop::Early || stop == Stop::Chain && !only_reads;
        if seen.1 > Self::GRACE && is_stopped {
            // SAFETY: as above. The run is stopping, and nobody waits for the answer.
            unsafe { libc::_exit(0) };
        }
    }
}

impl Watchdog {
    /// The longest sleep lasts between one and two of these.
    const PERIOD: Duration = Duration::from_millis(50);
    const STACK: usize = 64 * 1024;

    /// Starts the thread; it ends with the control_page.
    pub(crate) fn start(
        control_page: &Arc<ControlPage>,
        index: usize,
        patience: &Arc<Patience>,
    ) -> std::io::Result<()> {
        let control_page = Arc::downgrade(control_page);
        let patience = Arc::clone(patience);
        let watch = move || {
            let (mut seen, mut answer) = (0, (0, 0));
            while let Some(control_page) = control_page.upgrade() {
                let doorbell = control_page.process(index).doorbell();
                let sleeps = doorbell.sleeps();
                // The same sleep as the last time, whoever has rung for other topics meanwhile.
                if sleeps == seen {
                    doorbell.ring(ATTENTION);
                }
                seen = sleeps;
                patience.look(&mut answer, control_page.stop());
                drop(control_page);
                std::thread::sleep(Self::PERIOD);
            }
        };
        std::thread::Builder::new()
            .name("watchdog".into())
            .stack_size(Self::STACK)
            .spawn(watch)
            .map(drop)
    }
}
