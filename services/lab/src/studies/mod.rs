//! Studies on one thread: laws side by side, and the paper's figures.

pub mod compare;
pub mod figures;
pub(crate) mod lines;
