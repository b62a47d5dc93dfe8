//! From the ticks of a run to what people look at: the only code that knows Rerun.
//!
//! * [`write_rrd`] draws a run into an `.rrd`, [`show_live`] into a viewer while it lasts.
//! * What is recorded: [`Signal`] names the numbers (1 kHz); the picture (50 Hz) is the arm, its target and path, the singular frame with
//!   the lost direction ζ, the ellipsoids that go flat along it, ghosts of null-space motion; modes, states and words come as they change.
//! * How it is shown: a blueprint in the file, one layout per purpose, also as `.rbl` ([`save_blueprint`]).
//! * The same ticks as tables of other formats: [`export`]; as one HTML page: [`report`].
//!
//! `picture` is the function from a tick to what is seen of it, `signals` that to its numbers; `recording` and `report` write both.

#![allow(non_snake_case)]

mod blueprint;
mod body;
mod digits;
mod entity;
mod export;
mod eye;
mod facts;
mod manipulability;
mod meshes;
mod narration;
mod picture;
mod pose;
mod recording;
mod report;
mod run;
mod scene;
mod signals;
mod sink;
mod solids;
mod story;
mod strokes;
mod tint;

pub use digits::digits;
pub use export::{ExportError, ExportFormat, export, signals};
pub use recording::{save_blueprint, show_live, write_rrd};
pub use report::report;
pub use run::{Happened, Progress, Rival, Source, Tick};
pub use signals::Signal;
pub use sink::RecordError;
pub use solids::solids;

/// The name of a run's recording in its folder.
pub const RECORDING: &str = "run.rrd";
