//! Following of targets in a steered run: seconds per reason, and refused targets.

use std::collections::BTreeMap;

use shared_types::ServoState;
use shared_types::codes::{Named, REFUSALS, TARGET_REFUSALS, name_of, reason_text};
use shared_types::summary::ServoSummary;

/// Counts ticks by reason, and events by the controller's own counters.
#[derive(Debug, Default)]
pub(super) struct SteeredMeter {
    /// By `ServoState`'s `[reason, joint, upper]`.
    ticks: BTreeMap<[u32; 3], u64>,
    refused: Events,
    stops: Events,
}

/// Events by their codes.
#[derive(Debug, Default)]
struct Events {
    so_far: u32,
    by_code: BTreeMap<u32, u64>,
}

impl Events {
    /// Takes in how many there have been; the new ones have this code, because the controller takes in one target at a tick.
    fn take(&mut self, so_far: u32, code: u32) {
        let more = so_far.saturating_sub(self.so_far);
        self.so_far = so_far;
        if more > 0 {
            *self.by_code.entry(code).or_default() += u64::from(more);
        }
    }

    fn named(self, names: &[Named]) -> BTreeMap<String, u64> {
        let counts = self.by_code.into_iter();
        let named = |(code, count)| (name_of(names, code).to_owned(), count);
        counts.map(named).collect()
    }
}

impl SteeredMeter {
    pub(super) fn tick(&mut self, state: &ServoState) {
        let reason = [state.reason, state.joint, state.upper];
        *self.ticks.entry(reason).or_default() += 1;
        self.refused.take(state.refused, state.refusal);
        self.stops.take(state.stops, state.stop);
    }

    /// The summary at so many ticks per second; `None` of a run that was not steered.
    pub(super) fn finish(self, rate_hz: f64) -> Option<ServoSummary> {
        let seconds = self.ticks.iter().map(|(&[reason, joint, upper], ticks)| {
            let text = reason_text(reason, joint, upper).to_string();
            (text, *ticks as f64 / rate_hz)
        });
        (!self.ticks.is_empty()).then(|| ServoSummary {
            seconds: seconds.collect(),
            refused: self.refused.named(TARGET_REFUSALS),
            stops: self.stops.named(REFUSALS),
            after_end: 0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::codes::{
        REASON_LIMIT, REASON_RESTING, TARGET_REFUSAL_FRAME, TARGET_REFUSAL_NUMBER,
    };

    #[test]
    fn reasons_are_counted_in_seconds_and_refusals_by_their_own() {
        let mut meter = SteeredMeter::default();
        assert_eq!(SteeredMeter::default().finish(1000.0), None);
        for tick in 0..500_u32 {
            let (reason, joint) = if tick < 200 {
                (REASON_LIMIT, 4)
            } else {
                (REASON_RESTING, 0)
            };
            let refused = u32::from(tick >= 100) + u32::from(tick >= 300);
            let refusal = [0, TARGET_REFUSAL_NUMBER, TARGET_REFUSAL_FRAME][refused as usize];
            meter.tick(&ServoState {
                reason,
                joint,
                refused,
                refusal,
                ..ServoState::default()
            });
        }
        let summary = meter.finish(1000.0).unwrap();
        assert_eq!(
            summary.seconds[&reason_text(REASON_LIMIT, 4, 0).to_string()],
            0.2
        );
        assert_eq!(
            summary.refused.values().copied().collect::<Vec<_>>(),
            [1, 1]
        );
        assert!(
            summary
                .refused
                .contains_key(name_of(TARGET_REFUSALS, TARGET_REFUSAL_FRAME))
                && summary.stops.is_empty()
        );
    }
}
