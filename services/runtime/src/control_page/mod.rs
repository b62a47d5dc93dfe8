//! The control page of a run: everything that its processes must know without a message.

pub(crate) mod doorbell;
pub(crate) mod entry;
pub(crate) mod latest;
pub(crate) mod live_statistics;
pub(crate) mod page;
pub(crate) mod watchdog;

pub(crate) use doorbell::{ANYTHING, PROGRESS};
pub use entry::{Count, Counts, ProcessEntry, State};
pub use page::{ControlPage, ControlPageError, Phase, Stop};
pub(crate) use watchdog::{Patience, Watchdog};
