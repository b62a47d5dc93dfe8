//! A process's doorbell and node, for a transport that brings its own ports.

use std::fmt::Display;
use std::rc::Rc;

use iceoryx2::node::Node;
use iceoryx2::service::ipc;

use crate::context::Context;
use crate::shell::Shell;
use crate::wait::{Interrupted, Wait, Waited};

/// The doorbell's bit: above those of topics, below those of the control page.
const BIT: u32 = 1 << 29;

/// The wake-up that topics use, without a topic.
pub struct DoorbellPort {
    shared: Rc<Context>,
}

impl DoorbellPort {
    /// The doorbell of the process that a shell belongs to.
    pub fn of(shell: &Shell) -> Self {
        Self {
            shared: Rc::clone(&shell.shared),
        }
    }

    /// The process's iceoryx2 node; its services are in the run's directory.
    pub fn node(&self) -> &Node<ipc::Service> {
        &self.shared.bus
    }

    /// Wakes the process at this place of the manifest if it waits.
    pub fn ring(&self, process: usize) {
        self.shared
            .control_page
            .process(process)
            .doorbell()
            .ring(BIT);
    }

    /// Sleeps until `look` finds something; it is called again each time this process's doorbell has been rung. `None` when the run stops.
    ///
    /// # Errors
    /// [`Interrupted`] when nothing is found within the run's limit, or `look` fails.
    pub fn wait<T, E: Display>(
        &self,
        mut look: impl FnMut() -> Result<Option<T>, E>,
    ) -> Result<Option<T>, Interrupted> {
        let describe = || Wait {
            what: "a sample".to_owned(),
            from: "its writer".to_owned(),
        };
        let look = || look().map_err(|error| self.shared.port_failed("doorbell", error));
        match self.shared.wait(BIT, None, describe, look)? {
            Waited::Ready(found) => Ok(Some(found)),
            Waited::Late | Waited::Stopped => Ok(None),
        }
    }

    /// Whether the run is to stop.
    pub fn is_stopping(&self) -> bool {
        self.shared.is_stopping()
    }
}
