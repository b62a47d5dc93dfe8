//! Reports faults to the recording: when each was injected, detected, recovered.

use runtime::{FaultRecord, Shell};
use shared_types::graph::Graph;
use viz::Level;

use crate::tape::Tape;

const INJECTED: u32 = 1;
const DETECTED: u32 = 2;
const RECOVERED: u32 = 4;

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
            let FaultRecord { scheduled, origin, injected_ns, detected_ns, recovered_ns } = account;
            let states = [(injected_ns, INJECTED), (detected_ns, DETECTED), (recovered_ns, RECOVERED)];
            if states.iter().all(|(ns, state)| *ns == 0 || *reported & state != 0) {
                continue;
            }
            let process = shell.manifest().processes.get(scheduled.process as usize).map_or("?", |process| process.name.as_str());
            let fields = graph.target(process).map(|target| target.fields).unwrap_or_default();
            let Some(fault) = scheduled.fault(process, &fields) else { continue };
            let since_ms = |ns: u64| ns.saturating_sub(injected_ns) as f64 * 1e-6;
            if injected_ns != 0 && *reported & INJECTED == 0 {
                *reported |= INJECTED;
                tape.event(scheduled.at, Level::Error, &format!("fault ({}): {fault}", origin.name()));
            }
            if detected_ns != 0 && *reported & DETECTED == 0 {
                *reported |= DETECTED;
                tape.event(
                    scheduled.at,
                    Level::Warning,
                    &format!("{} of the {process} noticed after {:.2} ms", fault.kind, since_ms(detected_ns)),
                );
            }
            if recovered_ns != 0 && *reported & RECOVERED == 0 {
                *reported |= RECOVERED;
                tape.event(scheduled.until, Level::Info, &format!("the {process} works again, {:.0} ms later", since_ms(recovered_ns)));
            }
        }
    }
}
