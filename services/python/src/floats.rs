//! How a thread's processor treats numbers. A library that Python loads may have told it to take small ones for zero, and then a run would have other bits.

/// The mode of a thread: rounding, exceptions, and small numbers, as the register MXCSR has them. On other processors nothing is known, and nothing changed.
#[derive(Clone, Copy)]
pub(crate) struct Mode(u32);

/// Puts the mode from before back.
struct Until(Mode);

impl Drop for Until {
    fn drop(&mut self) {
        self.0.set();
    }
}

impl Mode {
    /// Rounds to nearest, no exceptions, small numbers as they are.
    pub(crate) const STANDARD: Self = Self(0x1F80);

    /// That of this thread.
    pub(crate) fn of_thread() -> Self {
        let mut mode = Self::STANDARD;
        #[cfg(target_arch = "x86_64")]
        // SAFETY: it writes four bytes.
        unsafe {
            std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut mode.0, options(nostack));
        }
        mode
    }

    fn set(self) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the mode is the standard one, or was this thread's.
        unsafe {
            std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const self.0, options(nostack, readonly));
        }
    }

    /// The result of work that is done in this mode on this thread.
    pub(crate) fn during<T>(self, work: impl FnOnce() -> T) -> T {
        let _until = Until(Self::of_thread());
        self.set();
        work()
    }
}
