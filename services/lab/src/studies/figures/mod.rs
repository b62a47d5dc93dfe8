//! The figures of Chang & Khatib (1995).

mod draw;
mod trace;

pub use draw::{Figure, Saved, figures};
