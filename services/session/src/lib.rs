//! A run as a library: loads scenario, robot and graph, plans and launches the run, summarises it,
//! keeps its results, finds them again and exports them.
//!
//! [`run`] is one run in that order. Nothing starts before everything is validated. This crate
//! prints nothing: events of a run go to an [`Observer`], and [`run_text`] turns a summary into
//! text.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod fault_kinds;
pub mod graph_text;
pub mod load;
pub mod observation;
pub mod schema;
pub mod table;

mod arm_faults;
mod catalogue;
mod drawing;
mod export;
mod failure;
mod injection;
mod launch;
mod layout;
mod machine;
mod mujoco;
mod observation_text;
mod opponent;
mod origin;
mod plan;
mod progress;
mod python;
mod recover;
mod report;
mod results;
mod robot;
mod ros2;
mod runs;
mod seal;
mod session;
mod steer;
mod summary;
mod text;
mod units;
mod viewer;

pub use arm_faults::lacks_limit;
pub use catalogue::Catalogue;
pub use drawing::{Shown, shown};
pub use export::{Export, ExportFormat, export};
pub use failure::Failure;
pub use injection::inject;
pub use launch::{Begin, GUARD, ROBOT, interrupts, launch, launch_watched};
pub use launcher::Interrupts;
pub use layout::save_blueprint;
pub use machine::machine;
pub use observation_text::observation_lines;
pub use opponent::{Controller, opposed};
pub use origin::Place;
pub use plan::plan;
pub use progress::{Observer, Progress};
pub use python::Python;
pub use recover::{go_on, recover, remains};
pub use report::{Page, report};
pub use results::{GIVEN_TARGETS, LINES, REPORT, RUNS, Results, SUMMARY, holds_run};
pub use robot::{mode_of, simulated};
pub use runs::Run;
pub use session::{Finished, Request, run, run_loaded, whole};
pub use shared_types::job::JOB;
pub use steer::{Steering, Targets};
pub use summary::{deadlines, summarise};
pub use text::{run_text, verdict};
pub use viewer::{WATCH, show, viewer_command, watch};
