//! A signal from outside that ends a process before it has taken part in its run.

use std::sync::atomic::Ordering;

use crate::context::Context;

/// Ends the process as the signal would have: an exit code of 0 would call the process complete, and the launcher would not replace it. Without such
/// a signal, and after the first tick, it does nothing.
pub(crate) fn pass_on(context: &Context) {
    let is_asked = context.control_page.stop() >= context.stop.at;
    if context.stop.signalled.load(Ordering::Relaxed) && !context.has_started.get() && !is_asked {
        // It cannot fail for SIGTERM; where it did, the exit code would end the process.
        let _ = signal_hook::low_level::emulate_default_handler(libc::SIGTERM);
    }
}
