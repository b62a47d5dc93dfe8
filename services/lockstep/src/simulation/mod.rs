//! The lockstep protocol simulated in one thread under one seed, with the launcher's part in it (deaths, their places in the plan, replacements) and the
//! recorder's: rounds, message logs, checkpoints, a volume that fills.

mod defect;
mod history;
pub(crate) mod machine;
mod recorder;

#[cfg(test)]
mod exploration;

pub use defect::Defect;
pub use history::{Outcome, history};
