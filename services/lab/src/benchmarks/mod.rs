//! The cost of a hop, a cycle, a period and a step, beside baseline transports of the machine.

mod distribution;
mod hop;
pub mod hour;
mod in_turns;
mod machine;
mod picture;
pub mod realtime;
mod record;
mod ring;
mod steps;
mod text;
mod transports;

pub use distribution::{Distribution, Row};
pub use hop::{Only, cycle, hop, paced};
pub use in_turns::{Lockstep, lockstep};
pub use machine::{machine, machine_line};
pub use picture::pictures;
pub use record::{Recorded, record};
pub use ring::peer;
pub use steps::{control, model, plant};
pub use text::Rows;
