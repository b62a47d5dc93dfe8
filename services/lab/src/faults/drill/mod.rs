//! Every fault on every process of a real graph, judged by the physics.

mod cell;
mod matrix;
mod picture;
mod plan;

pub use cell::Cell;
pub use matrix::{Drilled, Request, drill};
