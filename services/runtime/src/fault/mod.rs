//! Faults of a run.

pub(crate) mod table;
