//! Studies on one thread: laws side by side, an arm at one posture, and the paper's figures.

pub mod compare;
pub mod figures;
pub mod posture;

pub(crate) mod lines;
pub(crate) mod singular_lines;
