//! Properties that hold for any input: the same functions are fuzzed in `tests/fuzz` and tried with random inputs here.
#![allow(
    dead_code,
    unused_imports,
    reason = "each fuzz target uses one of them"
)]

mod chain_of_steps;
mod files;
mod input;
mod messages;
mod run_folder;

pub use chain_of_steps::{controller, fingers};
pub use files::{graph, job, results, scenario, target_file, urdf};
pub use messages::validation;
pub use run_folder::{MANIFEST, contents, control_page, manifest, record};
