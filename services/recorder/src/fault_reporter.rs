//! Reports faults to the recording: when each was injected, detected, recovered.

use runtime::{Exit, FaultRecord, Shell};
use shared_types::fault::{Fault, Kind};
use shared_types::graph::Graph;
use viz::Level;

use crate::tape::Tape;

const INJECTED: u32 = 1;
const DETECTED: u32 = 2;
const RECOVERED: u32 = 4;
const OVER: u32 = 8;

/// The reported states of each entry of the fault table.
#[derive(Debug, Default)]
pub(crate) struct FaultReporter {
    reported: Vec<u32>,
}

impl FaultReporter {
    pub(crate) fn resume(reported: Vec<u32>) -> Self {
        Self { reported }
    }

    pub(crate) fn reported(&self) -> Vec<u32> {
        self.reported.clone()
    }

    /// Reports all events since the last report.
    pub(crate) fn report(&mut self, shell: &Shell, graph: &Graph, tape: &mut Tape) {
        for (place, record) in shell.fault_table().records() {
            if self.reported.len() <= place {
                self.reported.resize(place + 1, 0);
            }
            let reported = &mut self.reported[place];
            let is_told = |ns: u64, state: u32| ns == 0 || *reported & state != 0;
            if is_told(record.injected_ns, OVER)
                && is_told(record.detected_ns, DETECTED)
                && is_told(record.recovered_ns, RECOVERED)
            {
                continue;
            }
            let scheduled = &record.scheduled;
            let process = shell.manifest().processes.get(scheduled.process as usize);
            let process = process.map_or("?", |process| process.name.as_str());
            let target = graph.target(process);
            if let Some(fault) = target.and_then(|target| scheduled.fault(process, &target)) {
                tell(reported, place, &record, &fault, tape);
            }
        }
    }
}

/// Reports new facts about a fault.
fn tell(reported: &mut u32, place: usize, record: &FaultRecord, fault: &Fault, tape: &mut Tape) {
    let FaultRecord {
        scheduled,
        origin,
        injected_ns,
        detected_ns,
        recovered_ns,
        exit,
    } = record;
    let process = &fault.process;
    let mut is_new = |is_so: bool, state: u32| {
        let is_new = is_so && *reported & state == 0;
        *reported |= if is_so { state } else { 0 };
        is_new
    };
    let since_ms = |ns: u64| ns.saturating_sub(*injected_ns) as f64 * 1e-6;
    // A process that is gone has recovered when it sends again; a fault of messages, sensors or drives ends with its ticks.
    let is_over = if fault.kind.takes_down() {
        *recovered_ns != 0
    } else {
        tape.next_tick() >= scheduled.until
    };
    if is_new(*injected_ns != 0, INJECTED) {
        let sentence = exit.map_or_else(
            || fault.to_string(),
            |exit| format!("the {process} ended with {exit}"),
        );
        let text = format!("fault ({}): {sentence}", origin.name());
        tape.event(scheduled.at, Level::Error, &text);
        let (lane, headline) = words(fault, *exit);
        tape.fault_begins(scheduled.at, place, &lane, &headline);
    }
    if is_new(*detected_ns != 0, DETECTED) {
        let kind = exit.map_or(fault.kind.name(), |_| "end");
        let after_ms = since_ms(*detected_ns);
        let text = format!("{kind} of the {process} detected after {after_ms:.2} ms");
        tape.event(scheduled.at, Level::Warning, &text);
    }
    if is_new(is_over && *injected_ns != 0, OVER) {
        let until = match scheduled.until {
            u64::MAX => tape.next_tick(),
            until => until,
        };
        tape.fault_ends(until.max(scheduled.at + 1), place);
    }
    if is_new(*recovered_ns != 0, RECOVERED) {
        let text = format!("{process} is back, {:.0} ms later", since_ms(*recovered_ns));
        tape.event(scheduled.until, Level::Info, &text);
    }
}

/// A fault for the lane of faults, `controller kill`, and for the headline, `Controller killed`.
fn words(fault: &Fault, exit: Option<Exit>) -> (String, String) {
    let way = fault.way.map_or(String::new(), |way| format!(" {way}"));
    let joint = fault
        .joint
        .map_or(String::new(), |joint| format!(" of joint {joint}"));
    let mut process = fault.process.clone();
    if let Some(first) = process.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    if let Some(exit @ Exit::Code(_)) = exit {
        return (
            format!("{} exit", fault.process),
            format!("{process} ended with {exit}"),
        );
    }
    let lane = format!("{} {}{way}", fault.process, fault.kind);
    let headline = match fault.kind {
        Kind::Kill => format!("{process} killed"),
        Kind::Crash => format!("{process} crashed"),
        Kind::Hang => format!("{process} hangs"),
        Kind::Sensor => format!("Sensor{way}{joint}"),
        Kind::Drive => format!("Drive{way}{joint}"),
        kind => format!("{process}: {kind}{way}"),
    };
    (lane, headline)
}
