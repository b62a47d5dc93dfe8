//! Faults of a run: the table that all processes share, and what each kind does.

pub(crate) mod burden;
pub(crate) mod clock;
pub(crate) mod exit;
pub(crate) mod process;
pub(crate) mod table;
