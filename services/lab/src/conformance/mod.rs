//! Whether the program does what it has done: byte by byte under other conditions, and from recorded inputs.

mod condition;
mod inputs;
pub mod kills;
mod outputs;
pub mod replay;
mod stops;
mod text;
pub mod verify;

pub use outputs::Topic;
pub use text::{ReplayedText, VerifiedText};
