//! Additions to the paper (+): continuity where the paper switches, and limits where it has none.
//!
//! Each addition reduces to the paper's law inside D_si and to plain operational-space control outside; `proofs` tests it.

pub mod auxiliary;
pub(crate) mod avoidance;
pub mod blended;
pub mod foresight;
pub mod governor;
pub mod guide;
pub mod path_plan;
pub mod saturation;
pub mod speed_limit;
pub mod torque_rate;
pub mod turn_plan;
