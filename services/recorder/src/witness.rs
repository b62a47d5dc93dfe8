//! Tells the recording of faults: when each struck, when something noticed, when all was well again.

use runtime::{FaultRecord, Shell};
use viz::Level;

use crate::tape::Tape;

const STRUCK: u32 = 1;
const NOTICED: u32 = 2;
const RESTORED: u32 = 4;

/// What has been told of each entry of the fault table.
#[derive(Debug, Default)]
pub(crate) struct Witness {
    told: Vec<u32>,
}

impl Witness {
    pub(crate) fn resume(told: Vec<u32>) -> Self {
        Self { told }
    }

    pub(crate) fn told(&self) -> Vec<u32> {
        self.told.clone()
    }

    /// Tells what has happened since the last time.
    pub(crate) fn tell(&mut self, shell: &Shell, tape: &mut Tape) {
        for (place, account) in shell.fault_table().records() {
            if self.told.len() <= place {
                self.told.resize(place + 1, 0);
            }
            let told = &mut self.told[place];
            let FaultRecord { scheduled: strike, origin, injected_ns, detected_ns, recovered_ns } = account;
            let process = shell.manifest().processes.get(strike.process as usize).map_or("?", |process| process.name.as_str());
            let Some(fault) = strike.fault(process) else { continue };
            let since_ms = |ns: u64| ns.saturating_sub(injected_ns) as f64 * 1e-6;
            if injected_ns != 0 && *told & STRUCK == 0 {
                *told |= STRUCK;
                tape.event(strike.at, Level::Error, &format!("fault ({}): {fault}", origin.name()));
            }
            if detected_ns != 0 && *told & NOTICED == 0 {
                *told |= NOTICED;
                tape.event(
                    strike.at,
                    Level::Warning,
                    &format!("{} of the {process} noticed after {:.2} ms", fault.kind, since_ms(detected_ns)),
                );
            }
            if recovered_ns != 0 && *told & RESTORED == 0 {
                *told |= RESTORED;
                tape.event(strike.until, Level::Info, &format!("the {process} works again, {:.0} ms later", since_ms(recovered_ns)));
            }
        }
    }
}
