//! Following of targets in a steered run: seconds per reason, and refused targets.

use std::collections::BTreeMap;

use shared_types::ServoState;
use shared_types::codes::{REFUSALS, TARGET_REFUSALS, name_of, reason_text};
use shared_types::summary::ServoSummary;

/// Counts ticks by reason, and events by the controller's own counters.
#[derive(Debug, Default)]
pub(super) struct SteeredMeter {
    /// By `ServoState`'s `[reason, joint, upper]`.
    ticks: Vec<([u32; 3], u64)>,
    refused: u32,
    by_refusal: Vec<(u32, u64)>,
    stops: u32,
    by_stop: Vec<(u32, u64)>,
}

impl SteeredMeter {
    pub(super) fn tick(&mut self, state: &ServoState) {
        count(&mut self.ticks, [state.reason, state.joint, state.upper], 1);
        // The controller takes in one target at a tick.
        count(
            &mut self.by_refusal,
            state.refusal,
            state.refused.saturating_sub(self.refused),
        );
        count(
            &mut self.by_stop,
            state.stop,
            state.stops.saturating_sub(self.stops),
        );
        (self.refused, self.stops) = (state.refused, state.stops);
    }

    /// The summary at so many ticks per second; `None` of a run that was not steered.
    pub(super) fn finish(self, rate_hz: f64) -> Option<ServoSummary> {
        let named = |counts: Vec<(u32, u64)>, names| {
            counts
                .into_iter()
                .map(|(code, count)| (name_of(names, code).to_owned(), count))
                .collect()
        };
        let seconds = |&([reason, joint, upper], ticks): &([u32; 3], u64)| {
            (
                reason_text(reason, joint, upper).to_string(),
                ticks as f64 / rate_hz,
            )
        };
        (!self.ticks.is_empty()).then(|| ServoSummary {
            seconds: self.ticks.iter().map(seconds).collect::<BTreeMap<_, _>>(),
            refused: named(self.by_refusal, TARGET_REFUSALS),
            stops: named(self.by_stop, REFUSALS),
            after_end: 0,
        })
    }
}

fn count<K: PartialEq>(counts: &mut Vec<(K, u64)>, key: K, more: u32) {
    if more == 0 {
        return;
    }
    match counts.iter_mut().find(|(known, _)| *known == key) {
        Some((_, count)) => *count += u64::from(more),
        None => counts.push((key, u64::from(more))),
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
