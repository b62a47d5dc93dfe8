//! Last words of a process whose program has truncated the exchange page.
//!
//! If this process touches a part of the page that its file no longer has, the kernel kills it by
//! SIGBUS. The handler cannot prevent that, but prints the cause on standard error, where the
//! launcher reads it.

use std::ops::Range;
use std::sync::OnceLock;

use libc::{SA_RESETHAND, SA_SIGINFO, SIGBUS, STDERR_FILENO, c_int, c_void, sigaction, siginfo_t};

/// The addresses of the page, and the line.
static PAGE: OnceLock<(Range<usize>, String)> = OnceLock::new();

/// From now on a SIGBUS at an address of the page is explained before it ends this process; a process has one page.
pub(crate) fn explain(process: &str, page: Range<usize>) {
    let line = format!(
        "armplane: the program of {process} has cut its exchange page short: a program never changes the length of the page\n"
    );
    if PAGE.set((page, line)).is_err() {
        return;
    }
    // SAFETY: zeros are a valid `sigaction` with an empty mask, and the handler has the signature that SA_SIGINFO demands.
    unsafe {
        let mut action: sigaction = std::mem::zeroed();
        action.sa_sigaction = on_bus_error as *const () as usize;
        action.sa_flags = SA_SIGINFO | SA_RESETHAND;
        sigaction(SIGBUS, &raw const action, std::ptr::null_mut());
    }
}

/// Calls only functions that may be called in a handler. The signal that it raises is held back until it returns, and has its default action then.
extern "C" fn on_bus_error(signal: c_int, info: *mut siginfo_t, _: *mut c_void) {
    // SAFETY: the kernel passes a valid `siginfo_t`; the line lives as long as the process.
    unsafe {
        let at = (*info).si_addr() as usize;
        // A signal sent by a process has a code of 0 or less, and no address.
        if let Some((page, line)) = PAGE.get()
            && (*info).si_code > 0
            && page.contains(&at)
        {
            libc::write(STDERR_FILENO, line.as_ptr().cast(), line.len());
        }
        libc::raise(signal);
    }
}
