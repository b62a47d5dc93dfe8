//! The plan of the whole path, and the demands ahead on what it does not plan (+).

pub mod foresight;
pub mod path_plan;
