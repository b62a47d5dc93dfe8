//! Faults that take a process down: its deaths, and the ticks for which it is absent.

use shared_types::fault::ScheduledFault;

/// Deaths of a process up to a tick, and the tick at which it takes part again: `tick` itself unless it is absent. `downs` are the faults that take it
/// down, at whatever tick.
pub fn absence<'a>(downs: impl Iterator<Item = &'a ScheduledFault>, tick: u64) -> (u32, u64) {
    let begun = downs.filter(|fault| fault.at <= tick);
    begun.fold((0, tick), |(deaths, returns), fault| {
        let deaths = deaths + u32::from(fault.ends_process());
        (deaths, returns.max(fault.until))
    })
}
