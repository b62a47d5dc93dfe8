//! The message log of a run, `messages.mcap`: messages on disk, their fingerprints, and differences
//! between two logs.
//!
//! The file is MCAP (<https://mcap.dev/spec>) of profile `ros2`: Foxglove, PlotJuggler,
//! `mcap-ros2-support` and `rosbags` open it. A message's bytes are valid CDR as they are:
//! naturally aligned, without padding, little endian. A block consists of an own record, the
//! [seal](block), a chunk of messages and its indices. The seal has a checksum of the block, the
//! run, and the number of earlier messages of each topic. So no message is mistaken for another,
//! and damaged, missing, repeated, displaced or foreign blocks are found.
//!
//! The `mcap` crate's writer cannot continue a file whose writer was killed, and leaves no summary
//! on a full volume. So this crate writes the records itself; in the tests, `mcap` reads them.
//!
//! This crate knows message layouts and files, but no process, clock or transport.

mod block;
mod contents;
mod difference;
mod error;
mod hash;
mod reader;
mod record;
#[cfg(test)]
mod tests;
mod writer;

pub use block::seal;
pub use contents::{Contents, tick_of};
pub use difference::{
    Difference, Differences, FieldDifference, first_difference, first_difference_in,
};
pub use error::{Defect, LogError};
pub use hash::TopicHash;
pub use reader::{Flaw, Log, Messages, Rows};
pub use writer::{Place, Writer, complete};

/// Name of the file in the results folder.
pub const FILE: &str = "messages.mcap";

/// Messages of a topic that may wait for the end of a block: a killed writer takes them with it. Its replacement finds them in the retainer
/// of the topic, which holds far more.
pub const BLOCK: usize = 128;
