//! Studies on one thread: laws side by side, an arm at one posture, and steered runs.

pub mod compare;
pub mod posture;
pub mod steered;

pub use first::{Shape, begin};

pub(crate) mod singular_lines;

mod first;
mod posture_text;
