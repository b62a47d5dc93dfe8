//! Message logs: the messages of a run on disk, their fingerprints, and the differences between two series of messages.
//!
//! It knows message layouts and files; it knows no process, no clock and no transport.

mod block;
mod difference;
mod hash;
mod log;
mod rows;

pub use block::BLOCK;
pub use difference::{Difference, Differences, FieldDifference, first_difference, first_difference_in};
pub use hash::TopicHash;
pub use log::{LogReader, LogWriter};
pub use rows::{LogError, RowReader, RowWriter, Shape, seal};
