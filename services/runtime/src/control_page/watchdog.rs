//! Wakes a process whose wait has lasted beyond its limit.

use std::sync::Arc;
use std::time::Duration;

use crate::control_page::doorbell::ATTENTION;
use crate::control_page::page::ControlPage;

/// A thread that wakes its own process out of a long sleep, so that it looks at its stop flag and its clock.
pub(crate) struct Watchdog;

impl Watchdog {
    /// The longest sleep lasts between one and two of these.
    const PERIOD: Duration = Duration::from_millis(50);
    const STACK: usize = 64 * 1024;

    /// Starts the thread; it ends with the control_page.
    pub(crate) fn start(control_page: &Arc<ControlPage>, index: usize) -> std::io::Result<()> {
        let control_page = Arc::downgrade(control_page);
        let watch = move || {
            let mut seen = 0;
            while let Some(control_page) = control_page.upgrade() {
                let doorbell = control_page.process(index).doorbell();
                let sleeps = doorbell.sleeps();
                // The same sleep as the last time, whoever has rung for other topics meanwhile.
                if sleeps == seen {
                    doorbell.ring(ATTENTION);
                }
                seen = sleeps;
                drop(control_page);
                std::thread::sleep(Self::PERIOD);
            }
        };
        std::thread::Builder::new()
            .name("watchdog".into())
            .stack_size(Self::STACK)
            .spawn(watch)
            .map(drop)
    }
}
