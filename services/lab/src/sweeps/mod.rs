//! A scenario under many settings: a grid or a seeded sample, computed on one thread per core, into Parquet.
//!
//! A run is what `armplane run SCENARIO --set …` runs, as [`chain`] computes it: the same bytes on every topic. Its number alone gives its
//! settings, so that any part of a sweep can be computed anywhere. A results folder holds `sweep.json`,
//! `runs/part-NNNNN.parquet` for each complete partition, and, while the sweep goes on, a journal of each partition begun. The files of a
//! partition have the same bytes whoever computes it.

mod cell;
mod journal;
mod manifest;
mod merge;
mod outcomes;
mod picture;
mod read_back;
mod report;
mod row;
mod space;
mod spec;
mod table;
mod text;
mod work;

pub use manifest::Shard;
pub use merge::{Merged, merge};
pub use outcomes::Outcomes;
pub use report::{Report, ReportRequest, Spread, Worst, report};
pub use work::{Done, Request, run};
