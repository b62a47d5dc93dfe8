//! Signals to the launcher, and its own priority.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicI32, AtomicUsize, Ordering};

use signal_hook::consts::{
    SIGALRM, SIGHUP, SIGINT, SIGIO, SIGPROF, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2, SIGVTALRM, SIGXCPU,
};

use crate::outcome::LaunchError;

/// In real time the launcher, and a process until it has a priority of its own, come before ordinary work, so that a death is mended at once. Children
/// inherit the priority.
///
/// Several launchers, their threads and the processes that they start may share one core; equals take turns on it. With `SCHED_FIFO` here three drills in
/// real time pinned to one core stood still, no signal ended their processes, and a change of the policy released them. The supposed cause, not shown: one
/// spins in the kernel for a lock, and keeps its equal that holds the lock from running.
pub(crate) struct Urgency(());

impl Urgency {
    /// Below every process of the graph that has a priority.
    const PRIORITY: u8 = 5;

    /// For this thread, where the machine allows.
    pub(crate) fn begin() -> Option<Self> {
        runtime::realtime::set_round_robin_priority(Self::PRIORITY)
            .inspect_err(|missing| tracing::info!("the launcher runs without {missing}"))
            .map(Self)
            .ok()
    }
}

impl Drop for Urgency {
    fn drop(&mut self) {
        runtime::realtime::set_ordinary_scheduling();
    }
}

/// All signals that would end this process and can be caught, except those raised by its own
/// defects. SIGPIPE is ignored: a write into a broken pipe fails.
const CAUGHT: [i32; 11] = [
    SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGXCPU, SIGIO,
];

/// Counts SIGINT, SIGTERM and similar signals while this value lives. Otherwise they have their
/// usual effect.
///
/// A command holds one from its first act to its last, and each of its runs one more: every holder sees every signal since the first began.
#[derive(Debug)]
pub struct Interrupts {
    /// Signals that this holder has taken.
    taken: usize,
}

/// How many are held.
static HELD: AtomicUsize = AtomicUsize::new(0);
/// Signals that have come so far, those before the first of the holders, and the last one.
static COUNT: AtomicUsize = AtomicUsize::new(0);
static BEFORE: AtomicUsize = AtomicUsize::new(0);
static LAST: AtomicI32 = AtomicI32::new(0);
static REGISTERED: OnceLock<()> = OnceLock::new();

impl Interrupts {
    /// Takes the signals in from now on. A signal that whoever started this program has told it to ignore (`nohup`) stays ignored.
    ///
    /// # Errors
    /// When the kernel refuses.
    pub fn catch() -> Result<Self, LaunchError> {
        if REGISTERED.get().is_none() {
            let ignored = ignored_signals();
            for signal in CAUGHT
                .into_iter()
                .filter(|signal| ignored & 1 << (signal - 1) == 0)
            {
                // SAFETY: the handler touches atomics only, and what it calls may be called in a handler.
                unsafe { signal_hook::low_level::register(signal, move || count(signal)) }
                    .map_err(LaunchError::Signals)?;
            }
            let _ = REGISTERED.set(());
        }
        if HELD.fetch_add(1, Ordering::SeqCst) == 0 {
            BEFORE.store(COUNT.load(Ordering::SeqCst), Ordering::SeqCst);
        }
        Ok(Self {
            taken: BEFORE.load(Ordering::SeqCst),
        })
    }

    /// Whether any holder has received a signal.
    pub fn has_come() -> bool {
        COUNT.load(Ordering::SeqCst) > 0
    }

    /// The name of a signal received since the last check.
    pub fn pending(&mut self) -> Option<&'static str> {
        if COUNT.load(Ordering::SeqCst) <= self.taken {
            return None;
        }
        self.taken += 1;
        Some(signal_hook::low_level::signal_name(LAST.load(Ordering::SeqCst)).unwrap_or("a signal"))
    }
}

impl Drop for Interrupts {
    fn drop(&mut self) {
        HELD.fetch_sub(1, Ordering::SeqCst);
    }
}

/// In the handler.
fn count(signal: i32) {
    if HELD.load(Ordering::SeqCst) == 0 {
        let _ = signal_hook::low_level::emulate_default_handler(signal);
        return;
    }
    LAST.store(signal, Ordering::SeqCst);
    COUNT.fetch_add(1, Ordering::SeqCst);
}

/// The signals that this process ignores, a bit each from signal 1 on; those it was started with, before it catches any.
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status
        .lines()
        .find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    // A shell without job control starts a background command with SIGINT and SIGQUIT ignored, and yet means them when it sends one.
    mask.unwrap_or_default() & !(1 << (SIGINT - 1) | 1 << (SIGQUIT - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_holder_sees_each_signal_since_the_first_began() {
        let mut command = Interrupts::catch().unwrap();
        assert_eq!(command.pending(), None);
        signal_hook::low_level::raise(SIGUSR1).unwrap();
        let mut run = Interrupts::catch().unwrap();
        assert_eq!(
            (run.pending(), run.pending()),
            (Some("SIGUSR1"), None),
            "it came before the run, and within the command"
        );
        drop(run);
        assert_eq!(
            (command.pending(), command.pending()),
            (Some("SIGUSR1"), None)
        );
    }
}
