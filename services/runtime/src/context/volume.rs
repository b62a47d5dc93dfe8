//! Faults of the volume that a polled process writes to.

use shared_types::fault::Kind;

use super::Context;
use crate::fault::process::forbid_writes;

impl Context {
    /// Applies the faults of the volume that a polled process writes to: full, by the kernel's own limit on the size of files.
    pub(crate) fn apply_volume_faults(&self, tick: u64, is_last: bool) {
        let mut is_full = false;
        for (place, _, kind) in self.faults.known.borrow().of(self.me, tick) {
            if kind == Kind::DiskFull {
                is_full = true;
                self.mark_injected(place);
            }
        }
        // The rest is written to another volume.
        let is_full = is_full && !is_last;
        if self.faults.is_volume_full.replace(is_full) != is_full {
            forbid_writes(is_full);
        }
    }
}
