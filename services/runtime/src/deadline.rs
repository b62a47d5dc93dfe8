//! The causes of missed deadlines.

use crate::control_page::Count;
use crate::realtime::Usage;

/// Ticks between two looks at what the kernel counts: asking each tick would be a system call each tick.
pub(crate) const USAGE_EVERY: u64 = 64;

/// Why a deadline was missed, as far as the kernel can tell of the last few ticks: what is rarer and costs more is named first.
pub(crate) fn cause(before: Usage, after: Usage, a_peer_restarted: bool) -> Count {
    if after.major_faults > before.major_faults {
        Count::MissedMajorFault
    } else if a_peer_restarted {
        Count::MissedPeerRestart
    } else if after.preemptions > before.preemptions {
        Count::MissedPreempted
    } else {
        Count::MissedOverrun
    }
}
