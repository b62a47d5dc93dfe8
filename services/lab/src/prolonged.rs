//! A scenario of any length.

use shared_types::scenario::{Scenario, Segment, Turn};

/// The default scenario's motion, there and back again until the time is over.
pub(crate) fn prolonged(scenario: &Scenario, rate_hz: u32, seconds: u64) -> Scenario {
    let mut scenario = Scenario {
        rate_hz,
        ..scenario.clone()
    };
    let back = |segment: &Segment| {
        let turn = segment.turn.clone().map(|turn| Turn {
            by_deg: -turn.by_deg,
            ..turn
        });
        Segment {
            turn,
            ..segment.clone()
        }
    };
    let Some(last) = scenario.segment.last().cloned() else {
        return scenario;
    };
    while scenario.duration_s() < seconds as f64 {
        let next = scenario
            .segment
            .last()
            .map(back)
            .unwrap_or_else(|| last.clone());
        scenario.segment.push(next);
    }
    scenario
}
