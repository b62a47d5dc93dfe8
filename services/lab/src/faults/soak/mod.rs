//! The soak: real-time runs of the whole graph, one after the other, with every fault and signals from outside at random.

mod draw;
mod inject;
mod judge;
mod launcher_events;
mod picture;
mod read_back;
mod round;
mod rounds;
mod tally;
mod text;

pub use judge::Messages;
pub use picture::picture;
pub use round::Round;
pub use rounds::{Soak, Usage, soak};
pub use tally::{Kind, Totals};
