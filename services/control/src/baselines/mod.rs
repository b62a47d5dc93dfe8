//! The laws of others, each as published, with the same model, limits, path and governor.

pub mod hold_and_blend;
pub mod resolved_rate;
