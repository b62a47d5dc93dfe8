//! The message log of a run, `messages.mcap`: its messages on disk, their fingerprints, and the differences between two series of messages.
//!
//! The file is MCAP (<https://mcap.dev/spec>) of profile `ros2`: Foxglove, PlotJuggler, `mcap-ros2-support` and `rosbags` open it. A message is CDR, which
//! its bytes are as they stand: naturally aligned, without padding, little endian. A record of our own, the [seal](block), a chunk of messages and its
//! indices are a block. The seal has a checksum of the block, the run, and how many messages of each topic came before: no message is
//! taken for another, and a block that is damaged, missing, repeated, displaced or foreign is found.
//!
//! The `mcap` crate's writer cannot go on with a file whose writer was killed, and leaves no summary where the volume is full; so the records are written
//! here, and the crate reads them in the tests.
//!
//! This crate knows message layouts and files; it knows no process, no clock and no transport.

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
