//! The lockstep protocol simulated in one thread under one seed, with the launcher's part in it: deaths, their places in the plan, replacements.

mod history;
pub(crate) mod machine;

#[cfg(test)]
mod exploration;

pub use history::{Outcome, history};
pub use machine::Defect;
