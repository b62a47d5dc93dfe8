//! The one clock: `CLOCK_MONOTONIC` in nanoseconds, the same in every process of the machine.

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::Timespec;

const NS_PER_S: u64 = 1_000_000_000;

/// Nanoseconds of `CLOCK_MONOTONIC`.
#[inline]
pub fn now_ns() -> u64 {
    read(libc::CLOCK_MONOTONIC)
}

/// Nanoseconds of a clock that every kernel has.
#[inline]
pub(crate) fn read(clock: libc::clockid_t) -> u64 {
    // By libc, so that a process of a run can be measured under valgrind: rustix looks for the kernel's own functions in memory that valgrind does not map.
    let mut now = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: a plain call that fills the structure; it leaves zeros where it fails.
    unsafe { libc::clock_gettime(clock, &raw mut now) };
    now.tv_sec as u64 * NS_PER_S + now.tv_nsec as u64
}

/// A duration or an instant in nanoseconds, as the kernel wants it.
pub(crate) fn timespec(ns: u64) -> Timespec {
    Timespec {
        tv_sec: (ns / NS_PER_S) as i64,
        tv_nsec: (ns % NS_PER_S) as i64,
    }
}

/// Sleeps until an instant of [`now_ns`]; returns early when a signal arrives.
pub(crate) fn sleep_until(ns: u64) {
    // An error here is an interruption by a signal: the caller looks at its stop flag and the clock.
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &timespec(ns));
}
