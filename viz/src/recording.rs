//! A recording in the making.

mod columns;
mod ending;
mod file;
mod lanes;
mod marks;
mod merge;
mod parts;
mod picture;
mod pieces;
mod rival;
mod state;
mod steered;
mod write;

pub use file::save_blueprint;
pub(crate) use merge::is_complete;
pub use merge::{MergeError, complete, merge};
pub use parts::{bytes_in, checksums, cut_behind, part_name, parts_in};
pub(crate) use pieces::Room;
pub use state::{Level, Options, Recording, RunInfo, Written};

#[cfg(test)]
mod tests;
