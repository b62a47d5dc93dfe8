//! Faults that cost a process time: a load on its core, slower steps, evicted pages.

use std::time::Duration;

use shared_types::fault::{Kind, ScheduledFault};

use super::process::{CpuLoad, give_up_pages};

/// Applies the faults in force on a process that cost it time and change nothing else: `load` runs on its core while one of them says so, and each
/// that takes effect is named by its place in the fault table.
pub(crate) fn burden<'a>(
    faults: impl Iterator<Item = (usize, &'a ScheduledFault, Kind)>,
    load: &mut Option<CpuLoad>,
    core: Option<usize>,
    mut injected: impl FnMut(usize),
) {
    let (mut starving, mut pause_ms) = (None, 0.0);
    for (place, fault, kind) in faults {
        match kind {
            Kind::Starve => starving = starving.or(Some(place)),
            Kind::Slow => pause_ms += fault.amount,
            Kind::PageOut => give_up_pages(),
            _ => continue,
        }
        injected(place);
    }
    match (starving, load.as_ref().map(|load| load.place)) {
        (Some(place), was) if was != Some(place) => *load = Some(CpuLoad::start(place, core)),
        (None, Some(_)) => *load = None,
        _ => {}
    }
    if pause_ms > 0.0 {
        std::thread::sleep(Duration::from_secs_f64(pause_ms * 1e-3));
    }
}
