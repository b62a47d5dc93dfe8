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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rarest_cause_is_named() {
        let before = Usage {
            major_faults: 1,
            preemptions: 5,
        };
        let fault = Usage {
            major_faults: 2,
            preemptions: 6,
        };
        let preempted = Usage {
            major_faults: 1,
            preemptions: 6,
        };
        assert_eq!(cause(before, fault, true), Count::MissedMajorFault);
        assert_eq!(cause(before, preempted, true), Count::MissedPeerRestart);
        assert_eq!(cause(before, preempted, false), Count::MissedPreempted);
        assert_eq!(cause(before, before, false), Count::MissedOverrun);
    }
}
