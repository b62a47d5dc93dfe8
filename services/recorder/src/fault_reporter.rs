//! Reports faults to the recording: when each was injected, detected, recovered.

use runtime::{FaultRecord, Shell};
use shared_types::event::{Event, Level, Source};
use shared_types::fault::Fault;
use shared_types::graph::Graph;

use crate::Record;

/// Whether each entry of the fault table has been reported as injected, as detected, and as recovered.
#[derive(Debug, Default)]
pub(crate) struct FaultReporter {
    reported: Vec<[bool; 3]>,
}

impl FaultReporter {
    /// Reports all events since the last report.
    pub(crate) fn report(&mut self, shell: &Shell, graph: &Graph, record: &mut Record) {
        for (place, course) in shell.fault_table().records() {
            if self.reported.len() <= place {
                self.reported.resize(place + 1, [false; 3]);
            }
            let times = [course.injected_ns, course.detected_ns, course.recovered_ns];
            let happened = times.map(|ns| ns != 0);
            let told = std::mem::replace(&mut self.reported[place], happened);
            if told == happened {
                continue;
            }
            let scheduled = &course.scheduled;
            let process = shell.manifest().processes.get(scheduled.process as usize);
            let process = process.map_or("?", |process| process.name.as_str());
            let target = graph.target(process);
            let Some(fault) = target.and_then(|target| scheduled.fault(process, &target)) else {
                continue;
            };
            let events = events(&course, &fault).into_iter().zip(happened).zip(told);
            for ((event, happened), told) in events {
                if happened && !told {
                    record.write(|record| record.event(&event));
                }
            }
        }
    }
}

/// The injection of a fault, its detection and the recovery from it.
fn events(course: &FaultRecord, fault: &Fault) -> [Event; 3] {
    let FaultRecord {
        scheduled,
        origin,
        injected_ns,
        detected_ns,
        recovered_ns,
        exit,
    } = course;
    let process = &fault.process;
    let [detected_ms, recovered_ms] =
        [detected_ns, recovered_ns].map(|ns| ns.saturating_sub(*injected_ns) as f64 * 1e-6);
    let sentence = exit.map_or_else(
        || fault.to_string(),
        |exit| format!("the {process} ended with {exit}"),
    );
    let kind = exit.map_or(fault.kind.name(), |_| "end");
    let injected = format!("fault ({}): {sentence}", origin.name());
    let detected = format!("{kind} of the {process} detected after {detected_ms:.2} ms");
    let recovered = format!("{process} is back, {recovered_ms:.0} ms later");
    let event = |tick, level, text| Event {
        tick,
        level,
        source: Source::Faults,
        text,
    };
    [
        event(scheduled.at, Level::Error, injected),
        event(scheduled.at, Level::Warning, detected),
        event(scheduled.until, Level::Info, recovered),
    ]
}
