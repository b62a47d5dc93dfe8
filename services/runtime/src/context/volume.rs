//! Faults of the volume that a polled process writes to.

use std::time::Duration;

use shared_types::fault::Kind;

use super::Context;
use crate::clock::now_ns;
use crate::fault::process::forbid_writes;

impl Context {
    /// Applies the faults of the volume that a polled process writes to: full, by the kernel's own limit on the size of files; or slow.
    pub(crate) fn apply_volume_faults(&self, tick: u64, is_last: bool) {
        let (mut is_full, mut pause_ms) = (false, 0.0);
        for (place, fault, kind) in self.faults.known.borrow().of(self.me, tick) {
            match kind {
                Kind::DiskFull => is_full = true,
                Kind::SlowDisk => pause_ms += fault.amount,
                _ => continue,
            }
            self.control_page
                .fault_table()
                .mark_injected(place, now_ns());
        }
        // The rest is written to another volume.
        self.fill_volume(is_full && !is_last);
        if pause_ms > 0.0 && !is_last {
            std::thread::sleep(Duration::from_secs_f64(pause_ms * 1e-3));
        }
    }

    /// Takes the room from the volume, or gives it back; returns whether there was none.
    pub(crate) fn fill_volume(&self, is_full: bool) -> bool {
        let was_full = self.faults.is_volume_full.replace(is_full);
        if was_full != is_full {
            forbid_writes(is_full);
        }
        was_full
    }
}
