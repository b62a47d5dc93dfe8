//! Reports faults to the recording: when each was injected, detected, recovered.

use runtime::{FaultRecord, Shell};
use shared_types::event::{Event, Level, Source};
use shared_types::fault::Fault;
use shared_types::graph::Graph;

use crate::Record;

const INJECTED: u32 = 1;
const DETECTED: u32 = 2;
const RECOVERED: u32 = 4;

/// The reported states of each entry of the fault table.
#[derive(Debug, Default)]
pub(crate) struct FaultReporter {
    reported: Vec<u32>,
}

impl FaultReporter {
    /// Reports all events since the last report.
    pub(crate) fn report(&mut self, shell: &Shell, graph: &Graph, record: &mut Record) {
        for (place, fault_record) in shell.fault_table().records() {
            if self.reported.len() <= place {
                self.reported.resize(place + 1, 0);
            }
            let reported = &mut self.reported[place];
            let is_told = |ns: u64, state: u32| ns == 0 || *reported & state != 0;
            if is_told(fault_record.injected_ns, INJECTED)
                && is_told(fault_record.detected_ns, DETECTED)
                && is_told(fault_record.recovered_ns, RECOVERED)
            {
                continue;
            }
            let scheduled = &fault_record.scheduled;
            let process = shell.manifest().processes.get(scheduled.process as usize);
            let process = process.map_or("?", |process| process.name.as_str());
            let target = graph.target(process);
            if let Some(fault) = target.and_then(|target| scheduled.fault(process, &target)) {
                tell(reported, &fault_record, &fault, record);
            }
        }
    }
}

/// Reports new facts about a fault.
fn tell(reported: &mut u32, course: &FaultRecord, fault: &Fault, record: &mut Record) {
    let FaultRecord {
        scheduled,
        origin,
        injected_ns,
        detected_ns,
        recovered_ns,
        exit,
    } = course;
    let mut event = |tick, level, text| {
        let event = Event {
            tick,
            level,
            source: Source::Faults,
            text,
        };
        record.write(|record| record.event(&event));
    };
    let process = &fault.process;
    let mut is_new = |is_so: bool, state: u32| {
        let is_new = is_so && *reported & state == 0;
        *reported |= if is_so { state } else { 0 };
        is_new
    };
    let since_ms = |ns: u64| ns.saturating_sub(*injected_ns) as f64 * 1e-6;
    if is_new(*injected_ns != 0, INJECTED) {
        let sentence = exit.map_or_else(
            || fault.to_string(),
            |exit| format!("the {process} ended with {exit}"),
        );
        let text = format!("fault ({}): {sentence}", origin.name());
        event(scheduled.at, Level::Error, text);
    }
    if is_new(*detected_ns != 0, DETECTED) {
        let kind = exit.map_or(fault.kind.name(), |_| "end");
        let after_ms = since_ms(*detected_ns);
        let text = format!("{kind} of the {process} detected after {after_ms:.2} ms");
        event(scheduled.at, Level::Warning, text);
    }
    if is_new(*recovered_ns != 0, RECOVERED) {
        let text = format!("{process} is back, {:.0} ms later", since_ms(*recovered_ns));
        event(scheduled.until, Level::Info, text);
    }
}
