//! Signals to the launcher, and its own priority.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// In real time whoever mends a death comes before ordinary work: the launcher, and a process until it has a priority of its own. Children
/// inherit it.
pub(crate) struct Urgency {
    is_raised: bool,
}

impl Urgency {
    /// Below every process of the graph that has a priority.
    const PRIORITY: u8 = 5;

    /// For this thread, where the machine allows.
    pub(crate) fn begin() -> Self {
        let raised = runtime::realtime::set_fifo_priority(Self::PRIORITY);
        let is_raised = raised.inspect_err(|missing| tracing::info!("the launcher runs without {missing}")).is_ok();
        Self { is_raised }
    }
}

impl Drop for Urgency {
    fn drop(&mut self) {
        if self.is_raised {
            runtime::realtime::set_ordinary_scheduling();
        }
    }
}

/// SIGINT, SIGTERM and SIGHUP to this process, taken in as long as somebody holds this; otherwise they do what they always do.
///
/// A run holds one; a command of several runs holds one over all of them, to clean up after the last.
pub struct Interrupts(Signals);

static IDLE: OnceLock<Arc<AtomicBool>> = OnceLock::new();
/// How many are held.
static HELD: AtomicUsize = AtomicUsize::new(0);

impl Interrupts {
    /// Takes the signals in from now on.
    ///
    /// # Errors
    /// When the kernel refuses.
    pub fn catch() -> io::Result<Self> {
        let signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
        if IDLE.get().is_none() {
            let idle = Arc::new(AtomicBool::new(false));
            for signal in [SIGINT, SIGTERM, SIGHUP] {
                signal_hook::flag::register_conditional_default(signal, Arc::clone(&idle))?;
            }
            let _ = IDLE.set(idle);
        }
        HELD.fetch_add(1, Ordering::SeqCst);
        Self::tell();
        Ok(Self(signals))
    }

    /// The name of a signal that has come since the last look.
    pub fn pending(&mut self) -> Option<&'static str> {
        self.0.pending().next().map(|signal| signal_hook::low_level::signal_name(signal).unwrap_or("a signal"))
    }

    fn tell() {
        if let Some(flag) = IDLE.get() {
            flag.store(HELD.load(Ordering::SeqCst) == 0, Ordering::SeqCst);
        }
    }
}

impl Drop for Interrupts {
    fn drop(&mut self) {
        HELD.fetch_sub(1, Ordering::SeqCst);
        Self::tell();
    }
}
