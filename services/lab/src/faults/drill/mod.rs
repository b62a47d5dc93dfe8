//! Every fault on every process of a real graph, judged by the physics.

mod cell;
mod fall;
mod limits;
mod matrix;
mod misled;
mod picture;
mod plan;
mod text;
mod without;

pub use cell::Cell;
pub use matrix::{Drilled, Request, drill};
pub use without::Without;
