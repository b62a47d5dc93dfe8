//! Faults of a clock: it jumps, or runs at another rate.

use shared_types::fault::{Kind, ScheduledFault, Way};

use crate::fault::table::FaultTable;

/// Lead of a process's clock over the machine's at the machine's instant `now`, ns; negative if it
/// lags. `faults` are those that concern the process at its tick.
pub(crate) fn error_ns<'a>(
    faults: impl Iterator<Item = (usize, &'a ScheduledFault, Kind)>,
    table: &FaultTable,
    now: u64,
) -> i64 {
    const NS_PER_MS: f64 = 1e6;
    let error = |(place, fault, _): (usize, &ScheduledFault, Kind)| {
        table.mark_injected(place, now);
        let since = table
            .record(place)
            .map_or(0, |record| now.saturating_sub(record.injected_ns));
        if fault.way() == Some(Way::Skew) {
            fault.amount * since as f64
        } else {
            fault.amount * NS_PER_MS
        }
    };
    faults
        .filter(|(_, _, kind)| *kind == Kind::Clock)
        .map(error)
        .sum::<f64>() as i64
}
