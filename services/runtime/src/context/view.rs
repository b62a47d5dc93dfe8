//! The lockstep protocol's view of a process's run.

use lockstep::{Outage, Progress, Role, View};

use super::Context;
use crate::control_page::{PROGRESS, State};
use crate::fault::table::Origin;
use crate::manifest::Process;

impl View for Context {
    fn processes(&self) -> usize {
        self.manifest.processes.len()
    }

    fn role(&self, process: usize) -> Role {
        let Process {
            makes_ticks,
            polled,
            ..
        } = self.manifest.processes[process];
        Role {
            makes_ticks,
            polled,
        }
    }

    fn progress(&self, process: usize) -> Progress {
        let entry = self.control_page.process(process);
        Progress {
            ticks: entry.ticks(),
            incarnation: entry.incarnation(),
            is_running: entry.state() == State::Running,
            awaits_progress: entry.doorbell().is_armed_for(PROGRESS),
        }
    }

    fn has_faults(&self) -> bool {
        !self.is_unharmed()
    }

    fn outages(&self) -> impl Iterator<Item = Outage> {
        let outage = |index: usize| {
            let (place, fault) = *self.faults.known.borrow().faults().get(index)?;
            let record = self.control_page.fault_table().record(place)?;
            Outage::of(
                &fault,
                place,
                record.injected_ns != 0,
                record.origin == Origin::Detected,
            )
        };
        let count = self.faults.known.borrow().faults().len();
        (0..count).filter_map(outage)
    }

    fn is_lockstep(&self) -> bool {
        Context::is_lockstep(self)
    }

    fn recorder_lag(&self) -> u64 {
        self.recorder_lag
    }
}
