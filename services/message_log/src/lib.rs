//! Message logs: the messages of a run on disk, their fingerprints, and the differences between two series of messages.
//!
//! It knows message layouts and files; it knows no process, no clock and no transport.

mod block;
mod difference;
mod error;
mod hash;
mod head;
mod log;
mod logs;
mod reader;
mod rows;
mod scan;
mod shape;

pub use block::BLOCK;
pub use difference::{
    Difference, Differences, FieldDifference, first_difference, first_difference_in,
};
pub use error::{Defect, LogError};
pub use hash::TopicHash;
pub use head::seal;
pub use log::{LogReader, LogWriter};
pub use logs::Logs;
pub use reader::RowReader;
pub use rows::RowWriter;
pub use shape::{Place, Shape, tick_of};
