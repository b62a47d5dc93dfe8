//! A scenario under many settings: a grid or a seeded sample, computed on one thread per core, into Parquet.
//!
//! A run is what `armplane run SCENARIO --set …` runs, as [`chain`] computes it: the same bytes on every topic. Its number alone gives its
//! settings, so that any part of a sweep can be computed anywhere. A results folder holds `sweep.json`, the sweep's identity, and a Parquet file for
//! each part of [`Manifest::part_runs`](folder::Manifest) runs that is complete. Such a file is written whole, has the checksum of its bytes in its
//! name, and is the same whoever computes it: to go on is to compute the parts that are not there, to merge is to copy files into one folder.

mod columns;
mod folder;
mod outcomes;
mod picture;
mod report;
mod space;
mod spec;
mod sweep;
mod units;
mod work;

pub use folder::Shard;
pub use outcomes::Outcomes;
pub use report::{Report, ReportRequest, report};
pub use work::{Done, Request, merge, run};
