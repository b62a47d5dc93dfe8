//! The figures of Chang & Khatib (1995).

mod draw;
mod figure;
mod locks;
mod trace;

pub use draw::{Saved, figures};
pub use figure::Figure;
