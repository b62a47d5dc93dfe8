//! From the messages of a run to a Rerun recording one wants to look at: the only code that knows Rerun.
//!
//! * [`Recording`] takes one complete tick at a time and writes an `.rrd` that ends cleanly: on a full disk, and when its process is killed.
//! * What is recorded: [`Signal`] names the numbers (1 kHz); the picture (50 Hz) is the arm, its target and path, the singular frame with
//!   the lost direction ζ, the ellipsoids that go flat along it, ghosts of null-space motion; modes, states and words come as they change.
//! * How it is shown: a blueprint in the file, one layout per purpose, also as `.rbl` ([`Recording::save_blueprint`]).
//!
//! * How it is read back without a viewer: [`read`]; as tables of other formats: [`export`]; as one HTML page: [`report`], with the pictures
//!   of [`plot`].
//!
//! The cost (`recorder.cpu_s` in `summary.json`) grows with the number of chunks, each of which carries its schema, hence one wide table of numbers
//! and a signal per component rather than per entity.
//!
//! docs/recording.md reads a recording back in Python.
//!
//! `manipulability`, `signals`, `scene`, `arm`, `solid` and `narration` map messages to data; `sink`, `blueprint` and `recording` write them.

#![allow(non_snake_case)]

mod arm;
mod blueprint;
mod entity;
mod export;
mod frames;
mod manipulability;
mod meshes;
mod narration;
mod parts;
pub mod plot;
mod read;
mod recording;
mod report;
mod scene;
mod shortfall;
mod signals;
mod sink;
mod solid;
mod tint;

pub use entity::Lives;
pub use export::{ExportError, ExportFormat, Exported, Messages, export, parquet_properties};
pub use parts::{
    MergeError, bytes_in, checksums, complete, cut_behind, is_part, merge, part_name, parts_in,
};
pub use read::{About, Damage, Piece, ReadError, ReadNews, Rows, read};
pub use recording::{Level, Options, Recording, RunInfo, Written, save_blueprint};
pub use report::{Report, ReportError, report};
pub use shortfall::{Reading, Shortfall, altered, has_rows, rows_in};
pub use signals::{ChainHops, Signal, TickRow, chain_hops, hop_names};
pub use sink::{RecordError, Storage};
pub use tint::singularity_ink;
