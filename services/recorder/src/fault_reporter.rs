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

    /// Reports what has happened since the last time.
    pub(crate) fn report(&mut self, shell: &Shell, graph: &Graph, tape: &mut Tape) {
        for (place, account) in shell.fault_table().records() {
            if self.reported.len() <= place {
                self.reported.resize(place + 1, 0);
            }
            let reported = &mut self.reported[place];
            let FaultRecord {
                scheduled,
                origin,
                injected_ns,
                detected_ns,
                recovered_ns,
                exit,
            } = account;
            let states = [
                (injected_ns, INJECTED),
                (detected_ns, DETECTED),
                (recovered_ns, RECOVERED),
            ];
            let is_told = injected_ns == 0 || *reported & OVER != 0;
            if is_told
                && states
                    .iter()
                    .all(|(ns, state)| *ns == 0 || *reported & state != 0)
            {
                continue;
            }
            let process = shell
                .manifest()
                .processes
                .get(scheduled.process as usize)
                .map_or("?", |process| process.name.as_str());
            let Some(fault) = graph
                .target(process)
                .and_then(|target| scheduled.fault(process, &target))
            else {
                continue;
            };
            let since_ms = |ns: u64| ns.saturating_sub(injected_ns) as f64 * 1e-6;
            // A process that is gone has recovered when it sends again; a fault of messages, sensors or drives ends with its ticks.
            let is_over = if fault.kind.takes_down() {
                recovered_ns != 0
            } else {
                tape.next_tick() >= scheduled.until
            };
            if injected_ns != 0 && *reported & INJECTED == 0 {
                *reported |= INJECTED;
                let sentence = exit.map_or_else(
                    || fault.to_string(),
                    |exit| format!("the {process} ended with {exit}"),
                );
                tape.event(
                    scheduled.at,
                    Level::Error,
                    &format!("fault ({}): {sentence}", origin.name()),
                );
                let (lane, headline) = words(&fault, exit);
                tape.fault_begins(scheduled.at, place, &lane, &headline);
            }
            if detected_ns != 0 && *reported & DETECTED == 0 {
                *reported |= DETECTED;
                let kind = if exit.is_some() {
                    "end"
                } else {
                    fault.kind.name()
                };
                let sentence = format!(
                    "{kind} of the {process} detected after {:.2} ms",
                    since_ms(detected_ns)
                );
                tape.event(scheduled.at, Level::Warning, &sentence);
            }
            if is_over && *reported & INJECTED != 0 && *reported & OVER == 0 {
                *reported |= OVER;
                let until = if scheduled.until == u64::MAX {
                    tape.next_tick()
                } else {
                    scheduled.until
                };
                tape.fault_ends(until.max(scheduled.at + 1), place);
            }
            if recovered_ns != 0 && *reported & RECOVERED == 0 {
                *reported |= RECOVERED;
                tape.event(
                    scheduled.until,
                    Level::Info,
                    &format!("{process} is back, {:.0} ms later", since_ms(recovered_ns)),
                );
            }
        }
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
