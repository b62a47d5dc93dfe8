//! Faults of a run: the table that all processes share, and the effect of each kind.

pub(crate) mod exit;
pub(crate) mod process;
pub(crate) mod table;
