//! Whether the program does what it has done: byte by byte under other conditions and with processes killed ([`verify`]), and from recorded inputs
//! ([`replay`]); and how two of its runs differ ([`diff`]).

mod compared;
mod condition;
mod diff;
mod difference;
mod replay;
mod verify;

pub use compared::{Place, Ran};
pub use diff::{Change, Differing, diff};
pub use difference::{Difference, FieldDifference};
pub use replay::{Replayed, replay};
pub use verify::{Request, Verified, verify};
