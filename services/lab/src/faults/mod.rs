//! Faults in a real graph, judged by what the arm does.

pub mod drill;
mod motion;
pub mod soak;
